"""Pictures, films and the window: a person can follow the game."""

import sys

import gymnasium
import numpy as np
import pytest
from PIL import Image

from fpg_bench.common.errors import UserError
from fpg_bench.envs.gymnasium_env import FPGEnv
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.envs.two_player import make_duel
from fpg_bench.game.jamming import covers
from fpg_bench.game.rules import rules_record
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.products.rendering.film import write_gif, write_mp4
from fpg_bench.products.rendering.picture import Picture, footprints
from fpg_bench.products.rendering.recording import Recording
from fpg_bench.products.rendering.watching import watch

SHORT = Scenario(steps_per_round=24, waypoints=4)
SHAPE = (640, 1120, 3)


def played(duel, recording, steps, seed=0):
    """Play random actions of both sides and record them."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        duel.batch.step(*rng.uniform(-1, 1, (2, duel.count, 9)))
        recording.add()
    return recording


def recorded(steps=24, games=1, game=0, **options):
    duel = make_duel(games, **{"scenario": SHORT, **options})
    duel.reset(seeds=5)
    return played(duel, Recording(duel.batch, game), steps)


def test_a_recording_holds_the_start_and_every_step_of_its_own_game():
    alone, third = recorded(), recorded(games=4, game=2)
    assert alone.frames["step"].tolist() == list(range(25))
    assert alone.frames["jamming_type"][0] == -1
    games = make_duel(4, scenario=SHORT)
    games.reset(seeds=5)
    assert third.seed == games.batch.games["seed"][2]
    assert not np.array_equal(alone.frames["ally_position"][0], third.frames["ally_position"][0])


def test_a_recording_begins_anew_with_the_next_round():
    duel = make_duel(scenario=SHORT)
    duel.reset(seeds=5)
    recording = played(duel, Recording(duel.batch), 10)
    duel.reset()
    recording.begin()
    assert (len(recording.frames), recording.match) == (1, 1)


@pytest.mark.parametrize("kind", range(4))
def test_the_drawn_footprint_is_the_one_that_the_game_plays(kind):
    frames = recorded(1).frames[1:].copy()
    frames["jamming_type"], frames["jamming_mhz"] = kind, 221.0
    rows = np.linspace(140, 260, 481) + 1e-3  # off the footprints' edges
    rules = rules_record(STANDARD)[0]
    expected = [covers(kind, 221.0, row, False, rules, None) for row in rows]
    assert footprints(frames, STANDARD, rows)[:, 0].tolist() == expected


def test_a_picture_shows_one_step_and_depends_on_the_recording_alone():
    recording = recorded(planner="circle")
    picture = Picture(recording)
    frames = [picture.draw(step) for step in (0, 20)]
    assert all(frame.shape == SHAPE and frame.dtype == np.uint8 for frame in frames)
    assert (frames[0] != frames[1]).any()
    np.testing.assert_array_equal(frames[1], Picture(recording).draw(20))


def test_the_snr_axis_grows_with_the_snr():
    recording = recorded(scenario="paper")
    recording.frames["snr_db"][-1] = -75
    picture = Picture(recording)
    below, grown = picture.draw(23), picture.draw(24)
    axis = (slice(380, 500), slice(530, 582))
    assert (below[axis] != grown[axis]).any()


def test_gymnasium_renders_arrays_that_are_the_callers_own():
    env = gymnasium.make("FPG/AllyVsScripted-v0", render_mode="rgb_array", scenario=SHORT)
    env.reset(seed=1)
    first = env.render()
    kept = first.copy()
    env.step(np.zeros(9, np.float32))
    second = env.render()
    assert first.shape == second.shape == SHAPE
    assert (first != second).any()
    np.testing.assert_array_equal(first, kept)
    both = parallel_env(render_mode="rgb_array", scenario=SHORT)
    both.reset(seed=1)
    assert both.render().shape == SHAPE


@pytest.mark.slow
def test_record_video_writes_a_film_of_every_step(tmp_path):
    pytest.importorskip("moviepy", reason="moviepy is in the extra video")
    scenario = Scenario(steps_per_round=2, waypoints=2)
    env = gymnasium.make("FPG/AllyVsScripted-v0", render_mode="rgb_array", scenario=scenario)
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "films"), disable_logger=True)
    env.reset(seed=1)
    while not env.step(env.action_space.sample())[3]:
        pass
    env.close()
    (film,) = (tmp_path / "films").glob("*.mp4")
    assert frame_count(film) == 3


def frame_count(film):
    from imageio_ffmpeg import count_frames_and_secs, read_frames

    assert next(read_frames(str(film)))["size"] == (1120, 640)
    return count_frames_and_secs(str(film))[0]


@pytest.mark.slow
def test_films_hold_each_nth_step_and_the_last(tmp_path):
    rounds = [recorded(3), recorded(2)]
    write_gif(rounds, tmp_path / "film.gif", "two rounds", every=2)
    with Image.open(tmp_path / "film.gif") as film:
        assert film.size == (1120, 640)
        assert film.n_frames == 3 + 2  # steps 0, 2, 3 and 0, 2
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg comes with the extra video")
    write_mp4(rounds[1:], tmp_path / "film.mp4", every=2)
    assert frame_count(tmp_path / "film.mp4") == 2


@pytest.mark.parametrize(
    ("package", "use"),
    [
        ("imageio_ffmpeg", lambda folder: watch(scenario=SHORT, out=folder / "film.mp4")),
        (
            "matplotlib",
            lambda folder: FPGEnv("FPG/AllyVsScripted-v0", render_mode="rgb_array", scenario=SHORT),
        ),
    ],
)
def test_a_missing_package_names_the_extra(package, use, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(UserError, match=r"is not installed: pip install .*\[video\]"):
        use(tmp_path)


def test_gymnasium_shows_the_picture_in_a_window(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame", reason="pygame-ce is in the extra video")
    env = gymnasium.make("FPG/AllyVsScripted-v0", render_mode="human", scenario=SHORT)
    env.reset(seed=1)
    env.step(np.zeros(9, np.float32))
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    assert shown.shape == SHAPE
    assert (shown != shown[0, 0]).any()
    env.close()
