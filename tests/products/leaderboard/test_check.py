import os
import subprocess

import pytest
from typer.testing import CliRunner

from fpg_bench.cli.main import app
from fpg_bench.common.errors import UserError
from fpg_bench.products.leaderboard.about import board_name
from fpg_bench.products.leaderboard.cases import board_reader
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.folders import start_board
from fpg_bench.products.leaderboard.playing import suites_of
from fpg_bench.products.leaderboard.submission import admit, notes
from fpg_bench.products.leaderboard.tracks import PUBLIC, TrackSuites
from fpg_bench.products.leaderboard.verification import run_one, verify
from tests.policies import policy, write_seed
from tests.products.leaderboard.entering import enter
from tests.products.leaderboard.making import FIELDS, problems, write_submission

TRAINED = FIELDS["training"]
NOWHERE = "is not inside a leaderboard folder; submit run expects <leaderboard>/submissions/<track>/<name>"
BOMB = "\n".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}' if i else 'x'] * 9)}]" for i in range(12))


def only(folder):
    """Return the only problem of a submission."""
    (line,) = problems(folder)
    assert "\n" not in line
    assert len(line) < 250
    with pytest.raises(UserError) as raised:
        admit(folder)
    assert line in str(raised.value)
    return line


def public_suite(submission):
    """The name of the public suite of a submission's track."""
    return suites_of(submission, TrackSuites())[PUBLIC].name


def test_a_sound_submission_is_read(tmp_path):
    folder = write_submission(tmp_path / "mine", description="two\nlines")
    assert problems(folder) == []
    submission = admit(folder)
    assert (submission.slug, submission.training.seeds) == ("mine", (0, 1))
    assert public_suite(submission) == "ally-v2"
    assert [(p.seed, p.model == policy(p.seed)) for p in submission.policies] == [(0, True), (1, True)]
    before = submission.fingerprint
    (folder / "submission.yaml").write_text("# a remark\n" + (folder / "submission.yaml").read_text())
    assert admit(folder).fingerprint == before
    write_seed(folder / "seed_1", 1, policy(9))
    assert admit(folder).fingerprint != before


def test_what_the_package_ships_is_named_alone(tmp_path):
    script = write_submission(tmp_path / "expert", (), name="expert", training=None, script="expert")
    assert admit(script).script == "expert"
    seeds = {"steps": 3_000_000, "hours": 0, "seeds": [0, 1, 2, 3, 4]}
    zoo = write_submission(tmp_path / "zoo", (), training=seeds, zoo="ally-scripted/ppo")
    assert [p.card.algorithm for p in admit(zoo).policies] == ["ppo"] * 5
    for track, path, name, suite in (
        ("planner", None, "hold", "planner-v1"),
        ("opponent", "pursuit", "tone", "opponent-v2"),
        ("opponent", "learned", "comb", "opponent-learned-v2"),
    ):
        entry = {"name": name, "track": track, "path": path, "training": None, "script": name}
        assert public_suite(admit(write_submission(tmp_path / name, (), **entry))) == suite


def test_players_of_link_have_tables_of_their_own(tmp_path):
    entry = {"name": "tone", "track": "opponent", "training": None, "script": "tone", "scenario": "link"}
    submission = admit(write_submission(tmp_path / "tone", (), path="pursuit", **entry))
    assert (public_suite(submission), submission.board_track.key) == ("opponent-link-v1", "opponent-link")
    flying = only(write_submission(tmp_path / "flying", (), path="learned", **entry))
    assert "path: opponents in link must have the path pursuit" in flying
    assert "lacks 'path'" in only(write_submission(tmp_path / "neither", (), path=None, **entry))
    planner = entry | {"name": "circle", "track": "planner", "script": "circle"}
    assert "scenario: planners play standard" in only(write_submission(tmp_path / "circle", (), **planner))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"name": "Expert"}, "name: 'Expert' is the name of a script"),
        ({"path": "pursuit"}, "path: only allowed for the track opponent, not for ally"),
        ({"runs": 2}, "runs: only allowed for transcripts of a language model"),
        (
            {"training": TRAINED | {"seeds": [0, 1, 5, 7]}},
            "training: seeds: listed but missing: seed_5, seed_7; found: seed_0, seed_1",
        ),
        ({"training": TRAINED | {"seeds": [1]}}, "training: seeds: found but not listed: seed_0"),
        (
            {"training": TRAINED | {"steps": 900}},
            "training: steps: states 900, but agent.json has training_steps 1,000",
        ),
    ],
)
def test_suites_that_do_not_do_are_named(tmp_path, change, line):
    assert line in only(write_submission(tmp_path / "mine", **change))


def test_everything_that_is_wrong_is_said_at_once(tmp_path):
    folder = write_submission(tmp_path / "Mine!", name="", licence=..., track="opponent")
    (folder / "notes.txt").write_text("x")
    os.remove(folder / "seed_1" / "policy.onnx")
    lines = problems(folder)
    for part in ("'Mine!'", "name: expected 1 to 60", "lacks 'licence'", "lacks 'path'", "'notes.txt'"):
        assert any(part in line for line in lines), part
    assert any(line.startswith("seed_0/agent.json: plays the ally") for line in lines)
    assert "seed_1/policy.onnx: is missing" in lines


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (BOMB, "aliases stand for more than 100,000 values"),
        ("a: &a [*a]", "aliases stand for more than"),
        ("a: !!python/object/apply:os.system [id]", "could not determine a constructor"),
        ("a: !!timestamp x", "not valid YAML"),
        ("a: " + "[" * 20_000, "brackets within brackets"),
        ("name: a\nname: b", "the key 'name' stands there twice"),
        ("[1, 2]", "expected a mapping"),
        ("a" * 64_001, "64,001 bytes, at most 64,000"),
    ],
    ids=["bomb", "cycle", "tag", "time", "deep", "twice", "list", "large"],
)
def test_hostile_yaml_is_one_line(tmp_path, text, line):
    folder = write_submission(tmp_path / "mine")
    (folder / "submission.yaml").write_text(text)
    (problem,) = problems(folder)
    assert problem.startswith("submission.yaml: ")
    assert line in problem
    (folder / "submission.yaml").write_bytes(b"\xff\xfe\x00")
    assert "cannot be read" in only(folder)


def test_links_lead_nowhere(tmp_path):
    folder = write_submission(tmp_path / "mine")
    other = write_submission(tmp_path / "other")
    (tmp_path / "link").symlink_to(folder)
    assert only(tmp_path / "link") == "is a link; put the folder itself there"
    (folder / "seed_1" / "policy.onnx").unlink()
    (folder / "seed_1" / "policy.onnx").symlink_to(other / "seed_1" / "policy.onnx")
    assert "seed_1/policy.onnx: is a link; put the file itself there" in problems(folder)
    for path, target in (("seed_1", other / "seed_1"), ("submission.yaml", "/dev/zero")):
        copy = write_submission(tmp_path / f"copy-{path[:4]}")
        subprocess.run(["rm", "-r", str(copy / path)], check=True)
        (copy / path).symlink_to(target)
        assert any(line.startswith(f"{path}: is a link") for line in problems(copy))


def test_files_that_are_too_large_or_no_files_are_not_read(tmp_path):
    folder = write_submission(tmp_path / "mine")
    for name, size in (("policy.onnx", 5_000_001), ("agent.json", 64_001)):
        with (folder / "seed_0" / name).open("wb") as file:
            file.truncate(size)
    (folder / "seed_1" / "agent.json").unlink()
    os.mkfifo(folder / "seed_1" / "agent.json")
    lines = problems(folder)
    assert "seed_1/agent.json: is not a regular file" in lines
    assert "seed_0/policy.onnx: holds 5,000,001 bytes, at most 5,000,000 are allowed" in lines
    assert "seed_0/agent.json: holds 64,001 bytes, at most 64,000 are allowed" in lines


def test_unknown_names_are_strays(tmp_path):
    folder = write_submission(tmp_path / "mine")
    for name in ("seed_01", "seed_x", "..evil", "a\nb"):
        (folder / name).mkdir()
    (folder / "seed_0" / "weights.bin").write_text("x")
    lines = problems(folder)
    assert len(lines) == 5
    assert any(line.endswith("; known: seed_0, seed_1, submission.yaml") for line in lines)
    assert all("is not part of a submission" in line and "\n" not in line for line in lines)
    assert any(line.startswith("seed_0/'weights.bin'") for line in lines)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"script": "os:system"}, "script: unknown 'os:system'"),
        *(
            ({"zoo": name}, f"zoo: the package ships no agents {name!r}")
            for name in ("../../../etc", "ally-scripted/../..", "/etc/passwd", "ally-scripted/pp")
        ),
        ({"script": "expert", "zoo": "ally-scripted/ppo"}, "zoo, script: only one of them"),
        ({"track": "planner", "script": "llm"}, "script: unknown 'llm'"),
        ({"track": "planner", "script": "module:Planner"}, "script: unknown 'module:Planner'"),
        ({"track": "planner", "script": "hold", "zoo": "ally-scripted/ppo"}, "zoo: not allowed for planners"),
        ({"track": "planner"}, "lacks 'runs': number of recordings made, including the submitted one"),
        ({"name": "@SUM(A1)"}, "name: expected printable text that begins with a letter or a digit"),
        ({"algorithm": "=1+2"}, "algorithm: expected printable text that begins with a letter or a digit"),
    ],
)
def test_scripts_and_recordings_that_are_not_there_are_named(tmp_path, change, line):
    folder = write_submission(tmp_path / "mine", (), training=None, **change)
    assert any(line in problem for problem in problems(folder))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"policy_sha256": "0" * 64}, "policy_sha256: does not match policy.onnx"),
        ({"id": "FPG/OpponentVsScripted-v0"}, "plays the opponent"),
        ({"training_seed": 3}, "training_seed: expected 1, as in the folder's name, got 3"),
        ({"actions": "many"}, "actions: expected one of continuous, discrete"),
        ({"algorithm": "=1+2"}, "algorithm: expected printable text that begins with a letter or a digit"),
    ],
)
def test_agents_that_do_not_fit_are_named(tmp_path, change, line):
    folder = write_submission(tmp_path / "mine")
    write_seed(folder / "seed_1", 1, **change)
    problem = only(folder)
    assert problem.startswith("seed_1/agent.json: ")
    assert line in problem


def test_steps_may_end_a_little_after_the_budget_and_lie_between_those_of_the_seeds(tmp_path):
    folder = write_submission(tmp_path / "mine", training=TRAINED | {"steps": 7000})
    write_seed(folder / "seed_1", 1, training_steps=9000)
    assert problems(folder) == []
    write_seed(folder / "seed_1", 1, training_steps=6700)
    assert problems(folder) == []
    write_seed(folder / "seed_1", 1, training_steps=6500)
    assert only(folder).endswith("steps: states 7,000, but agent.json has training_steps 1,000 to 6,500")


def test_steps_may_be_those_that_were_played(tmp_path):
    """Tables show them: whole rollouts, and those of the run that a training started from."""
    folder = write_submission(tmp_path / "mine", training=TRAINED | {"steps": 2048})
    for seed in (0, 1):
        write_seed(folder / f"seed_{seed}", seed, policy(seed), training_steps=1000, steps_done=2048)
    assert problems(folder) == []


def test_a_policy_twice_or_off_the_contract_is_named_with_its_seed(tmp_path):
    folder = write_submission(tmp_path / "mine")
    write_seed(folder / "seed_1", 1, policy(0))
    assert "seed_1: holds the same policy as seed_0; each seed must be a separate training run" in only(
        folder
    )
    write_seed(folder / "seed_1", 1, policy(1)[:200])
    assert only(folder).startswith("seed_1/policy.onnx: is not an ONNX file")


def test_names_are_taken_once_on_a_board(tmp_path):
    board = tmp_path / "submissions" / "ally"
    first = write_submission(board / "mine")
    second = write_submission(board / "other", name="  M1ne ")
    for folder, other in ((first, "other"), (second, "mine")):
        assert f"is the name of {other!r}, too" in problems(folder)[0]
    assert (
        admit(first, board_reader(tmp_path)).slug == "mine"
    )  # nobody's entry is taken off the board by a name
    with pytest.raises(UserError, match="is the name of 'mine', too"):
        admit(second, board_reader(tmp_path))


def test_the_package_s_agents_have_their_own_names_on_the_board_and_nobody_else(tmp_path):
    board = tmp_path / "submissions" / "ally"
    about = {
        "training": {"steps": 6_000_000, "hours": 0, "seeds": [0, 1, 2]},
        "zoo": "ally-champion/ppo-stack8",
    }
    about |= {"name": "PPO, 8 stacked frames (ally champion)", "algorithm": "PPO, 8 stacked frames"}
    shipped = admit(write_submission(board / "ally-champion", (), **about))
    assert board_name(shipped, shipped.slug) == "ally-champion/ppo-stack8"
    assert board_name(shipped, "ally-champion-ppo-stack8-again") == "ally-champion/ppo-stack8 (again)"
    other = write_submission(board / "other", name="Ally-Champi0n/PPO-stack8")
    assert "is the name of 'ally-champion', too" in problems(other)[0]
    assert problems(board / "ally-champion") == []


@pytest.mark.parametrize(
    ("track", "line"),
    [
        ("opponent", "opponent; move it to submissions/ally, or write track: opponent"),
        ("aly", "'aly', which is not a track; move it to submissions/ally"),
    ],
)
def test_a_folder_in_another_track_is_told_where_to_go(tmp_path, track, line):
    lost = write_submission(tmp_path / "submissions" / track / "lost")
    assert problems(lost)[0] == f"submission.yaml: track: states ally, but the folder is in {line}"


def test_notes_tell_of_few_seeds_and_of_other_boards(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "leaderboard/submissions/ally"
    training = TRAINED | {"seeds": [0, 1, 2, 3, 4]}
    assert notes(admit(write_submission(place / "mine", range(5), training=training))) == []
    script = {"training": None, "script": "expert", "name": "expert"}
    assert notes(admit(write_submission(place / "expert", (), **script))) == []
    other = write_submission(tmp_path / "other/submissions/ally/mine", range(5), training=training)
    line = "is not inside leaderboard/submissions; submit run writes its result to other/results"
    assert notes(admit(other)) == [line]
    assert notes(admit(other), "nowhere") == []
    few = write_submission(tmp_path / "mine", (0,), training=TRAINED | {"seeds": [0]})
    assert notes(admit(few)) == [
        "an algorithm of fewer than 5 training seeds has no rank; this one has 1",
        NOWHERE,
    ]


def test_the_verb_says_line_by_line(tmp_path):
    def check(folder):
        done = CliRunner().invoke(app, ["submit", "check", str(folder)])
        return done.exit_code, done.stdout

    folder = write_submission(tmp_path / "mine", name="")
    line = f"{folder}: submission.yaml: name: expected 1 to 60 characters, got 0\n"
    assert check(folder) == (1, line)
    sound = write_submission(tmp_path / "sound")
    few = "note: an algorithm of fewer than 5 training seeds has no rank; this one has 2"
    lines = [few, f"note: {NOWHERE}", "nothing is wrong"]
    assert check(sound) == (0, "".join(f"{sound}: {line}\n" for line in lines))
    assert check(tmp_path / "none")[0] == 1


@pytest.mark.parametrize("name", ["con", "nul", "com1", "index"])
def test_a_name_that_windows_or_the_site_has_already_is_refused(tmp_path, name):
    lines = problems(write_submission(tmp_path / name))
    assert f"the folder's name '{name}': is taken by Windows or by a page of the board" in lines


def test_a_leaderboard_of_ones_own_begins_with_the_entries_of_another(board, in_process, tmp_path):
    enter(board, "ally", "wise", script="expert")
    assert verify(board)[0].is_good
    start_board(tmp_path / "own", board)
    assert run_one(enter(tmp_path / "own", "ally", "still", script="idle")).is_good
    verified = load_entries(tmp_path / "own").verified
    assert [entry.key for entry in verified] == [("ally", "still"), ("ally", "wise")]
