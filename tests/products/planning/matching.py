"""Small hands for the tests of matches: a short one, and the rows of its file."""

from __future__ import annotations

import dataclasses
import json

from fpg_bench.game.scenario import STANDARD
from fpg_bench.products.planning.match import run_match

SHORT = dataclasses.replace(STANDARD, steps_per_round=32)
ROUNDS = 3


def lines(file):
    return [json.loads(line) for line in file.read_text().splitlines()]


def write(file, rows):
    file.write_text("".join(json.dumps(row) + "\n" for row in rows))


def play(file, planner="random", ally="expert", opponent="adaptive", **changes):
    return run_match(
        planner, ally, opponent, **{"scenario": SHORT, "rounds": ROUNDS, "out": file, "seed": 5, **changes}
    )
