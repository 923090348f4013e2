"""The tallies and the measures made of them, against a slow count over a whole round's history."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from fpg_bench.game.link import rate_mbit_s
from fpg_bench.game.metrics import measures, pool
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.radio import capacity_mbit_s
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import PAPER, STANDARD, preset
from fpg_bench.game.state import TALLY

from .playing import (
    EXPERT,
    HOP,
    PREFERENCE,
    SPREAD,
    TONE,
    ally,
    at_mhz,
    begin,
    opponent,
    place,
    play,
    still,
    to_point,
    wander,
)


def runs_of(flags: list[bool]) -> list[tuple[int, int]]:
    """First and one-past-last step of each unbroken run."""
    padded = np.concatenate([[0], np.asarray(flags, int), [0]])
    return list(zip(np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1), strict=True))


def recoveries(records, outage: list[bool]) -> list[tuple[int, bool]]:
    """For each check that heard: the length of the first outage that begins after it and before or in the
    step of the next check, and whether the round's end cut it."""
    checks = [k for k, game in enumerate(records) if game["checked"]]
    found = []
    for this, following in zip(checks, [*checks[1:], len(records) - 1], strict=True):
        heard = records[this]["last_check"] == 1
        begun = [run for run in runs_of(outage) if this < run[0] <= following]
        if heard and begun:
            start, end = begun[0]
            found.append((end - start, end == len(records)))
    return found


def open_rate(scenario, game):
    """The rate without jamming and spreading, whose noise is as wide as the band in use."""
    wider = scenario.spread_bandwidth_mhz / scenario.bandwidth_mhz if game["spreading"] else 1
    return scenario.bandwidth_mhz * math.log2(1 + wider * 10 ** (game["clean_snr_db"] / 10))


def slow_measures(scenario, records, point_before: int) -> dict[str, float | None]:
    """Everything from the list of a round's records, as a reader of the definitions would do it."""
    s, steps = scenario, len(records)
    outage = [bool(game["snr_db"] < s.snr_threshold_db) for game in records]
    both = sum(game["covered"] and out for game, out in zip(records, outage, strict=True))
    covered = sum(game["covered"] for game in records)
    checks = [game for game in records if game["checked"]]
    runs = [end - start for start, end in runs_of(outage)]
    recovered = recoveries(records, outage)
    points = [point_before, *(game["point"] for game in records)]
    width = [
        s.spread_bandwidth_mhz if s.spread_capacity and g["spreading"] else s.bandwidth_mhz for g in records
    ]
    rates = [b * math.log2(1 + 10 ** (g["snr_db"] / 10)) for b, g in zip(width, records, strict=True)]
    grid = s.band_low_mhz + np.arange(s.frequency_points) * s.point_spacing_mhz
    ours = np.bincount(points[1:], minlength=len(grid)) / steps
    nearest = [int(np.argmin(abs(grid - game["jamming_mhz"]))) for game in records]
    theirs = np.bincount(nearest, minlength=len(grid)) / steps
    found = {
        "overlap_ratio": covered / steps,
        "jamming_success_rate": both / steps,
        "outage": sum(outage) / steps,
        "success_given_overlap": both / covered if covered else None,
        "spectrum_overlap": float(np.minimum(ours, theirs).sum()),
        "detection_rate": sum(g["last_check"] == 1 for g in checks) / len(checks) if checks else None,
        "outage_longest_s": max(runs, default=0),
        "outage_mean_s": sum(runs) / len(runs) if runs else None,
        "time_to_recover_s": sum(t for t, _ in recovered) / len(recovered) if recovered else None,
        "recoveries_cut": sum(cut for _, cut in recovered),
        "hop_rate": sum(game["hopped"] for game in records) / steps,
        "frequency_changes": sum(a != b for a, b in itertools.pairwise(points)) / steps,
        "spread_ratio": sum(game["spreading"] for game in records) / steps,
        "near_ratio": sum(game["distance_m"] < s.distance_reward_m for game in records) / steps,
        "snr_db": sum(game["snr_db"] for game in records) / steps,
        "capacity_mbit_s": sum(rates) / steps,
        "delivered_share": sum(rates) / sum(open_rate(s, game) for game in records),
        "survived_share": None,
        "ally_return": sum(game["ally_reward"] for game in records),
        "opponent_return": sum(game["opponent_reward"] for game in records),
    }
    for kind, name in enumerate(JAMMING_TYPES):
        found[f"share_{name}"] = sum(game["jamming_type"] == kind for game in records) / steps
    return found


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    "scenario",
    [
        STANDARD,
        PAPER,
        dataclasses.replace(STANDARD, snr_threshold_db=60, first_check_s=(1, 2), check_interval_s=(2, 9)),
        dataclasses.replace(PAPER, opponent_path="circle", snr_threshold_db=45, detection="emission"),
    ],
    ids=["standard", "paper", "often-out", "paper-often-out"],
)
def test_the_measures_of_a_round(scenario, seed):
    batch = begin(scenario, seed)
    before = int(batch.games["point"][0])
    records = [r[0] for r in play(batch, *wander(seed, scenario.steps_per_round))]
    expected = slow_measures(scenario, records, before)
    found = measures(pool(batch.tallies[0]), batch.histograms[0])
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == (None if value is None else pytest.approx(value, rel=1e-9, abs=1e-9)), name


@pytest.mark.parametrize("to_the_end", [True, False])
def test_a_recovery_that_the_end_of_a_round_cuts_is_counted(to_the_end):
    """After checks that hear the ally it is jammed, to the end or not."""
    batch = begin(still())
    place(batch, (750.0, 800.0, 550.0))
    steps, records = STANDARD.steps_per_round, []
    own = float(batch.games["frequency_mhz"][0])
    for step in range(steps):
        is_jammed = steps - 40 <= step < (steps if to_the_end else steps - 20)
        batch.step(ally(), opponent(TONE, at_mhz(own if is_jammed else 400 - own), in_band=True))
        records.append(batch.games[0].copy())
    outage = [bool(game["snr_db"] < STANDARD.snr_threshold_db) for game in records]
    assert outage[-1] == to_the_end
    assert sum(cut for _, cut in recoveries(records, outage)) == to_the_end
    assert batch.tallies[0]["recoveries_cut"] == to_the_end


def test_before_the_first_step_nothing_exists():
    batch = begin(STANDARD)
    assert set(measures(pool(batch.tallies[0]), batch.histograms[0]).values()) == {None}


def test_the_survived_share_is_what_jamming_leaves_of_the_rate():
    """Of the same steps, so hops and spreading take nothing from it; models without such rates have none."""
    records, scenario = [], preset("link")
    batch = begin(scenario)
    for actions in zip(*wander(4, 60), strict=True):
        batch.step(*actions)
        records.append(batch.games[0].copy())
    found = measures(pool(batch.tallies[0]) | batch.clean_sum([0]), batch.histograms[0])["survived_share"]
    rules, radio = rules_record(scenario)[0], radio_record(scenario)[0]
    clean = sum(r["airtime"] * rate_mbit_s(r["clean_snr_db"], r["spreading"], rules, radio) for r in records)
    assert found == pytest.approx(sum(r["rate_mbit_s"] for r in records) / clean)
    assert 0.3 < found < 0.95
    batch.reset()
    assert batch.games["clean_mbit"][0] == 0
    assert begin(STANDARD).clean_sum() == {}


@pytest.mark.parametrize("name", ["standard", "link"])
def test_what_is_delivered_is_a_share_of_the_same_flight_unjammed_unspread_and_unhopped(name):
    """The yardstick is the rate without jamming of a twin on the same points that never spreads."""
    scenario, (allies, opponents) = preset(name), wander(4, 60)
    points = scenario.frequency_points
    batch, twin = begin(scenario), begin(scenario)
    rules, expected, spread = rules_record(scenario)[0], 0.0, 0
    for own, other in zip(allies, opponents, strict=True):
        batch.step(own, other)
        game, calm = batch.games[0], own.copy()
        calm[:, [HOP, SPREAD, EXPERT]] = (1 if game["point"] != twin.games[0]["point"] else -1), -1, -1
        calm[:, PREFERENCE] = to_point(game["point"], points)
        twin.step(calm, other)
        snr = twin.games[0]["clean_snr_db"]
        if name == "link":
            rate = rate_mbit_s(snr, False, rules, radio_record(scenario)[0])
        else:
            rate = capacity_mbit_s(snr, False, rules)
        assert game["open_mbit_s"] == pytest.approx(rate, rel=1e-9)
        expected += rate
        spread += game["spreading"]
    tally = pool(batch.tallies[0])
    assert 5 < spread < 55
    found = measures(tally, batch.histograms[0])["delivered_share"]
    assert found == pytest.approx(tally["capacity_mbit_s"] / expected)
    assert 0.1 < found < 0.98


def test_rounds_are_pooled_and_never_averaged():
    """Ratios of sums: a round without overlap weighs nothing in success given overlap."""
    tallies = np.zeros(2, TALLY)
    tallies["steps"] = 100, 300
    tallies["overlap"] = 10, 0
    tallies["jammed"] = 5, 0
    tallies["outage"] = 5, 45
    tallies["outage_runs"] = 1, 9
    tallies["longest_outage"] = 5, 12
    tallies["ally_return"] = 10.0, -4.0
    histogram = np.array([[400, 0], [100, 300]])
    found = measures(pool(tallies), histogram)
    assert found["overlap_ratio"] == 10 / 400
    assert found["success_given_overlap"] == 0.5
    assert found["outage"] == 50 / 400
    assert found["outage_mean_s"] == 5
    assert found["outage_longest_s"] == 12
    assert found["ally_return"] == 6.0
    assert found["spectrum_overlap"] == 0.25
    assert found["detection_rate"] is None


def test_parts_of_a_round_for_the_planner():
    """Per n-th part: the position in its middle and the mean of the opponent's rewards."""
    scenario = dataclasses.replace(STANDARD, steps_per_round=50, waypoints=7)
    batch = begin(scenario)
    records = [r[0] for r in play(batch, *wander(4, 50))]
    for i in range(7):
        part = [k for k in range(50) if k * 7 // 50 == i]
        reward = np.mean([records[k]["opponent_reward"] for k in part])
        assert batch.segments[0, i, 3] == pytest.approx(reward)
        middle = records[part[len(part) // 2]]["opponent_position"]
        np.testing.assert_allclose(batch.segments[0, i, :3], middle, atol=1e-9)
