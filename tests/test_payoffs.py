"""The measured pay-offs of a scenario: their equilibrium, frozen levers, and the committed page."""

from __future__ import annotations

import csv
import dataclasses

import measure_payoffs
import numpy as np
from measure_payoffs import (
    Frozen,
    Lever,
    agents_of,
    answers_note,
    best_agents,
    champions_of,
    equilibrium_note,
    groups_of,
    lever_table,
    levers,
    measure,
)

from fpg_bench.common.ids import SCRIPTS
from fpg_bench.evaluation.store import Store
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import preset
from fpg_bench.players.registry import as_player
from fpg_bench.products.league.payoffs import Payoffs
from tests.programs import ROOT

LINK = preset("link")
SUITE = dataclasses.replace(
    load_suite("ally-link-v1"), matches=2, rivals=load_suite("ally-link-v1").rivals[:2]
)


def test_the_note_names_the_equilibrium_of_the_payoffs():
    rows = tuple(np.array([[row, row]]) for row in ([3.0, -1.0], [-2.0, 1.0]))
    note = equilibrium_note(Payoffs(("a", "b"), ("x", "y"), rows))
    assert note == "equilibrium worth 0.14 to the ally. Allies: a 0.43, b 0.57. Opponents: x 0.29, y 0.71."


def test_the_note_counts_whom_each_player_is_the_best_answer_to():
    rows = tuple(np.array([[row, row]]) for row in ([3.0, -1.0, 2.0], [-2.0, 1.0, 0.0]))
    note = answers_note(Payoffs(("a", "b"), ("x", "y", "z"), rows))
    assert note == "Best answers to the 3 opponents: a to 2, b to 1. a earns least from y: -1.00."


def test_the_committed_pay_offs_are_those_of_the_zoos_agents_and_its_best_have_the_levers():
    folder = ROOT / "docs/results"
    with (folder / "link-payoffs.csv").open() as file:
        (_, *opponents), *rows = csv.reader(file)
    page = (folder / "link.md").read_text()
    listed = {"ally": [row[0] for row in rows], "opponent": opponents}
    best = {side: best_agents(side, groups_of(side, "link")) for side in listed}
    for side, names in listed.items():
        firsts = [name for name in agents_of(side, groups_of(side, "link")) if name.endswith("/seed_0")]
        shipped = [*SCRIPTS[side], *firsts, *champions_of(side, "link")]
        assert [name for name in names if not name.startswith("response to ")] == shipped
    entry = best["ally"][0].rpartition("/")[0].replace("/", "-")
    assert f"=leaderboard/responses/ally/{entry}/" in page
    assert f"response to {best['ally'][0].partition('/')[0]}" in opponents
    agents = " and ".join(f"`{names[0].rpartition('/')[0]}`" for names in best.values())
    assert f"<!-- levers -->\n\nThe agents are {agents}." in page


def test_pay_offs_that_are_in_the_store_are_not_played_again(tmp_path, monkeypatch):
    allies, store = {"idle": "idle", "mine": "expert"}, Store(tmp_path / "records.jsonl")
    first = measure(LINK, allies, {"tone": "tone"}, 3, store)
    assert (first.players, first.rivals) == (("idle", "mine"), ("tone",))
    assert len(measure(LINK, allies, {"tone": "tone", "again": "random"}, 3, store).rivals) == 2
    assert len(store.records()) == 4
    monkeypatch.setattr("fpg_bench.evaluation.store.play", None)
    assert np.array_equal(measure(LINK, allies, {"tone": "tone"}, 3, store).values, first.values)


def test_a_frozen_player_does_as_it_did_but_for_the_lever():
    seen = np.random.default_rng(0).uniform(-1, 1, (6, 15)).astype(np.float32)
    free = as_player("expert", "ally", LINK).predict(seen)[0]
    frozen = Frozen(as_player("expert", "ally", LINK), {1: 1.0}).predict(seen)[0]
    assert (frozen[:, 1] == 1).all()
    assert np.array_equal(np.delete(frozen, 1, axis=1), np.delete(free, 1, axis=1))


def test_a_lever_that_a_player_does_not_use_costs_nothing(monkeypatch):
    both = [Lever("ally", "spreading", {"never": {1: -1.0}}), Lever("ally", "hopping", {"never": {0: -1.0}})]
    monkeypatch.setattr(measure_payoffs, "levers", lambda scenario: both)
    spreading, hopping = lever_table(LINK, {"ally": SUITE}, {"ally": ["expert"]})[-2:]
    assert spreading[-1] == "0.0%"
    assert hopping[-1] != "0.0%"


def test_every_lever_has_constants_and_a_side():
    assert {lever.side for lever in levers(LINK)} == {"ally", "opponent"}
    assert all(lever.constants for lever in levers(LINK))
