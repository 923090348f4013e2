"""The replay page, and watching a pairing as text or as a file."""

import dataclasses
import json
import re

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.rendering.recording import Recording
from fpg_bench.products.rendering.replay import FORMAT, write_replay
from fpg_bench.products.rendering.watching import watch

SHORT = Scenario(steps_per_round=24, waypoints=4)
HOSTILE = '</script><script>alert("1")</script> {{data}} & <!-- \u2028'


@pytest.fixture
def recording():
    duel = make_duel(scenario=SHORT, planner="circle")
    duel.reset(seeds=2**62)
    kept = Recording(duel.batch)
    rng = np.random.default_rng(0)
    for _ in range(24):
        duel.batch.step(*rng.uniform(-1, 1, (2, 1, 9)))
        kept.add()
    return kept


def embedded(page):
    """The data in a page, as a browser reads them: up to the first end of the element."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script', page, re.S)[1])


def test_the_page_holds_the_rounds_step_by_step(recording, tmp_path):
    write_replay([recording, recording], tmp_path / "replay.html", "A title", ally="a", opponent="o")
    data = embedded((tmp_path / "replay.html").read_text())
    assert (data["format"], data["title"], data["ally"], data["opponent"]) == (FORMAT, "A title", "a", "o")
    assert [kind["name"] for kind in data["scenario"]["jamming"]] == list(JAMMING_TYPES)
    assert data["scenario"]["jamming"][3]["spacing_mhz"] == pytest.approx(400 / 14, abs=1e-4)
    first, _ = data["rounds"]
    assert (first["seed"], first["path"], np.shape(first["waypoints"])) == (str(2**62), "waypoints", (4, 3))
    steps, frames = first["steps"], recording.frames
    assert {len(column) for column in steps.values()} == {25}
    np.testing.assert_allclose(steps["opponent"], frames["opponent_position"], atol=0.051)
    np.testing.assert_allclose(steps["snr"], frames["snr_db"], atol=0.0051)
    np.testing.assert_allclose(steps["ally_reward"], frames["ally_reward"], atol=0.0051)
    assert steps["type"] == frames["jamming_type"].tolist()
    assert np.count_nonzero(steps["check"]) == frames["checked"].sum()


def test_no_text_becomes_markup_or_code_and_no_network_is_needed(recording, tmp_path):
    write_replay([recording], tmp_path / "replay.html", HOSTILE, ally=HOSTILE)
    page = (tmp_path / "replay.html").read_text(encoding="utf-8")
    assert page.count("<script") == 2
    assert page.count("</script>") == 2
    data = embedded(page)
    assert data["title"] == data["ally"] == HOSTILE
    assert "innerHTML" not in page
    assert "default-src 'none'" in page
    assert not re.search(r"https?:|src=|@import|url\(", page)


def test_watching_prints_every_step_and_the_measures(capsys):
    (measures,) = watch("expert-spread", "adaptive", scenario=SHORT, seed=3)
    lines = capsys.readouterr().out.splitlines()
    steps = [line for line in lines if re.match(r" *\d+ ", line)]
    assert [int(line.split()[0]) for line in steps] == list(range(1, 25))
    assert len({len(line) for line in steps}) == 1
    assert "expert-spread against adaptive" in lines[0]
    assert f"jamming success rate {measures['jamming_success_rate']:.1%}" in lines[-1]
    returns = sum(float(line.split()[-2]) for line in steps)
    assert returns == pytest.approx(measures["ally_return"], abs=0.2)


def test_watching_can_leave_lines_out_and_a_seed_shows_the_same_game(capsys):
    printed = []
    for _ in range(2):
        watch("random", "random", scenario=SHORT, path="circle", seed=9, every=10, rounds=2)
        printed.append(capsys.readouterr().out)
    steps = re.findall(r"^ *(\d+) ", printed[0], re.MULTILINE)
    assert steps == ["10", "20", "24"] * 2
    assert printed[0] == printed[1]


def test_with_a_planner_the_rounds_are_those_of_one_match(capsys):
    measures = watch(scenario=SHORT, planner="circle", rounds=3, every=24, seed=5)
    found = re.findall(r"^seed 5, match (\d), round (\d):", capsys.readouterr().out, re.MULTILINE)
    assert found == [("0", "0"), ("0", "1"), ("0", "2")]
    duel = make_duel(scenario=dataclasses.replace(SHORT, rounds_per_match=3), planner="circle")
    match = make_match(duel, "expert", "adaptive")
    for index, shown in enumerate(measures):
        play_round(match, seeds=5 if index == 0 else None)
        assert shown == duel.measures(0)


def test_a_picture_has_a_panel_per_round_and_a_bound(tmp_path):
    from matplotlib.image import imread

    watch(scenario=SHORT, planner="circle", rounds=6, out=tmp_path / "paths.png")
    height = imread(tmp_path / "paths.png").shape[0]
    assert height == pytest.approx((2.25 * 2 + 0.7) * 200, abs=2)  # two rows


@pytest.mark.parametrize(
    ("suffix", "begins"),
    [
        (".html", b"<!DOCTYPE html>"),
        (".GIF", b"GIF89a"),
        (".mp4", b"\0\0\0"),
        (".svg", b"<?xml"),
        (".pdf", b"%PDF"),
    ],
)
def test_watching_writes_files(tmp_path, capsys, suffix, begins):
    if suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg comes with the extra video")
    out = tmp_path / f"game{suffix}"
    watch("expert", "comb", scenario=SHORT, out=out, every=24)
    assert out.read_bytes().startswith(begins)
    assert capsys.readouterr().out.endswith(f"\nwrote {out}\n")
    assert list(tmp_path.iterdir()) == [out]


def test_watching_spares_a_file_that_is_there(tmp_path):
    out = tmp_path / "game.html"
    out.write_text("mine")
    with pytest.raises(UserError, match="exists already"):
        watch(scenario=SHORT, out=out)
    assert out.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"out": "game.htm"}, r"suffix '\.htm'.*did you mean '\.html'"),
        ({"every": 0}, "every"),
        ({"rounds": 1.5}, "rounds"),
        ({"path": "circel"}, "did you mean 'circle'"),
    ],
)
def test_watching_refuses_what_it_does_not_know(options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=message):
        watch(**{"scenario": SHORT, **options})
    assert not capsys.readouterr().out
    assert not list(tmp_path.iterdir())
