"""Best responses to a small board's entries: rows, agents and suites, made once."""

import importlib.util
import json
import sys

import pytest

from fpg_bench.common.ids import SCRIPTED
from fpg_bench.evaluation.suite import identity, load_suite
from fpg_bench.game.scenario import STANDARD, as_scenario
from fpg_bench.players.agent import read_card, suites_folder
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.tracks import RESPONSES, SCENARIOS, TRACKS, TrackSuites
from fpg_bench.products.leaderboard.verification import verify
from fpg_bench.products.league.evaluation import evaluate_against
from tests.products.leaderboard.entering import enter
from tests.programs import ROOT

pytestmark = pytest.mark.slow

SCRIPT = ROOT / "scripts" / "train_best_responses.py"


@pytest.fixture
def module(monkeypatch):
    """The script."""
    spec = importlib.util.spec_from_file_location("train_best_responses", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "train_best_responses", module)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def script(module, board, in_process, tmp_path, monkeypatch):
    """The script's main on a board of an ally of two training seeds, an opponent, and scripts."""
    monkeypatch.setattr(module, "run_jobs", lambda jobs, workers: run(jobs))
    monkeypatch.setattr(module, "ROWS_ALONE", ())
    call = {"algorithm": "ppo", "steps": 400, "n_seeds": 2}
    monkeypatch.setattr(module, "SEARCH", {"standard": (call,), "link": (call | {"n_seeds": 1},)})
    monkeypatch.setattr(module, "SPITE", module.SPITE | {"algorithm": "ppo", "steps": 400})
    enter(board, "ally", "linear", seeds=(3, 1))
    enter(board, "ally", "wise", script="expert")
    enter(board, "opponent", "flying", seeds=(5,), path="learned")

    def call(*words):
        monkeypatch.setattr(
            sys, "argv", ["train_best_responses.py", "--board", str(board), "--runs", str(tmp_path), *words]
        )
        return module.main()

    return call


def run(jobs):
    """All that is not done yet, in this process."""
    for job in jobs:
        if not job.done():
            print(f"{job.name}: begins")
            job.keep(job.run())
    return {}


def rows_of(board):
    return list(map(json.loads, (board / "results/best_responses.jsonl").read_text().splitlines()))


def split(rows):
    """Rows of scripts and rows of trained responses."""
    return [
        [row for row in rows if (row["algorithm"] == "script") == is_script] for is_script in (True, False)
    ]


def test_responses_become_rows_agents_and_suites_and_are_made_once(script, board, small_suites, capsys):
    def begun(*words):
        capsys.readouterr()
        assert script(*words) == 0
        return [line for line in capsys.readouterr().out.splitlines() if "begins" in line]

    both = "ally/linear", "opponent/flying"
    assert begun("ally/linear") == ["ally/linear: begins"]
    assert begun(*both) == ["opponent/flying: begins"]
    assert begun(*both) == []
    scripts, rows = split(rows_of(board))
    assert [(row["slug"], row["reward"]) for row in scripts] == [("linear", "zero_sum"), ("flying", "own")]
    against = {
        name: evaluate_against(rows[0]["agent"], {name: name}, "ally", STANDARD, 100).reward.value
        for name in SCRIPTED["opponent"]
    }
    assert scripts[0]["script"] == min(against, key=lambda name: against[name])
    assert scripts[0]["return"] == pytest.approx(min(against.values()), abs=1e-4)
    keys = "track", "slug", "steps", "actions", "training_seed", "reward"
    assert [tuple(row.get(key) for key in keys) for row in rows] == [
        ("ally", "linear", 400, None, 0, "zero_sum"),
        ("ally", "linear", 400, None, 1, "zero_sum"),
        ("opponent-learned", "flying", 400, None, 0, "own"),
        ("opponent-learned", "flying", 400, None, 1, "own"),
        ("opponent-learned", "flying", 400, "discrete", 0, "zero_sum"),
    ]
    assert all(row["agent"].endswith("seed_1") for row in rows[:2])
    assert all(0 <= row["jammed"] <= 1 and row["seconds"] > 0 for row in rows)
    strongest = min(rows[:2], key=lambda row: row["return"])
    about = json.loads((small_suites / "suites/responses-v2/ally/linear/agent.json").read_text())
    assert about["training_seed"] == strongest["training_seed"]
    suite, public = load_suite("ally-responses-v2"), TrackSuites().public(TRACKS["ally"])
    assert suite == TrackSuites().of(TRACKS["ally"])["responses"]
    (met,) = suite.rivals
    assert (met.name, met.players) == ("response to linear", ("responses-v2/ally/linear",))
    assert (met.scenario.opponent_path, suite.scale) == ("pursuit", public.scale)
    assert len(identity(met.players[0])) == 64
    (other,) = load_suite("opponent-learned-responses-v2").rivals
    assert other.scenario.opponent_path == "learned"
    assert not (small_suites / "suites/opponent-responses-v2.yml").exists()
    (verdict,) = verify(board, ["ally/wise"])  # all meet the strongest
    assert verdict.is_good
    _, *lines = map(json.loads, (board / "results/ally/wise.jsonl").read_text().splitlines())
    assert [line["rival"] for line in lines if line["suite"] == suite.name] == ["response to linear"]


def test_entries_of_link_have_a_search_suites_and_tables_of_their_own(
    script, module, board, small_suites, monkeypatch, capsys
):
    names = ("ally/linear", "ally/radio", "opponent/radio")
    enter(board, "ally", "radio", seeds=(4,), scenario="link")
    enter(board, "opponent", "radio", seeds=(6,), scenario="link")
    enter(board, "ally", "wise-link", script="expert", scenario="link")
    assert script(*names) == 0
    scripts, rows = split(rows_of(board))
    assert [(row["track"], row["slug"], row["reward"]) for row in rows] == [
        *[("ally", "linear", "zero_sum")] * 2,
        ("ally-link", "radio", "zero_sum"),
        ("opponent-link", "radio", "own"),
        ("opponent-link", "radio", "zero_sum"),
    ]
    link = as_scenario("link")
    for row, side in zip(scripts[1:], ("ally", "opponent"), strict=True):
        met = {row["script"]: row["script"]}
        in_link = evaluate_against(row["agent"], met, side, link, 100).reward.value
        assert row["return"] == pytest.approx(in_link, abs=1e-4)
        suites = TrackSuites().of(TRACKS[f"{side}-link"])
        assert (suites["responses"].name, suites["responses"].scenario) == (f"{side}-link-responses-v1", link)
        (rival,) = suites["responses"].rivals
        assert (rival.name, rival.players) == ("response to radio", (f"responses-link-v1/{side}/radio",))
        assert suites["responses"].scale == suites["public"].scale
        card = read_card(rival.players[0])
        assert (card.game.scenario, card.game.path) == ("link", ("pursuit",))
        assert card.command == f"python scripts/train_best_responses.py {side}/radio"
    assert [rival.name for rival in load_suite("ally-responses-v2").rivals] == ["response to linear"]
    assert not list((small_suites / "suites").glob("opponent-*responses-v2.yml"))
    (verdict,) = verify(board, ["ally/wise-link"])
    assert verdict.is_good
    (track,) = (track for track in make_board(load_entries(board)).tracks if track.key == "ally-link")
    ((_, figures),) = track.verified()
    ((name, score),) = figures.by_rival["responses"].items()
    assert (name, figures.worst.score.value <= score.value) == ("response to radio", True)
    monkeypatch.setattr(module, "TARGETS", names)
    capsys.readouterr()
    script("--table")
    linear, ally, opponent = (text.splitlines() for text in capsys.readouterr().out.split("\n\n"))
    assert linear[0] == ally[0] == "| entry | strongest script | ppo, 400 steps | lowest known |"
    assert [text[-1].split()[1] for text in (linear, ally, opponent)] == ["`linear`", *["`radio`"] * 2]
    assert len(opponent) == len(ally) == 3


def test_the_published_suites_are_those_that_follow_from_the_board(module, monkeypatch):
    written = {}
    monkeypatch.setattr(module, "write_whole", lambda path, text: written.update({path: text}))
    paths = list(module.write_suites(ROOT / "leaderboard"))
    current = [suites_folder() / f"{track.suite_name(RESPONSES)}.yml" for track in TRACKS.values()]
    assert paths == [path for path in current if path.exists()]
    assert written == {path: path.read_text() for path in paths}


def test_each_scenario_of_the_board_has_a_search_and_targets(module):
    assert tuple(module.SEARCH) == SCENARIOS
    of = {target.track.scenario for target in module.targets(ROOT / "leaderboard", module.TARGETS)}
    assert of == set(SCENARIOS)


def test_a_stronger_response_of_an_earlier_search_stays(
    script, module, board, small_suites, monkeypatch, capsys
):
    monkeypatch.setattr(module, "TARGETS", ("ally/linear",))
    script("ally/linear")
    policy = small_suites / "suites/responses-v2/ally/linear/policy.onnx"
    stronger = split(rows_of(board))[1][0] | {"steps": 800, "return": -100.0, "seconds": 90.0}
    (board / "results/best_responses.jsonl").write_text(json.dumps(stronger) + "\n")
    policy.write_bytes(b"stronger")
    script("ally/linear")
    assert policy.read_bytes() == b"stronger"
    assert [row["steps"] for row in split(rows_of(board))[1]] == [800, 400, 400]
    capsys.readouterr()
    script("--table")
    head, _, line = capsys.readouterr().out.splitlines()[:3]
    assert head == "| entry | strongest script | ppo, 800 steps | ppo, 400 steps | lowest known |"
    assert "| -100.0 (1.5) | -" in line


def test_responses_to_later_champions_are_rows_and_no_rivals(
    script, module, board, small_suites, monkeypatch
):
    monkeypatch.setattr(module, "ROWS_ALONE", ("ally/linear",))
    script("ally/linear")
    assert len(split(rows_of(board))[1]) == 2
    assert not (small_suites / "suites/responses-v2/ally/linear").exists()
    assert not any(small_suites.glob("suites/ally-responses-*"))
    (target,) = module.targets(board, ("ally/linear",))
    assert target.is_done(module.RowFile(board / "results/best_responses.jsonl"))


def test_a_published_response_names_no_path_of_this_machine(
    script, module, small_suites, tmp_path, monkeypatch
):
    kind = {"algorithm": "ppo", "steps": 400, "n_seeds": 1}
    pupil = kind | {"start": "strongest", "actions": "discrete"}
    monkeypatch.setattr(module, "SEARCH", {"standard": (kind, pupil)})
    monkeypatch.setattr(
        "fpg_bench.products.league.best_responses._strongest_player",
        lambda result, out: str(out / "nothing-ppo-400/seed_0/agent"),
    )
    keep = module.keep

    def keep_the_pupil(*given):
        *others, rows = given
        keep(*others, [row | {"return": -99.0} if row.get("start") == "strongest" else row for row in rows])

    monkeypatch.setattr(module, "keep", keep_the_pupil)
    script("ally/linear")
    text = (small_suites / "suites/responses-v2/ally/linear/agent.json").read_text()
    teacher = json.loads(text)["hyperparameters"]["imitate"]["teacher"]
    assert teacher == "nothing-ppo-400/seed_0"
    assert str(tmp_path / "ally") not in text  # the folder of its runs


def test_the_table_has_the_lowest_return_of_each_kind_and_of_all(
    script, module, board, small_suites, monkeypatch, capsys
):
    monkeypatch.setattr(module, "TARGETS", ("ally/linear", "opponent/flying"))
    script("ally/linear")
    capsys.readouterr()
    script("--table")
    head, _, line, *opponents = capsys.readouterr().out.splitlines()
    assert head == "| entry | strongest script | ppo, 400 steps | lowest known |"
    (met,), responses = split(rows_of(board))
    by_script, strongest = f"{met['return']:.1f}", min(responses, key=lambda row: row["return"])
    lowest = f"{strongest['return']:.1f} ({strongest['seconds'] / 60:.1f})"
    known = min((met, *responses), key=lambda row: row["return"])["return"]
    assert line == f"| `linear` | {by_script} (`{met['script']}`) | {lowest} | **{known:.1f}** |"
    assert opponents[-1] == "| `flying` | - | - | - | - |"
    keep = module.keep

    def keep_much_spite(*given):
        *others, rows = given
        spite = {"return": -99.0, "seconds": 90.0}
        keep(*others, [row | spite if row["reward"] == "zero_sum" else row for row in rows])

    monkeypatch.setattr(module, "keep", keep_much_spite)
    script("opponent/flying")
    about = json.loads((small_suites / "suites/responses-v2/opponent/flying/agent.json").read_text())
    assert about["game"]["reward"] == "own"
    capsys.readouterr()
    script("--table")
    head, _, line = capsys.readouterr().out.splitlines()[-3:]
    assert head.endswith("| ppo, 400 steps | paid for the loss: ppo discrete, 400 steps | lowest known |")
    rows = [row for row in rows_of(board) if row["slug"] == "flying" and row["reward"] == "own"]
    assert line.endswith(f"| -99.0 (1.5) | **{min(row['return'] for row in rows):.1f}** |")
