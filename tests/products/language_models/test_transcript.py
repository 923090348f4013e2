"""The transcript: what is written comes back exactly, and what does not fit is refused by name."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.language_models.transcript import Attempt, RunHeader, Transcript
from tests.programs import held_elsewhere

from .playing import path

ROOT = Path(__file__).parents[3]

BODY = {
    "model": "tiny",
    "messages": [{"role": "user", "content": "At 3,100,200 the reward was 0.25, now plan"}],
    "temperature": 0.7,
    "seed": 5,
}
ATTEMPT = Attempt(
    **{"seed": 1, "match": 2, "round": 3, "attempt": 0, "request": BODY},
    **{"text": "the text \u2028 ü", "error": None, "detail": "", "waypoints": (path() / 3).tolist()},
    **{"rung": "json", "status": "ok", "prompt": "standard", "prompt_hash": "ab12", "control": "none"},
    **{"calls": 2, "seconds": 0.1 + 0.2, "tokens_in": 10, "tokens_out": None, "model": "tiny-v2"},
)
RAW = {
    "model": "tiny-v2",
    "choices": [{"message": {"content": "the text \u2028 ü"}}],
    "usage": {"prompt_tokens": 10},
}


def changed(**fields):
    return ATTEMPT.model_copy(update=fields)


def with_content(text):
    return {**BODY, "messages": [{"role": "user", "content": text}]}


@pytest.fixture
def file(tmp_path):
    return tmp_path / "deep" / "transcript.jsonl"


@pytest.fixture
def recorded(file):
    transcript = Transcript(file, "record")
    transcript.add(ATTEMPT, {"raw": RAW, "versions": {"openai": "3"}})
    transcript.close()
    return file


@pytest.mark.parametrize("mode", ["record", "replay"])
def test_an_attempt_comes_back_to_the_last_bit(recorded, mode):
    assert Transcript(recorded, mode).find(ATTEMPT.where, BODY) == ATTEMPT


def test_a_record_goes_on_after_a_torn_line(file):
    others = [changed(round=number) for number in (4, 5)]
    for attempt in (ATTEMPT, *others):
        transcript = Transcript(file, "record")
        transcript.add(attempt, {"raw": RAW})
        transcript.close()
        with file.open("a") as torn:
            torn.write('{"kind": "att')
    lines = file.read_text().splitlines(keepends=True)[:3]
    file.write_text("".join(lines))
    assert Transcript(file, "replay").attempts() == [ATTEMPT, *others]


def test_what_is_not_there_is_none_in_a_record_and_refused_by_name_in_a_replay(recorded):
    where = (1, 2, 4, 1)
    assert Transcript(recorded, "record").find(where, BODY) is None
    with pytest.raises(UserError, match="seed 1, match 2, round 4, attempt 1 is missing"):
        Transcript(recorded, "replay").find(where, BODY)


@pytest.mark.parametrize(
    ("content", "fits"),
    [
        ("At 3,100,200 the reward was 0.25, now plan", True),
        ("At 3,100,200 the reward was 0.26, now plan", True),
        ("At 3,100,200 the reward was 0.28, now plan", False),
        ("At 3,101,200 the reward was 0.25, now plan", False),
        ("At 3,100,200 the reward was -0.25, now plan", False),
        ("At 3,100,200 the reward was 0.25, 1 now plan", False),
        ("At 3,100,200 the reward is 0.25, now plan", False),
        (f"At 3,100,200 the reward was {'9' * 5000}, now plan", False),
    ],
)
def test_a_request_fits_where_its_text_is_the_same_and_its_numbers_are_near(recorded, content, fits):
    transcript, body = Transcript(recorded, "replay"), {"messages": with_content(content)["messages"]}
    if fits:
        assert transcript.find(ATTEMPT.where, body) == ATTEMPT
    else:
        with pytest.raises(UserError, match=r"seed 1, match 2, round 3, attempt 0 .*other messages"):
            transcript.find(ATTEMPT.where, body)


@pytest.mark.parametrize("change", [{"model": "tiny-2"}, {"temperature": 0.71}])
def test_a_request_to_another_model_does_not_fit(recorded, change):
    with pytest.raises(UserError, match=f"other {next(iter(change))}.*into a new file"):
        Transcript(recorded, "record").find(ATTEMPT.where, {**BODY, **change})


def test_fields_that_a_server_may_refuse_do_not_count(recorded):
    attempt = Transcript(recorded, "record").find(ATTEMPT.where, {**BODY, "seed": 6, "response_format": {}})
    assert attempt == ATTEMPT


@pytest.mark.parametrize("name", ["text", "model", "tokens_in", "tokens_out"])
def test_an_attempt_that_is_not_as_its_raw_reply_says_is_refused(recorded, name):
    line = json.loads(recorded.read_text())
    line[name] = "north" if name in ("text", "model") else 9
    recorded.write_text(json.dumps(line) + "\n")
    with pytest.raises(
        UserError, match=f"match 2, round 3, attempt 0 is changed: its {name} is not what its raw"
    ):
        Transcript(recorded, "replay").attempts()


def test_a_raw_reply_that_was_cut_proves_nothing(recorded):
    line = json.loads(recorded.read_text())
    recorded.write_text(json.dumps({**line, "raw": '{"model": "tin'}) + "\n")
    assert Transcript(recorded, "replay").attempts() == [ATTEMPT]


def test_the_key_is_advice(recorded, caplog):
    recorded.write_text(recorded.read_text().replace(ATTEMPT.key, "0" * 64))
    assert Transcript(recorded, "replay").find(ATTEMPT.where, BODY) == ATTEMPT
    assert "line 1" in caplog.text


def test_the_first_of_two_answers_to_the_same_counts(recorded):
    transcript = Transcript(recorded, "record")
    assert transcript.add(changed(text="another"), {}) == ATTEMPT
    assert len(recorded.read_text().splitlines()) == 1


def test_a_file_that_another_process_writes_is_not_recorded_into(recorded):
    with held_elsewhere(recorded):
        assert Transcript(recorded, "replay").attempts() == [ATTEMPT]
        with pytest.raises(UserError, match="another process is writing there"):
            Transcript(recorded, "record").attempts()


def test_a_packed_transcript_is_replayed_and_never_added_to(tmp_path):
    file = tmp_path / "asked.jsonl"
    recorded = Transcript(file, "record")
    recorded.add(ATTEMPT, {"raw": RAW})
    recorded.close()
    packed = tmp_path / "asked.jsonl.gz"
    packed.write_bytes(gzip.compress(file.read_bytes()))
    assert Transcript(packed, "replay").attempts() == [ATTEMPT]
    with pytest.raises(UserError, match="is packed, and can only be replayed"):
        Transcript(packed, "record")
    packed.write_bytes(packed.read_bytes()[:-9])
    with pytest.raises(UserError, match=r"asked.jsonl.gz: cannot be unpacked"):
        Transcript(packed, "replay").attempts()


@pytest.mark.parametrize(
    "file",
    [*ROOT.glob("results/*/transcripts/*/planner.json"), *ROOT.glob("leaderboard/**/planner.json")],
    ids=lambda file: file.parents[1].name + "/" + file.parent.name,
)
def test_a_header_holds_what_its_file_holds_to_the_letter(file):
    content = json.loads(file.read_text())
    header = RunHeader(**content)
    assert json.dumps(header.to_dict(), sort_keys=True) == json.dumps(content, sort_keys=True)
