"""Imports of products: the public floor of the map, and what each still takes from elsewhere."""

from __future__ import annotations

import re

import pytest

from fpg_bench.common.products import products
from tests.programs import ROOT
from tests.test_layout import FILES, graph
from tests.test_products import owner

PAGE = (ROOT / "docs/project/map.md").read_text(encoding="utf-8").partition("## Public floor")[2]
PUBLIC_FLOOR = {
    f"fpg_bench.{room}.{name}"
    for room, names in re.findall(r"^\| `(\w+)` \| (`.*`) \|$", PAGE.partition("\n## ")[0], re.MULTILINE)
    for name in re.findall(r"\w+", names)
}
# Modules beside the floor that a product still imports: each that goes is struck out, none is added.
BESIDE = {
    "language_models": "training.run_folder",
    "leaderboard": "players.onnx_file training.rl_zoo3_format training.run_folder",
    "league": "training training.run_folder",
    "link_budget": "game.link game.propagation",
    "offline": "cli.training training.imitation",
    "planning": "game.elementary game.flight",
    "rendering": "envs.screen",
    "sandbox": "players.onnx_file",
    "sb3_zip": "training training.checkpoint training.rl_zoo3_format",
    "teams": "game.counting game.elementary game.flight game.hopping game.jamming game.link game.rewards",
    "theory": "game.elementary game.full_state game.hopping game.jamming game.rewards",
    "tuning": "training.rl_zoo3_format",
}


def imports_of(name: str) -> set[str]:
    """The modules of the core that a product imports."""
    of_product = (others for module, others in graph().items() if owner(module) == name)
    return {other for other in set().union(*of_product) if owner(other) is None}


def test_the_floor_is_there_and_no_wider_than_was_decided():
    assert FILES.keys() >= PUBLIC_FLOOR
    assert len(PUBLIC_FLOOR) <= 61


@pytest.mark.parametrize("name", products())
def test_a_product_imports_the_floor_and_what_is_listed(name):
    others = imports_of(name) - PUBLIC_FLOOR - {"fpg_bench.version"}
    beside = {module.removeprefix("fpg_bench.") for module in others}
    assert beside == set(BESIDE.get(name, "").split())
