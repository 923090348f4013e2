"""Keep the present season's scores before the next one replaces them: ``python scripts/keep_season.py``.

Writes ``leaderboard/results/seasons.jsonl``, from which the map of cross-play shows past seasons. Run it
before a season is closed, when all entries are verified and cross-play is complete.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.products.leaderboard.past_seasons import keep_seasons


def main() -> int:
    """Keep the present season of each scenario."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("leaderboard"), help="the leaderboard's folder")
    rows = keep_seasons(parser.parse_args().folder)
    for (season, track), count in Counter((row.season, row.track) for row in rows).items():
        print(f"season {season}, {track}: {count} entries")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"keep_season: {error}")
