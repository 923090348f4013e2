"""The track of planners: played as anybody's submission is, and without a language model."""

from __future__ import annotations

import pytest

from fpg_bench.evaluation.compare import compare
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summary_of
from fpg_bench.leaderboard.playing import Part, matchups_of, part_records
from fpg_bench.leaderboard.transcripts import check_transcripts
from tests.planning.llm.real_server import LlamaServer

from .recording import PLANNER_SUITE, enter, environment, record


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("track")
    (folder / "mine.yml").write_text(PLANNER_SUITE)
    return folder


@pytest.fixture(scope="module")
def suite(folder):
    return load_suite(str(folder / "mine.yml"))


@pytest.fixture(scope="module")
def short(folder):
    """One match of two rounds against one ally."""
    file, text = folder / "short.yml", PLANNER_SUITE.replace("  - {ally: expert}\n", "")
    file.write_text(text.replace("match: 3", "match: 2").replace("matches: 2", "matches: 1"))
    return file


@pytest.fixture(scope="module")
def toy(folder, suite):
    """What a comparison compared of a recorded model, its submission's folder, and its lines."""
    compared = record(folder, folder / "mine.yml")
    entry = enter(folder / "out", folder / "toy")
    return compared, entry, of_transcripts(entry, suite)


def of_transcripts(entry, suite):
    return list(part_records(Part("toy", None, "transcripts", recorded=entry), matchups_of([suite])))


def of_script(name, suite):
    return list(part_records(Part(name, None, name), matchups_of([suite])))


def test_a_recorded_model_scores_what_its_comparison_said_and_nobody_is_asked(toy, suite):
    compared, _, lines = toy
    summary = summary_of(lines, suite)
    assert (summary.score, summary.by_rival, summary.measures) == (
        compared.score,
        compared.by_rival,
        compared.measures,
    )
    assert [line.rounds_sha256 for line in lines] == [line.rounds_sha256 for line in compared.records]
    plans = summary.pooled.plans
    assert (plans.valid, plans.tokens) == (compared.pooled.plans.valid, compared.pooled.plans.tokens)
    assert plans.statuses == {"fallback-invalid": 4, "ok": 4, "reasked": 4}
    assert plans.useless == compared.pooled.plans.useless


def test_a_planner_of_the_package_scores_what_a_comparison_says(folder, suite):
    summary = compare(["interceptor", "random", "pursuit"], str(folder / "mine.yml"), folder / "plain")
    for compared in summary:
        own = summary_of(of_script(compared.entry, suite), suite)
        assert (own.score, own.measures) == (compared.score, compared.measures)
        assert (own.pooled.plans.valid, own.pooled.plans.tokens) == (None, None)


@pytest.mark.slow
def test_a_real_server_is_recorded_and_verified_when_it_is_gone(folder, short):
    profile = folder / "server.yml"
    profile.write_text("about: short\nresponse_format: json_schema\nseed: true\n")
    with LlamaServer() as server, environment(server.url, server.model):
        compare(["llm"], str(short), folder / "real", llm={"server": str(profile)})
    entry, suite = enter(folder / "real", folder / "tiny"), load_suite(str(short))
    assert check_transcripts(entry, suite) == []
    plans = summary_of(of_transcripts(entry, suite), suite).pooled.plans
    assert (plans.valid, plans.statuses) == (1, {"ok": suite.rounds})
    assert plans.tokens > 0
