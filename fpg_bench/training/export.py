"""Export of a trained SB3 model as an agent folder, with normalization and memory folded in.

Layers are written operator by operator, in a millisecond: training evaluates what it will ship. A module that
is made of these layers, such as a features extractor of the user's own, is traced by :mod:`torch.fx`.
"""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.training import require_libraries

require_libraries()

import hashlib
import math
import operator
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.fx
from numpy.typing import ArrayLike
from onnx import TensorProto, helper, numpy_helper
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from fpg_bench.common.errors import UserError
from fpg_bench.common.imports import reason
from fpg_bench.common.products import offered
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.actions import PREFERENCE
from fpg_bench.game.choices import PURSUIT_M, Choices, action_choices
from fpg_bench.game.sensing import RELATIVE_POSITION
from fpg_bench.game.spec import GameSpec, OtherGame, kind_of, observation_size, other_game
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.game.waterfall import waterfall_rows
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.card import AgentCard
from fpg_bench.players.memory import remember
from fpg_bench.players.player import Player
from fpg_bench.players.preprocessing import (
    GREATEST_DIFFERENCE,
    check_difference,
    core_of,
    difference_in_own_games,
    largest,
    preprocessing_of,
    takes_masks,
)
from fpg_bench.players.scripted import player_noise
from fpg_bench.players.trust import remember_exported
from fpg_bench.training.actor import Actor, Normalization, is_untouched, waterfall_of

OPSET = 20
LEAST_SHARE = 1e-7  # of a draw, above the probability of a forbidden choice


def export_onnx(model: BaseAlgorithm) -> bytes:
    """Return the model's deterministic policy as ONNX: ``observation`` (n, 15) to ``action`` (n, 9), float32.

    A policy with memory also has an input ``state`` (n, S) and an output ``next_state``. One that draws
    points has an input ``noise``, and so has that of a seat of a team, which draws its actions and observes
    more numbers; see :class:`fpg_bench.training.actor.Actor`. The file of a discrete policy includes its
    list of choices.

    Args:
        model: a trained model.

    Raises:
        UserError: an unsupported policy, or one with a layer that is not written.
    """
    return plain_onnx(Actor(model))


def exported_player(
    model: BaseAlgorithm,
    choices: Choices | None = None,
    samples: bool | None = None,
    game: OtherGame | None = None,
) -> OnnxPlayer:
    """Return the player of a model's export, as the model is now; arguments and errors as of ``Actor``."""
    actor = Actor(model, choices, samples, game)
    player = OnnxPlayer(plain_onnx(actor), size=actor.size)
    if (core := core_of(model)) is not None and isinstance(core.game_spec, OtherGame):
        player.sees, player.skills = core.game_spec.sees, core.game_spec.skills
    return player


def checked_player(model: BaseAlgorithm, choices: Choices | None = None) -> OnnxPlayer:
    """Return :func:`exported_player`; raise UserError if it plays otherwise than the model's ``predict``."""
    player = exported_player(model, choices)
    check_close(model, largest_difference(model, player, choices, steps=20))
    return player


def export_agent(
    model: BaseAlgorithm,
    folder: str | os.PathLike[str],
    *,
    training_seed: int,
    game: str | GameSpec | None = None,
    algorithm: str | None = None,
    **about: object,
) -> float:
    """Write a trained model as an agent folder: ``policy.onnx`` and ``agent.json``.

    Its ``VecNormalize`` and stacked frames are folded in; nothing is pickled.

    >>> import fpg_bench, tempfile
    >>> from stable_baselines3 import PPO
    >>> games = fpg_bench.make_sb3("FPG/AllyVsScripted-v0", n_envs=2)
    >>> model = PPO("MlpPolicy", games, n_steps=8, batch_size=16)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     difference = export_agent(model, folder, training_seed=0)
    ...     fpg_bench.load_agent(folder).card.algorithm
    'ppo'
    >>> difference < 1e-4
    True

    Args:
        model: a trained model with a policy like those of PPO, DQN, SAC or TD3, with or without an LSTM.
        folder: the agent's folder; for a submission ``<submission>/seed_<training seed>``.
        training_seed: the training seed.
        game: the game that it was trained in, or its id; None takes that of the model's games. A model
            without games needs one that names its scenario, for instance
            ``GameSpec("FPG/AllyVsScriptedDiscrete-v0", scenario="standard")``.
        algorithm: name of the algorithm; None takes the model's class.
        **about: further entries of ``agent.json``.

    Returns:
        The largest difference of any action from the model's own ``predict``.

    Raises:
        UserError: an unsupported policy, or neither games of this package nor a game with its scenario.
    """
    core = core_of(model)
    spec = GameSpec.of(game) if game is not None else None if core is None else core.game_spec
    if spec is None or spec.is_duel or (core is None and spec.scenario is None):
        raise UserError(
            "export: the model has no games of fpg_bench of one side; give the game that it was trained in, "
            f"as game={_example(model)}"
        )
    scenario = spec.resolve() if core is None else core.scenario
    choices = action_choices(spec.config.side, spec.action_mode, scenario) if core is None else None
    description = {
        "algorithm": algorithm or type(model).__name__.lower(),
        "game": spec.describe(),
        "scenario": scenario.hash,
        "scenario_fields": scenario.to_dict(),
        "training_seed": training_seed,
        "training_steps": model.num_timesteps,
    }
    return write_exported(model, Path(folder), description | about, choices, other_game(spec))


def _example(model: BaseAlgorithm) -> str:
    """Return the Python expression of a game whose players observe what a model does."""
    size = math.prod(model.observation_space.shape or ())
    for env_id in offered("game"):
        if size % observation_size(kind_of(env_id)(env_id)) == 0:
            return f"GameSpec.of({env_id!r}, side='ally')"
    return "GameSpec('FPG/AllyVsScripted-v0', scenario='standard')"


def write_exported(
    model: BaseAlgorithm,
    folder: Path,
    about: JsonObject,
    choices: Choices | None = None,
    game: OtherGame | None = None,
) -> float:
    """Write an agent folder: ``policy.onnx`` and ``agent.json``.

    Args:
        model: a trained model (with its ``VecNormalize`` and stacked frames, if it was trained with them).
        folder: the agent's folder.
        about: attributes of the agent's card; the action mode is added where actions are discrete.
        choices: the choices of a discrete model without games.
        game: the game of a model without games, if it is not the duel.

    Returns:
        The largest difference of any action from the model's own ``predict``; of a policy that draws its
        actions, that of its mode.

    Raises:
        UserError: an unsupported policy, or one that plays differently once exported.
    """
    actor = Actor(model, choices, game=game)
    data = plain_onnx(actor)
    played = dict(about["game"])
    if actor.choices is not None:
        played.setdefault("actions", actor.choices.mode)
    content = {**about, "game": played, "policy_sha256": hashlib.sha256(data).hexdigest()}
    if actor.samples:
        content["sample"] = True
    card = AgentCard.parse(content, f"agent {folder}")
    mode = OnnxPlayer(data, size=actor.size)
    if actor.samples:
        mode = exported_player(model, actor.choices, False, game)
    difference = largest_difference(model, mode, actor.choices, game=game)
    check_close(model, difference)
    remember_exported(card.policy_sha256)
    card.model_copy(update={"largest_difference": difference}).write(folder, data)
    return difference


def check_exportable(model: BaseAlgorithm) -> None:
    """Raise UserError if the model's policy cannot be exported."""
    actor = Actor(model)
    plain_onnx(actor)  # what it draws must be written, too
    mode = exported_player(model, actor.choices, False)
    check_close(model, largest_difference(model, mode, actor.choices, steps=20))


def check_close(model: BaseAlgorithm, difference: float) -> None:
    """Raise UserError if the largest difference of an export from its model is too large, or NaN."""
    if not difference <= GREATEST_DIFFERENCE:
        raise UserError(
            f"export: the exported policy differs from predict by {difference:g}, more than "
            f"{GREATEST_DIFFERENCE:g}: {type(model.policy).__name__} computes more than its networks do"
        )


def largest_difference(
    model: BaseAlgorithm,
    player: Player,
    choices: Choices | None = None,
    steps: int = 200,
    game: OtherGame | None = None,
) -> float:
    """Return the largest difference of any action entry between a model and a player.

    They are compared in a copy of the model's own games, or, if it has none that can be copied, in five games
    of uniformly random observations, which restart every twenty steps on average.

    Args:
        model: a trained model.
        player: what plays in its place; its ``predict`` gets the numbers of the game.
        choices: the choices of a discrete model; None for continuous actions.
        steps: number of steps.
        game: as of :func:`write_exported`.

    Raises:
        UserError: wrappers of the games change what the model sees or does, or cannot be looked into.
    """
    difference = difference_in_own_games(model, player, choices, steps)
    check_difference(model, difference)
    if difference is not None:
        return difference
    games, rng = 5, np.random.default_rng(0)
    preprocessing = preprocessing_of(model, waterfall_of(model), game)
    stack = model_state = player_state = None
    starts, differences = np.ones(games, bool), []
    steps_of_round, keys = np.zeros(games, np.int64), np.arange(games, dtype=np.uint64)
    masks: dict[str, np.ndarray] = {}
    if choices is not None and takes_masks(model) and not choices.mask.all():
        masks["action_masks"] = np.tile(choices.mask, (games, 1))
    for _ in range(steps):
        observation = rng.uniform(-1, 1, (games, preprocessing.size)).astype(np.float32)
        stack = preprocessing.pushed(stack, observation, starts)
        expected, model_state = model.predict(preprocessing.shown(stack), model_state, starts, True, **masks)
        if choices is not None:
            steps_of_round[starts] = 0
            expected = choices.decode(expected, observation, noise=player_noise(keys, steps_of_round))
            steps_of_round += 1
        actions, player_state = player.predict(observation, player_state, starts)
        differences.append(np.abs(expected - actions).max(1))
        starts = rng.random(games) < 0.05
    return largest(differences, choices)


def plain_onnx(actor: Actor) -> bytes:
    """Return an actor as ONNX, with the inputs and outputs of :func:`export_onnx`.

    Raises:
        UserError: a layer that is not written, or one that is changed by a hook.
    """
    for module in (actor.features, actor.lstm or nn.Identity(), actor.networks):
        if not all(map(is_untouched, module.modules())):
            raise _not_written(module, "has hooks or replaced methods")
    graph = Graph()
    inputs = [rows_of("observation", actor.size)]
    outputs = [rows_of("action", ACTION_SIZE)]
    obs, next_state, waterfall = "observation", [], actor.waterfall
    if waterfall is not None:
        obs = waterfall_rows(Value(graph, obs), waterfall.table).name
    obs = _normalized(graph, actor.before, obs)
    if actor.past_size:
        parts = [graph.columns("state", 0, actor.frames_size)] if actor.frames_size else []
        parts.append(obs)
        if actor.memory:
            past = Value(graph, "state")[:, actor.frames_size : actor.past_size]
            parts += [each.name for each in remember(actor.memory, Value(graph, "observation"), past)]
        obs = graph.add("Concat", *parts, axis=1)
        next_state.append(graph.columns(obs, actor.frame_size, actor.frame_size + actor.past_size))
    latent = _normalized(graph, actor.after, obs)
    if waterfall is not None and type(actor.features) is not FlattenExtractor:
        latent = graph.add("Reshape", latent, graph.constant([-1, *waterfall.shape]))
    latent = _layer(graph, actor.features, latent)
    if actor.lstm is not None:
        latent, memory = _lstm(graph, actor.lstm, latent, actor.past_size)
        next_state += memory
    latent = _layer(graph, actor.networks, latent)
    if actor.choices is not None:
        _chosen(graph, actor, actor.choices, latent)
    elif actor.samples:
        spread = graph.add("Mul", "noise", graph.constant(actor.deviation))
        graph.clip(graph.add("Add", latent, spread), -1.0, 1.0, to="action")
    elif actor.squash:
        graph.add("Tanh", latent, to="action")
    else:
        graph.clip(latent, -1.0, 1.0, to="action")
    if actor.noise_size:
        inputs.append(rows_of("noise", actor.noise_size))
    if next_state:
        inputs.append(rows_of("state", actor.state_size))
        outputs.append(rows_of("next_state", actor.state_size))
        graph.add("Concat", *next_state, axis=1, to="next_state")
    return graph.to_bytes(inputs, outputs)


class Graph:
    """Graph of ONNX operators, in their order, and their constants."""

    def __init__(self) -> None:
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def add(self, kind: str, *inputs: str, to: str | Sequence[str] = "", **attributes: Any) -> str:
        """Add an operator; returns the name of its first output."""
        outputs = [to or f"{kind.lower()}_{len(self._nodes)}"] if isinstance(to, str) else to
        self._nodes.append(helper.make_node(kind, inputs, outputs, **attributes))
        return outputs[0]

    def constant(self, values: torch.Tensor | ArrayLike) -> str:
        """Add a constant; returns its name."""
        array = values.detach().numpy() if isinstance(values, torch.Tensor) else np.asarray(values)
        name = f"number_{len(self._constants)}"
        self._constants.append(numpy_helper.from_array(array, name))
        return name

    def columns(self, matrix: str, start: int, end: int) -> str:
        """Add a slice of a matrix, the columns from ``start`` to before ``end``."""
        return self.add("Slice", matrix, self.constant([start]), self.constant([end]), self.constant([1]))

    def clip(self, values: str, low: float, high: float, to: str = "") -> str:
        """Add a clip between two limits."""
        return self.add(
            "Clip", values, self.constant(np.float32(low)), self.constant(np.float32(high)), to=to
        )

    def to_bytes(self, inputs: Sequence[Any], outputs: Sequence[Any]) -> bytes:
        """Return the graph as the bytes of an ONNX file."""
        graph = helper.make_graph(self._nodes, "policy", inputs, outputs, self._constants)
        opsets = [helper.make_opsetid("", OPSET)]
        ir_version = helper.find_min_ir_version_for(opsets)
        model = helper.make_model(
            graph, producer_name="fpg-bench", opset_imports=opsets, ir_version=ir_version
        )
        data: bytes = model.SerializeToString(deterministic=True)
        return data


def rows_of(name: str, size: int) -> Any:
    """Return an input or output of a policy with so many numbers in each row."""
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])


def _operator(kind: str) -> Callable[..., Value]:
    return lambda self, *others: self.of(kind, *others)


class Value:
    """A tensor in a graph, with operators and methods that it shares with NumPy's arrays and torch's tensors.

    >>> graph = Graph()
    >>> ((Value(graph, "observation")[:, 2:3] + 1) / 2).name
    'div_2'
    """

    __array_ufunc__ = None  # an array on the left leaves its operators to this class
    __add__, __sub__, __mul__, __truediv__ = map(_operator, ("Add", "Sub", "Mul", "Div"))
    __neg__, __abs__, __lt__, __invert__ = map(_operator, ("Neg", "Abs", "Less", "Not"))
    __and__, __or__, equals = map(_operator, ("And", "Or", "Equal"))
    __radd__, __rmul__ = __add__, __mul__

    def __init__(self, graph: Graph, name: str) -> None:
        self.graph, self.name = graph, name

    def of(self, kind: str, *others: Any, **attributes: Any) -> Value:
        """Return an operator of this and of other values or constants, such as ``Abs``."""
        names = [self.name, *(self._value(each).name for each in others)]
        return Value(self.graph, self.graph.add(kind, *names, **attributes))

    def _value(self, value: Any) -> Value:
        """Return a value, or a constant of the same graph: a list as places or sizes."""
        if isinstance(value, Value):
            return value
        if isinstance(value, torch.Tensor):
            value = value.detach().numpy()
        array = np.asarray(value, np.int64 if isinstance(value, list) else np.float32)
        return Value(self.graph, self.graph.constant(array))

    def column(self, start: int, count: int = 1) -> Value:
        """Return columns."""
        return Value(self.graph, self.graph.columns(self.name, start, start + count))

    def where(self, one: Any, other: Any) -> Value:
        """Return ``one`` where this condition holds, else ``other``."""
        return self.of("Where", one, other)

    def at_least(self, low: float) -> Value:
        """Return the greater of each value and a limit."""
        return self.of("Max", low)

    def dot(self, other: Value) -> Value:
        """Return the inner product ``(n, 1)`` of vectors of three, added in order."""
        product = self.of("Mul", other)
        return product.column(0).of("Add", product.column(1)).of("Add", product.column(2))

    def __rsub__(self, other: Any) -> Value:
        return self._value(other).of("Sub", self)

    def __gt__(self, other: Any) -> Value:
        return self._value(other).of("Less", self)

    def __floordiv__(self, other: Any) -> Value:
        return self.of("Div", other).of("Floor")

    def __getitem__(self, key: tuple[Any, slice]) -> Value:
        """Return a part of the last axis; raise IndexError for what cuts another one, or leaves gaps."""
        *others, last = key
        if last.step not in (None, 1) or any(each not in (..., slice(None)) for each in others):
            raise IndexError(f"{key}: only the last axis is cut, without gaps")
        end = 2**31 - 1 if last.stop is None else last.stop
        return self.of("Slice", [last.start or 0], [end], [-1])

    def clip(self, low: Any, high: Any) -> Value:
        """Return the values within two limits."""
        return self.of("Max", low).of("Min", high)

    def sum(self, axis: int) -> Value:
        """Return the sum along an axis."""
        return self.of("ReduceSum", [axis], keepdims=0)

    def mean(self, dim: int, keepdim: bool = False) -> Value:
        """Return the mean along an axis."""
        return self.of("ReduceMean", [dim], keepdims=int(keepdim))

    def reshape(self, *shape: int) -> Value:
        """Return another shape."""
        return self.of("Reshape", list(shape))

    def unsqueeze(self, dim: int) -> Value:
        """Return an axis of size 1 more."""
        return self.of("Unsqueeze", [dim])

    def flatten(self, start_dim: int) -> Value:
        """Return a matrix."""
        return self.of("Flatten", axis=start_dim)


def _normalized(graph: Graph, layers: Sequence[Normalization], x: str) -> str:
    for layer in layers:
        centred = graph.add("Sub", x, graph.constant(layer.mean))
        x = graph.clip(graph.add("Div", centred, graph.constant(layer.scale)), -layer.clip, layer.clip)
    return x


def _chosen(graph: Graph, actor: Actor, choices: Choices, values: str) -> None:
    """Add the action of the choices with the highest values, or drawn, looked up in their tables."""
    if not choices.mask.all():
        values = graph.add("Add", values, graph.constant(actor.penalty))
    ends = np.cumsum(choices.sizes)
    parts = [
        values if len(choices.lists) == 1 else graph.columns(values, end - size, end)
        for size, end in zip(choices.sizes, ends, strict=True)
    ]
    if actor.samples:
        first = actor.noise_size - len(parts)
        best = [
            draw_choices(graph, part, size, first + k)
            for k, (part, size) in enumerate(zip(parts, choices.sizes, strict=True))
        ]
    else:
        best = [graph.add("ArgMax", part, axis=1, keepdims=0) for part in parts]
    rows = [
        graph.add("Gather", graph.constant(of.rows), chosen, axis=0)
        for of, chosen in zip(choices.lists, best, strict=True)
    ]
    if choices.is_homing:
        rows.append(_velocity(graph, choices, best[-1]))
    if choices.is_drawn:
        normal = "noise" if actor.noise_size == 1 else graph.columns("noise", 0, 1)
        rows.append(_preference(graph, choices, best[0], normal))
    graph.add("Sum", *rows, to="action")


def draw_choices(graph: Graph, values: str, size: int, column: int) -> str:
    """Add the choices of the probabilities softmax(values), drawn by a column of normal noise."""
    sums = graph.constant(np.triu(np.ones((size, size), np.float32)))
    reached = graph.add("MatMul", graph.add("Softmax", values, axis=1), sums)
    normal = graph.columns("noise", column, column + 1)
    error = graph.add("Erf", graph.add("Mul", normal, graph.constant(np.float32(0.5**0.5))))
    half = graph.constant(np.float32(0.5))
    share = graph.add("Mul", graph.add("Add", error, graph.constant(np.float32(1))), half)
    share = graph.add("Max", share, graph.constant(np.float32(LEAST_SHARE)))
    share = graph.add("Mul", share, graph.columns(reached, size - 1, size))
    return counted(graph, graph.add("Less", reached, share))


def counted(graph: Graph, is_true: str, of: tuple[int, int] = (1, 0)) -> str:
    """Add the number of columns that are true, or with ``(0, 1)`` false."""
    counted = graph.add("Where", is_true, *(graph.constant([each]) for each in of))
    return graph.add("ReduceSum", counted, graph.constant([1]), keepdims=0)


def _velocity(graph: Graph, choices: Choices, chosen: str) -> str:
    """Add the velocity that a homing choice adds to its action; see :mod:`fpg_bench.game.choices`."""
    root = graph.columns("observation", RELATIVE_POSITION, RELATIVE_POSITION + 3)
    away = graph.add("Mul", graph.add("Mul", root, graph.add("Abs", root)), graph.constant(choices.box_m))
    squares = graph.add("ReduceSum", graph.add("Mul", away, away), graph.constant([1]), keepdims=1)
    distance = graph.add("Max", graph.add("Sqrt", squares), graph.constant(np.float32(PURSUIT_M)))
    homing = graph.add("Gather", graph.constant(choices.lists[-1].homing[:, None]), chosen, axis=0)
    velocity = graph.add("Mul", graph.add("Div", away, distance), homing)
    return graph.add("MatMul", velocity, graph.constant(np.eye(3, ACTION_SIZE, ACTION_SIZE - 3, np.float32)))


def _preference(graph: Graph, choices: Choices, chosen: str, normal: str) -> str:
    """Add the preferred frequency that a choice with a point drawn by ``normal`` adds to its action."""
    below = graph.add("Less", normal, graph.constant(choices.quantiles))  # ONNX 1.17 infers no shape of >=
    point = counted(graph, below, (0, 1))
    actions = np.zeros((len(choices.preferences), ACTION_SIZE), np.float32)
    actions[:, PREFERENCE] = choices.preferences
    drawn = graph.add("Gather", graph.constant(choices.lists[0].drawn[:, None]), chosen, axis=0)
    return graph.add("Mul", graph.add("Gather", graph.constant(actions), point, axis=0), drawn)


def _linear(graph: Graph, layer: nn.Linear, x: str) -> str:
    parameters = (layer.weight,) if layer.bias is None else (layer.weight, layer.bias)
    return graph.add("Gemm", x, *map(graph.constant, parameters), transB=1)


def _sequential(graph: Graph, layers: nn.Sequential, x: str) -> str:
    for layer in layers:
        x = _layer(graph, layer, x)
    return x


def _convolution(graph: Graph, layer: nn.Conv2d, x: str) -> str:
    if isinstance(layer.padding, str) or layer.padding_mode != "zeros":
        raise _not_written(layer, f"has padding {layer.padding!r} of {layer.padding_mode}")
    parameters = (layer.weight,) if layer.bias is None else (layer.weight, layer.bias)
    return graph.add(
        "Conv",
        x,
        *map(graph.constant, parameters),
        strides=layer.stride,
        pads=2 * layer.padding,
        dilations=layer.dilation,
        group=layer.groups,
    )


def _softplus(graph: Graph, layer: nn.Softplus, x: str) -> str:
    if layer.beta != 1:
        raise _not_written(layer, f"has beta {layer.beta:g}")
    return graph.add("Softplus", x)


def _flatten(graph: Graph, layer: nn.Flatten, x: str) -> str:
    if (layer.start_dim, layer.end_dim) != (1, -1):
        raise _not_written(layer, f"flattens {layer.start_dim} to {layer.end_dim}")
    return graph.add("Flatten", x, axis=1)


# Layers whose attributes describe them completely, and the operators of each.
_LAYERS: dict[type[nn.Module], Callable[[Graph, Any, str], str]] = {
    nn.Sequential: _sequential,
    nn.Linear: _linear,
    nn.Conv2d: _convolution,
    FlattenExtractor: lambda graph, layer, x: x,  # of observations that are flat
    nn.Flatten: _flatten,
    nn.Identity: lambda graph, layer, x: x,
    nn.Dropout: lambda graph, layer, x: x,
    nn.ReLU: lambda graph, layer, x: graph.add("Relu", x),
    nn.Tanh: lambda graph, layer, x: graph.add("Tanh", x),
    nn.Sigmoid: lambda graph, layer, x: graph.add("Sigmoid", x),
    nn.SiLU: lambda graph, layer, x: graph.add("Mul", x, graph.add("Sigmoid", x)),
    nn.ELU: lambda graph, layer, x: graph.add("Elu", x, alpha=layer.alpha),
    nn.CELU: lambda graph, layer, x: graph.add("Celu", x, alpha=layer.alpha),
    nn.SELU: lambda graph, layer, x: graph.add("Selu", x),
    nn.GELU: lambda graph, layer, x: graph.add("Gelu", x, approximate=layer.approximate),
    nn.Mish: lambda graph, layer, x: graph.add("Mish", x),
    nn.Softplus: _softplus,
    nn.Softsign: lambda graph, layer, x: graph.add("Softsign", x),
    nn.Hardsigmoid: lambda graph, layer, x: graph.add("HardSigmoid", x, alpha=1 / 6),
    nn.Hardswish: lambda graph, layer, x: graph.add("HardSwish", x),
    nn.Hardtanh: lambda graph, layer, x: graph.clip(x, layer.min_val, layer.max_val),
    nn.ReLU6: lambda graph, layer, x: graph.clip(x, 0.0, 6.0),
    nn.Hardshrink: lambda graph, layer, x: graph.add("Shrink", x, lambd=layer.lambd),
    nn.Softshrink: lambda graph, layer, x: graph.add("Shrink", x, lambd=layer.lambd, bias=layer.lambd),
    nn.Tanhshrink: lambda graph, layer, x: graph.add("Sub", x, graph.add("Tanh", x)),
    nn.LeakyReLU: lambda graph, layer, x: graph.add("LeakyRelu", x, alpha=layer.negative_slope),
}
# Functions of torch in the code of a module that is made of these layers, beside operators and methods.
_FUNCTIONS: dict[Any, Callable[..., Value]] = {
    torch.relu: lambda x: x.of("Relu"),
    torch.tanh: lambda x: x.of("Tanh"),
    torch.sigmoid: lambda x: x.of("Sigmoid"),
    torch.flatten: Value.flatten,
    torch.cat: lambda parts, dim=0: parts[0].of("Concat", *parts[1:], axis=dim),
    nn.functional.relu: lambda x, inplace=False: x.of("Relu"),
}


class _Tracer(torch.fx.Tracer):
    """Follows the code of a module down to the layers that are written."""

    def is_leaf_module(self, m: nn.Module, module_qualified_name: str) -> bool:
        return type(m) in _LAYERS


def _layer(graph: Graph, layer: nn.Module, x: str) -> str:
    """Add the operators of a layer, or of all in a module that is made of them; returns the output's name."""
    if type(layer) in _LAYERS:
        return _LAYERS[type(layer)](graph, layer, x)
    values: dict[torch.fx.Node, Any] = {}
    try:
        for node in _Tracer().trace(layer).nodes:
            args, words = torch.fx.map_arg((node.args, node.kwargs), values.__getitem__)
            if node.op == "placeholder":
                values[node] = Value(graph, x)
            elif node.op == "get_attr":
                values[node] = operator.attrgetter(node.target)(layer)
            elif node.op == "call_module":
                values[node] = Value(graph, _layer(graph, layer.get_submodule(node.target), args[0].name))
            elif node.op == "call_method":
                values[node] = getattr(args[0], node.target)(*args[1:], **words)
            elif node.op == "call_function":
                values[node] = _FUNCTIONS.get(node.target, node.target)(*args, **words)
        return str(args[0].name)
    except UserError:
        raise
    except Exception as error:  # of code of the user's own
        raise _not_written(layer, reason(error)) from error


def _not_written(layer: nn.Module, why: str) -> UserError:
    return UserError(
        f"export: {type(layer).__name__} cannot be written as ONNX ({why}); write the whole policy as ONNX "
        "yourself, and make an agent of it with fpg_bench.write_agent"
    )


def _lstm(graph: Graph, lstm: nn.LSTM, x: str, start: int) -> tuple[str, list[str]]:
    """Add an LSTM with its memory at column ``start`` of the state; returns its output and next memory."""
    size, layers = lstm.hidden_size, lstm.num_layers
    first = graph.constant([0])
    memory: list[list[str]] = [[], []]
    x = graph.add("Unsqueeze", x, first)
    for layer in range(layers):
        previous = [
            graph.add("Unsqueeze", graph.columns("state", begin, begin + size), first)
            for begin in (start + layer * size, start + (layers + layer) * size)
        ]
        weights = [graph.constant(_gates(lstm, f"weight_{kind}_l{layer}")[None]) for kind in ("ih", "hh")]
        biases = ""
        if lstm.bias:
            both = torch.cat([_gates(lstm, f"bias_{kind}_l{layer}") for kind in ("ih", "hh")])
            biases = graph.constant(both[None])
        names = [f"{name}_{layer}" for name in ("remembered", "hidden", "cell")]
        x = graph.add("LSTM", x, *weights, biases, "", *previous, hidden_size=size, to=names)
        x = graph.add("Squeeze", x, graph.constant([1]))
        for part, name in zip(memory, names[1:], strict=True):
            part.append(graph.add("Squeeze", name, first))
    return graph.add("Squeeze", x, first), [*memory[0], *memory[1]]


def _gates(lstm: nn.LSTM, name: str) -> torch.Tensor:
    """Return weights or biases with the gates in ONNX's order: input, output, forget, cell."""
    input_gate, forget_gate, cell_gate, output_gate = getattr(lstm, name).detach().chunk(4)
    return torch.cat([input_gate, output_gate, forget_gate, cell_gate])
