"""Training, evaluation and page of the zoo; a stand-in trains, the real training is in tests/test_zoo.py."""

import logging
import shutil
from functools import partial

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import SCRIPTED
from fpg_bench.common.parallel import run_jobs
from fpg_bench.evaluation.curves import curves
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summarise
from tests.training.making import (
    add_missing_records,
    evaluations,
    make_agent,
    make_zoo,
    page,
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
    assert (config.algorithm, config.id, config.seed, config.steps) == (
        "ppo",
        "FPG/AllyVsScripted-v0",
        1,
        2000,
    )
    assert config.game.to_dict() == {"path": ["pursuit", "circle"]}
    assert [config.suite] == list(zoo.groups[0].suites)


def test_missing_agents_are_trained_shipped_and_evaluated_once(zoo, tmp_path, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")
    runs = tmp_path / "runs"
    make_agent(zoo.members()[0])
    assert script.train_zoo(zoo, runs, "small/ppo") == []
    assert sorted(begun(zoo)) == ["1", "2"]
    assert [agent.shipped for agent in zoo.members()] == [True] * 3 + [False] * 3
    assert sum(line.endswith(": shipped") for line in caplog.messages) == 2
    assert {row["training_seed"] for row in zoo_page.curve_file(zoo, zoo.groups[0]).read()} == {1, 2}
    scored = [row for row in zoo.score_file(zoo.groups[0]).read() if row["entry"] == "ppo"]
    assert {row["training_seed"] for row in scored} == {0, 1, 2}
    script.train_zoo(zoo, runs, "small/ppo")
    assert len(begun(zoo)) == 2


def test_a_failure_does_not_hold_up_the_others(zoo, tmp_path, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")
    (tmp_path / "break_0").touch()
    assert script.train_zoo(zoo, tmp_path / "runs", "small/ppo", n_jobs=1) == ["small/ppo/seed_0"]
    assert "small/ppo/seed_0: failed: out of luck" in caplog.messages
    assert [agent.shipped for agent in zoo.members("small/ppo")] == [False, True, True]
    (tmp_path / "break_0").unlink()
    assert script.train_zoo(zoo, tmp_path / "runs", "small/ppo") == []


@pytest.mark.parametrize("key", ["training_seed", "training_steps", "id"])
def test_an_agent_of_another_budget_is_not_shipped(zoo, tmp_path, key):
    agent = zoo.members()[0]
    make_agent(agent, tmp_path / "run" / "agent", **{key: "FPG/OpponentVsScripted-v0" if key == "id" else 7})
    with pytest.raises(UserError, match=f"{key} is .*, the zoo asks for"):
        script.ship(agent, tmp_path / "run")
    assert not agent.shipped


# Evaluation


@pytest.fixture(scope="module")
def shipped(tmp_path_factory):
    """A zoo whose agents are all shipped and evaluated."""
    zoo = make_zoo(tmp_path_factory.mktemp("zoo"))
    for agent in zoo.members():
        make_agent(agent, seed=agent.seed + 10 * (agent.algorithm == "td3"))
    add_missing_records(zoo, zoo.groups[0])
    return zoo


def records_of(zoo, algorithm):
    suite = load_suite(zoo.groups[0].suites[0])
    return [record for record in zoo.read_records(zoo.groups[0], suite) if record.entry == algorithm]


def test_every_player_is_evaluated_once(shipped):
    group = shipped.groups[0]
    records = shipped.read_records(group, load_suite(group.suites[0]))
    assert len(records) == 2 * (len(SCRIPTED["ally"]) + 6)
    size = shipped.score_file(group).path.stat().st_size
    assert add_missing_records(shipped, group) == records
    assert shipped.score_file(group).path.stat().st_size == size


def test_the_zoo_s_numbers_are_those_of_evaluate_to_the_digit(shipped, tmp_path):
    group = shipped.groups[0]
    suite = load_suite(group.suites[0])
    agents = [str(agent.folder) for agent in shipped.members("small/ppo")]
    expected = evaluate([*agents, "expert", "idle"], group.suites[0], tmp_path)
    summaries = {s.entry: s for s in summarise(shipped.read_records(group, suite), suite)}
    assert len(expected) == 3
    for summary in expected:
        own = summaries[summary.entry]
        assert (own.score, own.reward, own.measures) == (summary.score, summary.reward, summary.measures)
        for one, other in zip(own.records, summary.records, strict=True):
            assert one.same_as(other)


def test_a_replaced_agent_is_evaluated_again(tmp_path):
    zoo = make_zoo(tmp_path)
    agent = zoo.members()[0]
    make_agent(agent)
    add_missing_records(zoo, agent.group)
    before = records_of(zoo, "ppo")
    assert script.differences(zoo, agent) == []
    shutil.rmtree(agent.folder)
    make_agent(agent, seed=77)
    assert records_of(zoo, "ppo") == []
    missing = ["small-v1, adaptive/pursuit: no record", "small-v1, sweep/circle: no record"]
    assert script.differences(zoo, agent) == missing
    add_missing_records(zoo, agent.group)
    after = records_of(zoo, "ppo")
    assert [record.returns for record in after] != [record.returns for record in before]
    file = zoo.score_file(agent.group).path
    file.write_text(file.read_text().replace(after[0].rounds_sha256, "0" * 64))
    assert script.differences(zoo, agent) == [
        "small-v1, adaptive/pursuit: the same returns, but other rounds"
    ]
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


def test_curves_are_means_and_ranges_over_seeds_as_far_as_all_have_come(zoo):
    for k, agent in enumerate(zoo.members("small/ppo")[:2]):
        keep_curve(zoo, agent, count=5 - k, score=4.0 * k, pace=2.0 + k)
    rows = zoo_page.curve_file(zoo, zoo.groups[0]).read()
    (curve,) = curves(rows, "steps", "range").values()
    assert (curve.x[0], curve.x[-1]) == pytest.approx((500, 1500))
    assert curve.mean == pytest.approx(curve.x / 50 + 2)  # both rise by 10 in 500 steps, 4 apart
    assert curve.high - curve.low == pytest.approx(np.full(len(curve.x), 4.0))
    (by_time,) = curves(rows, "seconds", "range").values()
    assert by_time.x[-1] == pytest.approx(6.0)  # at the speed of the faster one
    assert by_time.mean == pytest.approx(curve.mean)
    assert curves(rows[:1], "steps") == {}


def test_the_page_has_a_table_of_algorithms_and_scripts_and_pictures(zoo):
    for agent in zoo.members("small/ppo") + zoo.members("small/td3")[:1]:
        make_agent(agent)
        keep_curve(zoo, agent)
    add_missing_records(zoo, zoo.groups[0])
    images = []
    for _ in range(2):
        zoo_page.write_page(zoo)
        images.append((zoo.folder / "scores" / "small" / "profiles.svg").read_bytes())
    assert images[0] == images[1]
    text = (zoo.folder / "README.md").read_text()
    assert text == page(zoo)
    rows = {line.split(" | ")[0].strip("|* "): line.split(" | ") for line in text.splitlines() if "|" in line}
    assert {"ppo", "td3", "expert", "random"} <= set(rows)
    assert rows["ppo"][1:3] == ["3", "0.002M"]
    assert rows["td3"][1] == "1"
    assert "†" in rows["td3"][4]
    assert "†" not in rows["ppo"][4]
    (expert,) = summarise(records_of(zoo, "expert"), load_suite(zoo.groups[0].suites[0]))
    assert rows["expert"][3] == f"{expert.score.value:.1f}"
    assert rows["ppo"][-1] == "1.5 |"  # minutes
    for name in ("curves", "profiles", "improvement"):
        assert f"(scores/small/{name}.svg)" in text
        image = (zoo.folder / "scores" / "small" / f"{name}.svg").read_bytes()
        assert image.startswith(b"<?xml")
        assert len(image) < 100_000
