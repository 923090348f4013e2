r"""Write gains on a grid, as a scenario's ``channel`` names them: those of free space, or measured ones.

python scripts/make_channel.py [--scenario link] [--spacing 250 250 150] [--out examples/free-space.csv]
python scripts/make_channel.py --spacing 75 75 75 --out examples/lake-wheeler.csv \
    --antenna 35.727451 -78.695974 10 \
    --samples shadow-fading-ang-corr/data_gen/processed_data/results_cole_*.mat

The samples of the second, https://github.com/MPACT-Lab/shadow-fading-ang-corr at 823cc72b, are a part of
AERPAW's Dataset 12, https://doi.org/10.5061/dryad.2z34tmpvv; docs/environments/scenario.md describes the fit.
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path

import numpy as np

from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text
from fpg_bench.game.channel import COLUMNS
from fpg_bench.game.scenario import Scenario, as_scenario

ELEVATIONS_DEG = np.array([4, 7, 10, 15, 20, 30, 45, 60, 75])  # linear between them, constant beyond
FEWEST_SAMPLES = 10  # of a cell that has a mean of its own
EARTH_M = 6_378_137.0


def rows(
    scenario: Scenario, spacing: list[float], samples: np.ndarray | None = None
) -> list[tuple[str, ...]]:
    """Return places and gains over all of the box: of free space in the middle of the band, or as measured.

    ``samples`` has rows of metres to the east, to the north and up from the antenna, and power in dB. Its
    level need not be known: at the ally's altitudes the mean gain is set to that of free space.
    """
    s = scenario
    counts = [math.ceil(size / step) for size, step in zip(s.box_m, spacing, strict=True)]
    axes = [[k * size / count for k in range(count + 1)] for size, count in zip(s.box_m, counts, strict=True)]
    places = np.array(list(itertools.product(*axes)))
    metres = np.maximum(np.linalg.norm(places - s.base_station_m, axis=1), s.minimum_distance_m)
    mhz = (s.band_low_mhz + s.band_high_mhz) / 2
    gains = -s.path_loss_constant_db - 20 * np.log10(metres / 1000 * mhz)
    if samples is not None:
        over = gain_over_free_space(places - s.base_station_m, [len(axis) for axis in axes], samples)
        low, high = s.ally_path_altitude_m
        gains += over - over[(low <= places[:, 2]) & (places[:, 2] <= high)].mean()
    return [(*(f"{x:g}" for x in place), f"{gain:.2f}") for place, gain in zip(places, gains, strict=True)]


def gain_over_free_space(places: np.ndarray, shape: list[int], samples: np.ndarray) -> np.ndarray:
    """Return gains over free space in dB, but for a constant, at the places of a grid around the antenna.

    A gain is the samples' by elevation, and where its cell has enough samples their mean distance from that.
    """
    sampled, power = samples[:, :3], samples[:, 3]
    over = power + 20 * np.log10(np.linalg.norm(sampled, axis=1))
    by_elevation = np.linalg.lstsq(_shares(sampled), over)[0]
    left = over - _shares(sampled) @ by_elevation
    size = np.ptp(places, axis=0) / (np.array(shape) - 1)
    indices = np.rint((sampled - places[0]) / size).astype(int)
    inside = np.all((indices >= 0) & (indices < shape), axis=1)
    cells = np.ravel_multi_index(tuple(indices[inside].T), tuple(shape))
    counts = np.bincount(cells, minlength=len(places))
    means = np.bincount(cells, left[inside], len(places)) / np.maximum(counts, 1)
    means[counts < FEWEST_SAMPLES] = 0
    print(
        f"{len(samples):,} samples; standard deviation {over.std():.2f} dB about free space, "
        f"{left.std():.2f} dB about the fit by elevation, "
        f"{(left[inside] - means[cells]).std():.2f} dB about the means of cells; "
        f"{(counts >= FEWEST_SAMPLES).sum()} of {len(places)} places have samples"
    )
    return _shares(places) @ by_elevation + means


def _shares(places: np.ndarray) -> np.ndarray:
    """Return the shares of ``ELEVATIONS_DEG`` in places around the antenna, ``(places, elevations)``."""
    elevations = np.degrees(np.arctan2(places[:, 2], np.hypot(places[:, 0], places[:, 1])))
    one_each = np.eye(len(ELEVATIONS_DEG))
    return np.stack([np.interp(elevations, ELEVATIONS_DEG, one) for one in one_each], axis=1)


def read_samples(paths: list[Path], antenna: list[float]) -> np.ndarray:
    """Return samples of MATLAB files for ``rows``; ``antenna`` is a latitude, a longitude and a height."""
    from scipy.io import loadmat  # not needed for free space

    names = ("lon_all", "lat_all", "h_all", "power_all")
    files = [loadmat(path, variable_names=names) for path in paths]
    east, north, up, power = (np.concatenate([file[name].ravel() for file in files]) for name in names)
    latitude, longitude, height = antenna
    per_degree = math.radians(EARTH_M)
    east = (east - longitude) * per_degree * math.cos(math.radians(latitude))
    return np.stack([east, (north - latitude) * per_degree, up - height, power], axis=1)


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", default="link", help="a preset or a YAML file")
    parser.add_argument("--spacing", type=float, nargs=3, default=[250.0, 250.0, 150.0], metavar="M")
    parser.add_argument("--samples", type=Path, nargs="+", help="MATLAB files of measured power, in dB")
    parser.add_argument("--antenna", type=float, nargs=3, metavar=("LAT", "LON", "M"), help="of the samples")
    parser.add_argument("--out", type=Path, default=Path("examples/free-space.csv"))
    options = parser.parse_args()
    if bool(options.samples) != bool(options.antenna):
        parser.error("--samples and --antenna go together")
    samples = read_samples(options.samples, options.antenna) if options.samples else None
    table = [COLUMNS, *rows(as_scenario(options.scenario), options.spacing, samples)]
    write_whole(options.out, csv_text(table))


if __name__ == "__main__":
    main()
