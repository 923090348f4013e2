"""Tables and portfolios: what they find, resumption, and the exported agent."""

import json
import logging
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import other_side
from fpg_bench.common.rows import RowFile
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.scenario import as_scenario, preset
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import OnnxPlayer, load_agent
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from fpg_bench.products.league import best_responses as mixing
from fpg_bench.products.league import categorical, targets
from fpg_bench.products.league.best_responses import best_responses
from fpg_bench.products.league.candidates import Candidates
from fpg_bench.products.league.config import BestResponseConfig
from fpg_bench.products.league.tabular import FEATURES, count_cells, table_choices, table_onnx, table_search
from fpg_bench.products.league.targets import training_seeds
from fpg_bench.products.league.verbs import best_response
from fpg_bench.version import versions
from tests.training.tiny import settings

FEW = {"known_age_s": [1, 3]}
EDGES = {
    "distance_m": [35, 90],
    "snr_db": [10],
    "spreading_s": [1, 3],
    "sensed_type": [1, 2, 3, 4],
    "covered": [1],
    "since_hit_s": [2, 4],
    "hits": [2],
    "known_age_s": [1, 3],
    "next_check_s": [2, 3],
    "last_check": [0, 1],
    "own_type": [2, 3],
    "since_check_s": [1, 3],
    "same_point": [1, 2],
}


@pytest.fixture
def local(monkeypatch):
    """The local search begins early, and plays few rounds."""
    for name, value in (("CROSS_ENTROPY", 3), ("MUTANTS", 8), ("FINAL_ROUNDS", 16)):
        monkeypatch.setattr(categorical, name, value)
    monkeypatch.setattr(mixing, "FINAL_MATCHES", 20)


ROWS = "tabular.jsonl"
IDLE = GameSpec.of("FPG/OpponentVsPolicy-v0", against="idle", reward="zero_sum")


def kept_rows(folder):
    return [{k: v for k, v in row.items() if k != "seconds"} for row in RowFile(folder / ROWS).read()]


def respond(agent, out, **options):
    return best_responses(BestResponseConfig(agent=agent, **options), out, progress=False)


@pytest.mark.parametrize("side", ["ally", "opponent"])
@pytest.mark.parametrize("name", ["standard", "link"])
def test_an_exported_table_plays_as_the_table_to_the_bit(side, name):
    scenario = as_scenario(preset(name), opponent_path="learned")
    features = {name: list(map(float, EDGES[name])) for name in FEATURES[side]}
    choices = len(table_choices(side, scenario).names)
    cells = np.random.default_rng(0).integers(0, choices, count_cells(features))
    exported = OnnxPlayer(table_onnx(side, features, scenario, cells.tolist()))
    batch = TwoPlayerBatch(scenario, 16, threads=1)
    rival = as_player("hunter" if side == "ally" else "clock", other_side(side), scenario)
    table = Candidates(table_onnx(side, features, scenario), cells[None])
    runners = [PolicyRunner(side, [player], batch.batch) for player in (table, exported)]
    runners.append(PolicyRunner(other_side(side), [rival], batch.batch))
    for _ in range(2):
        started = batch.reset(seeds=5)
        for runner in runners:
            runner.begin(started)
        for _ in range(120):
            mine, same, others = (runner.act() for runner in runners)
            np.testing.assert_array_equal(mine, same)
            batch.batch.step(*((mine, others) if side == "ally" else (others, mine)))


@pytest.mark.slow
def test_an_obvious_hole_is_found_in_a_second_and_exported_as_an_agent(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    table_search(IDLE, FEW, tmp_path / "out", budget=1)
    target = targets.find_target("idle", "ally", {})
    assert target.kept("idle", str(tmp_path / "out" / "agent"), 300)["high"] < -12  # random play leaves it 15
    generations = len(kept_rows(tmp_path / "out"))
    assert 1 <= sum(line.startswith("generation") for line in caplog.messages) <= 4 < generations
    card = load_agent(tmp_path / "out" / "agent", "opponent").card
    assert (card.algorithm, card.recipe["features"], len(card.recipe["cells"])) == ("tabular", FEW, 3)
    assert (card.command, card.to_dict()["versions"]) == (None, versions())


@pytest.mark.slow
def test_a_table_answers_an_opponent_and_plays_for_itself(tmp_path, local):
    result = respond("tone", tmp_path / "out", search="tabular", budget=0.5)
    card = load_agent(tmp_path / "out" / "tabular_0" / "agent").card
    assert (result["reward"], card.side, card.game.reward) == ("own", "ally", "own")


@pytest.mark.slow
def test_a_stopped_search_goes_on_with_the_same_bits(tmp_path, local):
    one, other = tmp_path / "one", tmp_path / "other"
    game = GameSpec.of(IDLE, ally="reactive")
    table_search(game, FEW, one, budget=0.2)
    begun = len(kept_rows(one))
    with (one / ROWS).open("a") as file:
        file.write('{"generation": 99, "sec')  # killed while it wrote
    table_search(game, FEW, one, budget=1.5)
    table_search(game, FEW, other, budget=1.5)
    rows, whole = kept_rows(one), kept_rows(other)
    assert len(rows) > begun
    assert [row["generation"] for row in rows] == list(range(len(rows)))
    common = min(len(rows), len(whole))
    assert rows[:common] == whole[:common]
    assert rows[-1]["method"] == "local search"
    content = (one / ROWS).read_text().splitlines(keepends=True)
    (one / ROWS).write_text("".join(content[1:]))
    with pytest.raises(UserError, match=r"tabular.jsonl: holds generation 1 of another search"):
        table_search(game, FEW, one, budget=1.5)


def test_a_response_to_one_training_seed_is_played_against_all():
    seeds = [f"ally-champion-3/ppo-stack8/seed_{k}" for k in range(5)]
    assert training_seeds(seeds[3], None) == training_seeds("ally-champion-3/ppo-stack8", None) == seeds
    assert training_seeds("expert", None) == ["expert"]


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ({"snr_db": [1]}, "features: the opponent does not observe 'snr_db'"),
        ({"distance_m": [2, 1]}, "features: distance_m: expected rising edges"),
        ({}, "features: expected 2 to 4096 cells, got 1; name some"),
    ],
)
def test_invalid_features_are_refused_and_leave_nothing(features, message, tmp_path):
    with pytest.raises(UserError, match=message):
        table_search(IDLE, features, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"search": "table"}, "search: expected one of tabular, portfolio, got 'table'"),
        ({"budget": float("nan")}, "budget: expected CPU seconds above 0, got nan"),
        ({"reward": "jamming"}, "reward: expected one of zero_sum, own, got 'jamming'"),
        ({"actions": "discrete"}, "actions: --search decides the actions of its responses; omit it"),
    ],
)
def test_invalid_options_of_a_search_are_refused(options, message):
    with pytest.raises(UserError, match=message):
        BestResponseConfig(**{"agent": "idle", "search": "tabular"} | options)


@pytest.mark.slow
def test_another_search_needs_another_folder(tmp_path, local):
    table_search(IDLE, FEW, tmp_path, budget=0.1)
    with pytest.raises(UserError, match="a tabular search with another features"):
        table_search(IDLE, {"known_age_s": [2]}, tmp_path, budget=0.1)
    with pytest.raises(UserError, match="other files, but no best responses"):
        respond("idle", tmp_path, side="ally", search="portfolio", budget=0.1)


@pytest.mark.full
@pytest.mark.slow
def test_a_portfolio_reports_the_lowest_of_all_methods_and_goes_on(tmp_path, local, monkeypatch, caplog):
    caplog.set_level(logging.INFO)
    small = {"MATCHES": 5, "STEPS": 400, "IMITATION_STEPS": 400, "N_SCRIPTS": 2, "TABLE_BUDGET": 0.3}
    for name, value in (small | {"ALGORITHM": "ppo", "RULE_BUDGET": 0.3}).items():
        monkeypatch.setattr(mixing, name, value)
    load = partial(mixing.load_hyperparameters, file=settings("ppo"))
    monkeypatch.setattr(mixing, "load_hyperparameters", load)
    first = respond("idle", tmp_path, side="ally", search="portfolio", budget=0.5)
    begun = RowFile(tmp_path / mixing.ROWS).read()
    result = respond("idle", tmp_path, side="ally", search="portfolio", budget=first["seconds"] + 12)
    rows = RowFile(tmp_path / mixing.ROWS).read()
    assert rows[: len(begun)] == begun
    assert {row["method"] for row in rows} == {"script", "rule", "tabular", "pupil", "ppo"}
    assert len({row["response"] for row in rows}) == len(rows)
    told = [line for line in caplog.messages if "spent" in line]  # a line for all scripts of a call
    assert len(told) == 2 + sum(row["method"] != "script" for row in rows)
    best = min(rows, key=lambda row: row["returns"]["idle"])
    found = result["returns"][result["lowest"]]
    assert (found["response"], found["method"]) == (best["response"], best["method"])
    assert found["low"] < found["return"] < found["high"]
    spent = [sum(row["seconds"] for row in rows[: k + 1]) for k in range(len(rows))]
    assert all(one < other for one, other in pairwise(spent))
    assert found["spent"] == round(spent[rows.index(best)], 1)
    pupil = next(k for k, row in enumerate(rows) if row["method"] == "pupil")
    before = min(rows[:pupil], key=lambda row: row["returns"]["idle"])
    run = json.loads((tmp_path / "pupil_0" / "run.json").read_text())
    assert run["hyperparameters"]["imitate"]["teacher"].endswith(before["response"])


def test_no_code_is_run_on_the_word_of_a_portfolio_s_rows(tmp_path, monkeypatch, local):
    monkeypatch.setattr(mixing, "MATCHES", 2)
    monkeypatch.setattr(mixing, "N_SCRIPTS", 0)
    respond("idle", tmp_path, side="ally", search="portfolio", budget=1e-3)
    file = tmp_path / mixing.ROWS
    (row,) = RowFile(file).read()
    file.write_text(json.dumps(row | {"response": "package.module:object"}) + "\n")
    with pytest.raises(UserError, match=r"would run package\.module:object"):
        respond("idle", tmp_path, side="ally", search="portfolio", budget=1)


def test_the_features_of_later_tables_are_drawn():
    for side in ("ally", "opponent"):
        drawn = [mixing.draw_features(side, number) for number in range(6)]
        assert drawn == [mixing.draw_features(side, number) for number in range(6)]
        assert len({json.dumps(each) for each in drawn}) > 3
        assert all(len(each) >= 2 and count_cells(each) <= mixing.MOST_DRAWN_CELLS for each in drawn[1:])


@pytest.mark.slow
def test_the_verb_says_what_each_training_seed_keeps(tmp_path, capsys, local, monkeypatch):
    monkeypatch.setattr(mixing, "MATCHES", 2)
    options = {"side": "ally", "search": "tabular", "budget": 0.2}
    best_response("idle", tmp_path / "out", options, {"knowledge": "none"})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("idle: -")
    assert lines[1].startswith("lowest: -")
    card = load_agent(tmp_path / "out" / "tabular_0" / "agent", "opponent").card
    assert card.game.knowledge == "none"
