"""Files of strangers are bounded before they are read, and a reader waits at no pipe."""

import dataclasses
import os

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_bounded, read_json, read_yaml
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.suite import load_suite, read_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.evaluation.table import MOST_RANKED, standings
from fpg_bench.game.knowledge import load_knowledge
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.products.offline.read import iterate_rounds
from fpg_bench.products.offline.spec import load_spec
from fpg_bench.products.offline.storage import part_digests
from fpg_bench.products.rendering.scores import MOST_DRAWN, draw_scores
from fpg_bench.training.checkpoint import _read
from tests.evaluation.test_summary import records_of

SUITE = {"side": "ally", "scenario": "standard", "matches": 1, "rivals": [{"opponent": "tone"}]}


@pytest.fixture
def pipe(tmp_path):
    file = tmp_path / "pipe.yml"
    os.mkfifo(file)
    return file


def test_no_reader_waits_at_a_pipe(pipe, tmp_path):
    for read in (read_yaml, read_json, lambda file, what: read_bounded(file, what, 9)):
        with pytest.raises(UserError, match=r"file .*pipe\.yml: cannot be read: is not a regular file"):
            read(pipe, "file")
    rows = RowFile(pipe)
    for use in (as_scenario, load_knowledge, load_suite, read_suite, load_spec, lambda file: rows.read()):
        with pytest.raises(UserError, match="is not a regular file"):
            use(str(pipe))
    for read in (part_digests, _read):
        with pytest.raises(OSError, match="is not a regular file"):
            read(pipe)
    os.mkfifo(tmp_path / "main_data.hdf5")
    with pytest.raises(UserError, match="is not a regular file"):
        next(iterate_rounds(tmp_path, load_spec("ally-expert-v0"), "", "data set"))


def test_an_agent_s_policy_may_be_no_pipe(tmp_path):
    shipped = baselines_folder() / "agents/ally-scripted/ppo/seed_0"
    (tmp_path / "agent").mkdir()
    (tmp_path / "agent/agent.json").write_bytes((shipped / "agent.json").read_bytes())
    os.mkfifo(tmp_path / "agent/policy.onnx")
    with pytest.raises(UserError, match="is not a regular file"):
        load_agent(tmp_path / "agent")


def test_a_yaml_file_is_measured_before_it_is_parsed(tmp_path, monkeypatch):
    monkeypatch.setattr("fpg_bench.common.files._CarefulLoader", lambda text: pytest.fail("was parsed"))
    file = tmp_path / "large.yml"
    for text in ("".join(f"k{k}: {k}\n" for k in range(60_000)), f"a: {'x' * 20_000_000}\n"):
        file.write_text(text)
        with pytest.raises(UserError, match=r"large\.yml: is longer than 200,000 bytes$"):
            read_yaml(file, "suite")


@pytest.mark.parametrize("opened", ["- ", "? "])
def test_a_yaml_file_nested_without_brackets_is_refused(opened, tmp_path):
    (tmp_path / "deep.yml").write_text(opened * 90_000)
    with pytest.raises(UserError, match=r"deep\.yml: not valid YAML: maximum recursion depth exceeded"):
        read_yaml(tmp_path / "deep.yml", "suite")


@pytest.mark.parametrize("changes", [{"matches": 10**12}, {"matches": 10**4, "rounds_per_match": 10**4}])
def test_a_suite_has_no_more_rounds_than_can_be_played(changes, tmp_path):
    file = tmp_path / "suite.yml"
    file.write_text(yaml.safe_dump(SUITE | changes))
    for read in (load_suite, read_suite):
        with pytest.raises(UserError, match="at most 1,000,000 rounds per rival are allowed"):
            read(str(file))


def test_a_table_of_many_entries_draws_the_first_and_ranks_none(tmp_path):
    suite = dataclasses.replace(load_suite("ally-v2"), matches=2, rivals=load_suite("ally-v2").rivals[:1])
    records = [
        record for k in range(MOST_RANKED + 1) for record in records_of(suite, f"entry {k}", [[k, k + 1.0]])
    ]
    many = summarise(records, suite)
    assert all(standing.rank is None for standing in standings(many).values())
    assert all(standing.rank is not None for standing in standings(many[:MOST_RANKED]).values())
    draw_scores(many, suite, tmp_path / "all.svg")
    drawn = (tmp_path / "all.svg").read_text()
    assert f"the first {MOST_DRAWN} of {len(many):,}" in drawn
    assert drawn.count("entry ") == MOST_DRAWN
    assert f"entry {MOST_RANKED}" in drawn
