"""Double oracle: who is met, when a search stops, what is exported, and resumption."""

import dataclasses
import json

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.store import RECORDS, Store
from fpg_bench.players.agent import load_agent
from fpg_bench.products.league import double_oracle as oracle
from fpg_bench.products.league.config import DoubleOracleConfig
from fpg_bench.products.league.folder import check_same
from fpg_bench.training.run_folder import RunFolder
from tests.training.tiny import settings

TINY = settings("ppo", normalize={"norm_obs": False})
SEARCH = {
    "steps": 400,
    "algorithm": "ppo",
    "response_algorithm": "ppo",
    "against": ["tone*2", "hunter"],
    "weight": 3,
    "actions": "uniform-hop",
    "hyperparams": TINY,
    "response_hyperparams": TINY,
}


def find(out, **changes):
    """The result of a double oracle."""
    return oracle.double_oracle(DoubleOracleConfig(**SEARCH | changes), out, progress=False)


@pytest.fixture(autouse=True)
def few_matches(monkeypatch):
    """Few matches in each evaluation."""
    monkeypatch.setattr(oracle, "MATCHES", 3)


@pytest.mark.full
def test_iterations_meet_the_responses_by_their_weights_and_the_best_is_exported(tmp_path, monkeypatch):
    first = find(tmp_path, iterations=1)
    assert list(first["confirmed"]) == ["0"]
    trained, real = [], oracle.train

    def record(config, out, **options):
        trained.append(out.name)
        return real(config, out, **options)

    monkeypatch.setattr(oracle, "train", record)
    result = find(tmp_path, iterations=2)
    assert {"iteration_1", "response_1_0", "response_1_1"} <= set(trained)
    rows = RowFile(tmp_path / oracle.ROWS).read()
    assert result["rows"] == rows
    assert rows[0] == first["rows"][0]
    assert [row["iteration"] for row in rows] == [0, 1]
    response = str(tmp_path / "runs" / "response_0_0" / "agent")
    spec = RunFolder(tmp_path / "runs" / "iteration_1").read().game
    assert spec.opponent == ("tone", "tone", "hunter", *[response] * 3)
    assert [row["rivals"] for row in rows] == [3, 6]
    assert result["iteration"] == int(max(result["confirmed"], key=result["confirmed"].get))
    agent = load_agent(tmp_path / "agent")
    assert agent.card.training_steps == 400 * (result["iteration"] + 1)
    assert agent.card.game.actions == "uniform-hop"
    assert json.loads((tmp_path / oracle.ABOUT).read_text())["iteration"] == result["iteration"]
    seeds = {RunFolder(run).read().training_seed for run in (tmp_path / "runs").glob("*")}
    assert len(seeds) == 6
    with pytest.raises(UserError, match=r"another weight \(3, now 4\)"):
        find(tmp_path, iterations=2, weight=4)


def test_the_same_search_in_another_folder_writes_the_same_records(tmp_path):
    for name in ("one", "two"):
        find(tmp_path / name, iterations=1, against=["tone"])
    one, two = (
        [dataclasses.asdict(record) for record in Store(tmp_path / name / RECORDS).records()]
        for name in ("one", "two")
    )
    assert one == two
    assert {record["rival"] for record in one} == {f"runs/response_0_{k}/agent" for k in (0, 1)} | {"tone"}


@pytest.mark.full
def test_by_nash_each_side_answers_the_equilibrium_of_the_other(tmp_path):
    first = find(tmp_path, iterations=1, meta_solver="nash")
    result = find(tmp_path, iterations=2, meta_solver="nash")
    assert result["rows"][0] == first["rows"][0]
    runs = tmp_path / "runs"
    games = {run.name: RunFolder(run).read().game for run in runs.glob("*")}
    policies = [str(runs / f"iteration_{number}" / "agent") for number in (0, 1)]
    response = str(runs / "response_0_0" / "agent")
    assert games["iteration_0"].opponent == ("tone", "tone", "hunter")
    assert set(games["response_0_0"].ally) == {policies[0]}
    met, answered = games["iteration_1"].opponent, games["response_1_0"].ally
    assert set(met) <= {"tone", "hunter", response}
    assert set(answered) <= set(policies)
    assert len(met) == len(answered) == oracle.PARTS
    assert [row["rivals"] for row in result["rows"]] == [3, oracle.PARTS]
    values = {
        tuple(name if "/" not in name else str(tmp_path / name) for name in pair): value
        for pair, value in payoffs_of(tmp_path).items()
    }
    first_game = [values[policies[0], name] for name in ("tone", "hunter", response)]
    assert values[policies[0], met[0]] == min(first_game)  # one row: the equilibrium is its lowest column
    low = sum(values[name, str(runs / "response_1_0" / "agent")] for name in answered) / oracle.PARTS
    assert result["rows"][1]["low"] == pytest.approx(low, abs=1e-4)
    assert set(games[f"response_{result['iteration']}_1"].ally) == {policies[result["iteration"]]}
    with pytest.raises(UserError, match="a search with another meta_solver"):
        find(tmp_path, iterations=2)


def test_a_search_that_cannot_begin_leaves_nothing_behind(tmp_path):
    with pytest.raises(UserError, match="unknown opponent 'nobody'"):
        find(tmp_path / "search", against="nobody")
    assert not (tmp_path / "search").exists()


def payoffs_of(folder):
    """The return per step of each policy against each rival that it met."""
    return {
        (record.entry, record.rival): sum(record.returns) / record.tally["steps"]
        for record in Store(folder / RECORDS).records()
    }


def test_shares_become_whole_parts():
    parts = oracle._in_parts({"tone": 0.333, "comb": 0.334, "sweep": 0.333, "never": 0.0})
    assert sorted(map(parts.count, ("tone", "comb", "sweep", "never"))) == [0, 33, 33, 34]


def test_a_search_stops_once_no_iteration_keeps_more():
    lows = [{"low": low} for low in (-3.0, -1.0, -2.0, -1.5)]
    assert [oracle._is_flat(lows[:count], 2) for count in range(5)] == [False, False, False, False, True]
    assert oracle._is_flat(lows[:3], 1)


def test_an_opponent_searches_against_allies_that_play_for_themselves(tmp_path):
    options = {"actions": "discrete", "against": "clock", "response_actions": "uniform-hop"}
    result = find(tmp_path, side="opponent", iterations=1, **options)
    response = RunFolder(tmp_path / "runs" / "response_0_0").read().game
    assert (response.reward, response.actions) == ("own", "uniform-hop")
    assert result["rows"][0]["meta_value"] <= result["rows"][0]["low"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"meta_solver": "nsh"}, "meta_solver: expected one of weights, nash, got 'nsh'; did you mean"),
        ({"iterations": 0}, "iterations: expected a whole number above 0, got 0"),
        ({"game": {"pth": "circle"}}, "game: unknown key 'pth'; did you mean 'path'"),
        ({"game": {"actions": "discrete"}}, "game: unknown key 'actions'"),
    ],
)
def test_what_is_unknown_or_out_of_range_is_refused_by_the_configuration(change, message):
    with pytest.raises(UserError, match=message):
        DoubleOracleConfig(**change)


def test_another_search_says_what_differs(tmp_path):
    about = {"game": {"id": "a", "opponent": ["tone"]}, "steps": [1, 2], "seed": 0}
    (tmp_path / "about.json").write_text(json.dumps(about))
    for changes, message in (
        ({"game": {"id": "a", "opponent": ["comb"]}}, r"game\.opponent\[0\] \('tone', now 'comb'\)"),
        ({"game": {"id": "a"}}, r"game\.opponent \(\['tone'\], now None\)"),
        ({"steps": [1, 3]}, r"steps\[1\] \(2, now 3\)"),
    ):
        with pytest.raises(UserError, match=f"holds a double oracle with another {message}"):
            check_same(tmp_path / "about.json", "a double oracle", about | changes)
    assert check_same(tmp_path / "about.json", "a double oracle", about) == about
