"""The track of planners: played as anybody's submission is, and without a language model."""

from __future__ import annotations

import json

import numpy as np
import pytest
from fpg_bench.evaluation.planner_references import measure_planner_panel
from fpg_bench.leaderboard.planner_ranking import planner_standing

from fpg_bench.errors import UserError
from fpg_bench.evaluation.compare import compare, read_comparison
from fpg_bench.leaderboard.planner_track import (
    is_planner_line,
    planner_facts,
    planner_lines,
    planner_summary,
    returns_of,
)
from fpg_bench.leaderboard.ranking import lead_shares, rank_ranges
from fpg_bench.leaderboard.result import Result
from fpg_bench.leaderboard.transcripts import check_transcripts, entered_table
from tests.planning.llm.real_server import LlamaServer

from .recording import PANEL, enter, environment, record


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("track")
    (folder / "mine.yml").write_text(PANEL)
    measure_planner_panel(str(folder / "mine.yml"))
    return folder


@pytest.fixture(scope="module")
def table(folder):
    return entered_table(str(folder / "mine.yml"))


@pytest.fixture(scope="module")
def short(folder):
    """One match of two rounds against one ally."""
    file = folder / "short.yml"
    for old, new in (("match: 3", "match: 2"), ("matches: 2", "matches: 1"), ("[idle, expert]", "[idle]")):
        file.write_text((file if file.exists() else folder / "mine.yml").read_text().replace(old, new))
    measure_planner_panel(str(file))
    return file


@pytest.fixture(scope="module")
def toy(folder, table):
    """What a comparison said of a recorded model, its submission, and its lines."""
    said = record(folder, folder / "mine.yml")
    entry = submitted(enter(folder / "out", folder / "toy"))
    return said, entry, planner_lines(entry, table)


def submitted(folder=None, script=None):
    return type("Submitted", (), {"folder": folder, "script": script})


def of_script(name, table):
    return planner_lines(submitted(script=name), table)


def assert_same(found, interval):
    assert [found["value"], found["low"], found["high"]] == pytest.approx(
        [interval.value, interval.low, interval.high], abs=0.01
    )


def test_a_recorded_model_scores_what_its_comparison_said_and_nobody_is_asked(toy, table):
    said, _, lines = toy
    summary = planner_summary(lines, table)
    assert_same(summary["score"], said.last)
    assert_same(summary["score_all"], said.all)
    for found, round_score in zip(summary["curve"], said.curve, strict=True):
        assert_same(found, round_score)
    assert {name: of["value"] for name, of in summary["entries"].items()} == pytest.approx(
        said.allies_last, abs=0.01
    )
    assert (summary["valid"], summary["tokens"]) == pytest.approx((said.valid, said.tokens))
    assert summary["statuses"] == {"fallback-invalid": 4, "ok": 4, "reasked": 4}


def test_playing_again_gives_the_same_lines(toy, table):
    _, entry, lines = toy
    assert planner_lines(entry, table) == lines
    assert of_script("hill-climb", table) == of_script("hill-climb", table)


def test_a_planner_of_the_package_scores_what_a_comparison_says(folder, table):
    (folder / "plain").mkdir(exist_ok=True)
    compare(["interceptor"], str(folder / "mine.yml"), folder / "plain")
    said = {summary.planner: summary for summary in read_comparison(folder / "plain")[0]}
    for name in ("interceptor", "random", "pursuit"):
        summary = planner_summary(of_script(name, table), table)
        assert_same(summary["score"], said[name].last)
        assert summary["valid"] is summary["statuses"] is summary["tokens"] is None
        assert summary["measures"]["near_ratio"] == pytest.approx(said[name].in_all.near, rel=1e-4, abs=1e-9)


def test_lines_are_of_the_form_of_all_results(toy, table):
    for line in (*toy[2], *of_script("hold", table)):
        assert json.loads(json.dumps(line, allow_nan=False)) == line
        assert line["n"] == len(line["returns"]) == table.rounds
        assert len(line["ally_points"]) == table.scenario.frequency_points
        assert is_planner_line(line, table)


@pytest.mark.parametrize(
    "change", [{"statuses": {"ok": 1}}, {"statuses": [6]}, {"statuses": None}, {"tokens": "many"}]
)
def test_a_line_that_says_something_else_is_none(toy, table, change):
    assert not is_planner_line(toy[2][0] | change, table)


def test_the_fingerprint_tells_the_tier_the_matches_and_the_model(toy, table):
    assert planner_facts(submitted(script="pursuit"), table) == {"tier": "ally", "matches": 2}
    facts = planner_facts(toy[1], table)
    assert facts | {"prompt_hash": ""} == {
        "tier": "history",
        "matches": 2,
        "model": "toy",
        "server": "generic",
        "control": "none",
        "prompt": "standard",
        "prompt_hash": "",
    }


def test_standings_rank_by_the_planner_s_score(toy, table):
    lines = {name: of_script(name, table) for name in ("pursuit", "random")} | {"toy": toy[2]}
    entries = [planner_standing(Result({"slug": name}, of), table) for name, of in lines.items()]
    for entry, of in zip(entries, lines.values(), strict=True):
        summary = planner_summary(of, table)
        assert (entry.value, entry.interval.low) == (summary["score"]["value"], summary["score"]["low"])
        assert entry.entry(1).value == summary["entries"]["expert"]["value"]
        assert entry.scores.shape == (1, 2, 2)
        assert float(entry.scores.mean()) == pytest.approx(entry.value)
    assert lead_shares(entries).tolist() == [1, 0, 0]
    assert rank_ranges(entries)[0] == (1, 1)


def test_returns_stand_in_the_order_of_the_panel(table):
    lines = [
        {"entry": "expert", "returns": list(range(6, 12))},
        {"entry": "idle", "returns": list(range(6))},
    ]
    assert np.array_equal(returns_of(lines, table).ravel(), range(12))


def test_a_real_server_is_recorded_and_verified_when_it_is_gone(folder, short):
    profile = folder / "server.yml"
    profile.write_text("about: short\nresponse_format: json_schema\nseed: true\n")
    with LlamaServer() as server, environment(server.url, server.model):
        compare(["llm"], str(short), folder / "real", llm={"server": str(profile)})
    entry, table = submitted(enter(folder / "real", folder / "tiny")), entered_table(str(short))
    assert check_transcripts(entry.folder, str(short)) == []
    summary = planner_summary(planner_lines(entry, table), table)
    assert (summary["valid"], summary["statuses"]) == (1, {"ok": table.rounds})
    assert summary["tokens"] > 0


def test_transcripts_of_another_ally_are_refused(toy, folder, table):
    swapped = enter(folder / "out", folder / "swapped", pack=False) / "transcripts"
    (swapped / "idle.jsonl").write_text((swapped / "expert.jsonl").read_text())
    assert check_transcripts(folder / "swapped", str(folder / "mine.yml")) == []
    with pytest.raises(
        UserError, match=r"against idle: transcript transcripts/idle.jsonl: .* other messages"
    ):
        planner_lines(submitted(folder / "swapped"), table)
