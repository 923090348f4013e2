"""Games of two teams: the duel inside them to the bit, seats, draws and what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from game.playing import wander

from fpg_bench.common.errors import UserError
from fpg_bench.game.batch import ActionError, GameBatch
from fpg_bench.game.scenario import PRESETS, RADIOMETER, preset
from fpg_bench.products.teams.batch import TEAM_STATE_SIZE, TeamBatch
from fpg_bench.products.teams.rules import TEAM_REWARDS, TeamRules

from .reference import ReferenceTeams

LINK = preset("link")
LEARNED = dataclasses.replace(LINK, opponent_path="learned")


# Other values of all rules that are new in link.
STRICT = dataclasses.replace(
    LINK, filter_stopband_db=-30, fading_distance_m=20, jamming_fading_sd_db=3,
    jamming_backoff_db=(0, 1, 2, 3), flight_cost_per_w=0.02, ally_speed_m_s=(5, 20), look_through_s=0.3,
    opponent_speed_m_s=15,
)  # fmt: skip
BASES = {
    **{name: preset(name) for name in PRESETS if name.startswith("link")},
    "strict": STRICT,
    "learned": dataclasses.replace(STRICT, opponent_path=("learned", "pursuit"), sensing_type_error=0.5),
    "paid": dataclasses.replace(
        LINK, hop_cost=1, spread_cost_per_s=(0.1, 0.2, 0.3, 0.4), distance_reward=3, distance_reward_m=200,
        reselect_on_despread=True, rounds_per_match=2, snr_drop_weight=0.5, comb_spacing_points=1,
    ),
}  # fmt: skip
# Rules at their neutral values, each by itself.
NEUTRAL = {
    "fading_correlation": {"fading_distance_m": 0, "fading_correlation": 0.7},
    "jamming_fading_sd_db": {"jamming_fading_sd_db": 0},
    "jamming_backoff_db": {"jamming_backoff_db": (0, 0, 0, 0)},
    "hop_airtime_s": {"hop_airtime_s": 0},
    "flight_cost_per_w": {"flight_cost_per_w": 0},
    "look_through_s": {"look_through_s": 0},
    "notch_width_mhz": {"notch_width_mhz": 0},
    "hopping": {"hopping": "always"},
    "knowledge": {"knowledge": "none"},
}
VARIANTS = BASES | {name: dataclasses.replace(LINK, **values) for name, values in NEUTRAL.items()}
OF_ALLY = [
    *("control_points", "ally_position", "point", "frequency_mhz", "spreading", "airtime", "spreading_s"),
    *("opponent_position", "distance_m", "covered", "fading", "snr_db", "clean_snr_db", "rate_mbit_s"),
    *("clean_mbit", "sensed_type", "sensed_mhz", "jamming_type", "jamming_mhz", "ally_value", "hopped"),
    *("ally_reward", "opponent_reward", "outage_run", "recovering", "checked", "last_check", "step"),
    *("round_key", "match", "round", "truncated", "horizon"),
]
OF_OPPONENT = [
    *("opponent_position", "opponent_start", "flown_m", "known_mhz", "age_s", "next_check", "last_check"),
    *("checked", "jamming_type", "jamming_mhz", "opponent_reward", "path", "distance_m", "round_key", "step"),
]


def both(steps: int, games: int, n: int, m: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Actions ``(steps, games, seats, 9)`` of both teams; those of a game do not depend on the others."""
    allies, opponents = wander(seed, steps, games * 5)
    allies, opponents = (each.reshape(steps, games, 5, 9) for each in (allies, opponents))
    return allies[:, :, :n], opponents[:, :, :m]


def content(batch: TeamBatch, games: slice = slice(None)) -> bytes:
    """Every bit of some games (records field by field: padding is nobody's)."""
    records = (batch.allies, batch.opponents, batch.sensed, batch.found, batch.tallies)
    parts = [record[games][name] for record in records for name in record.dtype.names]
    arrays = (batch.ally_observations, batch.opponent_observations, batch.histograms, batch.rivals)
    parts += [array[games] for array in arrays]
    return b"".join(part.tobytes() for part in parts)


def played(team: TeamRules, games: int = 4, steps: int = 40, seed: int = 0, scenario=LEARNED, **options):
    batch = TeamBatch(scenario, team, games, **options)
    batch.reset(seeds=range(seed, seed + games))
    for actions in zip(*both(steps, games, *team.most), strict=True):
        batch.step(*actions)
    return batch


@pytest.mark.parametrize("name", VARIANTS)
def test_a_team_of_one_against_one_is_the_duel_to_the_bit(name):
    scenario, games, steps = VARIANTS[name], 16, 150
    duel, team = GameBatch(scenario, games), TeamBatch(scenario, TeamRules(1, 1), games)
    actions = both(steps, games, 1, 1, seed=3)
    horizons = np.full(games, min(steps // 2, scenario.steps_per_round))
    duel.reset(seeds=5, horizons=horizons)
    team.reset(seeds=5, horizons=horizons)
    for step, (ally, opponent) in enumerate(zip(*actions, strict=True)):
        for field in OF_ALLY:
            assert np.array_equal(team.allies[field][:, 0], duel.games[field]), (step, field)
        for field in OF_OPPONENT if step else ():
            assert np.array_equal(team.opponents[field][:, 0], duel.games[field]), (step, field)
        assert np.array_equal(team.ally_observations[:, 0, :15], duel.ally_observations)
        assert np.array_equal(team.opponent_observations[:, 0, :15], duel.opponent_observations)
        assert not team.ally_observations[:, :, 15:].any()
        assert np.array_equal(team.tallies[:, 0], duel.tallies)
        assert np.array_equal(team.histograms[:, 0], duel.histograms)
        for reward in TEAM_REWARDS:
            assert np.array_equal(team.rewards("opponent", reward)[:, 0], duel.games["opponent_reward"])
        if step == steps // 2:
            duel.reset()
            team.reset()
        duel.step(ally[:, 0], opponent[:, 0])
        team.step(ally, opponent)
    assert duel.games["last_check"].any()


@pytest.mark.parametrize("sizes", [(3, 2), (5, 3), ((1, 5), (1, 3))])
def test_a_game_is_the_game_of_its_seed_in_any_batch(sizes):
    team = TeamRules(*sizes)
    whole = played(team, games=9, scenario=STRICT)
    assert content(whole) == content(played(team, games=9, scenario=STRICT))
    for game in range(0, 9, 4):
        one = TeamBatch(STRICT, team, 1)
        one.reset(seeds=game)
        for ally, opponent in zip(*both(40, 9, *team.most), strict=True):
            one.step(ally[game : game + 1], opponent[game : game + 1])
        assert content(one) == content(whole, slice(game, game + 1))


def test_seats_draw_apart():
    """No two seats, and no two pairs of them, fade or err alike."""
    batch = played(TeamRules(5, 3, formation="separate"), games=6, scenario=STRICT)
    for name in ("fading", "control_points", "ally_position"):
        rows = batch.allies[name].reshape(30, -1)
        assert len({row.tobytes() for row in rows}) == 30
    for values in (batch.sensed["fading"], batch.sensed["mhz"] - batch.opponents["jamming_mhz"][:, None]):
        assert len(np.unique(values)) == values.size
    assert len(np.unique(batch.opponents["opponent_start"].reshape(18, 3), axis=0)) == 18


def test_numbers_are_drawn_by_the_round_and_absent_seats_are_zeros():
    batch = TeamBatch(LEARNED, TeamRules((2, 5), (1, 3)), 200)
    batch.reset(seeds=0)
    first = batch.counts.copy()
    assert set(first[:, 0]) == {2, 3, 4, 5}
    assert set(first[:, 1]) == {1, 2, 3}
    for actions in zip(*both(5, 200, 5, 3), strict=True):
        batch.step(*actions)
    for side, rows in (("ally", batch.ally_observations), ("opponent", batch.opponent_observations)):
        is_there = batch.playing(side)
        assert rows[is_there].any(axis=1).all()
        assert not rows[~is_there].any()
        for reward in ("own", "team"):
            assert not batch.rewards(side, reward)[~is_there].any()
    batch.reset()
    assert (batch.counts != first).any()
    assert batch.state().shape == (200, TEAM_STATE_SIZE)
    assert np.abs(batch.state()).max() <= 1


@pytest.mark.parametrize("mates", ["none", "place", "full", {"ally": "full", "opponent": "none"}])
def test_mates_tell_what_they_are_meant_to(mates):
    batch, full = played(TeamRules(5, 3), mates=mates), played(TeamRules(5, 3))
    told = dict.fromkeys(("ally", "opponent"), mates) if isinstance(mates, str) else mates
    assert (full.ally_observations[..., 42::8] == 1).all()
    for side, rows, whole, size, of_place in (
        ("ally", batch.ally_observations, full.ally_observations, 8, (0, 1, 2, 6, 7)),
        ("opponent", batch.opponent_observations, full.opponent_observations, 12, (0, 1, 2, 10, 11)),
    ):
        start = 35 if side == "ally" else 43
        assert np.array_equal(rows[..., :start], whole[..., :start])
        known = {"none": (), "place": of_place, "full": range(size)}[told[side]]
        kept = np.isin((np.arange(start, 67) - start) % size, known)
        assert np.array_equal(rows[..., start:], np.where(kept, whole[..., start:], 0))


def test_teams_are_detected_by_radiometers_alone():
    of_radiometers = [
        field for field in dataclasses.fields(LINK) if field.metadata.get("needs") == RADIOMETER
    ]
    others = {field.name: field.default for field in of_radiometers}
    with pytest.raises(UserError, match="teams: detection 'off'"):
        TeamBatch(dataclasses.replace(LINK, detection="off", **others))


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"allies": 6}, "allies: expected a whole number from 1 to 5"),
        ({"jammers": 0}, "jammers: expected a whole number from 1 to 3"),
        ({"allies": (3, 2)}, "allies: expected .* two that do not fall, got"),
        ({"allies": True}, "allies: expected"),
        ({"spacing_m": -1}, "spacing_m: expected a number from 0 to 10000, got -1"),
        ({"code_orthogonality": 1.5}, "code_orthogonality: expected a number from 0 to 1"),
        ({"formation": "swarm"}, "formation: expected one of convoy, separate"),
        ({"share_power": 1}, "share_power: expected true or false"),
    ],
)
def test_rules_out_of_range_are_refused_in_one_line(rules, message):
    with pytest.raises(UserError, match=message):
        TeamRules(**rules)


def test_bad_actions_are_refused_and_nothing_is_played():
    batch = TeamBatch(LINK, TeamRules(3, 2), 2)
    with pytest.raises(UserError, match="reset before its first step"):
        batch.step(np.zeros((2, 3, 9)), np.zeros((2, 2, 9)))
    batch.reset(seeds=0)
    before = content(batch)
    with pytest.raises(ActionError, match=r"ally actions: expected a float array of shape \(2, 3, 9\)"):
        batch.step(np.zeros((2, 2, 9)), np.zeros((2, 2, 9)))
    bad = np.zeros((2, 2, 9))
    bad[1, 0, 4] = np.nan
    with pytest.raises(ActionError, match="opponent action 0 of game 1: index 4 is nan"):
        batch.step(np.zeros((2, 3, 9)), bad)
    assert content(batch) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "team"),
    [
        (LINK, TeamRules(3, 2)),
        (STRICT, TeamRules(3, 2)),
        (LEARNED, TeamRules(5, 3, spacing_m=5)),
        (BASES["learned"], TeamRules(2, 3, formation="separate")),
        (STRICT, TeamRules(4, 1, code_orthogonality=0.5)),
        (LINK, TeamRules(3, 2, share_power=False)),
    ],
    ids=["link", "strict", "large", "separate", "one-jammer", "whole-power"],
)
def test_a_round_of_teams_is_the_one_that_the_rules_describe(scenario, team):
    (n, m), steps, seed = team.most, 30, 11
    batch, reference = TeamBatch(scenario, team), ReferenceTeams(scenario, team, seed)
    batch.reset(seeds=seed)
    allies, opponents = both(steps, 1, n, m, seed=3)
    near, rivals = {"rtol": 1e-6, "atol": 1e-5}, []
    for step in range(steps + 1):
        for side, seats in (("ally", reference.allies), ("opponent", reference.jammers)):
            rows = batch.ally_observations[0] if side == "ally" else batch.opponent_observations[0]
            expected = np.stack([seat.seen for seat in seats])
            np.testing.assert_allclose(rows, expected, atol=2e-6, err_msg=f"{side} {step}")
        if step:
            for field in ("snr_db", "clean_snr_db", "ally_reward", "opponent_reward", "ally_position"):
                expected = [getattr(ally, field) for ally in reference.allies]
                np.testing.assert_allclose(
                    batch.allies[field][0], expected, err_msg=f"{field} {step}", **near
                )
            for field in ("known_mhz", "age_s", "next_check", "last_check", "opponent_position"):
                expected = [getattr(jammer, field) for jammer in reference.jammers]
                np.testing.assert_allclose(
                    batch.opponents[field][0], expected, err_msg=f"{field} {step}", **near
                )
            drops = [ally.opponent_reward for ally in reference.allies]
            np.testing.assert_allclose(batch.rewards("opponent", "team")[0], np.mean(drops), **near)
            own = [drops[rival] for rival in rivals]
            np.testing.assert_allclose(batch.rewards("opponent")[0], own, **near)
        if step < steps:
            rivals = list(reference.rivals)
            batch.step(allies[step], opponents[step])
            reference.step(allies[step, 0], opponents[step, 0])


def test_the_rounds_of_the_comparison_have_everything_in_them():
    """Else the comparison above would compare little."""
    batch = played(TeamRules(3, 2), steps=100, seed=11)
    tallies = batch.tallies
    for name in ("overlap", "heard", "hops", "spread"):
        assert (tallies[name] > 0).all(), name
    assert (tallies["heard"] < tallies["checks"]).all()
