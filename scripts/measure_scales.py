"""Measure the two constants of each public field's scale, and compare them with those that stand in its file.

python scripts/measure_scales.py [FIELD ...]

zero: the random player's (or planner's) mean return a step over the field. top: for allies in a game whose
SNR is capped the unjammed link, cap - M a step; otherwise the mean over counterparts of the best that is
known: the oracle and all scripts for players, the planner ``optimised`` for planners. On the field's own
evaluation seeds.
"""

from __future__ import annotations

import argparse
import sys

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import PLANNER, Field, load_field
from fpg_bench.evaluation.play import play
from fpg_bench.players.agent import fields_folder
from fpg_bench.players.scripted import SCRIPTED

DIGITS = 2
BORROWING = ("-shifted-v1", "-responses-v1")  # have the scale of their track's public field


def rewards(who: str, field: Field) -> list[float]:
    """The mean return a step of a player or planner against each counterpart."""
    lines = [play(player_entry(who), field, counterpart) for counterpart in field.counterparts]
    return [float(field.rewards(line.returns).mean()) for line in lines]


def scale(field: Field) -> tuple[float, float]:
    """Zero and top of a field."""
    zero = mean(rewards("random", field))
    cap = field.scenario.snr_cap_db
    if field.side == "ally" and cap is not None:
        return zero, cap - field.scenario.snr_threshold_db
    bounds = ("optimised",) if field.side == PLANNER else ("oracle", *SCRIPTED[field.side])
    each = [rewards(who, field) for who in bounds]
    return zero, mean([max(against) for against in zip(*each, strict=True)])


def mean(values: list[float]) -> float:
    """The mean of some numbers."""
    return sum(values) / len(values)


def main() -> int:
    """Print a line per field; 1 where a file says something else."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("fields", nargs="*", help="names or files; default: all public ones")
    named = parser.parse_args().fields
    public = (path.stem for path in fields_folder().glob("*-v1.yml"))
    names = named or sorted(name for name in public if not name.endswith(BORROWING))
    same = True
    for name in names:
        field = load_field(name)
        zero, top = (round(value, DIGITS) for value in scale(field))
        kept = (field.scale.zero, field.scale.top) == (zero, top)
        same = same and kept
        print(f"{name}: scale: {{zero: {zero}, top: {top}}}{'' if kept else f'  (the file: {field.scale})'}")
    return 0 if same else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"measure_scales: {error}")
