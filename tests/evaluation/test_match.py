"""A match of a planner: its file, going on, being repeated to the bit, and its picture."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

from fpg_bench import make_duel
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.match import replay_match
from fpg_bench.evaluation.match_picture import MOST, draw_match
from fpg_bench.planning import PLANNERS
from fpg_bench.planning.registry import LLM_CONTROLS
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player

from .matching import ROUNDS, SHORT, lines, play, write


def untimed(rows):
    """Rows without what depends on the clock."""
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


@pytest.mark.slow
@pytest.mark.parametrize("planner", [name for name in PLANNERS if name not in LLM_CONTROLS])
def test_a_match_is_repeated_to_the_bit(planner, file):
    played = play(file, planner)
    before = file.read_bytes()
    match, again = replay_match(file)
    assert (match.planner, match.seed, match.rounds) == (planner, 5, ROUNDS)
    assert [x.row for x in again] == [x.row for x in played]
    for x, y in zip(played, again, strict=True):
        assert (x.recording.frames == y.recording.frames).all()
    assert file.read_bytes() == before


def test_the_rounds_are_those_of_the_duel_with_that_planner(file):
    played = play(file, "circle", "expert-spread", "tone")
    duel = make_duel(scenario=dataclasses.replace(SHORT, rounds_per_match=ROUNDS), planner="circle")
    runners = [
        PolicyRunner(side, [as_player(name, side, duel.scenario)], duel.batch)
        for side, name in (("ally", "expert-spread"), ("opponent", "tone"))
    ]
    for index, found in enumerate(played):
        mask = duel.reset(seeds=5 if index == 0 else None)
        for runner in runners:
            runner.begin(mask)
        while not duel.batch.games["truncated"].all():
            duel.step(*(runner.act() for runner in runners))
        assert found.measures == duel.measures(0)
        assert found.row["waypoints"] == duel.plans[0].waypoints.tolist()
        assert found.reward_per_step == duel.measures(0)["opponent_return"] / 32
    assert [row["kind"] for row in lines(file)] == ["run", "round", "round", "round"]


def test_without_a_file_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(play(None)) == ROUNDS
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("torn", ["", '{"kind":"round","se'])
def test_a_stopped_match_goes_on(torn, file, tmp_path):
    def stop(index, played):
        if index == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play(file, progress=stop)
    kept = lines(file)
    assert [row.get("round") for row in kept] == [None, 0, 1]
    with pytest.raises(UserError, match="round 2 is missing"):
        replay_match(file)
    with file.open("a") as end:
        end.write(torn)
    seen = []
    play(file, progress=lambda index, played: seen.append((index, played is None)))
    assert seen == [(index, first) for index in range(ROUNDS) for first in (True, False)]
    assert lines(file)[:3] == kept
    play(tmp_path / "unbroken.jsonl")
    assert untimed(lines(file)) == untimed(lines(tmp_path / "unbroken.jsonl"))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"planner": "circle"}, "planner"),
        ({"ally": "idle"}, "ally"),
        ({"opponent": "tone"}, "opponent"),
        ({"seed": 6}, "seed"),
        ({"rounds": 4}, "rounds"),
        ({"scenario": dataclasses.replace(SHORT, hop_cost=3.0)}, "scenario"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_file_of_another_match_is_refused_and_left(changes, word, file):
    play(file)
    before = file.read_bytes()
    with pytest.raises(UserError, match=f"is another match, {word}.* name another file") as error:
        play(file, **changes)
    assert "\n" not in str(error.value)
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"seed": -1}, "seed"),
        ({"seed": 2.5}, "seed"),
        ({"rounds": 0}, "rounds_per_match"),
        ({"planner": "circel"}, "did you mean 'circle'"),
        ({"ally": "exprt"}, "did you mean 'expert'"),
        ({"planner": "circle", "llm": {"prompt": "paper"}}, "prompt: is for the planner 'llm'"),
    ],
    ids=lambda value: value[:12] if isinstance(value, str) else "",
)
def test_a_wrong_word_writes_nothing(changes, word, file):
    with pytest.raises(UserError, match=word):
        play(file, **changes)
    assert not file.exists()


def changed_digit(rows):
    rows[2]["waypoints"][3][1] += 1e-9


def another_tally(rows):
    rows[3]["ally_return"] = np.nextafter(rows[3]["ally_return"], np.inf)


def another_step(rows):
    rows[1]["steps_sha256"] = "0" * 64


def another_status(rows):
    rows[1]["status"] = "repaired"


def another_ally(rows):
    rows[0]["ally"] = "random"


def another_seed(rows):
    rows[0]["seed"] = 6


def another_rule(rows):
    rows[0]["scenario"]["hop_cost"] = 3.0


def unknown_rule(rows):
    rows[0]["scenario"]["hop_price"] = 3.0


def fewer_rounds(rows):
    rows[0]["rounds"] = 2
    del rows[3]


def no_time(rows):
    rows[2]["seconds"] = "soon"


def lost_middle(rows):
    del rows[2]


def lost_end(rows):
    del rows[3]


def doubled(rows):
    rows.insert(2, rows[1])


def lost_head(rows):
    del rows[0]


@pytest.mark.parametrize(
    ("tamper", "message"),
    [
        (changed_digit, r"round 1 differs: waypoints\[3\]\[1\] is .* in the file, .* now"),
        (another_tally, "round 2 differs: ally_return"),
        (another_step, "round 0 differs: steps_sha256"),
        (another_status, "round 0 differs: status is 'repaired' in the file, 'ok' now"),
        (another_ally, "round 0 differs"),
        (another_seed, "round 0 differs: seed is 5 in the file, 6 now"),
        (another_rule, "its scenario is not the one it was played in"),
        (unknown_rule, "its scenario cannot be played: .*hop_price"),
        (fewer_rounds, "its scenario is not the one it was played in"),
        (no_time, "round 1 differs: seconds is 'soon'"),
        (lost_middle, "round 1 is missing; round 2 is in its place"),
        (lost_end, "round 2 is missing"),
        (doubled, "round 1 is missing; round 0 is in its place"),
        (lost_head, "holds no match"),
    ],
)
def test_a_changed_or_missing_line_is_named(tamper, message, file):
    play(file)
    rows = lines(file)
    tamper(rows)
    write(file, rows)
    with pytest.raises(UserError, match=message) as error:
        replay_match(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", ["", "no rows\n", "[]\n", '{"kind": "run"}\n', '{"suite": "ally-v1"}\n'])
def test_other_files_are_no_matches(content, file):
    file.parent.mkdir()
    file.write_text(content)
    with pytest.raises(UserError, match=str(file)):
        replay_match(file)
    if content:
        with pytest.raises(UserError, match=str(file)):
            play(file)
        assert file.read_text() == content


def test_a_folder_is_no_match_but_holds_one(file):
    play(file)
    with pytest.raises(UserError, match=r"is a folder; name its match\.jsonl"):
        replay_match(file.parent)


def test_a_file_in_which_nothing_was_played_is_begun_anew(file):
    play(file)
    rows = lines(file)
    write(file, rows[:1])
    play(file, "circle")
    assert [row.get("planner", "") for row in lines(file)] == ["circle"] + [""] * ROUNDS


def test_no_file_is_no_match(file):
    with pytest.raises(UserError, match="no such file"):
        replay_match(file)


def test_a_difference_under_other_versions_says_so(file):
    play(file)
    rows = lines(file)
    rows[0]["versions"]["fpg_bench"] = "0.0.1"
    write(file, rows)
    assert replay_match(file)  # other versions alone are no difference
    another_tally(rows)
    write(file, rows)
    with pytest.raises(UserError, match=r"round 2 differs.*; versions\.fpg_bench is '0\.0\.1' in the file"):
        replay_match(file)


def test_a_planner_of_ones_own_by_name(file, tmp_path, monkeypatch):
    (tmp_path / "matches_mine.py").write_text(
        "import numpy as np\nfrom fpg_bench.planning import Plan\n"
        "class Mine:\n"
        "    name, tier = 'mine', 'history'\n"
        "    def plan(self, history, current_position, limits, rng):\n"
        "        return Plan(rng.uniform(0, limits.box_m, (limits.waypoints, 3)), self.name)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    played = play(file, "matches_mine:Mine")
    assert lines(file)[0]["planner"] == "matches_mine:Mine"
    with pytest.raises(UserError, match="would run matches_mine:Mine; if you trust that code, add --allow"):
        replay_match(file)
    again = replay_match(file, allow=["matches_mine:Mine"])[1]
    assert [x.row for x in again] == [x.row for x in played]
    sys.modules.pop("matches_mine")


# The picture


@pytest.mark.slow
@pytest.mark.parametrize(("rounds", "rows"), [(1, 1), (5, 1), (6, 2), (MOST + 7, MOST // 5)])
def test_the_picture_has_a_panel_per_round_and_a_bound(rounds, rows, tmp_path):
    from matplotlib.image import imread

    played = play(None, rounds=rounds)
    draw_match(played, tmp_path / "paths.png", "a match")
    height = imread(tmp_path / "paths.png").shape[0]
    assert height == pytest.approx((3.7 * rows + 0.7) * 110, abs=2)
