"""Families of policies, each written once as an ONNX graph, of which a search plays many at once.

While a search runs, the numbers of the candidates are an input of the graph, a row for each game. In an
exported agent they are constants, so what was searched and what is exported are the same operators.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fpg_bench.common.ids import other_side
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import RELATIVE_POSITION
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.player import Player
from fpg_bench.products.league.categorical import Play
from fpg_bench.training.export import Graph, Value, rows_of


class PolicyGraph:
    """Graph of a policy with memory.

    Args:
        names: names of the family's numbers.
        numbers: ``(len(names),)`` float32, those of one candidate; None: they are an input ``numbers``.
        memory: size of the memory.

    Attributes:
        seen: the observation ``(n, 15)``.
        memory: the memory ``(n, memory)``, zero when a round begins.
        noise: ``(n, 1)``, standard normal numbers of the player.
    """

    def __init__(self, names: Sequence[str], numbers: np.ndarray | None, memory: int) -> None:
        self._graph, self._names, self._numbers, self._size = Graph(), tuple(names), numbers, memory
        self.seen, self.memory, self.noise = (
            Value(self._graph, name) for name in ("observation", "state", "noise")
        )

    def given(self, name: str, count: int = 1) -> Value:
        """Return numbers of the candidate from the named one on, ``(n, count)`` or ``(1, count)``."""
        first = self._names.index(name)
        if self._numbers is None:
            return Value(self._graph, self._graph.columns("numbers", first, first + count))
        return Value(self._graph, self._graph.constant(self._numbers[None, first : first + count]))

    def constant(self, *values: float) -> Value:
        """Return a row of constants ``(1, k)``."""
        return Value(self._graph, self._graph.constant(np.array([values], np.float32)))

    def count_at_most(self, edges: Value, value: Value) -> Value:
        """Return ``(n, 1)``, how many of the edges ``(n, k)`` are at most the value ``(n, 1)``."""
        each = (value < edges).where(0, 1)
        axes = self._graph.constant([1])
        return Value(self._graph, self._graph.add("ReduceSum", each.name, axes, keepdims=1))

    def finish(self, action: Sequence[tuple[int, int, Value]], memory: Sequence[Value]) -> bytes:
        """Return the model as bytes.

        Args:
            action: parts of the action, each its first column, how many it has, and the values ``(n, k)`` or
                ``(1, k)``; other columns are 0.
            memory: the columns of the next memory.
        """
        graph, eye = self._graph, np.eye(ACTION_SIZE, dtype=np.float32)
        parts = [
            graph.add("MatMul", value.name, graph.constant(eye[column : column + count]))
            for column, count, value in action
        ]
        graph.add("Sum", *parts, to="action")
        graph.add("Concat", *(each.name for each in memory), axis=1, to="next_state")
        inputs = [rows_of("observation", OBSERVATION_SIZE), rows_of("noise", 1), rows_of("state", self._size)]
        if self._numbers is None:
            inputs.append(rows_of("numbers", len(self._names)))
        return graph.to_bytes(inputs, [rows_of("action", ACTION_SIZE), rows_of("next_state", self._size)])


def away_m(seen: Value, scenario: Scenario) -> Value:
    """Return the relative position ``(n, 3)`` of an observation in m."""
    root = seen.column(RELATIVE_POSITION, 3)
    box = Value(seen.graph, seen.graph.constant(np.array([scenario.box_m], np.float32)))
    return root * abs(root) * box


class Candidates(OnnxPlayer):
    """Player of many candidates of a family; the batch is divided evenly among them, in their order.

    Args:
        model: the family's graph, with the input ``numbers``.
        numbers: ``(candidates, n)`` float32.
    """

    def __init__(self, model: bytes, numbers: np.ndarray) -> None:
        self.model, self.card, self.size = model, None, OBSERVATION_SIZE
        self._open(model)
        self._numbers = self._rows = np.ascontiguousarray(numbers, np.float32)

    def run(self, feeds: dict[str, np.ndarray]) -> list[np.ndarray]:
        """Return the outputs of one call of the family, with each game's candidate."""
        count = len(feeds["observation"])
        if len(self._rows) != count:
            self._rows = self._numbers[np.arange(count) * len(self._numbers) // count]
        return super().run(feeds | {"numbers": self._rows})


def earnings(
    candidates: Callable[[np.ndarray], Candidates],
    side: str,
    rivals: Sequence[Player],
    scenario: Scenario,
    reward: str = "own",
) -> Play:
    """Return what plays candidates of a side against a rival, for a search.

    Args:
        candidates: the player of candidates by their options ``(candidates, numbers)``.
        side: side of the candidates.
        rivals: players of the other side.
        scenario: what is played.
        reward: ``own``, or ``zero_sum``, what the rivals lose.
    """
    sign, whose = (-1.0, other_side(side)) if reward == "zero_sum" else (1.0, side)

    def play(options: np.ndarray, rival: int, first_seed: int, matches: int) -> np.ndarray:
        count = len(options)
        batch = TwoPlayerBatch(scenario, count * matches, threads=1)
        players: dict[str, Player] = {side: candidates(options), other_side(side): rivals[rival]}
        match = make_match(batch, players["ally"], players["opponent"])
        seeds = np.tile(np.arange(first_seed, first_seed + matches), count)
        earned = np.zeros(count * matches)
        for number in range(scenario.rounds_per_match):
            play_round(match, seeds=None if number else seeds)
            tallies = batch.batch.tallies
            earned += sign * tallies[f"{whose}_return"] / tallies["steps"]
        return earned.reshape(count, matches) / scenario.rounds_per_match

    return play
