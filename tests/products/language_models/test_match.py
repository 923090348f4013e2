"""A match of a language model: repeated without it, going on without asking twice, what its file tells."""

from __future__ import annotations

import gc

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.language_models.llm_planner import LLMPlanner
from fpg_bench.products.planning.match import replay_match
from tests.products.language_models.fault_server import FaultServer, error_object, ok, refusal, status
from tests.products.language_models.playing import GOOD, KEY, path_text
from tests.products.planning.matching import SHORT, lines, play, write
from tests.programs import held_elsewhere

BEHAVIOURS = (
    GOOD,
    ok("I would rather not say."),
    ok(path_text(200)),
    status(400),
    refusal(),
    error_object(),
    ok(path_text(600)),
)
STATUSES = ["ok", "reasked", "fallback-http", "fallback-refused", "fallback-http", "ok"]


@pytest.fixture(autouse=True, scope="module")
def no_open_sockets():
    """Planners leave their connections to the garbage collector; other tests make its warnings errors."""
    yield
    gc.collect()


def ask(file, **changes):
    return play(file, "llm", rounds=len(STATUSES), **changes)


def test_a_language_models_match_is_repeated_without_it(asks, file, monkeypatch):
    with FaultServer(BEHAVIOURS) as server:
        asks(server)
        played = ask(file)
        assert len(server.requests) == len(BEHAVIOURS)
    monkeypatch.delenv("FPG_LLM_BASE_URL")
    monkeypatch.delenv("FPG_LLM_MODEL")
    before = file.read_bytes()
    _, again = replay_match(file)
    assert [x.row for x in again] == [x.row for x in played]
    assert [x.row["status"] for x in played] == STATUSES
    assert [x.row["waypoints"][0][0] for x in played] == [100, 300, 300, 300, 300, 700]
    assert file.read_bytes() == before
    assert KEY.encode() not in before


@pytest.mark.parametrize("planner", ["circle", "llm"])
def test_a_match_that_ends_lets_go_of_its_file(planner, asks, file):
    def hold(index, played):
        if index == 1:
            with pytest.raises(BlockingIOError), held_elsewhere(file):
                pass

    with FaultServer([GOOD]) as server:
        asks(server)
        play(file, planner, progress=hold)
    with held_elsewhere(file):
        pass


def attempts(rows):
    return [row for row in rows if row["kind"] == "attempt"]


def reply_raw_and_path_digit(rows):
    """Change a digit wherever the transcript holds it."""
    row = attempts(rows)[0]
    row["text"] = row["text"].replace('"x": 110', '"x": 112')
    row["waypoints"][1][0] = 112.0
    row["raw"]["choices"][0]["message"]["content"] = row["text"]


def another_model(rows):
    rows[0]["llm"]["model"] = "a-better-model"


def lost_attempt(rows):
    rows.remove(attempts(rows)[2])


def test_a_changed_or_missing_attempt_is_named(asks, file):
    with FaultServer(BEHAVIOURS) as server:
        asks(server)
        ask(file)
    for tamper, named in (
        (reply_raw_and_path_digit, "round 0 differs"),
        (another_model, "attempt 0 was recorded with model toy, and not a-better-model"),
        (lost_attempt, "round 1, attempt 1 is missing"),
    ):
        rows = lines(file)
        tamper(rows)
        write(file.with_name("changed.jsonl"), rows)
        with pytest.raises(UserError, match=named):
            replay_match(file.with_name("changed.jsonl"))


def test_the_file_holds_a_prompt_of_ones_own(asks, file, tmp_path):
    prompt = tmp_path / "mine.yml"
    prompt.write_text(
        "about: mine\nuser: 'Fly from ($x, $y, $z). $history'\nrow: '$x $y $z $reward'\n"
        "rounds: {first: 1, best: 1, latest: 1}\n"
    )
    with FaultServer([GOOD]) as server:
        asks(server)
        play(file, "llm-no-history", llm={"prompt": str(prompt)})
        text = server.requests[-1].body["messages"][-1]["content"]
        assert text.startswith("Fly from (")
    prompt.unlink()
    match, _ = replay_match(file)
    assert match.planner == "llm-no-history"
    rows = lines(file)
    rows[0]["llm"]["prompt"]["user"] = "Fly! $history"
    write(file, rows)
    with pytest.raises(UserError, match="its prompt is not the one that was recorded"):
        replay_match(file)
    for broken in ({**rows[0]["llm"], "prompt": {}}, {**rows[0]["llm"], "prompt": 3}, {}, None, "llm"):
        write(file, [{**rows[0], "llm": broken}, *rows[1:]])
        with pytest.raises(UserError, match="lacks the prompt"):
            replay_match(file)


def test_a_planner_whose_file_would_not_tell_all_is_refused(asks, file):
    with FaultServer(BEHAVIOURS) as server:
        asks(server)
        planner = LLMPlanner(SHORT)
        with pytest.raises(UserError, match="name it 'llm'"):
            play(file, planner)
        assert play(None, planner, rounds=1)[0].row["status"] == "ok"
