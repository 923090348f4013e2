"""The spectrum waterfall: what a row holds, its history, and who may ask for it."""

from __future__ import annotations

import dataclasses
import warnings

import gymnasium
import numpy as np
import onnxruntime
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from fpg_bench import make_sb3
from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import STANDARD, as_scenario, preset
from fpg_bench.game.waterfall import Waterfall, waterfall_rows
from fpg_bench.training.export import Graph, Value, rows_of

from .playing import ALLY, OPPONENT, SHORT

TYPES = ("tone", "narrowband", "broadband", "comb")
LINK = preset("link")


def band_of(scenario):
    """The width of the band in MHz, and the number of its bins."""
    band = scenario.band_high_mhz - scenario.band_low_mhz
    return band, round(band / scenario.bandwidth_mhz)


def seen(scenario, kind=None, jamming_mhz=0.0, own_mhz=None, spreading=0.0, snr=0.0, covers=-1.0):
    """The ally's 15 numbers; frequencies are given from the band's lower end."""
    half = (scenario.band_high_mhz - scenario.band_low_mhz) / 2
    numbers = np.zeros((1, 15), np.float32)
    numbers[0, 6] = 1.0 if own_mhz is None else own_mhz / half - 1
    numbers[0, 7], numbers[0, 8], numbers[0, 14] = spreading, snr, covers
    if kind is not None:
        numbers[0, 9], numbers[0, 10 + TYPES.index(kind)] = jamming_mhz / half - 1, 1
    return numbers


def row(scenario, kind=None, *args, **options):
    return waterfall_rows(seen(scenario, kind, *args, **options), Waterfall(scenario).table)[0]


def covered_shares(scenario, kind, jamming_mhz):
    """The share of each bin that a footprint covers, by sampling; nothing outside the band counts."""
    band, bins = band_of(scenario)
    places = (np.arange(5000 * bins) + 0.5) * band / (5000 * bins)
    half = scenario.footprint_half_widths_mhz[TYPES.index(kind)]
    teeth = jamming_mhz + np.array([0])
    if kind == "comb":
        teeth = jamming_mhz + np.arange(-5, 6) * scenario.comb_spacing_points * scenario.point_spacing_mhz
        if scenario.snr_model == "link":
            teeth = teeth[(teeth >= -1e-6) & (teeth <= band + 1e-6)]
    is_covered = (np.abs(places[:, None] - teeth) <= half).any(1)
    return is_covered.reshape(bins, 5000).mean(1)


@pytest.mark.parametrize("scenario", [STANDARD, LINK], ids=["standard", "link"])
@pytest.mark.parametrize("kind", TYPES)
def test_the_jamming_lies_where_the_footprint_is(scenario, kind):
    width = 2 * scenario.footprint_half_widths_mhz[TYPES.index(kind)]
    teeth = 3.5 if kind == "comb" else 1  # 14 points over 4
    band, bins = band_of(scenario)
    level = 1 + np.log10(min(width, band / bins) / (width * teeth)) / 3  # 0 at -30 dB
    for jamming_mhz in (0.0, 3.3, 27.7, 50.0, 71.4, band - 1, band):
        shares = covered_shares(scenario, kind, jamming_mhz) / min(width * bins / band, 1)
        shown = row(scenario, kind, jamming_mhz)
        assert shown[:-1] == pytest.approx(level * shares[:-1], abs=0.03)
        assert shown[-1] == -0.75  # the ally's own
        assert 0 <= shown[:-1].min() <= shown[:-1].max() <= 1


def test_the_own_channel_is_negative_deeper_with_snr_and_shallower_where_it_is_covered():
    for point in range(15):
        shown = row(STANDARD, own_mhz=point * 100 / 14)
        assert np.flatnonzero(shown).tolist() == [min(int(point * 20 / 14 + 1e-6), 19)]
    own = [
        row(STANDARD, "broadband", 50.0, own_mhz=50.0, snr=snr, covers=covers)[10]
        for covers in (-1.0, 1.0)
        for snr in (-1.0, 0.0, 1.0)
    ]
    assert own == [-0.5, -0.75, -1.0, 0.0, -0.25, -0.5]


def test_a_spread_signal_shows_where_it_is():
    everywhere = row(STANDARD, own_mhz=50.0, spreading=0.1)
    assert everywhere == pytest.approx([*[-0.25] * 10, -0.75, *[-0.25] * 9], abs=1e-6)
    partly = row(LINK, own_mhz=42.0, spreading=0.1)  # 50 MHz from 17 to 67, bins of 77.4 / 15 MHz
    first, last = 0.25 * (4 - 17 * 15 / 77.4), 0.25 * (67 * 15 / 77.4 - 12)
    expected = [0, 0, 0, -first, *[-0.25] * 4, -0.75, *[-0.25] * 3, -last, 0, 0]
    assert partly == pytest.approx(expected, abs=1e-6)


def test_the_bins_follow_the_scenario():
    wide = dataclasses.replace(STANDARD, bandwidth_mhz=12.0)
    assert Waterfall(wide).shape == (16, 8)
    with pytest.raises(UserError, match=r"a waterfall of 20000 bins .* at most 1,000"):
        Waterfall(dataclasses.replace(STANDARD, bandwidth_mhz=0.005))


@pytest.mark.parametrize("scenario", [SHORT, as_scenario("link", opponent_path="pursuit")])
def test_a_window_holds_the_rows_of_the_last_steps(scenario):
    """Oldest first, zero before the round; the games are those of the numbers."""
    scenario = dataclasses.replace(scenario, steps_per_round=12, waypoints=3)
    options = {"scenario": scenario, "opponent": ["comb", "random"], "actions": "discrete"}
    numbers = make_sb3(ALLY, 3, seed=1, **options)
    waterfall = make_sb3(ALLY, 3, seed=1, observation="waterfall", history=5, **options)
    table = waterfall.core.waterfall.table
    rng, begun = np.random.default_rng(0), [waterfall_rows(numbers.reset(), table)]
    rows, window = begun, waterfall.reset()
    for _ in range(30):
        padded = [np.zeros((3, band_of(scenario)[1]), np.float32)] * 5 + rows
        assert np.array_equal(window, np.stack(padded[-5:], axis=1))
        assert window in waterfall.observation_space or all(w in waterfall.observation_space for w in window)
        actions = rng.integers(0, 19, 3)
        (seen_now, rewards, over, infos), (window, same, _, other) = (
            numbers.step(actions),
            waterfall.step(actions),
        )
        assert np.array_equal(rewards, same)
        if over.all():
            last = waterfall_rows(np.stack([info["terminal_observation"] for info in infos]), table)
            assert np.array_equal([info["terminal_observation"][-1] for info in other], last)
            rows = []
        rows = [*rows, waterfall_rows(seen_now, table)]


@pytest.mark.parametrize("bandwidth_mhz", [5.0, 12.0, 77.0])
@pytest.mark.parametrize("name", ["standard", "paper", "link"])
def test_a_graph_has_the_bits_of_arrays(name, bandwidth_mhz):
    """Any numbers, those of channels' centres, and types that are mixed, as no sensor reports them."""
    waterfall = Waterfall(dataclasses.replace(preset(name), bandwidth_mhz=bandwidth_mhz), history=3)
    rng = np.random.default_rng(0)
    numbers = rng.uniform(-1, 1, (5000, 15)).astype(np.float32)
    numbers[:4000, 10:14] = np.eye(5)[rng.integers(0, 5, 4000), :4]
    numbers[::2, 7] = 0
    for index in (6, 9):
        numbers[index::5, index] = rng.integers(0, 15, len(numbers[index::5])) / 7 - 1
    windows = rng.uniform(-1, 1, (5000, *waterfall.shape)).astype(np.float32)
    starts = rng.random(5000) < 0.1
    pushed, rows = waterfall.pushed(windows, numbers, starts), waterfall_rows(numbers, waterfall.table)
    assert np.array_equal(pushed[:, -1].view(np.uint32), rows.view(np.uint32))
    assert np.array_equal(pushed[:, :-1], np.where(starts[:, None, None], 0, windows[:, 1:]))
    graph = Graph()
    graph.add("Identity", waterfall_rows(Value(graph, "observation"), waterfall.table).name, to="action")
    data = graph.to_bytes([rows_of("observation", 15)], [rows_of("action", waterfall.shape[1])])
    (written,) = onnxruntime.InferenceSession(data).run(None, {"observation": numbers})
    assert np.array_equal(written.view(np.uint32), rows.view(np.uint32))


def test_the_checkers_pass():
    env = gymnasium.make("FPG/AllyVsScriptedDiscrete-v0", observation="waterfall").unwrapped
    assert env.observation_space == gymnasium.spaces.Box(-1, 1, (16, 20), np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)
        warnings.filterwarnings("ignore", "Your observation .* has an unconventional shape")  # not flat
        check_env_sb3(env)


@pytest.mark.parametrize(
    ("env_id", "options", "message"),
    [
        (OPPONENT, {"observation": "waterfall"}, "the waterfall is the ally's; in .* you play the opponent"),
        (ALLY, {"observation": "waterfal"}, "expected one of .*; did you mean 'waterfall'"),
        (ALLY, {"history": 4}, "history: counts the rows of a waterfall"),
        (ALLY, {"observation": "waterfall", "history": 0}, "history: expected a whole number above 0, got 0"),
    ],
)
def test_bad_options_are_refused_in_one_line(env_id, options, message):
    for make in (gymnasium.make, gymnasium.make_vec, make_sb3):
        with pytest.raises(UserError, match=message):
            make(env_id, **options)
