"""Training, evaluation and page of the zoo; a stand-in trains, the real training is in tests/test_zoo.py."""

import dataclasses
import logging
import shutil
from functools import partial

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL, ORACLES, SCRIPTED
from fpg_bench.common.parallel import run_jobs
from fpg_bench.common.rows import RowFile
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.verdicts import RECORD
from fpg_bench.products.zoo.zoo import load_zoo
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model
from tests.training.making import (
    add_missing_records,
    evaluations,
    make_agent,
    make_zoo,
    script,
    stand_in,
    zoo_page,
)


@pytest.fixture
def zoo(tmp_path, monkeypatch):
    monkeypatch.setattr(script, "train", partial(stand_in, tmp_path))
    monkeypatch.setattr(script, "run_jobs", run_in_turn)
    return make_zoo(tmp_path)


def run_in_turn(jobs, workers):
    """As ``run_jobs``, but one after the other, in this process."""
    run_jobs(jobs, 1)


def begun(zoo):
    file = zoo.folder / "begun"
    return file.read_text().split() if file.exists() else []


# Training


def test_a_run_is_what_the_zoo_says(zoo):
    config = script.run_config(zoo.members()[1])
    told = (config.algorithm, config.spec.id, config.seed, config.steps)
    assert told == ("ppo", "FPG/AllyVsScripted-v0", 1, 2000)
    assert config.spec.options() == {"path": ("pursuit", "circle")}
    assert [config.suite] == list(zoo.groups[0].suites)


@pytest.mark.parametrize(
    "agent",
    [agent for agent in load_zoo().members() if agent.seed == 0 and agent.group.id != DUEL],
    ids=lambda agent: agent.name,
)
def test_each_row_of_the_shipped_zoo_has_hyperparameters_for_its_game(agent):
    config = script.run_config(agent)
    parameters = load_hyperparameters(config.algorithm, config.spec, config.hyperparams)
    small = {"n_envs": 2, "buffer_size": 100} if "buffer_size" in parameters.algorithm else {"n_envs": 2}
    parameters = load_hyperparameters(config.algorithm, config.spec, parameters.entry() | small)
    games = make_sb3(dataclasses.replace(config.spec, **dict.fromkeys(SIDES)), 2)
    make_model(config.algorithm, games, parameters, 0)


def test_missing_agents_are_trained_shipped_and_evaluated_once_whichever_fails(zoo, tmp_path, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")
    runs = tmp_path / "runs"
    make_agent(zoo.members()[0])
    (tmp_path / "break_1").touch()
    assert script.train_zoo(zoo, runs, "small/ppo", workers=1) == ["small/ppo/seed_1"]
    assert "small/ppo/seed_1: failed: out of luck" in caplog.messages
    (tmp_path / "break_1").unlink()
    assert script.train_zoo(zoo, runs, "small/ppo") == []
    assert begun(zoo) == ["1", "2", "1"]
    assert [agent.shipped for agent in zoo.members()] == [True] * 3 + [False] * 3
    assert sum(line.endswith(": shipped") for line in caplog.messages) == 2
    assert {row["training_seed"] for row in zoo_page.curve_file(zoo, zoo.groups[0]).read()} == {1, 2}
    scored = [row for row in RowFile(zoo.records_file(zoo.groups[0])).read() if row["entry"] == "ppo"]
    assert {row["training_seed"] for row in scored} == {0, 1, 2}
    script.train_zoo(zoo, runs, "small/ppo")
    assert len(begun(zoo)) == 3


def test_an_agent_of_another_budget_is_not_shipped(zoo, tmp_path):
    agent = zoo.members()[0]
    for key, value in (("training_seed", 7), ("training_steps", 7), ("id", "FPG/OpponentVsScripted-v0")):
        make_agent(agent, tmp_path / key / "agent", **{key: value})
        with pytest.raises(UserError, match=f"{key} is .*, the zoo asks for"):
            script.ship(agent, tmp_path / key)
    assert not agent.shipped


# Evaluation


def one_agent(folder):
    """A zoo of one agent, its group and public suite, and their records."""
    zoo = make_zoo(folder)
    make_agent(zoo.members("small/ppo")[0])
    (group, *_), suite = zoo.groups, load_suite(zoo.groups[0].suites[0])
    return zoo, group, suite, add_missing_records(zoo, group)


def records_of(zoo, algorithm):
    suite = load_suite(zoo.groups[0].suites[0])
    return [record for record in zoo.read_records(zoo.groups[0], suite) if record.entry == algorithm]


def test_every_player_is_evaluated_once_as_evaluate_does_to_the_digit(tmp_path):
    zoo = make_zoo(tmp_path / "zoo")
    for agent in zoo.members("small/ppo"):
        make_agent(agent)
    group = zoo.groups[0]
    suite = load_suite(group.suites[0])
    records = add_missing_records(zoo, group)
    assert len(records) == 2 * (len(SCRIPTED["ally"]) + len(ORACLES) + 3)
    size = zoo.records_file(group).stat().st_size
    assert add_missing_records(zoo, group) == records == zoo.read_records(group, suite)
    assert zoo.records_file(group).stat().st_size == size
    agents = [str(agent.folder) for agent in zoo.members("small/ppo")]
    expected = evaluate([*agents, "expert", "idle"], group.suites[0], tmp_path / "results")
    summaries = {s.entry: s for s in summarise(records, suite)}
    assert len(expected) == 3
    for summary in expected:
        own = summaries[summary.entry]
        assert (own.score, own.reward, own.measures) == (summary.score, summary.reward, summary.measures)
        for one, other in zip(own.records, summary.records, strict=True):
            assert RECORD.is_same(one, other)


def test_each_record_is_kept_once_and_the_newest_of_a_matchup(tmp_path):
    zoo, group, suite, records = one_agent(tmp_path / "zoo")
    file = RowFile(zoo.records_file(group))
    newer = file.read()
    older = [{**row, "rounds_sha256": "older"} for row in newer]
    former = {**newer[0], "suite_hash": "of a suite that is gone"}
    file.replace([*older, *newer, former])
    with pytest.raises(UserError, match="of the same matchup"):
        zoo.read_records(group, suite)
    script.compact(zoo, group)
    assert file.read() == newer
    assert zoo.read_records(group, suite) == records


def test_what_the_board_verified_is_read_there_and_neither_kept_nor_played_again(tmp_path):
    zoo, group, suite, records = one_agent(tmp_path / "zoo")
    own = RowFile(zoo.records_file(group))
    rows = [row | {"entry": "small-ppo"} for row in own.read()]
    board = RowFile(tmp_path / "leaderboard/results/ally/small-ppo.jsonl")
    board.append([{"kind": "result"}, *rows, rows[0] | {"fingerprint": "another policy"}])
    assert len(rows) == 2
    script.compact(zoo, group)
    assert own.read() == []
    assert zoo.read_records(group, suite) == add_missing_records(zoo, group) == records
    assert own.read() == []
    board.path.unlink()
    assert add_missing_records(zoo, group) == records
    assert len(own.read()) == len(rows)


def test_a_replaced_agent_is_evaluated_again(tmp_path):
    zoo = make_zoo(tmp_path)
    agent = zoo.members()[0]
    make_agent(agent)
    add_missing_records(zoo, agent.group)
    before = records_of(zoo, "ppo")
    shutil.rmtree(agent.folder)
    make_agent(agent, seed=77)
    assert records_of(zoo, "ppo") == []
    add_missing_records(zoo, agent.group)
    after = records_of(zoo, "ppo")
    assert [record.returns for record in after] != [record.returns for record in before]
    (agent.folder / "policy.onnx").write_bytes(b"torn")
    with pytest.raises(UserError, match="sha256"):
        add_missing_records(zoo, agent.group)


# The page


def keep_curve(zoo, agent, **options):
    run = zoo.folder / "run"
    run.mkdir(exist_ok=True)
    (run / "evaluations.jsonl").write_text(evaluations(**options))
    zoo_page.keep_curve(zoo, agent, run)


def test_a_curve_is_kept_once(zoo):
    one, other, *_ = zoo.members()
    keep_curve(zoo, one)
    keep_curve(zoo, other, score=5.0)
    keep_curve(zoo, one, count=3, score=7.0)
    rows = zoo_page.curve_file(zoo, one.group).read()
    assert [(r["training_seed"], r["steps"], r["score"]) for r in rows] == [
        *((1, 500 * i, 5.0 + 10 * i) for i in range(5)),
        *((0, 500 * i, 7.0 + 10 * i) for i in range(3)),
    ]
