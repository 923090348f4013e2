"""A match of a planner: its file, going on, being repeated to the bit, and its picture."""

from __future__ import annotations

import copy
import dataclasses
import sys

import numpy as np
import pytest

from fpg_bench import make_duel
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.players.planner import PLANNERS, asks_language_model
from fpg_bench.products.planning.match import replay_match

from .matching import ROUNDS, SHORT, lines, play, write


def untimed(rows):
    """Rows without what depends on the clock."""
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


@pytest.mark.slow
@pytest.mark.parametrize("planner", [name for name in PLANNERS if not asks_language_model(name)])
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
    match = make_match(duel, "expert-spread", "tone")
    for index, found in enumerate(played):
        play_round(match, seeds=5 if index == 0 else None)
        assert found.measures == duel.measures(0)
        assert found.row["waypoints"] == duel.plans[0].waypoints.tolist()
        assert found.reward_per_step == duel.measures(0)["opponent_return"] / 32
    assert [row["kind"] for row in lines(file)] == ["run", "round", "round", "round"]


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


def test_a_file_of_another_match_is_refused_and_left(played):
    file, _ = played
    before = file.read_bytes()
    others = {"planner": "circle", "ally": "idle", "opponent": "tone", "seed": 6, "rounds": 4}
    for word, value in (others | {"scenario": dataclasses.replace(SHORT, hop_cost=3.0)}).items():
        with pytest.raises(UserError, match=f"is another match, {word}.* name another file") as error:
            play(file, **{word: value})
        assert "\n" not in str(error.value)
        assert file.read_bytes() == before


def change(number, *keys, value):
    """Return a function that sets one value of a row."""

    def tamper(rows):
        *path, last = keys
        place = rows[number]
        for key in path:
            place = place[key]
        place[last] = value(place[last]) if callable(value) else value

    return tamper


def fewer_rounds(rows):
    rows[0]["rounds"] = 2
    del rows[3]


another_return = change(3, "ally_return", value=lambda old: np.nextafter(old, np.inf))


@pytest.mark.parametrize(
    ("tamper", "message"),
    [
        (
            change(2, "waypoints", 3, 1, value=lambda old: old + 1e-9),
            r"1 differs: waypoints\[3\]\[1\] is .* now",
        ),
        (another_return, "round 2 differs: ally_return"),
        (change(1, "steps_sha256", value="0" * 64), "round 0 differs: steps_sha256"),
        (change(1, "status", value="repaired"), "status is 'repaired' in the file, 'ok' now"),
        (change(0, "ally", value="random"), "round 0 differs"),
        (change(0, "seed", value=6), "round 0 differs: seed is 5 in the file, 6 now"),
        (change(0, "scenario", "hop_cost", value=3.0), "its scenario is not the one it was played in"),
        (lambda rows: rows[0]["scenario"].update(hop_price=3), "its scenario cannot be played: .*hop_price"),
        (fewer_rounds, "its scenario is not the one it was played in"),
        (change(2, "seconds", value="soon"), "round 1 differs: seconds is 'soon'"),
        (lambda rows: rows.pop(2), "round 1 is missing; round 2 is in its place"),
        (lambda rows: rows.pop(3), "round 2 is missing"),
        (lambda rows: rows.insert(2, rows[1]), "round 1 is missing; round 0 is in its place"),
        (lambda rows: rows.pop(0), "holds no match"),
    ],
)
def test_a_changed_or_missing_line_is_named(tamper, message, played):
    file, rows = played
    tamper(rows)
    write(file, rows)
    with pytest.raises(UserError, match=message) as error:
        replay_match(file)
    assert "\n" not in str(error.value)


@pytest.fixture(scope="module")
def rows_of_a_match(tmp_path_factory):
    file = tmp_path_factory.mktemp("match") / "match.jsonl"
    play(file)
    return lines(file)


@pytest.fixture
def played(rows_of_a_match, tmp_path):
    """A match's file to be changed, and its rows."""
    write(tmp_path / "match.jsonl", rows_of_a_match)
    return tmp_path / "match.jsonl", copy.deepcopy(rows_of_a_match)


def test_other_files_are_no_matches(file):
    file.parent.mkdir()
    for content in ("", "no rows\n", "[]\n", '{"kind": "run"}\n', '{"suite": "ally-v1"}\n'):
        file.write_text(content)
        for use in (lambda: replay_match(file), lambda: play(file))[: 2 if content else 1]:
            with pytest.raises(UserError, match=str(file)):
                use()
            assert file.read_text() == content


def test_a_difference_under_other_versions_says_so(played):
    file, rows = played
    rows[0]["versions"]["fpg_bench"] = "0.0.1"
    write(file, rows)
    assert replay_match(file)  # other versions alone are no difference
    another_return(rows)
    write(file, rows)
    with pytest.raises(UserError, match=r"round 2 differs.*; versions\.fpg_bench is '0\.0\.1' in the file"):
        replay_match(file)


def test_a_planner_of_ones_own_by_name(file, tmp_path, monkeypatch):
    (tmp_path / "matches_mine.py").write_text(
        "import numpy as np\nfrom fpg_bench.players.planner import Plan\n"
        "class Mine:\n"
        "    name, tier = 'mine', 'history'\n"
        "    def plan(self, history, current_position, limits, rng):\n"
        "        return Plan(rng.uniform(0, limits.box_m, (limits.waypoints, 3)), self.name)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    played = play(file, "matches_mine:Mine")
    assert lines(file)[0]["planner"] == "matches_mine:Mine"
    with pytest.raises(UserError, match="would run matches_mine:Mine; if you trust it, add --allow"):
        replay_match(file)
    again = replay_match(file, allow=["matches_mine:Mine"])[1]
    assert [x.row for x in again] == [x.row for x in played]
    sys.modules.pop("matches_mine")


# The picture


@pytest.mark.slow
def test_the_picture_has_a_panel_per_round_and_a_bound(tmp_path):
    from matplotlib.image import imread

    pictures = pytest.importorskip("fpg_bench.products.planning.match_picture")
    pictures.draw_match(play(None, rounds=6), tmp_path / "paths.png", "a match")
    height = imread(tmp_path / "paths.png").shape[0]
    assert height == pytest.approx((2.25 * 2 + 0.7) * 200, abs=2)  # two rows
