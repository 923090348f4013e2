"""From hyper-parameters to a model of Stable-Baselines3 on a batch of games; whether it is still finite."""

from __future__ import annotations

import copy
import difflib
import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.utils import LinearSchedule, set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize
from torch import nn

from fpg_bench.checks import check_keys, flag, mapping
from fpg_bench.envs.sb3 import SB3View, make_sb3, make_sb3_duel
from fpg_bench.errors import UserError, nearest
from fpg_bench.game.arena import ActionError
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.ids import sides_of
from fpg_bench.imports import reason
from fpg_bench.training.algorithms import Algorithm, find_algorithm
from fpg_bench.training.hyperparameters import Hyperparameters

_OURS = {"self", "env", "seed", "tensorboard_log", "verbose", "_init_setup_model"}  # not for files to say
_SCHEDULED = ("learning_rate", "clip_range", "clip_range_vf")
# What may follow hidden layers: torch's elementwise activations that ONNX has, too, without weights of their
# own and without chance. Left out: LogSigmoid, whose export differs by 8e-4.
_NAMES = (
    "CELU ELU GELU Hardshrink Hardsigmoid Hardswish Hardtanh LeakyReLU Mish ReLU ReLU6 SELU SiLU Sigmoid "
    "Softplus Softshrink Softsign Tanh Tanhshrink"
)
ACTIVATIONS: dict[str, type[nn.Module]] = {name: getattr(nn, name) for name in _NAMES.split()}


def make_games(view_id: str, parameters: Hyperparameters, first_seed: int, **options: Any) -> SB3View:
    """The games of a training run, in mixed phases.

    Raises:
        UserError: something unknown, out of range, or impossible together.
    """
    if len(sides_of(view_id)) == 2:
        given = {name: value for name, value in options.items() if value is not None}
        return make_sb3_duel(parameters.n_envs, first_seed, stagger=True, **given)
    return make_sb3(view_id, parameters.n_envs, first_seed, stagger=True, **options)


def by_side(model: Any, sides: Sequence[str]) -> dict[str, Any]:
    """The sides that learn, each as a model of its own; one side's is the model itself."""
    return {sides[0]: model} if len(sides) == 1 else dict(zip(sides, model.players, strict=True))


def make_model(
    algorithm: str | Algorithm, games: VecEnv, parameters: Hyperparameters, seed: int
) -> BaseAlgorithm:
    """The SB3 model of an algorithm on a batch of games, stacked and normalised as the hyper-parameters say.

    The games begin with the matches that they were made with. SB3's own ``seed`` argument would begin them
    at the training seed, and neighbouring training seeds with nearly the same matches.

    Raises:
        UserError: a hyper-parameter that the algorithm does not have, or not in this form.
    """
    found = algorithm if isinstance(algorithm, Algorithm) else find_algorithm(algorithm)
    where = f"hyper-parameters of {found.name}"
    arguments = _arguments(found, parameters.algorithm, where)
    if found.joint and (parameters.normalize is not None or parameters.frame_stack is not None):
        raise UserError(f"{where}: {found.name} knows neither normalize nor frame_stack")
    games = wrapped(games, parameters, where)
    try:
        set_random_seed(seed)
        model = found.kind(env=games, **arguments)
    except UserError:
        raise
    except Exception as error:
        if not found.custom and not isinstance(error, TypeError | ValueError | AssertionError):
            raise
        raise UserError(f"{where}: {reason(error) if found.custom else error}") from error
    model.action_space.seed(seed)
    return model


def wrapped(games: VecEnv, parameters: Hyperparameters, where: str = "hyper-parameters") -> VecEnv:
    """The games as the model sees them: the last observations stacked, then normalised.

    rl-zoo3 normalises first. SB3's replay buffer keeps what ``VecNormalize`` saw, so with SAC and TD3 that
    must be the whole stack; without ``norm_obs`` both orders are the same.

    Raises:
        UserError: an argument that ``VecNormalize`` does not have.
    """
    if parameters.frame_stack is not None:
        games = VecFrameStack(games, parameters.frame_stack)
    if parameters.normalize is None:
        return games
    check_arguments(parameters.normalize, VecNormalize.__init__, f"{where}: normalize", {"venv"})
    return VecNormalize(games, **{"gamma": parameters.algorithm.get("gamma", 0.99), **parameters.normalize})


def check_arguments(
    values: dict[str, Any], function: Callable[..., Any], where: str, hidden: frozenset[str] | set[str]
) -> None:
    """Raise UserError for a key that a function has no argument for, or a value that is not of its kind."""
    arguments = inspect.signature(function).parameters
    known = set(arguments) - {"self"} - hidden
    anything = any(argument.kind == argument.VAR_KEYWORD for argument in arguments.values())
    if not anything:
        check_keys(values, known, where)
    for name in known & set(values):
        _check_value(values[name], arguments[name], f"{where}: {name}")


def _check_value(value: Any, argument: inspect.Parameter, where: str) -> None:
    """Raise UserError where an argument's default is a number or a truth value, and the value is none."""
    default, words = argument.default, "str" in str(argument.annotation) or argument.name in _SCHEDULED
    if isinstance(default, bool):
        flag(value, where)
    elif isinstance(default, int | float) and not (words and isinstance(value, str | list)):
        whole = argument.annotation in (int, "int")
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            number = "a whole number" if whole else "a number (1.0e-4, not 1e-4)"
            raise UserError(f"{where}: expected {number}, got {value!r}")


def _arguments(algorithm: Algorithm, values: dict[str, Any], where: str) -> dict[str, Any]:
    """What the algorithm's constructor is handed: rl-zoo3's words as SB3's objects."""
    arguments: dict[str, Any] = {"device": "cpu", **copy.deepcopy(values)}  # SB3 writes into policy_kwargs
    kind, sd = arguments.pop("noise_type", None), arguments.pop("noise_std", None)
    if (kind, sd) != (None, None):
        if kind != "normal":
            raise UserError(f"{where}: expected noise_type: normal with a noise_std, got {kind}, {sd}")
        sds = _per_action(sd, f"{where}: noise_std")
        arguments["action_noise"] = NormalActionNoise(np.zeros(ACTION_SIZE), np.array(sds))
    check_arguments(arguments, algorithm.kind.__init__, where, _OURS)
    policy: Any = mapping(arguments.get("policy_kwargs", {}), f"{where}: policy_kwargs")
    if isinstance(policy.get("log_std_init"), list):  # one for each action
        policy["log_std_init"] = torch.tensor(_per_action(policy["log_std_init"], f"{where}: log_std_init"))
    if "activation_fn" in policy:
        policy["activation_fn"] = as_activation(policy["activation_fn"], f"{where}: activation_fn")
    for name in _SCHEDULED:
        if isinstance(arguments.get(name), str):
            arguments[name] = _schedule(arguments[name], f"{where}: {name}")
    if isinstance(arguments.get("train_freq"), list):
        arguments["train_freq"] = tuple(arguments["train_freq"])
    return arguments


def _per_action(found: Any, where: str) -> list[float]:
    """How widely each action is drawn, from a number for all or one for each."""
    values = found if isinstance(found, list) else [found] * ACTION_SIZE
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if len(values) != ACTION_SIZE or not numbers:
        raise UserError(f"{where}: expected a number, or {ACTION_SIZE} of them, got {found}")
    return [float(value) for value in values]


def _schedule(word: str, where: str) -> LinearSchedule:
    """``lin_0.001``: from there to zero over the budget."""
    try:
        if not word.startswith("lin_"):
            raise ValueError
        return LinearSchedule(float(word.removeprefix("lin_")), 0.0, 1.0)
    except ValueError as error:
        raise UserError(
            f"{where}: expected a number (1.0e-4, not 1e-4) or lin_<number>, got {word!r}"
        ) from error


def as_activation(found: Any, where: str) -> type[nn.Module]:
    """The activation of a name, ``ReLU`` for instance; a class of torch's kind, from Python, is itself one.

    Raises:
        UserError: no such name, or something else; ``where`` begins the message.
    """
    if isinstance(found, type) and issubclass(found, nn.Module):
        return found
    if not isinstance(found, str):
        raise UserError(f"{where}: expected the name of an activation, ReLU for instance, got {found!r}")
    if found not in ACTIVATIONS:
        lower = {name.lower(): name for name in ACTIVATIONS}
        near = difflib.get_close_matches(found.lower(), lower, n=1)
        written = lower[near[0]] if near else found  # relu and RELU are near ReLU, too
        raise UserError(f"{where}: unknown activation {found!r}{nearest(written, ACTIVATIONS)}")
    return ACTIVATIONS[found]


def tells_divergence(error: Exception, sides: Sequence[str]) -> bool:
    """Whether an error is one that a policy without usable numbers leads to.

    Either an action of a side that learns is NaN, or torch refuses the parameters of the distribution that
    actions are drawn from: a mean that is NaN, or a standard deviation that fell to 0, which can happen while
    all weights are finite.

    Args:
        error: what stopped the training.
        sides: those that learn.
    """
    own_action = isinstance(error, ActionError) and str(error).startswith(tuple(sides))
    return own_action or "found invalid values" in str(error)


def is_finite(model: BaseAlgorithm) -> bool:
    """Whether all weights of a model's policy are finite."""
    return all(bool(torch.isfinite(weights).all()) for weights in model.policy.parameters())
