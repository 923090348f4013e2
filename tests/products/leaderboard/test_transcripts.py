"""A language model's transcripts: each way to be wrong ends in one clear line."""

from __future__ import annotations

import gzip
import json
import re
import shutil

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summary_of
from fpg_bench.products.language_models.transcript import MOST_BYTES
from fpg_bench.products.leaderboard.playing import Part, matchups_of, part_records
from fpg_bench.products.leaderboard.transcripts import LARGEST_FOLDER, check_transcripts
from tests.products.language_models.real_server import LlamaServer

from .recording import PLANNER_SUITE, PLANS, enter, environment, record, rows_of, write_rows

_REWARD = re.compile(r"^(\d+,\d+,\d+,\d+,)(-?\d+\.\d\d)$", re.MULTILINE)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "mine.yml").write_text(PLANNER_SUITE)
    return folder


@pytest.fixture(scope="module", autouse=True)
def compared(recorded):
    """Return what a comparison says of the recorded model."""
    return record(recorded, recorded / "mine.yml")


@pytest.fixture(scope="module")
def suite(recorded):
    return load_suite(str(recorded / "mine.yml"))


@pytest.fixture
def entry(recorded, tmp_path):
    return enter(recorded / "out", tmp_path / "toy", pack=False)


@pytest.fixture
def check(suite, entry):
    return lambda: check_transcripts(entry, suite)


def only(found):
    (line,) = found
    return line


def test_what_was_recorded_may_be_run_packed_or_not(recorded, suite, entry, check, tmp_path):
    assert check() == []
    packed_entry = enter(recorded / "out", tmp_path / "packed")
    assert check_transcripts(packed_entry, suite) == []


# Files


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: shutil.rmtree(f), "transcripts: does not exist; it holds what evaluate has recorded"),
        (lambda f: (f / "expert.jsonl").unlink(), "transcripts/expert.jsonl: is missing"),
        (lambda f: (f / "planner.json").unlink(), "transcripts/planner.json: is missing"),
        (lambda f: (f / "notes.txt").write_text("hello"), "transcripts/'notes.txt': does not belong here"),
        (lambda f: (f / "more").mkdir(), "transcripts/'more': is a folder; put the files into transcripts"),
        (lambda f: (f / "idle.jsonl.gz").write_bytes(b""), "is there both packed and unpacked"),
        (lambda f: (f / "prompt.yml").write_text("#" * 20_000), "prompt.yml: 20,000 bytes, more than 16,000"),
        (lambda f: f.symlink_to(f.rename(f.with_name("all"))), "transcripts: is a link"),
        (
            lambda f: (f / "idle.jsonl").symlink_to((f / "idle.jsonl").rename(f.parent / "elsewhere.jsonl")),
            "transcripts/'idle.jsonl': not a plain file",
        ),
        (lambda f: (f / "expert.jsonl").write_bytes(bytes(LARGEST_FOLDER)), "pack transcripts by gzip -9"),
    ],
)
def test_files_that_lack_or_do_not_belong(entry, check, spoil, message):
    spoil(entry / "transcripts")
    assert message in check()[0]


# The prompt, and what is told of all


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("suite_hash", "0" * 64, "record those of evaluate --suite mine --matches 2"),
        ("control", "magic", "control: expected one of none"),
        ("server", ["generic"], "server: expected a line"),
        ("server", "\x1b[2J", "server: expected a line"),
        ("prompt_hash", "0" * 64, "does not match the prompt_hash in planner.json"),
        ("model", "another", "nonce: does not follow from the seed of season 5"),
        ("season", None, "season: expected the number of a closed one, got None"),  # beside a nonce
    ],
)
def test_what_is_told_of_all_must_be_so(entry, check, key, value, message):
    file = entry / "transcripts" / "planner.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {key: value}))
    assert message in check()[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [1]\nb: [*a, *a]\n", "holds an alias"),
        ("about: !!python/object/apply:os.system [echo]\n", "prompt.yml: not valid YAML"),
        (f"user: '{'$history' * 3}'\n", "uses $history more than 2 times"),
    ],
)
def test_a_prompt_that_would_do_harm(entry, check, text, message):
    (entry / "transcripts" / "prompt.yml").write_text(text)
    assert message in only(check())


# Lines


def each(**changes):
    return lambda rows: [row | changes for row in rows]


def more(**changes):
    """One more attempt, as the first one but for the changes."""
    return lambda rows: [*rows, rows[0] | changes]


def answered_again(rows):
    return [*rows, next(row for row in rows if row["waypoints"]) | {"attempt": 1}]


def asked(**changes):
    return lambda rows: [row | {"request": row["request"] | changes} for row in rows]


def answered_twice(rows):
    return [row | {"raw": row["raw"] | {"choices": row["raw"]["choices"] * 2}} for row in rows]


NOT_ASKED = "holds an attempt that nothing asks for"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[1:], f"lacks 1 of {PLANS} plans: seed "),
        (lambda rows: [row for row in rows if row["attempt"] == 0], "lacks the second attempt: seed "),
        (more(), "is another attempt at what was asked before"),
        (more(seed=3), f"{NOT_ASKED}: seed 3, match 0, round 0, attempt 0"),
        (more(match=1), NOT_ASKED),
        (answered_again, NOT_ASKED),
        (more(attempt=2), NOT_ASKED),
        (each(request=None), "line 1 does not show what was asked"),
        (each(request={"model": "toy"}), "line 1 does not show the model and messages of its request"),
        (asked(tools=[]), "line 1 holds 'tools', which the planner does not send"),
        (asked(seed=1), "line 1 was asked with another seed than the run's"),
        (asked(temperature=0.1), "line 1 was asked with another temperature"),
        (asked(response_format={"type": "text"}), "line 1 was asked with another response_format"),
        (asked(max_tokens=9, max_completion_tokens=9), "line 1 holds both max_tokens and max_completion"),
        (answered_twice, "line 1 was answered 2 times at once"),
        (each(raw=None), "line 1 does not show the raw reply"),
        (
            lambda rows: [row | {"text": f"{row['text'] or ''} "} for row in rows],
            "line 1 is changed: its text is not what its raw reply says",
        ),
        (each(seconds=1e300), "seconds: 1e+300 is not possible"),
        (each(seed="1"), "is not a valid attempt: seed: expected a whole number, got '1'"),
        (each(kind="flown"), "is not an attempt; a transcript has no other rows"),
        (each(control="no-history"), "was made with control 'no-history', and not 'none'"),
    ],
)
def test_attempts_that_are_not_those_of_the_matches(entry, check, change, message):
    file = entry / "transcripts" / "idle.jsonl"
    rows = [dict(row) for row in change(rows_of(file))]
    if all(isinstance(row["seed"], int) for row in rows):
        write_rows(file, rows)
    else:
        file.write_text("".join(json.dumps(row) + "\n" for row in rows))
    line = only(check())
    assert message in line
    assert line.startswith("transcript transcripts/idle.jsonl: ")


def test_a_key_that_is_not_its_request_s(entry, check):
    file = entry / "transcripts" / "idle.jsonl"
    file.write_text(file.read_text().replace('"temperature":0.7', '"temperature":0.1'))
    assert "its key does not match its request" in only(check())


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data[:-1], "is cut off in its last line"),
        (lambda data: data + b"[1]\n", "is not a valid row"),
        (lambda data: data + b'{"kind": NaN}\n', "NaN is not a valid number"),
        (lambda data: data + b'{"a":' + b"[" * 100_000 + b"\n", "is not a valid row"),
        (lambda data: data + b'{"a":"' + b"x" * 1_000_001 + b'"}\n', "is longer than 1,000,000 bytes"),
        (lambda data: data + b"\n" * 20_001, "has more than 20,000 lines"),
    ],
)
def test_bytes_that_are_no_transcript(entry, check, spoil, message):
    file = entry / "transcripts" / "idle.jsonl"
    file.write_bytes(spoil(file.read_bytes()))
    assert message in only(check())


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data[:-20], "cannot be unpacked"),
        (lambda data: data[:50] + b"????" + data[54:], "cannot be unpacked"),
        (lambda data: gzip.compress(bytes(MOST_BYTES + 1), 9), "is longer than 16,000,000 bytes"),
    ],
)
def test_packed_files_that_are_broken_or_blow_up(entry, check, spoil, message):
    file = entry / "transcripts" / "idle.jsonl"
    data = spoil(gzip.compress(file.read_bytes(), 9))
    file.unlink()
    file.with_name("idle.jsonl.gz").write_bytes(data)
    assert message in only(check())


# What shows only when the matches are played again


def in_the_prompt(old, new):
    def change(row):
        message = row["request"]["messages"][0]
        message["content"] = re.sub(old, new, message["content"])

    return change


def a_reward(by):
    """All rewards of the history, which stand at the end of its lines."""
    return in_the_prompt(_REWARD, lambda of: f"{of[1]}{float(of[2]) + by:.2f}")


def a_path(row):
    if row["waypoints"]:
        row["waypoints"][0][0] += 50


def a_status(row):
    row["status"] = "ok" if row["status"] == "invalid" else "repaired"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (in_the_prompt("Where the reward was", "Where the ally was"), "was recorded with other messages"),
        (in_the_prompt("\n10,", "\n11,"), "was recorded with other messages"),
        (a_reward(0.03), "was recorded with other messages"),
        (a_path, "is changed: its waypoints are not what its text says"),
        (a_status, "is changed: its status are not what its text says"),
    ],
)
def test_a_forged_transcript_is_found_when_it_is_played(suite, entry, check, change, message):
    file = entry / "transcripts" / "idle.jsonl"
    rows = rows_of(file)
    for row in rows:
        change(row)
    write_rows(file, rows)
    assert check() == []
    with pytest.raises(UserError) as caught:
        records_of(entry, suite)
    assert message in str(caught.value)
    assert str(caught.value).startswith("against idle: transcript transcripts/idle.jsonl: seed ")


def test_the_last_digit_of_a_reward_may_be_another_on_another_machine(suite, entry):
    before = records_of(entry, suite)
    file = entry / "transcripts" / "idle.jsonl"
    rows = rows_of(file)
    for row in rows:
        a_reward(0.01)(row)
    write_rows(file, rows)
    assert records_of(entry, suite) == before


def records_of(entry, suite):
    """The matches, played again."""
    return list(part_records(Part("toy", None, "transcripts", recorded=entry), matchups_of([suite])))


def test_a_recorded_model_scores_what_its_comparison_said_and_nobody_is_asked(compared, suite, entry):
    lines = records_of(entry, suite)
    summary = summary_of(lines, suite)
    for name in ("score", "by_rival", "measures"):
        assert getattr(summary, name) == getattr(compared, name)
    assert [line.rounds_sha256 for line in lines] == [line.rounds_sha256 for line in compared.records]
    plans, expected = summary.pooled.plans, compared.pooled.plans
    assert (plans.valid, plans.tokens, plans.useless) == (expected.valid, expected.tokens, expected.useless)
    assert plans.statuses == {"fallback-invalid": 4, "ok": 4, "reasked": 4}


def test_a_planner_of_the_package_scores_what_a_comparison_says(recorded, suite):
    for compared in evaluate(["interceptor", "random"], str(recorded / "mine.yml"), recorded / "plain"):
        part = Part(compared.entry, None, compared.entry)
        own = summary_of(list(part_records(part, matchups_of([suite]))), suite)
        assert (own.score, own.measures) == (compared.score, compared.measures)
        assert (own.pooled.plans.valid, own.pooled.plans.tokens) == (None, None)


@pytest.mark.slow
def test_a_real_server_is_recorded_and_verified_when_it_is_gone(tmp_path):
    """One match of two rounds against one ally."""
    file, text = tmp_path / "short.yml", PLANNER_SUITE.replace("  - {ally: expert}\n", "")
    file.write_text(text.replace("match: 3", "match: 2").replace("matches: 2", "matches: 1"))
    profile = tmp_path / "server.yml"
    profile.write_text("about: short\nresponse_format: json_schema\nseed: true\n")
    with LlamaServer() as server, environment(server.url, server.model):
        evaluate(["llm"], str(file), tmp_path / "real", planner_options={"server": str(profile)})
    entry, suite = enter(tmp_path / "real", tmp_path / "tiny"), load_suite(str(file))
    assert check_transcripts(entry, suite) == []
    plans = summary_of(records_of(entry, suite), suite).pooled.plans
    assert (plans.valid, plans.statuses) == (1, {"ok": suite.rounds})
    assert plans.tokens > 0
