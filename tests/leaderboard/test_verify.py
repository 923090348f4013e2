import hashlib
import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.play import LOST_SCORE, play
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.leaderboard.cases import make_case, sampled, work_folder
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.playing import part_records, parts_of
from fpg_bench.leaderboard.tracks import PUBLIC
from fpg_bench.leaderboard.verify import run_one, verify
from fpg_bench.players.agent import OnnxPlayer
from tests.leaderboard.entering import SUITE, close_season, enter, write_suite

pytestmark = pytest.mark.slow

BOARD = Path(__file__).parents[2] / "leaderboard"
RIVALS = ("adaptive/pursuit", "sweep/circle")


def told(board, *names, **how):
    """The verdicts of a board, by name: whether good, and the line."""
    verdicts = verify(board, names, say=lambda record: None, **how)
    return {verdict.name: (verdict.good, verdict.record) for verdict in verdicts}


def result(board, name):
    return board / "results" / f"{name}.jsonl"


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_a_result_is_written_and_holds(board, in_process):
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "linear", seeds=(0, 2))
    first = told(board)
    assert [good for good, _ in first.values()] == [True, True]
    assert first["ally/wise"][1].startswith("verified: known ")
    before = result(board, "ally/linear").read_bytes()
    assert told(board)["ally/linear"] == (True, "holds: 4 of 4 lines played again are the same to the bit")
    assert result(board, "ally/linear").read_bytes() == before
    head, *records = map(json.loads, before.splitlines())
    assert (head["status"], head["summary"]["training_seeds"], head["summary"]["lost"]) == ("verified", 2, 0)
    assert [(record["training_seed"], record["rival"]) for record in records] == [
        (seed, name) for seed in (0, 2) for name in RIVALS
    ]


def test_a_verdict_says_what_an_evaluation_says_to_the_digit(board, in_process, tmp_path):
    """The same policies, once behind the door and once as agents' folders."""
    folder = enter(board, "ally", "linear", seeds=(0, 2))
    told(board)
    agents = [str(folder / f"seed_{seed}") for seed in (0, 2)]
    (found,) = evaluate(agents, "ally-v1", tmp_path / "results", name="linear", say=lambda record: None)
    kept = make_case(board, folder).known
    assert kept.summaries(load_submission(folder).suites)[PUBLIC].records == found.records
    score = kept.head["summary"]["scores"][PUBLIC]
    assert (score["value"], score["low"]) == pytest.approx((found.score.value, found.score.low), rel=1e-5)


def test_a_shipped_agent_plays_behind_the_door_as_it_does_without(board):
    submission = load_submission(BOARD / "submissions/ally/ally-scripted-ppo")
    part = parts_of(submission)[0]
    known = submission.suites[PUBLIC]
    (behind,) = part_records(part, [(known, known.rivals[0])])
    player = OnnxPlayer(part.plays.model, part.plays.about)
    assert behind == play(part.entry(player, known), known, known.rivals[0])


def test_all_suites_of_the_track_are_played(board, small_suites):
    """Before a season all on seeds that everybody knows, and then on the season's."""
    write_suite(small_suites, "ally-shifted-v1", SUITE | {"matches": 2})
    write_suite(small_suites, "ally-responses-v1", SUITE | {"matches": 3})
    folder = enter(board, "ally", "wise", script="expert")
    told(board)
    head, *records = map(json.loads, result(board, "ally/wise").read_text().splitlines())
    assert list(head["summary"]["scores"]) == ["public", "shifted", "responses"]
    assert [len(record["returns"]) for record in records] == [4, 4, 2, 2, 3, 3]
    close_season(small_suites, ally={"matches": 5})
    assert told(board)["ally/wise"] == (
        False,
        f"result {result(board, 'ally/wise')}: of other suites; make it again: "
        f"fpg-bench submit run --update {folder}",
    )
    assert told(board, update=True)["ally/wise"][1].startswith("verified: unseen ")
    head, *records = map(json.loads, result(board, "ally/wise").read_text().splitlines())
    assert list(head["summary"]["scores"]) == ["public", "public-seeds", "unseen", "shifted", "responses"]
    assert len({record["rounds_sha256"] for record in records}) == len(records) == 10
    assert told(board)["ally/wise"][0]


def test_lost_rounds_count_as_the_lowest_return(board, in_process):
    in_process.loses = (1, 3)
    submission = load_submission(enter(board, "ally", "linear", seeds=(0,)))
    assert told(board)["ally/linear"][1].endswith(", 4 of 8 rounds lost by rule")
    known = submission.suites[PUBLIC]
    worst = (known.scale.zero + LOST_SCORE / 100 * (known.scale.top - known.scale.zero)) * 300
    for record in make_case(board, submission.folder).known.records:
        lowest = min(worst, record.returns[0], record.returns[2])
        assert [record.returns[k] for k in (1, 3)] == pytest.approx([lowest] * 2, abs=1e-3)
        assert record.lost == 2


def test_who_loses_all_rounds_is_not_verified(board, in_process):
    in_process.loses = (0, 1, 2, 3)
    enter(board, "ally", "linear", seeds=(0, 1))
    why = "all of its rounds are lost by rule: its answers are no valid actions"
    assert told(board)["ally/linear"] == (False, f"not verified: {why}")
    assert told(board)["ally/linear"] == (True, f"not verified, as before: {why}")


def test_a_policy_that_fails_is_not_verified_and_stops_nobody(board, in_process):
    enter(board, "ally", "linear", seeds=(0, 1))
    enter(board, "ally", "wise", script="expert")
    in_process.fails = True
    found = told(board)
    assert found["ally/linear"] == (False, "not verified: seed_0: took longer than it may")
    assert found["ally/wise"][0]
    head = json.loads(result(board, "ally/linear").read_text())
    assert (head["status"], head["reason"]) == ("not verified", "seed_0: took longer than it may")
    assert told(board)["ally/linear"] == (True, "not verified, as before: seed_0: took longer than it may")
    assert told(board, sample=0.1)["ally/linear"] == (True, "not verified; not part of a sample")
    in_process.fails = False
    good, record = told(board)["ally/linear"]
    assert not good
    assert record.startswith("the result is not verified, but it plays")


def test_a_verified_policy_that_fails_later_is_told(board, in_process):
    enter(board, "ally", "linear", seeds=(0,))
    told(board)
    in_process.fails = True
    before = result(board, "ally/linear").read_bytes()
    assert told(board)["ally/linear"] == (
        False,
        "the result is verified, but now: seed_0: took longer than it may",
    )
    assert result(board, "ally/linear").read_bytes() == before


EDITS = {
    "a return": ('"returns":[', '"returns":[9', "its lines are not those it was written with"),
    "a tally": ('"jammed":', '"jammed":1', "its lines are not those it was written with"),
    "the rounds' hash": ('"rounds_sha256":"', '"rounds_sha256":"0', "its lines are not those it was"),
    "the score": (
        '"scores":{"known":{"value":',
        '"scores":{"known":{"value":9',
        "its summary does not follow",
    ),
    "the worst": ('"against":"adaptive/pursuit"', '"against":"sweep/circle"', "its summary does not follow"),
    "the suites": (
        '"suites":{"known":["ally-v1","',
        '"suites":{"known":["ally-v1","0',
        "of other suites; make",
    ),
    "the protocol": (f'"protocol":"{PROTOCOL}"', '"protocol":"0"', "of another protocol than this version's"),
    "the status": ('"status":"verified"', '"status":"not verified"', "not verified, but with lines or"),
    "a seed": ('"training_seed":null', '"training_seed":"x"', "training_seed: expected a whole number, 0 or more"),
    "the name": ('"slug":"wise"', '"slug":"wiser"', "is the result of ally/wiser"),
    "a number": ('"tally":', '"tally":NaN,"m":', "not lines of JSON: NaN is no number"),
    "all": ('{"kind"', '[{"kind"', "not lines of JSON"),
}


@pytest.mark.parametrize("what", EDITS)
def test_a_result_that_was_edited_is_told_in_a_line(board, what):
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "still", script="idle")
    told(board)
    old, new, record = EDITS[what]
    edit(result(board, "ally/wise"), old, new)
    found = told(board)
    assert not found["ally/wise"][0]
    assert record in found["ally/wise"][1]
    assert "\n" not in found["ally/wise"][1]
    assert found["ally/still"][0]
    assert told(board, update=True)["ally/wise"][1].startswith("verified: known ")
    assert told(board)["ally/wise"][0]


def test_a_forged_result_is_found_by_playing_again(board):
    """Lines, hash and summary fit each other; only the rounds were never played."""
    enter(board, "ally", "still", script="idle")
    enter(board, "ally", "wise", script="expert")
    told(board)
    head, *_ = result(board, "ally/still").read_text().splitlines(keepends=True)
    forged = json.loads(result(board, "ally/wise").read_text().splitlines()[0])
    forged |= {key: json.loads(head)[key] for key in ("slug", "fingerprint")}
    records = "".join(result(board, "ally/wise").read_text().splitlines(keepends=True)[1:])
    records = records.replace('"entry":"wise"', '"entry":"still"')
    forged["lines_sha256"] = hashlib.sha256(records.encode()).hexdigest()
    text = json.dumps(forged, separators=(",", ":")) + "\n" + records
    result(board, "ally/still").write_text(text)
    good, record = told(board, sample=0.5)["ally/still"]
    assert not good
    assert record.startswith("the result does not hold: 100.0 % of ")


def test_a_submission_that_has_changed_wants_a_new_result(board, in_process, monkeypatch):
    folder = enter(board, "ally", "linear", seeds=(0,))
    told(board)
    edit(folder / "submission.yaml", "much", "nothing")
    said = "submission.yaml or a policy changed since this result was made; make it again: "
    said += "fpg-bench submit run --update {}"
    assert told(board)["ally/linear"] == (False, said.format(folder))
    monkeypatch.chdir(board)
    for given in ("submissions/ally/linear", folder):
        verdict = run_one(given, say=lambda record: None)
        assert verdict.record == said.format("submissions/ally/linear")
    assert told(board, update=True)["ally/linear"][0]


def test_other_policies_want_a_new_result(board, in_process):
    folder = enter(board, "ally", "linear", seeds=(0,))
    told(board)
    shutil.rmtree(folder)
    enter(board, "ally", "linear", seeds=(1,))
    assert told(board)["ally/linear"][1].startswith("submission.yaml or a policy changed since")


def test_a_bad_submission_stops_nobody(board):
    (enter(board, "ally", "torn", script="expert") / "submission.yaml").write_text("{")
    enter(board, "ally", "wise", script="expert")
    found = told(board)
    assert not found["ally/torn"][0]
    assert "not valid YAML" in found["ally/torn"][1]
    assert found["ally/wise"][0]
    assert not result(board, "ally/torn").exists()


def test_results_without_a_submission_are_told(board):
    enter(board, "ally", "wise", script="expert")
    told(board)
    (board / "submissions/ally/wise").rename(board / "submissions/ally/wiser")
    found = told(board)
    assert not found["ally/wise"][0]
    assert found["ally/wise"][1].endswith("no such submission")


def test_a_sample_holds_a_line_of_each_and_can_be_drawn_again(board, in_process):
    for slug in ("idle", "expert", "random"):
        enter(board, "ally", f"the-{slug}", script=slug)
    enter(board, "ally", "linear", seeds=(0, 1, 2, 3))
    told(board)
    cases = [make_case(board, folder) for folder in sorted((board / "submissions/ally").iterdir())]

    def drawn(share, seed):
        return [
            [(part.name, matchup[1].name) for part, matchups in case.wanted for matchup in matchups]
            for case in sampled(cases, share, seed)
        ]

    assert [len(records) for records in drawn(0.01, 5)] in ([1, 1, 1, 1],)
    assert sum(map(len, drawn(0.75, 5))) >= 11
    assert sum(map(len, drawn(1, 5))) == 14
    assert drawn(0.3, 5) == drawn(0.3, 5)
    assert len({str(drawn(0.3, seed)) for seed in range(5)}) > 1
    records = []
    verify(board, sample=0.05, say=records.append)
    assert records[0].startswith("sample: 5 % of all lines, --sample-seed ")
    assert all("holds: 1 of 1 lines" in record for record in records[1:])


@pytest.mark.parametrize("share", [0, -0.1, 1.5])
def test_a_sample_of_nothing_is_refused(board, share):
    enter(board, "ally", "wise", script="expert")
    with pytest.raises(UserError, match="sample: expected a share above 0 and at most 100 %"):
        told(board, sample=share)


def test_names_are_looked_up(board, tmp_path):
    enter(board, "ally", "wise", script="expert")
    assert list(told(board, "ally/wise")) == ["ally/wise"]
    with pytest.raises(UserError, match=r"no submission 'ally/wide'.*did you mean 'ally/wise'"):
        told(board, "ally/wide")
    with pytest.raises(UserError, match=r"no submission 'opponent/wise'.*did you mean 'ally/wise'"):
        told(board, "opponent/wise")
    with pytest.raises(UserError, match=r"no submission 'ally/tone'.*; known: ally/wise$"):
        told(board, "ally/tone")
    with pytest.raises(UserError, match="has no folder submissions"):
        told(tmp_path)


def test_one_folder_is_run_where_it_lies(board, tmp_path):
    folder = enter(board, "opponent", "near", script="adaptive")
    verdict = run_one(folder, say=lambda record: None)
    assert (verdict.name, verdict.good) == ("opponent/near", True)
    assert result(board, "opponent/near").exists()
    with pytest.raises(UserError, match="expected a folder <leaderboard>/submissions/"):
        run_one(tmp_path)
    with pytest.raises(UserError, match="did you mean 'opponent'"):
        run_one(board / "submissions/oponent/near")


def test_several_at_once_give_the_same_results(board, monkeypatch):
    for slug in ("idle", "expert", "reactive"):
        enter(board, "ally", f"the-{slug}", script=slug)
    told(board)
    alone = {path.name: path.read_bytes() for path in (board / "results/ally").iterdir()}
    told(board, update=True)
    for path in (board / "results/ally").iterdir():
        path.unlink()
    assert all(good for good, _ in told(board, jobs=2).values())
    assert {path.name: path.read_bytes() for path in (board / "results/ally").iterdir()} == alone


def command(board):
    words = [sys.executable, "-m", "fpg_bench.cli", "submit", "verify", "--folder", str(board)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.process
def test_what_is_killed_goes_on_and_gives_the_same(tmp_path):
    board = tmp_path / "board"
    for slug in ("expert", "reactive"):
        enter(board, "ally", f"the-{slug}", script=slug)
    killed = command(board)
    while not (there := _lines_under_way(board)) and killed.poll() is None:
        time.sleep(0.005)
    killed.kill()
    killed.wait()
    assert killed.returncode == -signal.SIGKILL
    assert not (board / "results").exists() or len(there) < 20
    again = command(board)
    out, _ = again.communicate()
    assert again.returncode == 0, out
    assert out.endswith("2 verdicts, all good\n")
    assert _lines_under_way(board) == []
    files = {path: path.read_bytes() for path in (board / "results/ally").iterdir()}
    assert len(files) == 2
    for path in files:
        path.unlink()
    assert all(good for good, _ in told(board).values())
    assert {path: path.read_bytes() for path in files} == files


def _lines_under_way(board):
    rows = [RowFile(path).read() for path in work_folder(board).rglob("records.jsonl")]
    return [row for each in rows for row in each]
