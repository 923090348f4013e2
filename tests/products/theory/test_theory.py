"""Players of theory: the beliefs of both sides, the range rule, and the oracles of the model link."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.full_state import FULL_STATE_SIZE, OPPONENT
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD, preset
from fpg_bench.players.player import Player
from fpg_bench.players.registry import as_player
from fpg_bench.players.tactics import Tactic
from fpg_bench.products.theory import belief as belief_module
from fpg_bench.products.theory.bayes import HAZARDS, SURE, BayesJammer, OracleLinkAlly
from fpg_bench.products.theory.belief import BeliefAlly
from tests.players.playing import ally_sees, mean, opponent_sees

LINK = preset("link")
TONE, NARROWBAND, BROADBAND = range(3)
JAM_CENTRE, JAM_TYPE, LAST_CHECK = 9, 10, 14


def heard(point: int, jam: tuple[int, int] | None = None, age_s: float = 0.0, check: int = 1) -> np.ndarray:
    """Return what a jammer sees 200 m from an ally last heard at a point, after a jamming (type, centre)."""
    seen = opponent_sees((200.0, 0.0, 0.0), age_s=age_s)
    seen[0, :3], seen[0, 6], seen[0, LAST_CHECK] = 0.0, 2 * point / 14 - 1, check
    seen[0, 8] = 1 / LINK.check_scale_s  # the next check comes in this step
    if jam is not None:
        seen[0, JAM_CENTRE], seen[0, JAM_TYPE + jam[0]] = 2 * jam[1] / 14 - 1, 1
    return seen


def follow(
    seen: list[np.ndarray], jammer: BayesJammer | None = None
) -> tuple[list[tuple[str, int]], np.void]:
    """Return the types and centres (as points) that a Bayes jammer plays, and its last belief."""
    jammer, state, found = jammer or BayesJammer(LINK), None, []
    for one in seen:
        action, state = jammer.predict(one, state)
        assert action[0, 5] > 0
        found.append((JAMMING_TYPES[action[0, :4].argmax()], round((float(action[0, 4]) + 1) * 7)))
    return found, state[0]


def test_a_jammer_that_knows_the_point_puts_a_narrow_jamming_on_it_and_a_lost_one_a_wide():
    stays, moves = [heard(3, (TONE, 3)) for _ in range(40)], [heard(k % 15, (TONE, 7)) for k in range(40)]
    jams, belief = follow(stays)
    assert jams[-1][0] in ("tone", "narrowband")
    assert abs(jams[-1][1] - 3) <= 1
    assert belief["stayed"] @ belief["weight"] > 0.95
    jams, belief = follow(moves)
    assert jams[-1][0] == "broadband"
    assert belief["stayed"] @ belief["weight"] < 0.1


def test_it_tells_an_ally_that_leaves_jamming_from_one_that_leaves_of_itself():
    points = [0]
    for step in range(60):
        points.append(points[-1] if step % 2 else (points[-1] + 5) % 15)
    flees = [heard(points[k], (TONE, points[k] if k % 2 == 0 else 14 - points[k])) for k in range(60)]
    belief = follow(flees)[1]
    weights = belief["weight"] / belief["weight"].sum()
    calm, hit = weights @ HAZARDS
    assert hit > calm + 0.3


def test_checks_that_do_not_hear_a_near_ally_say_that_it_spreads():
    assert follow([heard(7, (TONE, 7))] * 20)[1]["spread"] < 0.1
    silent = [heard(7), *(heard(7, (TONE, 7), age_s=k, check=-1) for k in range(1, 20))]
    far = [one.copy() for one in silent]
    for one, distance_m in ((one, d) for of, d in ((silent, 500.0), (far, 1200.0)) for one in of):
        one[0, 0], one[0, 3] = -1.0, np.sqrt(distance_m / 1500)  # 1200 m: no check hears either waveform
    assert follow(silent)[1]["spread"] > 0.9
    assert follow(far)[1]["spread"] < 0.6


def test_an_impossible_belief_begins_anew():
    jammer = BayesJammer(LINK)
    _, state = jammer.predict(heard(3))
    certain = state.copy()
    certain["weight"], certain["weight"][:, 0], certain["stayed"] = 0.0, 1.0, 1.0  # it never hops
    action, after = jammer.predict(heard(9), certain)
    assert np.isfinite(action).all()
    assert (after["weight"] == 1.0).all()
    assert after["point"] == 9


@pytest.mark.parametrize("preset_name", ["standard", "paper", "figures", "link", "link-throughput"])
@pytest.mark.parametrize(("name", "side"), [("bayes", "opponent"), ("belief", "ally")])
def test_each_game_of_a_batch_is_played_as_alone_in_every_scenario(name, side, preset_name):
    scenario, rng = preset(preset_name), np.random.default_rng(0)
    jammer = as_player(name, side, scenario)
    assert isinstance(jammer, Player)
    seen = rng.uniform(-1, 1, (20, 3, 15)).astype(np.float32)
    starts, state, alone = rng.random((20, 3)) < 0.1, None, [None] * 3
    for step in range(20):
        actions, state = jammer.predict(seen[step], state, starts[step])
        assert np.isfinite(actions).all()
        for game in range(3):
            rows = slice(game, game + 1)
            if isinstance(jammer, BeliefAlly):
                jammer.reset(np.ones(1, bool), np.array([game], np.uint64))
            one, alone[game] = jammer.predict(seen[step, rows], alone[game], starts[step, rows])
            assert np.array_equal(one[0], actions[game])


def best_worth(
    belief: dict[tuple[int, int], float], worth: np.ndarray, interval: tuple[int, int], seconds: int
) -> float:
    """The worth of the best plan, by going through all that is done and seen; both waveforms are heard."""
    if seconds == 0 or not belief:
        return 0.0
    of_choices = []
    for choice in range(4):
        total = sum(chance * worth[choice, knows] for (_, knows), chance in belief.items())
        for seen in range(2):
            after: dict[tuple[int, int], float] = {}
            for (left, knows), chance in belief.items():
                then = 0 if choice % 2 else knows
                if knows != seen:
                    continue
                ends = [((left - 1, then), chance)]
                if left == 1:
                    times = range(interval[0], interval[1] + 1)
                    ends = [((time, 1), chance * SURE / len(times)) for time in times]
                    ends += [((time, then), chance * (1 - SURE) / len(times)) for time in times]
                for end, share in ends:
                    after[end] = after.get(end, 0.0) + share
            total += belief_module.DISCOUNT * best_worth(after, worth, interval, seconds - 1)
        of_choices.append(total)
    return max(of_choices)


@pytest.mark.parametrize("interval", [(1, 2), (2, 2), (2, 3)])
def test_plans_are_worth_what_going_through_all_of_them_says(monkeypatch, interval):
    monkeypatch.setattr(belief_module, "APART", 1e-9)
    worth = np.array([[10.0, 1.0], [6.0, 6.0], [7.0, 5.0], [4.0, 4.0]])
    first = np.zeros(belief_module.STATES)
    first[[1, 3]] = 0.5  # the jammer knows the point, and checks in this second or in the next
    steps = belief_module.transitions(interval)
    beliefs = belief_module.reachable(first, steps[:, 1:], 1 + 4 + 4**2 + 4**3)  # of three seconds
    later = belief_module.solve(worth, steps[[0, 1, 0, 1], 1], beliefs, 3)
    sums = [(first * later)[:, :, knew::2].sum(axis=2).max(axis=1) for knew in range(2)]
    now = (worth[:, None, :] * first.reshape(-1, 2)).sum(axis=(1, 2))
    exact = best_worth({(1, 1): 0.5, (2, 1): 0.5}, worth, interval, 4)
    assert (now + sums[0] + sums[1]).max() == pytest.approx(exact, rel=1e-12)


def jammed(point: int, centre: int | None, away_m: float = 300.0) -> np.ndarray:
    """Return what an ally sees at a point after narrowband jamming of a centre, or at the start."""
    seen = ally_sees(10.0)
    seen[0, 3], seen[0, 6] = np.sqrt(away_m / 1500), 2 * point / 14 - 1
    if centre is not None:
        seen[0, 9], seen[0, 10 + NARROWBAND] = 2 * centre / 14 - 1, 1
    return seen


def test_a_planning_ally_leaves_a_point_once_it_is_jammed_and_stays_while_the_jammer_has_lost_it():
    ally, state = BeliefAlly(LINK), None
    for point, centre in ((2, None), (2, 2)):
        action, state = ally.predict(jammed(point, centre), state)
        assert action[0, 0] > 0 or action[0, 1] > 0
    action, state = ally.predict(jammed(12, 2), state)
    assert action[0, 0] < 0
    assert state["known"] == 2
    assert state["belief"][0, 1::2].sum() < 0.6  # unless a check has just found it
    action, state = ally.predict(jammed(12, 12), state)
    assert state["known"] == 12
    assert action[0, 0] > 0


@pytest.mark.parametrize("belief", [0.0, 1e-320])
def test_a_planning_ally_begins_anew_where_nothing_explains_what_it_sees(belief):
    ally, state = BeliefAlly(LINK), None
    for point, centre in ((2, None), (2, 2), (5, 14), (9, 0)):
        action, state = ally.predict(jammed(point, centre), state)
        assert np.isfinite(action).all()
        assert state["belief"].sum() == pytest.approx(1)
    state["belief"] = belief
    action, state = ally.predict(jammed(9, 9), state)
    assert np.isfinite(action).all()
    assert state["belief"].sum() == pytest.approx(1)


def test_it_jams_with_allowed_types_only():
    from dataclasses import replace

    jammer = BayesJammer(replace(LINK, jamming_types=("comb",)))
    assert follow([heard(3)] * 3, jammer)[0][-1][0] == "comb"


@pytest.mark.full
@pytest.mark.slow
def test_the_bayes_jammer_earns_more_than_every_script_and_its_oracle_more_than_it():
    allies = ("idle", "reactive", "by-type", "always-hop")

    def earned(jammer: str) -> float:
        return float(np.mean([mean("opponent_return", ally, jammer, LINK) for ally in allies]))

    bayes = earned("bayes")
    assert bayes > max(map(earned, ("adaptive", "watchful", "tone", "broadband"))) + 0.1
    assert earned("oracle") > bayes + 0.1


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize("jammer", ["tone", "narrowband", "adaptive"])
def test_a_planning_ally_earns_more_than_every_script_against_a_jammer_that_it_knows(jammer):
    def earned(ally: str) -> float:
        return mean("ally_return", ally, jammer, LINK)

    scripts = max(map(earned, ("by-type", "clock", "evidence", "range")))
    assert scripts < earned("belief") < earned("oracle")


def test_the_range_rule_spreads_by_geometry_and_sprints_away_from_a_near_opponent():
    rule, state, speeds = Tactic("ally", "range", LINK), None, []
    for x, away_m in ((0.0, 100.0), (0.1, 100.0), (0.0, 100.0), (-0.1, 700.0)):
        seen = ally_sees(10.0)
        seen[0, :3] = x, 0.0, 0.0  # 275 m above the base station
        seen[0, 3:6] = np.sqrt(away_m / 1500), 0.0, 0.0
        action, state = rule.predict(seen, state)
        assert action[0, 0] < 0  # it never hops
        speeds.append(round(12.5 * (float(action[0, 2]) + 1), 1))
        assert (action[0, 1] > 0) == (away_m == 100.0)
    assert speeds == [25.0, 10.0, 25.0, 10.0]


def test_oracles_of_the_model_link_are_its_own():
    assert isinstance(as_player("oracle", "ally", LINK), OracleLinkAlly)
    assert not isinstance(as_player("oracle", "ally", STANDARD), OracleLinkAlly)
    state = np.zeros((1, FULL_STATE_SIZE), np.float32)
    state[0, 6], state[0, OPPONENT + 6], state[0, OPPONENT + 7] = 0.0, 0.0, 0.02
    state[0, 3:6] = 0.2
    state[0, OPPONENT + 3 : OPPONENT + 6] = -0.2
    state[0, OPPONENT + JAM_TYPE] = 1  # a tone on its point
    action = OracleLinkAlly(LINK).predict(state)[0][0]
    assert action[0] > 0 or action[1] > 0
    state[0, OPPONENT + 6] = 1.0  # it is taken to be at the other end of the band
    state[0, OPPONENT + JAM_CENTRE] = 1.0
    action = OracleLinkAlly(LINK).predict(state)[0][0]
    assert action[0] < 0
    assert action[1] < 0
