"""Train every agent of the zoo that is missing, ship and score it, and write the zoo's page.

python scripts/train_zoo.py [--only ally-scripted/ppo] [--jobs 2]    trains; stopped, it goes on next time
python scripts/train_zoo.py --list      how far each agent is
python scripts/train_zoo.py --check     plays every shipped agent again and compares with its lines
python scripts/train_zoo.py --tables    scores what has no lines yet; baselines/README.md and its pictures
"""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from fpg_bench.errors import UserError
from fpg_bench.zoo.scores import add_missing_lines, check_member
from fpg_bench.zoo.table import write_page
from fpg_bench.zoo.training import state, train_zoo
from fpg_bench.zoo.zoo import Zoo, load_zoo


def show(zoo: Zoo, runs: Path, only: str | None) -> bool:
    """Print how far each agent is."""
    for member in zoo.members(only):
        print(f"{member.name:36} {member.steps:12,}  {state(member, runs)}")
    return True


def check(zoo: Zoo, only: str | None) -> bool:
    """Play the shipped agents again; whether all lines are as before."""
    same = True
    for member in zoo.members(only):
        if member.shipped:
            found = check_member(zoo, member)
            print(f"{member.name}: {'; '.join(found) or 'as before'}", flush=True)
            same = same and not found
    return same


def write_tables(zoo: Zoo) -> bool:
    """Score what has no lines yet, and write the page."""
    for view in zoo.views:
        add_missing_lines(zoo, view, lambda name: print(f"scoring {name}", flush=True))
    write_page(zoo)
    print(f"written: {zoo.folder / 'README.md'}")
    return True


def main() -> int:
    """Do what the options say; 0 where all went well."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", help="a view, view/algorithm, or view/algorithm/seed_k")
    parser.add_argument("--jobs", type=int, default=2, help="trainings at once, one thread each")
    parser.add_argument("--runs", type=Path, default=Path("runs/zoo"), help="the runs' folders")
    parser.add_argument("--zoo", type=Path, help="a folder with a zoo.yml; default: baselines/")
    for name in ("list", "check", "tables"):
        parser.add_argument(f"--{name}", action="store_true")
    options = parser.parse_args()
    zoo = load_zoo(options.zoo)
    if options.list:
        return not show(zoo, options.runs, options.only)
    if options.check:
        return not check(zoo, options.only)
    failed = []
    if not options.tables:
        failed = train_zoo(
            zoo, options.runs, only=options.only, jobs=options.jobs, say=lambda line: print(line, flush=True)
        )
    return not write_tables(zoo) or bool(failed)


if __name__ == "__main__":
    # Also where a shell in the background has Ctrl-C ignored; a plain kill stops the trainings as well.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"train_zoo: {error}")
    except KeyboardInterrupt:
        sys.exit("train_zoo: stopped; what was finished is kept, and the rest goes on next time")
