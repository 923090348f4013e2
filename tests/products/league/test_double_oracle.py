"""Double oracle: whom each stage meets, when it stops, what is exported, and resumption."""

import inspect
import json
import shlex

import pytest

from fpg_bench.cli.fields import with_fields
from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.store import RECORDS, Store
from fpg_bench.players.agent import load_agent
from fpg_bench.products.league import double_oracle as oracle
from fpg_bench.products.league.evaluation import check_same
from fpg_bench.products.league.verbs import double_oracle
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
    "progress": False,
}


@pytest.fixture(autouse=True)
def few_matches(monkeypatch):
    """Few matches in each evaluation."""
    monkeypatch.setattr(oracle, "MATCHES", 3)


def test_stages_meet_the_responses_by_their_weights_and_the_best_is_exported(tmp_path, monkeypatch):
    first = oracle.double_oracle(tmp_path, stages=1, **SEARCH)
    assert list(first["confirmed"]) == ["0"]
    trained, real = [], oracle.train

    def record(config, out, **options):
        trained.append(out.name)
        return real(config, out, **options)

    monkeypatch.setattr(oracle, "train", record)
    result = oracle.double_oracle(tmp_path, stages=2, **SEARCH)
    assert {"stage_1", "response_1_0", "response_1_1"} <= set(trained)
    rows = RowFile(tmp_path / oracle.ROWS).read()
    assert result["rows"] == rows
    assert rows[0] == first["rows"][0]
    assert [row["stage"] for row in rows] == [0, 1]
    response = str(tmp_path / "runs" / "response_0_0" / "agent")
    spec = RunFolder(tmp_path / "runs" / "stage_1").read().game
    assert spec.opponent == ("tone", "tone", "hunter", *[response] * 3)
    assert [row["rivals"] for row in rows] == [3, 6]
    assert result["stage"] == int(max(result["confirmed"], key=result["confirmed"].get))
    agent = load_agent(tmp_path / "agent")
    assert agent.card.training_steps == 400 * (result["stage"] + 1)
    assert agent.card.game.actions == "uniform-hop"
    options = shlex.split(agent.card.command)[2:]
    assert dict(zip(options[::2], options[1::2], strict=True)) == {
        "--side": "ally",
        "--mode": "one",
        "--stages": str(result["stage"] + 1),
        "--steps": "400",
        "--response-steps": "400",
        "--algorithm": "ppo",
        "--response-algorithm": "ppo",
        "--response-actions": "discrete",
        "--against": "tone,tone,hunter",
        "--weight": "3",
        "--seed": "0",
        "--actions": "uniform-hop",
        "--hyperparams": json.dumps(TINY),
        "--response-hyperparams": json.dumps(TINY),
        "--out": tmp_path.name,
    }
    known = {
        f"--{name.replace('_', '-')}" for name in inspect.signature(with_fields(double_oracle)).parameters
    }
    assert set(options[::2]) <= known
    assert json.loads((tmp_path / oracle.ABOUT).read_text())["stage"] == result["stage"]
    seeds = {RunFolder(run).read().training_seed for run in (tmp_path / "runs").glob("*")}
    assert len(seeds) == 6
    with pytest.raises(UserError, match=r"another weight \(3, now 4\)"):
        oracle.double_oracle(tmp_path, stages=2, **SEARCH | {"weight": 4})


def test_in_the_mode_both_each_side_answers_the_equilibrium_of_the_other(tmp_path, monkeypatch):
    options = SEARCH | {"mode": "both"}
    first = oracle.double_oracle(tmp_path, stages=1, **options)
    result = oracle.double_oracle(tmp_path, stages=2, **options)
    assert result["rows"][0] == first["rows"][0]
    runs = tmp_path / "runs"
    games = {run.name: RunFolder(run).read().game for run in runs.glob("*")}
    stages = [str(runs / f"stage_{number}" / "agent") for number in (0, 1)]
    response = str(runs / "response_0_0" / "agent")
    assert games["stage_0"].opponent == ("tone", "tone", "hunter")
    assert set(games["response_0_0"].ally) == {stages[0]}
    met, answered = games["stage_1"].opponent, games["response_1_0"].ally
    assert set(met) <= {"tone", "hunter", response}
    assert set(answered) <= set(stages)
    assert len(met) == len(answered) == oracle.PARTS
    assert [row["rivals"] for row in result["rows"]] == [3, oracle.PARTS]
    values = payoffs_of(tmp_path)
    first_game = [values[stages[0], name] for name in ("tone", "hunter", response)]
    assert values[stages[0], met[0]] == min(first_game)  # one row: the equilibrium is its lowest column
    low = sum(values[name, str(runs / "response_1_0" / "agent")] for name in answered) / oracle.PARTS
    assert result["rows"][1]["low"] == pytest.approx(low, abs=1e-4)
    assert set(games[f"response_{result['stage']}_1"].ally) == {stages[result["stage"]]}
    assert "--mode both" in load_agent(tmp_path / "agent").card.command
    with pytest.raises(UserError, match="another mode"):
        oracle.double_oracle(tmp_path, stages=2, **SEARCH)
    with pytest.raises(UserError, match="mode: expected"):
        oracle.double_oracle(tmp_path, mode="all", **SEARCH)


def test_in_self_play_a_rival_learns_beside_the_side_and_responses_measure_both(tmp_path):
    result = oracle.double_oracle(tmp_path, stages=2, **SEARCH | {"mode": "selfplay"})
    runs = tmp_path / "runs"
    stages = [runs / f"stage_{number}" for number in (0, 1)]
    for stage in stages:
        run, rival = RunFolder(stage).read(), RunFolder(stage / "rival").read()
        assert run.game.opponent == ("tone", "tone", "hunter")
        assert (run.options["rival"]["weight"], rival.options["rival"]["weight"]) == (3, 1)
        assert (rival.game.reward, rival.game.actions) == ("zero_sum", "discrete")
    for inner in (".", "rival"):
        assert RunFolder(stages[1] / inner).read().options["start"] == str(stages[0] / inner)
    values = payoffs_of(tmp_path)
    for number, row in enumerate(result["rows"]):
        stage, response = stages[number] / "agent", runs / f"response_{number}_0" / "agent"
        answer, rival = runs / f"answer_{number}" / "agent", stages[number] / "rival" / "agent"
        assert row["low"] == pytest.approx(values[str(stage), str(response)], abs=1e-4)
        earned = max(values[str(policy), str(rival)] for policy in (answer, stage))
        assert row["high"] == pytest.approx(earned, abs=1e-4)
        assert row["rivals"] == 3 + 3
    for name in ("agent", "rival"):
        card = load_agent(tmp_path / name).card
        assert card.sample
        assert "--mode selfplay" in card.command
        assert card.training_steps == 400 * (result["stage"] + 1)
    found = [runs / "response_0_0", runs / "response_1_0", runs / "answer_0", runs / "answer_1"]
    seeds = [RunFolder(run).read().training_seed for run in (*stages, *(s / "rival" for s in stages), *found)]
    assert len(set(seeds)) == len(seeds)


def payoffs_of(folder):
    """The return per step of each policy against each rival that it met."""
    return {
        (record.entry, record.rival): sum(record.returns) / record.tally["steps"]
        for record in Store(folder / RECORDS).records()
    }


def test_shares_become_whole_parts():
    parts = oracle._in_parts({"tone": 0.333, "comb": 0.334, "sweep": 0.333, "never": 0.0})
    assert sorted(map(parts.count, ("tone", "comb", "sweep", "never"))) == [0, 33, 33, 34]


def test_a_search_stops_once_no_stage_keeps_more():
    lows = [{"low": low} for low in (-3.0, -1.0, -2.0, -1.5)]
    assert [oracle._is_flat(lows[:count], 2) for count in range(5)] == [False, False, False, False, True]
    assert oracle._is_flat(lows[:3], 1)


def test_an_opponent_searches_against_allies_that_play_for_themselves(tmp_path):
    options = SEARCH | {"actions": "discrete", "against": "clock", "response_actions": "uniform-hop"}
    result = oracle.double_oracle(tmp_path, side="opponent", stages=1, **options)
    response = RunFolder(tmp_path / "runs" / "response_0_0").read().game
    assert (response.reward, response.actions) == ("own", "uniform-hop")
    assert result["rows"][0]["meta_value"] <= result["rows"][0]["low"]
    with pytest.raises(UserError, match="side"):
        oracle.double_oracle(tmp_path / "other", side="both", **SEARCH)


def test_another_search_says_what_differs(tmp_path):
    about = {"game": {"id": "a", "opponent": ["tone"]}, "steps": [1, 2], "seed": 0}
    (tmp_path / "about.json").write_text(json.dumps(about))
    for changes, message in (
        ({"game": {"id": "a", "opponent": ["comb"]}}, r"game, opponent \(\['tone'\], now \['comb'\]\)"),
        ({"game": {"id": "a"}}, r"game, opponent \(\['tone'\], now None\)"),
        ({"steps": [1, 3]}, r"steps \(\[1, 2\], now \[1, 3\]\)"),
    ):
        with pytest.raises(UserError, match=f"holds a double oracle with another {message}"):
            check_same(tmp_path / "about.json", "a double oracle", about | changes)
    assert check_same(tmp_path / "about.json", "a double oracle", about) == about
