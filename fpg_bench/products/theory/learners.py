"""Learning allies without networks: bandits over frequency points, and tabular Q-learning.

Each begins a round knowing nothing, and learns from its own SNR and from what hopping and spreading cost by
the rules. Its draws come from the round's own stream, so a round is the same, bit for bit, in a batch of any
size.
"""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.actions import HOP_GATE, KNOWLEDGE_GATE, PREFERENCE, SPEED, SPREAD_GATE
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import log
from fpg_bench.game.rewards import spread_cost
from fpg_bench.game.rules import rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import OWN_FREQUENCY, SENSED_COVERS, SENSED_TYPE, SNR, SPREADING_TIME
from fpg_bench.game.state import ACTION_SIZE, TYPES, Record
from fpg_bench.players.player import Memory, Prediction
from fpg_bench.players.scripted import ally_speed, scenario_scales
from fpg_bench.players.seeded import SeededPolicy

LEARNERS = ("epsilon-greedy", "ucb", "thompson", "q-learning")
EPSILON_GREEDY, UCB, THOMPSON, Q_LEARNING = range(len(LEARNERS))

EPSILON = 0.1  # of epsilon-greedy and Q-learning
LEARNING_RATE, DISCOUNT = 0.2, 0.9  # of Q-learning
STAY, SPREAD, HOP, HOP_BY_KNOWLEDGE = range(4)  # what Q-learning chooses from
CHOICES = 4
LAST_STATE, LAST_CHOICE = range(2)  # what Q-learning remembers of the step before
STATES = 2 * (TYPES + 1)  # whether it is covered, times the sensed type or none


@compiled
def play_bandit(
    kind: int,
    observations: np.ndarray,
    actions: np.ndarray,
    steps: np.ndarray,
    keys: np.ndarray,
    means: np.ndarray,
    counts: np.ndarray,
    rules: np.ndarray,
    scales: np.ndarray,
) -> None:
    """Fill the actions of a bandit, whose arms are the frequency points.

    It keeps the mean reward of the steps on each point, and draws an arm whenever its link is in outage.
    """
    row = rules[0]
    points = means.shape[1]
    for i in range(observations.shape[0]):
        seen = observations[i]
        point = int((seen[OWN_FREQUENCY] + 1.0) / 2.0 * (points - 1) + 0.5)
        value = _gain(seen, row)
        if steps[i] > 0:  # before, nothing has been jammed
            counts[i, point] += 1.0
            means[i, point] += (value - means[i, point]) / counts[i, point]
        arm = point
        if value < 0.0:
            arm = _arm(kind, means[i], counts[i], keys[i], steps[i])
        speed = ally_speed(seen, scales[0])
        _act(actions[i], arm != point, False, speed, False, 2.0 * arm / (points - 1) - 1.0)
        steps[i] += 1


@compiled
def play_q_learning(
    observations: np.ndarray,
    actions: np.ndarray,
    steps: np.ndarray,
    keys: np.ndarray,
    values: np.ndarray,
    last: np.ndarray,
    rules: np.ndarray,
    scales: np.ndarray,
) -> None:
    """Fill the actions of tabular Q-learning, and update its values ``(n, states, choices)``.

    Its state is whether it is covered, and the sensed type or none. ``last`` ``(n, 2)`` has the state and
    the choice of the step before.
    """
    row = rules[0]
    for i in range(observations.shape[0]):
        seen = observations[i]
        state = 0
        for kind in range(TYPES):
            if seen[SENSED_TYPE + kind] > 0.0:
                state = kind + 1
        if seen[SENSED_COVERS] > 0.0:
            state += TYPES + 1
        if steps[i] > 0:
            before, choice = last[i, LAST_STATE], last[i, LAST_CHOICE]
            gain = _gain(seen, row) - _costs(seen, choice >= HOP, row)
            target = gain + DISCOUNT * values[i, state, _best(values[i, state])]
            values[i, before, choice] += LEARNING_RATE * (target - values[i, before, choice])
        choice = _best(values[i, state])
        if rng.uniform(keys[i], steps[i], rng.PLAYER_DRAW) < EPSILON:
            choice = rng.integer(keys[i], steps[i], rng.PLAYER_DRAW + 1, CHOICES)
        preference = 2.0 * rng.uniform(keys[i], steps[i], rng.PLAYER_DRAW + 2) - 1.0
        speed = ally_speed(seen, scales[0])
        _act(actions[i], choice >= HOP, choice == SPREAD, speed, choice == HOP_BY_KNOWLEDGE, preference)
        last[i, LAST_STATE], last[i, LAST_CHOICE] = state, choice
        steps[i] += 1


@compiled
def _best(values: np.ndarray) -> int:
    """Return the index of the greatest value, the lowest of several."""
    best = 0
    for index in range(1, len(values)):
        if values[index] > values[best]:
            best = index
    return best


@compiled
def _arm(kind: int, means: np.ndarray, counts: np.ndarray, key: np.uint64, step: int) -> int:
    """Return the arm to draw; one that was never drawn has an unbounded index."""
    points = len(means)
    if kind == EPSILON_GREEDY and rng.uniform(key, step, rng.PLAYER_DRAW) < EPSILON:
        drawn: int = rng.integer(key, step, rng.PLAYER_DRAW + 1, points)
        return drawn
    best, highest = 0, -math.inf
    for arm in range(points):
        index = means[arm]
        if kind == THOMPSON:
            normal, _ = rng.gaussians(key, step * points + arm, rng.PLAYER_DRAW + 2)
            index += normal / math.sqrt(counts[arm] + 1.0)
        elif kind == UCB:
            index += math.sqrt(2.0 * log(step + 1.0) / counts[arm]) if counts[arm] > 0.0 else math.inf
        elif counts[arm] == 0.0:
            index = 1.0
        if index > highest:
            best, highest = arm, index
    return best


@compiled
def _gain(seen: np.ndarray, rules: Record) -> float:
    """Return the reward of Eq. 5 before costs, scaled to be 1 at the cap; below 0 in outage."""
    cap = min(rules.snr_cap, 1.0 / rules.per_snr_scale)
    snr = min(seen[SNR] / rules.per_snr_scale, cap)
    gain: float = (snr - rules.threshold) / (cap - rules.threshold)
    return gain


@compiled
def _costs(seen: np.ndarray, hopped: bool, rules: Record) -> float:
    """Return what hopping and spreading cost in the last step, on the same scale."""
    cap = min(rules.snr_cap, 1.0 / rules.per_snr_scale)
    cost: float = spread_cost(seen[SPREADING_TIME] / rules.per_spreading_scale, rules)
    cost += rules.hop_cost if hopped else 0.0
    cost /= cap - rules.threshold
    return cost


@compiled
def _act(
    action: np.ndarray, hop: bool, spread: bool, speed: float, knowledge: bool, preference: float
) -> None:
    """Fill the nine floats."""
    action[:] = 0.0
    action[HOP_GATE] = 1.0 if hop else -1.0
    action[SPREAD_GATE] = 1.0 if spread else -1.0
    action[SPEED] = speed
    action[PREFERENCE] = preference
    action[KNOWLEDGE_GATE] = 1.0 if knowledge else -1.0


class Learner(SeededPolicy):
    """A learning ally: its memory is the step of the round and what it has learned in it.

    ``epsilon-greedy``, ``ucb`` (UCB1; Auer, Cesa-Bianchi and Fischer 2002) and ``thompson`` (Thompson
    sampling with normal priors; Agrawal and Goyal 2013) choose a frequency point whenever their link is in
    outage, by the mean reward of the steps on each point. ``q-learning`` (Watkins and Dayan 1992; against
    jamming Slimeni et al. 2015) chooses in every step whether to stay, to spread, or to hop to a point drawn
    at random or by the knowledge base.

    Args:
        name: one of ``LEARNERS``.
        scenario: the rules, with the scales of observations and the costs.
    """

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name = name
        self._kind = LEARNERS.index(name)
        self._points = scenario.frequency_points
        self._rules, self._scales = rules_record(scenario), scenario_scales(scenario)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        count = len(seen)
        memory = self._empty(count) if state is None else tuple(part.copy() for part in state)
        for part in memory if starts is not None else ():
            part[starts] = 0
        seen = np.require(seen, np.float32, ("C", "A", "W"))
        actions = np.empty((count, ACTION_SIZE), np.float32)
        steps, first, second = memory
        keys = self.keys(count)
        if self._kind == Q_LEARNING:
            play_q_learning(seen, actions, steps, keys, first, second, self._rules, self._scales)
        else:
            play_bandit(self._kind, seen, actions, steps, keys, first, second, self._rules, self._scales)
        return actions, memory

    def _empty(self, count: int) -> tuple[np.ndarray, ...]:
        """Return the memory of rounds that have not begun: steps, and two arrays of the method's own."""
        steps = np.zeros(count, np.int64)
        if self._kind == Q_LEARNING:
            return steps, np.zeros((count, STATES, CHOICES)), np.zeros((count, 2), np.int64)
        return steps, np.zeros((count, self._points)), np.zeros((count, self._points))

    def __repr__(self) -> str:
        return f"Learner({self.name!r})"
