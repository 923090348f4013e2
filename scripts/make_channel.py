"""Write the channel of free space as a grid: an example of the files that a scenario's ``channel`` names.

python scripts/make_channel.py [--scenario link] [--spacing 250 250 150] [--out examples/free-space.csv]
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path

from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text
from fpg_bench.game.channel import COLUMNS
from fpg_bench.game.scenario import Scenario, as_scenario


def rows(scenario: Scenario, spacing: list[float]) -> list[tuple[str, ...]]:
    """Return places and gains of free space in the middle of the band, over all of the box."""
    s = scenario
    counts = [math.ceil(size / step) for size, step in zip(s.box_m, spacing, strict=True)]
    axes = [[k * size / count for k in range(count + 1)] for size, count in zip(s.box_m, counts, strict=True)]
    found = []
    for place in itertools.product(*axes):
        metres = max(math.dist(place, s.base_station_m), s.minimum_distance_m)
        mhz = (s.band_low_mhz + s.band_high_mhz) / 2
        loss = s.path_loss_constant_db + 20 * math.log10(metres / 1000 * mhz)
        found.append((*(f"{x:g}" for x in place), f"{-loss:.2f}"))
    return found


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", default="link", help="a preset or a YAML file")
    parser.add_argument("--spacing", type=float, nargs=3, default=[250.0, 250.0, 150.0], metavar="M")
    parser.add_argument("--out", type=Path, default=Path("examples/free-space.csv"))
    options = parser.parse_args()
    write_whole(options.out, csv_text([COLUMNS, *rows(as_scenario(options.scenario), options.spacing)]))


if __name__ == "__main__":
    main()
