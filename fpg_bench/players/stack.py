"""Policies of equal layer sizes as one stack, which one compiled loop computes for many games at once.

A stack's actions are equal to those of onnxruntime to 1e-5, not to the bit, and each game is computed by
itself, whatever the others are. So training may play rivals by it, and results are made without it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fpg_bench.common.extras import has
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.compiling import compiled
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.onnx_file import plain_model
from fpg_bench.players.player import Player

# Of an action entry, between a stack and onnxruntime, whose float32 rounding differs by up to 1.1e-5 among
# the shipped agents: 57 of 98 plain networks are within 1e-6, 97 within 5e-6. An export may differ by 1e-4.
TOLERANCE = 1e-5
_FLAGS = {"Relu": 1, "Tanh": 2, "Clip": 4}  # what follows a layer, in this order
_logger = logging.getLogger(__name__)


class Network(NamedTuple):
    """A plain chain of layers.

    Attributes:
        sizes: of the observation, or of all its stacked frames, and of each layer's output.
        flags: per layer, what follows it.
        parameters: ``(n,)`` float32: per layer the weights ``(inputs, outputs)``, and the bias.
    """

    sizes: tuple[int, ...]
    flags: tuple[int, ...]
    parameters: np.ndarray


class PolicyStack:
    """Policies of equal layer sizes.

    Args:
        networks: the policies.
        games: number of games.

    Attributes:
        frames: ``(games, sizes[0])`` float32, the stacked observations of each game, the newest last.
    """

    def __init__(self, networks: Sequence[Network], games: int) -> None:
        self._sizes = np.array(networks[0].sizes)
        self.frames = np.zeros((games, self._sizes[0]), np.float32)
        self._flags = np.array([network.flags for network in networks])
        self._parameters = np.stack([network.parameters for network in networks])
        self._rows = np.zeros((2, self._sizes.max()), np.float32)

    def actions(
        self, observations: np.ndarray, starts: np.ndarray, games: np.ndarray, members: np.ndarray
    ) -> np.ndarray:
        """Return the actions ``(n, 9)`` of a policy in each of some games; no game's depend on another's.

        Args:
            observations: ``(games, 15)`` float32, of all games.
            starts: ``(games,)`` bool, those whose round starts; frames of before are forgotten.
            games: ``(n,)`` int64, the games.
            members: ``(n,)`` int64, the index of the policy that plays in each.
        """
        answer = np.empty((len(games), ACTION_SIZE), np.float32)
        networks = self._sizes, self._flags, self._parameters
        _compute(answer, observations, starts, games, members, *networks, self.frames, self._rows)
        return answer


def stacks(players: Sequence[Player], side: str, batch: GameBatch) -> list[tuple[PolicyStack, list[int]]]:
    """Return stacks of players, each with the indices of its members; at least two form one.

    Members are agents of this process without noise whose policies are plain chains of layers behind an
    observation or stacked frames.
    On the observations of a round at random, each must act as by onnxruntime to 1e-5; those that do not are
    named in one line of the log and play one by one.
    """
    by_sizes: dict[tuple[int, ...], list[tuple[int, Network]]] = {}
    for index, player in enumerate(players):
        if any(other is player for other in players[:index]):  # named several times, to be drawn more often
            continue
        if (network := network_of(player)) is not None:
            by_sizes.setdefault(network.sizes, []).append((index, network))
    alike = [group for group in by_sizes.values() if len(group) > 1]
    seen = _observations(side, batch.scenario) if alike else np.empty(0)
    found = []
    for group in alike:
        equal = [(index, network) for index, network in group if _is_equal(players[index], network, seen)]
        if len(equal) < len(group):
            members = {index for index, _ in equal}
            apart = ", ".join(repr(players[index]) for index, _ in group if index not in members)
            _logger.warning(
                f"{side}: by over {TOLERANCE:g} unlike onnxruntime in a stack, so played one by one: {apart}"
            )
        if len(equal) > 1:
            networks = [network for _, network in equal]
            found.append((PolicyStack(networks, batch.count), [index for index, _ in equal]))
    return found


def network_of(player: Player) -> Network | None:
    """Return the network of an agent; None for all but plain chains of layers that are played here.

    What an agent with a memory moves before the first layer is taken for frames, and compared when it joins.
    """
    if not isinstance(player, OnnxPlayer) or player.noise_size:
        return None
    if type(player).predict is not OnnxPlayer.predict or not has("onnx"):
        return None
    from onnx import numpy_helper

    graph = plain_model(player.model).graph
    constants = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    flowing, sizes, flags = "observation", list[int](), list[int]()
    parameters: list[np.ndarray] = []
    for node in graph.node:
        inputs, attributes = list(node.input), {each.name: each for each in node.attribute}
        if player.state_size and node.op_type in ("Slice", "Concat"):
            continue
        if not sizes and player.state_size:
            flowing = inputs[0]
        if not inputs or inputs[0] != flowing or not all(name in constants for name in inputs[1:]):
            return None
        flowing, values = node.output[0], [constants[name] for name in inputs[1:]]
        if node.op_type == "Gemm" and len(values) == 2 and values[1].ndim == 1:
            if any(attributes[key].f != 1 for key in ("alpha", "beta") if key in attributes):
                return None
            if "transA" in attributes and attributes["transA"].i:
                return None
            weights = values[0].T if "transB" in attributes and attributes["transB"].i else values[0]
            if values[1].shape != weights.shape[1:] or weights.dtype != np.float32:
                return None
            sizes += list(weights.shape) if not sizes else [weights.shape[1]]
            flags.append(0)
            parameters += [np.ascontiguousarray(weights).ravel(), values[1]]
        elif flags and node.op_type in _FLAGS and flags[-1] < _FLAGS[node.op_type]:
            if node.op_type == "Clip" and [value.tolist() for value in values] != [-1.0, 1.0]:
                return None
            flags[-1] |= _FLAGS[node.op_type]
        else:
            return None
    if flowing != "action" or not sizes or sizes[0] != player.state_size + OBSERVATION_SIZE:
        return None
    return Network(tuple(sizes), tuple(flags), np.concatenate(parameters).astype(np.float32))


def _observations(side: str, scenario: Scenario) -> np.ndarray:
    """Return observations ``(n, 15)`` of eight rounds in which both sides act at random."""
    games, chance, seen = GameBatch(scenario, 8, threads=1), np.random.default_rng(0), []
    games.reset(seeds=0)
    for step in range(scenario.steps_per_round):
        games.step(*chance.uniform(-1, 1, (2, games.count, ACTION_SIZE)).astype(np.float32))
        if step % 10 == 0:
            seen.append(
                games.ally_observations.copy() if side == "ally" else games.opponent_observations.copy()
            )
    return np.concatenate(seen)


def _is_equal(player: Player, network: Network, seen: np.ndarray) -> bool:
    """Return True if a network acts as its player does; False also where either is not a number."""
    stack, size = PolicyStack([network], len(seen)), network.sizes[0] - OBSERVATION_SIZE
    before = np.random.default_rng(0).permuted(np.resize(seen, (len(seen), size)), axis=0)
    stack.frames[:, OBSERVATION_SIZE:] = before
    games, none = np.arange(len(seen)), np.zeros(len(seen), np.int64)
    stacked = stack.actions(seen, none > 0, games, none)
    actions, memory = player.predict(seen, (before, none) if size else None)
    is_kept = not size or np.array_equal(memory[0], stack.frames[:, OBSERVATION_SIZE:])
    return is_kept and bool(np.max(np.abs(stacked - actions)) <= TOLERANCE)


@compiled
def _compute(
    answer: np.ndarray,
    observations: np.ndarray,
    starts: np.ndarray,
    games: np.ndarray,
    members: np.ndarray,
    sizes: np.ndarray,
    flags: np.ndarray,
    parameters: np.ndarray,
    frames: np.ndarray,
    rows: np.ndarray,
) -> None:
    """Compute the actions of each game, all in float32."""
    zero, one, size = np.float32(0), np.float32(1), observations.shape[1]
    for i in range(len(games)):
        x, weights, place = frames[games[i]], parameters[members[i]], 0
        for k in range(sizes[0] - size):
            x[k] = zero if starts[games[i]] else x[k + size]
        for k in range(size):
            x[sizes[0] - size + k] = observations[games[i], k]
        for layer in range(len(sizes) - 1):
            inputs, outputs, kind = sizes[layer], sizes[layer + 1], flags[members[i], layer]
            y = rows[layer % 2]
            for j in range(outputs):
                y[j] = weights[place + inputs * outputs + j]
            for k in range(0, inputs - 3, 4):  # four at once: y is read and written a quarter as often
                a, b, c, d = x[k], x[k + 1], x[k + 2], x[k + 3]
                w, more = weights[place : place + 4 * outputs], 2 * outputs
                for j in range(outputs):
                    y[j] += a * w[j] + b * w[outputs + j] + c * w[more + j] + d * w[more + outputs + j]
                place += 4 * outputs
            for k in range(inputs - inputs % 4, inputs):
                for j in range(outputs):
                    y[j] += x[k] * weights[place + j]
                place += outputs
            place += outputs
            for j in range(outputs):
                value = y[j]
                if kind & 1 and value < zero:
                    value = zero
                if kind & 2:
                    value = np.tanh(value)
                if kind & 4:
                    value = one if value > one else -one if value < -one else value
                y[j] = value
            x = y
        for j in range(len(answer[i])):
            answer[i, j] = x[j]
