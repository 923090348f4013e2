"""Planners side by side, from a suite's file to the table; language models on loopback, then replayed."""

import csv
import json
import shutil
from collections import Counter

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.evaluate import evaluate, read_results
from fpg_bench.evaluation.table import write_table
from tests.products.language_models.fault_server import FaultServer, answer, ok

MATCHES, ROUNDS, ALLIES = 2, 3, ("idle", "expert")
PLANS = MATCHES * ROUNDS * len(ALLIES)
CHASER = """\
from fpg_bench.players.planner import Plan

class Chaser:
    name, tier = "chaser", "ally"

    def plan_batch(self, requests):
        due = [r.limits.due_s().astype(int) for r in requests]
        return [Plan(r.ally_path[at], "chaser") for r, at in zip(requests, due)]
"""
SUITE = f"""\
side: planner
scenario: short.yml
rounds_per_match: {ROUNDS}
matches: {MATCHES}
opponent: adaptive
last_rounds: 2
scale: {{zero: 5.0, top: 30.0}}
rivals: [{", ".join(f"{{ally: {ally}}}" for ally in ALLIES)}]
"""
PATH = json.dumps({"waypoints": [{"x": 700, "y": 40 * k, "z": 300} for k in range(16)]})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "chasing.py").write_text(CHASER)
    (tmp_path / "mine.yml").write_text(SUITE)
    (tmp_path / "short.yml").write_text("steps_per_round: 64\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def records_of(folder, planner):
    """Its lines, without its name and the seconds that planning took."""
    records = [row for row in RowFile(folder / "records.jsonl").read() if row["entry"] == planner]
    for record in records:
        del record["entry"]
        del record["plans"]["seconds"]
    return records


def first_round_only(body):
    """A model that plans each match's first round, and only talks in the others."""
    return "I would rather fly a loop." if "\nRound " in body["messages"][0]["content"] else PATH


# Planners that ask nobody


def test_planners_side_by_side_and_their_table(folder):
    found = evaluate(["hold", "circle", "chasing:Chaser"], "mine.yml", "out")
    assert {s.entry for s in found} == {"chasing:Chaser", "hold", "circle"}
    assert found[0].entry == "chasing:Chaser"
    again, suite = read_results("out")
    assert [s.records for s in again] == [s.records for s in found]
    write_table(found, suite, folder / "out")
    text = (folder / "out" / "table.md").read_text()
    assert text.splitlines()[0].startswith(
        "| planner | score last 2 | 95 % interval | rank | from the first | overlap ratio % | jamming "
    )
    assert text.splitlines()[2].startswith("| chasing:Chaser | ")
    best, *others = csv.DictReader((folder / "out" / "table.csv").open())
    assert (best["valid"], best["tokens"]) == ("", "")
    assert {f"return_per_step {ally}" for ally in ALLIES} <= best.keys()
    assert {f"round_{k}_low" for k in range(1, ROUNDS + 1)} <= best.keys()
    assert len(others) == 2
    assert (folder / "out" / "table.png").read_bytes().startswith(b"\x89PNG")


def test_all_are_those_that_ask_no_language_model(folder, monkeypatch):
    known = ("circle", "random", "hold", "llm", "llm-no-history")
    monkeypatch.setattr("fpg_bench.evaluation.entry.PLANNERS", known)
    found = evaluate(["all-scripted", "circle"], "mine.yml", "out")
    assert {s.entry for s in found} == {"circle", "random", "hold"}


# Language models


def test_a_language_model_is_recorded_and_replayed_without_a_server(folder, asks):
    with FaultServer([answer(first_round_only)]) as server:
        asks(server)
        evaluate(["llm"], "mine.yml", "out", planner_options={"concurrency": 1})
    options = {"concurrency": 1}
    found = {s.entry: s for s in evaluate(["llm", "hold"], "mine.yml", "out", planner_options=options)}
    assert found["llm"].pooled.plans.valid == pytest.approx(1 / ROUNDS)
    assert found["llm"].pooled.plans.tokens > 0
    assert found["hold"].pooled.plans.valid is None

    shutil.copytree(folder / "out" / "transcripts" / "llm", folder / "kept" / "toy-model")
    (replayed,) = evaluate([], "mine.yml", "again", planner_options={"transcripts": "kept"})
    assert (replayed.entry, replayed.score) == ("toy-model", found["llm"].score)
    assert records_of(folder / "again", "toy-model") == records_of(folder / "out", "llm")


def test_temperature_and_sampling_seed_are_asked_for_told_and_kept_to(folder, asks):
    (folder / "server.yml").write_text("about: short\nseed: true\n")
    with FaultServer([ok(PATH)]) as server:
        asks(server)
        for out, more in (("usual", {}), ("cold", {"temperature": 0.0}), ("other", {"sampling_seed": 1})):
            evaluate(["llm"], "mine.yml", out, planner_options=dict(server="server.yml", **more))
        bodies = [received.body for received in server.requests]
        usual, cold, other = (bodies[k : k + PLANS] for k in range(0, 3 * PLANS, PLANS))
        with pytest.raises(UserError, match="holds records of another 'llm'"):
            evaluate(["llm"], "mine.yml", "cold")
        (folder / "cold" / "records.jsonl").unlink()
        with pytest.raises(UserError, match=r"recorded with temperature 0\.0, not 0\.7; choose another"):
            evaluate(["llm"], "mine.yml", "cold")
        with pytest.raises(UserError, match=r"temperature: expected a number from 0 to 2, got 3"):
            evaluate(["llm"], "mine.yml", "hot", planner_options={"temperature": 3})
    assert {body["temperature"] for body in cold} == {0.0}
    assert {body["temperature"] for body in usual + other} == {0.7}
    assert [body["seed"] for body in cold] == [body["seed"] for body in usual]
    assert not {body["seed"] for body in other} & {body["seed"] for body in usual}
    told = read_json(folder / "other" / "transcripts" / "llm" / "planner.json", "told")
    assert (told["temperature"], told["sampling_seed"]) == (0.7, 1)
    (replayed,) = evaluate([], "mine.yml", "again", planner_options={"transcripts": "other/transcripts"})
    assert replayed.pooled.plans.valid_but_useless == pytest.approx(1 - 1 / ROUNDS)  # all but each first
    (record, *_) = RowFile(folder / "again" / "records.jsonl").read()
    assert record["plans"]["useless"] == {"repeated": MATCHES * (ROUNDS - 1)}


def test_a_stopped_run_goes_on_calls_nothing_twice_and_keeps_its_cap(folder, asks):
    class Stop(Exception):
        pass

    def stop(who, ally, rounds, *of):
        if (ally.name, rounds) == ("expert", 2):
            raise Stop

    options = {"planner_options": {"calls": PLANS - 1}}  # of all allies together
    with FaultServer([ok(PATH)]) as server:
        asks(server)
        with pytest.raises(Stop):
            evaluate(["llm"], "mine.yml", "out", progress=stop, **options)
        assert len(server.requests) == PLANS - MATCHES
        evaluate(["llm"], "mine.yml", "out", **options)
        assert len(server.requests) == PLANS - 1
    records = records_of(folder / "out", "llm")
    statuses = sum((Counter(record["plans"]["statuses"]) for record in records), Counter())
    assert statuses == {"ok": PLANS - 1, "fallback-budget": 1}


def test_controls_and_prompts_of_ones_own_are_recorded_as_such(folder, asks):
    from fpg_bench.products.language_models.prompts import prompt_file

    (folder / "mine-prompt.yml").write_bytes(prompt_file("paper").read_bytes())
    with FaultServer([answer(lambda body: PATH)]) as server:
        asks(server)
        evaluate(["llm-no-history"], "mine.yml", "out", planner_options={"prompt": "mine-prompt.yml"})
        texts = {json.dumps(request.body["messages"]) for request in server.requests}
    assert len(texts) == MATCHES  # nothing that a round or an ally showed: the match's start alone
    (folder / "mine-prompt.yml").unlink()
    found = evaluate([], "mine.yml", "again", planner_options={"transcripts": "out/transcripts"})
    assert "llm-no-history" in {s.entry for s in found}


def test_folders_without_transcripts_and_names_that_stand_for_two_are_refused(folder, asks):
    (folder / "kept").mkdir()
    with pytest.raises(UserError, match="hold no planner"):
        evaluate([], "mine.yml", "out", planner_options={"transcripts": "kept"})
    with FaultServer([ok(PATH)]) as server:
        asks(server)
        evaluate(["llm"], "mine.yml", "out")
        for planners, name, message in (
            ([], "circle", "a planner of the package has this name"),
            (["llm"], "llm", "llm: another planner here has this name; rename"),
            (["chasing:Chaser"], "chasing:Chaser", "chasing:Chaser: another planner here has this name"),
        ):
            shutil.copytree(folder / "out/transcripts/llm", folder / "kept" / name)
            with pytest.raises(UserError, match=message):
                evaluate(planners, "mine.yml", "more", planner_options={"transcripts": "kept"})
            shutil.rmtree(folder / "kept")
        assert len(server.requests) == PLANS
    with pytest.raises(UserError, match=r"another suite, 'mine' with 2 matches per ally; .* and --matches"):
        evaluate([], "mine.yml", "more", matches=3, planner_options={"transcripts": "out/transcripts"})


def test_a_model_without_a_valid_plan_against_an_ally_has_no_score(folder, asks):
    with FaultServer([ok("To the north.")]) as server:
        asks(server)
        with pytest.raises(UserError, match=r"idle: none of 6 plans is valid, .*\(6 times: no points found"):
            evaluate(["llm"], "mine.yml", "out")
    assert not (folder / "out" / "records.jsonl").exists()


@pytest.mark.parametrize("planner", ["circle", "llm"])
def test_a_folder_of_other_files_is_left_alone(folder, asks, planner):
    (folder / "out").mkdir()
    (folder / "out" / "notes.txt").write_text("mine")
    with FaultServer([ok(PATH)]) as server:
        asks(server)
        with pytest.raises(UserError, match="out: holds other files, but no results; choose another"):
            evaluate([planner], "mine.yml", "out")
    assert [path.name for path in (folder / "out").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("transcripts", [{}, {"transcripts": "out/transcripts"}])
def test_options_of_a_language_model_need_one(folder, transcripts):
    with pytest.raises(UserError, match=r"^prompt: is for the planners llm, .*; name one of them"):
        evaluate(["circle"], "mine.yml", "out", planner_options={"prompt": "paper"} | transcripts)
    assert not (folder / "out").exists()


def test_transcripts_that_were_changed_are_refused(folder, asks):
    with FaultServer([ok(PATH)]) as server:
        asks(server)
        evaluate(["llm"], "mine.yml", "out", planner_options={"prompt": "paper"})
    for name, old, new, message in (
        ("planner.json", '"toy"', '"huge"', "with model toy, and not huge as its header says"),
        ("prompt.yml", "UAV", "UFO", r"its prompt.yml is not the prompt that was recorded"),
        ("idle.jsonl", '"control":"none"', '"control":"no-history"', "with control no-history, and not none"),
    ):
        file = folder / "out/transcripts/llm" / name
        text = file.read_text()
        assert old in text
        file.write_text(text.replace(old, new))
        with pytest.raises(UserError, match=message):
            evaluate([], "mine.yml", "again", planner_options={"transcripts": "out/transcripts"})
        file.write_text(text)
