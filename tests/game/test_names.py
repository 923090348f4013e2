"""The numbers of observations and actions have the names that the rules give them."""

import re
from pathlib import Path

import pytest

from fpg_bench.game.names import CHOSEN, OBSERVED
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE

RULES = Path(__file__).parents[2] / "docs/reference/rules.md"


def documented(heading, side):
    """The name of each number in a table of the rules."""
    section = RULES.read_text().split(f" {heading}\n")[1].split("\n## ")[0]
    table = re.split(r"\*\*(Ally|Opponent)\*\*", section)
    rows = re.findall(r"(?m)^\| (\d+)(?:-(\d+))? \| ([\w ]+) \|", table[table.index(side.title()) + 1])
    return [name for first, last, name in rows for _ in range(int(first), int(last or first) + 1)]


@pytest.mark.parametrize("side", ["ally", "opponent"])
@pytest.mark.parametrize(
    ("heading", "named", "size"),
    [("8. Observations", OBSERVED, OBSERVATION_SIZE), ("7. Actions", CHOSEN, ACTION_SIZE)],
    ids=["seen", "chosen"],
)
def test_names_are_those_of_the_rules(heading, named, size, side):
    found = documented(heading, side)
    assert len(found) == len(named[side]) == size
    for name, rule in zip(named[side], found, strict=True):
        assert name.startswith(rule.removesuffix("s"))
