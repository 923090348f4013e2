"""Self-play of stochastic tables: an ally that responses can hardly foresee.

Each player has a distribution over few choices for each cell of discretised features, which mirror descent
moves towards choices of higher advantage and, more weakly, towards that of the beginning (Sokota et al.
2023). Without that pull self-play goes round in circles; with it, the policies settle. The exported ally is
the average of the last ones. It meets several opponents, each of which begins with another type of jamming,
since a single one stays near where it began; those that leave it least are met most.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import NormalDist

import numpy as np

from fpg_bench.common.files import write_json
from fpg_bench.common.locks import own_folder
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.game import rng
from fpg_bench.game import step as kernel
from fpg_bench.game.actions import HOP_GATE, IN_BAND_GATE, PREFERENCE, TUNING, TYPE_SCORES
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.compiling import compiled
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.game.sensing import (
    JAM_TYPE,
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    LAST_CHECK,
    NEXT_CHECK,
    OWN_FREQUENCY,
    RELATIVE_POSITION,
    SENSED_CENTRE,
    SENSED_COVERS,
    SENSED_TYPE,
    SPREADING_TIME,
)
from fpg_bench.game.spec import GameSpec
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE, TYPES
from fpg_bench.players.agent import write_agent
from fpg_bench.products.league.candidates import away_m
from fpg_bench.products.league.config import TabularSelfPlayConfig
from fpg_bench.products.league.tabular import cell_of, drawn_point, kind_of, table_choices
from fpg_bench.training.export import Graph, Value, counted, rows_of

RESULT = "tabular_self_play.json"
TONE, NARROWBAND, BROADBAND, COMB = map(JAMMING_TYPES.index, ("tone", "narrowband", "broadband", "comb"))
# Edges of the ally's features, in metres, seconds and counts: the distance; hits in a row; the sensed type,
# or 5 for narrow jamming on the point that it left last; seconds since a change of the point, since the first
# of the last hits in a row (the sign of a check), and of spreading.
ALLY_EDGES = (
    (12, 30, 60, 105),
    (0.5, 1.5, 2.5),
    (0.5, 1.5, 2.5, 3.5, 4.5),
    (1.5, 2.5, 3.5, 4.5, 6.5),
    (1.5, 2.5, 3.5, 4.5, 5.5, 6.5),
    (0.5, 3.5, 9.5),
)
# The distance; the age of the known point; seconds until the next check; how often in a row checks have found
# the ally where the one before had; whether the last check did not hear it; and the own type.
OPPONENT_EDGES = (
    (12, 30, 60, 105),
    (0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 7.5),
    (1.5, 2.5, 3.5),
    (0.5, 1.5),
    (0.5,),
    (0.5, 1.5, 2.5, 3.5),
)
# Choices of the opponent: a type, and where: at the known point, or at the middle of one of so many equal
# parts of the band, drawn anew; 0 stands for the half without the known point.
_AT_KNOWN, _OTHER_HALF = -1, 0
OPPONENT_CHOICES = (
    *((kind, _AT_KNOWN) for kind in range(TYPES)),
    (NARROWBAND, 5),
    (BROADBAND, 2),
    (COMB, 15),
    (BROADBAND, _OTHER_HALF),
)
_NORMAL = NormalDist()
_LONG_AGO, _NOWHERE = np.float32(99), np.float32(9)
_NEAR = np.float32(1.2 / 14)  # of a point, in halves of the band: 0.6 of the distance of two points
_HITS, _CLOCK, _HOPPED, _FORMER, _OWN, _BEGUN = range(6)  # columns of the ally's memory
_CHOICE, _PLACE, _OPPONENT_CHOICE, _OPPONENT_PLACE, _ODD = (rng.PLAYER_DRAW + k for k in range(5))
# Opponents by the choice that each leans to, and how much. Of the games that they share: the difference in
# what they leave that makes one e times as frequent, the least share, and the weight of an iteration.
LEANINGS, LEANING = (0, 1, 3, 5), 3.0
HARDNESS, LEAST_SHARE, NEWS = 0.5, 1 / 16, 0.2
ODD_SHARE = 1 / 8  # of games whose opponent plays a random table: the ally learns what to do wherever it gets
# Of the learning: the discount and the decay of advantages; the visits at which an average counts half; what
# an iteration takes off the average policy; the step; and the pull, at first and in the end.
GAMMA, LAMBDA, HALF_VISITS, FORGETTING, STEP, PULLS = 0.95, 0.9, 30.0, 0.02, 0.08, (1.5, 0.25)
_STAYS, _MOST_ADVANTAGE, _LEAST_LOGIT = -2.0, 30.0, -12.0
_logger = logging.getLogger(__name__)


def padded(edges: Sequence[Sequence[float]], scales: Sequence[float]) -> np.ndarray:
    """Return ``(features, most edges)`` float32, the edges in the units that are observed, then infinity."""
    rows = np.full((len(edges), max(map(len, edges))), np.inf, np.float32)
    for row, of, scale in zip(rows, edges, scales, strict=True):
        row[: len(of)] = np.array(of) / scale
    rows[0] *= rows[0]  # of a squared distance
    return rows


def ally_edges(scenario: Scenario) -> np.ndarray:
    """Return the edges of the ally's features as it observes them."""
    return padded(ALLY_EDGES, (1, 1, 1, 1, 1, scenario.spreading_scale_s))


def opponent_edges(scenario: Scenario) -> np.ndarray:
    """Return the edges of the opponent's features as it observes them."""
    return padded(OPPONENT_EDGES, (1, scenario.age_scale_s, scenario.check_scale_s, 1, 1, 1))


def count_cells(edges: Sequence[Sequence[float]]) -> int:
    """Return the number of cells."""
    return int(np.prod([len(of) + 1 for of in edges]))


@compiled
def _squared_m(seen: np.ndarray, box_m: np.ndarray) -> np.float32:
    """Return the squared distance in float32, computed as the exported agent does."""
    total = np.float32(0)
    for axis in range(3):
        root = seen[RELATIVE_POSITION + axis]
        away = root * abs(root) * box_m[axis]
        total += away * away
    return total


@compiled
def _cell(values: np.ndarray, edges: np.ndarray) -> int:
    """Return the cell of the features' values."""
    cell = 0
    for k in range(edges.shape[0]):
        count, reached = 0, 0
        for j in range(edges.shape[1]):
            count += edges[k, j] < np.inf
            reached += values[k] >= edges[k, j]
        cell = cell * (count + 1) + reached
    return cell


@compiled
def _kind(seen: np.ndarray, first: int) -> int:
    """Return 1 and more for the type that is seen, 0 for none."""
    kind = 0
    for k in range(TYPES):
        if seen[first + k] > 0.0:
            kind = k + 1
    return kind


@compiled
def ally_cells(
    seen: np.ndarray,
    memory: np.ndarray,
    values: np.ndarray,
    edges: np.ndarray,
    box_m: np.ndarray,
    cells: np.ndarray,
) -> None:
    """Fill the cells of an ally, and its memory ``(n, 6)`` float32; ``values`` is room for the features."""
    for i in range(seen.shape[0]):
        see, own = seen[i], memory[i]
        if own[_BEGUN] <= 0.0:
            own[_HITS], own[_CLOCK], own[_HOPPED] = 0, _LONG_AGO, _LONG_AGO
            own[_FORMER], own[_OWN], own[_BEGUN] = _NOWHERE, see[OWN_FREQUENCY], 1
        own[_HOPPED] += np.float32(1)
        if see[OWN_FREQUENCY] != own[_OWN]:
            own[_HOPPED], own[_FORMER], own[_OWN] = 1, own[_OWN], see[OWN_FREQUENCY]
        is_hit, kind = see[SENSED_COVERS] > 0.0, _kind(see, SENSED_TYPE)
        own[_HITS] = own[_HITS] + np.float32(1) if is_hit else np.float32(0)
        own[_CLOCK] = np.float32(0) if own[_HITS] == 1.0 else own[_CLOCK] + np.float32(1)
        is_narrow = kind == TONE + 1 or kind == NARROWBAND + 1
        if not is_hit and is_narrow and abs(see[SENSED_CENTRE] - own[_FORMER]) < _NEAR:
            kind = TYPES + 1
        values[0], values[1], values[2] = _squared_m(see, box_m), own[_HITS], kind
        values[3], values[4], values[5] = own[_HOPPED], own[_CLOCK], see[SPREADING_TIME]
        cells[i] = _cell(values, edges)


@compiled
def opponent_cells(
    seen: np.ndarray,
    memory: np.ndarray,
    values: np.ndarray,
    edges: np.ndarray,
    box_m: np.ndarray,
    cells: np.ndarray,
) -> None:
    """Fill the cells of an opponent, and its memory ``(n, 3)``: finds in a row, the known point, begun."""
    for i in range(seen.shape[0]):
        see, own = seen[i], memory[i]
        if own[2] <= 0.0:
            own[0], own[1], own[2] = 0, see[KNOWN_FREQUENCY], 1
        elif see[KNOWN_AGE] <= 0.0:
            own[0] = own[0] + np.float32(1) if see[KNOWN_FREQUENCY] == own[1] else np.float32(0)
            own[1] = see[KNOWN_FREQUENCY]
        values[0], values[1], values[2] = _squared_m(see, box_m), see[KNOWN_AGE], see[NEXT_CHECK]
        values[3], values[4], values[5] = own[0], -see[LAST_CHECK], _kind(see, JAM_TYPE)
        cells[i] = _cell(values, edges)


@compiled
def _drawn(reached: np.ndarray, share: float) -> int:
    """Return the choice at a share of cumulated probabilities."""
    choice = 0
    while choice < reached.shape[0] - 1 and share >= reached[choice]:
        choice += 1
    return choice


@compiled
def _act_ally(
    games: np.ndarray,
    cells: np.ndarray,
    reached: np.ndarray,
    rows: np.ndarray,
    points: np.ndarray,
    chosen: np.ndarray,
    actions: np.ndarray,
) -> None:
    """Draw the ally's choices, and fill its actions."""
    for i in range(cells.shape[0]):
        key, step = games[i].round_key, games[i].step
        chosen[i] = _drawn(reached[cells[i]], rng.uniform(key, step, _CHOICE))
        for j in range(ACTION_SIZE):
            actions[i, j] = rows[chosen[i], j]
        if actions[i, HOP_GATE] > 0.0:
            actions[i, PREFERENCE] = points[rng.integer(key, step, _PLACE, points.shape[0])]


@compiled
def _act_opponent(
    games: np.ndarray,
    cells: np.ndarray,
    reached: np.ndarray,
    choices: np.ndarray,
    points: int,
    whose: np.ndarray,
    chosen: np.ndarray,
    seen: np.ndarray,
    actions: np.ndarray,
) -> None:
    """Draw the choices of each game's opponent, and fill its actions; number -1 plays a random table."""
    for i in range(cells.shape[0]):
        key, step = games[i].round_key, games[i].step
        if whose[i] < 0:
            chosen[i] = rng.integer(key, cells[i], _ODD, choices.shape[0])
        else:
            chosen[i] = _drawn(reached[whose[i], cells[i]], rng.uniform(key, step, _OPPONENT_CHOICE))
        kind, parts = choices[chosen[i], 0], choices[chosen[i], 1]
        for k in range(TYPES):
            actions[i, TYPE_SCORES + k] = 1.0 if k == kind else -1.0
        actions[i, IN_BAND_GATE], actions[i, TUNING] = 1.0, 0.0
        if parts == _AT_KNOWN:
            actions[i, IN_BAND_GATE] = -1.0
        elif parts == _OTHER_HALF:
            actions[i, TUNING] = 0.5 if seen[i, KNOWN_FREQUENCY] < 0.0 else -0.5
        else:
            part = 2.0 * rng.integer(key, step, _OPPONENT_PLACE, parts)
            is_point = parts == points
            actions[i, TUNING] = part / (parts - 1.0) - 1.0 if is_point else (part + 1.0) / parts - 1.0


@compiled
def _advantages(
    cells: np.ndarray,
    chosen: np.ndarray,
    rewards: np.ndarray,
    sign: float,
    values: np.ndarray,
    sums: np.ndarray,
    counts: np.ndarray,
) -> None:
    """Add up generalised advantage estimates by cell and choice, and count the visits."""
    for i in range(rewards.shape[1]):
        advantage = 0.0
        for t in range(rewards.shape[0] - 1, -1, -1):
            cell, choice = cells[t, i], chosen[t, i]
            error = sign * rewards[t, i] + GAMMA * values[cells[t + 1, i]] - values[cell]
            advantage = error + GAMMA * LAMBDA * advantage
            sums[cell, choice] += advantage
            counts[cell, choice] += 1.0


@dataclass
class TableLearner:
    """A stochastic table that learns.

    Attributes:
        prior: ``(choices,)``, the logits that it begins with and is pulled to.
        cells: number of cells.
        sign: 1 for the ally, -1 for the opponent, whose reward is what the ally loses.
        values: ``(cells,)``, estimated returns.
        average: ``(cells, choices)``, the probabilities, the newest with most weight.
    """

    prior: np.ndarray
    cells: int
    sign: float
    logits: np.ndarray = field(init=False)
    values: np.ndarray = field(init=False)
    average: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.logits, self.values = np.tile(self.prior, (self.cells, 1)), np.zeros(self.cells)
        self.average = self.probabilities

    @property
    def probabilities(self) -> np.ndarray:
        """``(cells, choices)``, the present policy."""
        shares = np.exp(self.logits - self.logits.max(axis=1, keepdims=True))
        return np.asarray(shares / shares.sum(axis=1, keepdims=True))

    def learn(
        self, cells: np.ndarray, chosen: np.ndarray, rewards: np.ndarray, step: float, temperature: float
    ) -> None:
        """Take a step of mirror descent by what rounds showed: all ``(steps, games)``, cells one more."""
        sums, counts = np.zeros_like(self.logits), np.zeros_like(self.logits)
        _advantages(cells, chosen, rewards, self.sign, self.values, sums, counts)
        visits = counts.sum(axis=1)
        known = visits / (visits + HALF_VISITS)
        mean = sums.sum(axis=1) / np.maximum(visits, 1.0)
        advantages = (sums / np.maximum(counts, 1.0) - mean[:, None]) * counts / (counts + HALF_VISITS)
        policy = self.probabilities
        advantages -= (policy * advantages).sum(axis=1, keepdims=True)
        pulled = self.logits - step * temperature * known[:, None] * (self.logits - self.prior)
        moved = pulled + step * np.clip(advantages, -_MOST_ADVANTAGE, _MOST_ADVANTAGE)
        moved = np.maximum(moved - moved.max(axis=1, keepdims=True), _LEAST_LOGIT)
        self.logits = np.where(visits[:, None] > 0.0, moved, self.logits)
        self.values += mean * np.minimum(known, 0.5)
        self.average += FORGETTING * (self.probabilities - self.average)


class SelfPlay:
    """Games of two stochastic tables.

    Args:
        scenario: the rules; the opponent pursues the ally.
        games: games of a batch.
        first_seed: seed of the first game.
    """

    def __init__(self, scenario: Scenario, games: int, first_seed: int) -> None:
        self.batch, self.steps = GameBatch(scenario, games, threads=1), scenario.steps_per_round
        self._seeds: np.ndarray | None = np.arange(first_seed, first_seed + games)
        self._edges = ally_edges(scenario), opponent_edges(scenario)
        self._box_m = np.array(scenario.box_m, np.float32)
        hops = table_choices("ally", scenario)
        self.choices = len(hops.names)
        self._rows, self._points = hops.rows, hops.places
        self._ways = np.array(OPPONENT_CHOICES)

    def play(self, ally: np.ndarray, opponents: np.ndarray, whose: np.ndarray) -> tuple[np.ndarray, ...]:
        """Play a round of every game, the first of its next match.

        Args:
            ally: ``(cells, choices)``, its probabilities.
            opponents: ``(opponents, cells, choices)``.
            whose: ``(games,)``, the opponent of each; -1 for one that draws a table of its own.

        Returns:
            The cells of the ally and of the opponent, ``(steps + 1, games)``, their choices, and the ally's
            rewards, ``(steps, games)``.
        """
        batch, count = self.batch, self.batch.count
        batch.reset(seeds=self._seeds, new_match=self._seeds is None)
        self._seeds = None
        memories = np.zeros((count, 6), np.float32), np.zeros((count, 3), np.float32)
        seen = batch._ally_observations, batch._opponent_observations
        cells = np.zeros((2, self.steps + 1, count), np.int64)
        chosen = np.zeros((2, self.steps, count), np.int64)
        rewards, room = np.zeros((self.steps, count)), np.zeros(6, np.float32)
        reached = ally.cumsum(axis=1), opponents.cumsum(axis=2)
        for t in range(self.steps + 1):
            ally_cells(seen[0], memories[0], room, self._edges[0], self._box_m, cells[0, t])
            opponent_cells(seen[1], memories[1], room, self._edges[1], self._box_m, cells[1, t])
            if t == self.steps:
                break
            rows, points, actions = self._rows, self._points, batch._ally_actions
            _act_ally(batch.games, cells[0, t], reached[0], rows, points, chosen[0, t], actions)
            ways, actions = (self._ways, len(points), whose), batch._opponent_actions
            _act_opponent(batch.games, cells[1, t], reached[1], *ways, chosen[1, t], seen[1], actions)
            kernel.play(0, count, *batch._arguments)
            rewards[t] = batch.games["ally_reward"]
        return (*cells, *chosen, rewards)


def stochastic_table_onnx(probabilities: np.ndarray, scenario: Scenario) -> bytes:
    """Return an ally's table as ONNX, with the inputs and outputs of an agent.

    Its cells are those of :func:`ally_cells` to the bit. The first number of the noise draws the point, the
    second the choice.
    """
    graph, choices, size = Graph(), table_choices("ally", scenario), _BEGUN + 1

    seen, state = Value(graph, "observation"), Value(graph, "state")
    is_new, own_now = state.column(_BEGUN) < 0.5, seen.column(OWN_FREQUENCY)
    remembered = {column: state.column(column) for column in range(_BEGUN)}
    for column, start in ((_CLOCK, _LONG_AGO), (_HOPPED, _LONG_AGO), (_FORMER, _NOWHERE), (_OWN, own_now)):
        value = start if isinstance(start, Value) else float(start)
        remembered[column] = is_new.where(value, remembered[column])
    is_same, is_hit = own_now.equals(remembered[_OWN]), seen.column(SENSED_COVERS) > 0
    hopped = is_same.where(remembered[_HOPPED] + 1, 1)
    former = is_same.where(remembered[_FORMER], remembered[_OWN])
    hits = is_hit.where(remembered[_HITS] + 1, 0)
    clock = hits.equals(1).where(0, remembered[_CLOCK] + 1)
    types = seen.column(SENSED_TYPE, TYPES)
    is_narrow = (types.column(TONE) > 0) | (types.column(NARROWBAND) > 0)
    is_former = is_narrow & (abs(seen.column(SENSED_CENTRE) - former) < float(_NEAR)) & ~is_hit
    kind, away = is_former.where(TYPES + 1, kind_of(types)), away_m(seen, scenario)
    values = (away.dot(away), hits, kind, hopped, clock, seen.column(SPREADING_TIME))
    features = [value.name for value in values]
    edges = [of[np.isfinite(of)] for of in ally_edges(scenario)]
    bounds = graph.constant(_quantiles(probabilities))
    bounds = graph.add("Gather", bounds, cell_of(graph, list(zip(features, edges, strict=True))), axis=0)
    chosen = counted(graph, graph.add("Less", graph.columns("noise", 1, 2), bounds), (0, 1))
    point = (choices.drawn, choices.quantiles, choices.drawn_rows)
    parts = [
        graph.add("Gather", graph.constant(choices.rows), chosen, axis=0),
        drawn_point(graph, graph.columns("noise", 0, 1), chosen, *point),
    ]
    graph.add("Sum", *parts, to="action")
    memory = (hits, clock, hopped, former, own_now, state.column(_BEGUN).at_least(1))
    graph.add("Concat", *(each.name for each in memory), axis=1, to="next_state")
    inputs = [rows_of("observation", OBSERVATION_SIZE), rows_of("noise", 2), rows_of("state", size)]
    return graph.to_bytes(inputs, [rows_of("action", ACTION_SIZE), rows_of("next_state", size)])


def _quantiles(probabilities: np.ndarray) -> np.ndarray:
    """Return ``(cells, choices - 1)`` float32, the normal quantiles at which one choice follows another."""
    reached = probabilities.cumsum(axis=1)[:, :-1].clip(0.0, 1.0)
    flat = [-np.inf if p <= 0 else np.inf if p >= 1 else _NORMAL.inv_cdf(p) for p in reached.ravel().tolist()]
    return np.array(flat, np.float32).reshape(reached.shape)


def share_games(left: np.ndarray, games: int) -> np.ndarray:
    """Return ``(games,)``, the opponent of each game: those that leave least to the ally have most.

    A share of the games has number -1, an opponent with a random table.
    """
    odd, least = int(games * ODD_SHARE), int(games * LEAST_SHARE)
    weights = np.exp((left.min() - left) / HARDNESS)
    ends = np.cumsum(weights / weights.sum()) * (games - odd - least * len(left))
    counts = np.diff(np.round(ends).astype(int), prepend=0) + least
    return np.repeat(np.arange(-1, len(left)), (odd, *counts))


def tabular_self_play(config: TabularSelfPlayConfig, out: str | Path, *, progress: bool = False) -> Path:
    """Train an ally and its opponents, all of them stochastic tables, against each other.

    Args:
        config: the training.
        out: a folder for ``agent``, the ally, and ``tabular_self_play.json``, what it earned.
        progress: not read.

    Returns:
        The folder of the agent.

    Raises:
        UserError: a folder with other files.
        KeyboardInterrupt: stopped by the user.
    """
    scenario, folder, began = STANDARD, Path(out), time.process_time()
    with own_folder(folder, RESULT, "tabular self-play"):
        games = SelfPlay(scenario, config.games, training_seed(config.seed))
        stays = np.repeat((0.0, _STAYS), games.choices // 2)
        ally = TableLearner(stays, count_cells(ALLY_EDGES), 1.0)
        leanings = LEANING * np.eye(len(OPPONENT_CHOICES))[list(LEANINGS)]
        opponents = [TableLearner(prior, count_cells(OPPONENT_EDGES), -1.0) for prior in leanings]
        left = np.zeros(len(opponents))  # to the ally, by each
        earned = []
        for iteration in range(config.iterations):
            done = iteration / config.iterations
            first, last = PULLS
            temperature = first * (last / first) ** min(1.0, done / 0.7)
            step = STEP * min(1.0, max(0.2, 2.5 * (1.0 - done)))
            whose = share_games(left, config.games)
            policies = np.array([opponent.probabilities for opponent in opponents])
            cells, answering, chosen, answers, rewards = games.play(ally.probabilities, policies, whose)
            ally.learn(cells, chosen, rewards, step, temperature)
            for number, opponent in enumerate(opponents):
                mine = whose == number
                opponent.learn(answering[:, mine], answers[:, mine], rewards[:, mine], step, temperature)
                left[number] += NEWS * (rewards[:, mine].mean() - left[number])
            earned.append(float(left.min()))
            if iteration % 50 == 49:
                _logger.info(f"iteration {iteration}: keeps {np.round(left, 2).tolist()} per step")
        seconds = round(time.process_time() - began, 1)
        last_ones = earned[-max(1, len(earned) // 10) :]
        write_json(folder / RESULT, {"earned": round(float(np.mean(last_ones)), 4), "seconds": seconds})
        write_agent(
            folder / "agent",
            stochastic_table_onnx(ally.average, scenario),
            algorithm="tabular",
            game=GameSpec.of("FPG/duel_v0", actions={"ally": "uniform-hop"}),
            side="ally",
            sample=True,
            training_seed=config.seed,
            training_steps=config.iterations * config.games * scenario.steps_per_round,
            seconds=seconds,
        )
    return folder / "agent"
