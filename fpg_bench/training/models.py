"""Construction of Stable-Baselines3 models on a batch of games from hyper-parameters."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.training import require_libraries

require_libraries()

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.utils import LinearSchedule, set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize
from torch import nn

from fpg_bench.common.checks import mapping, of_kind
from fpg_bench.common.errors import UserError, first_line, nearest, one_line, shown
from fpg_bench.common.imports import imported, reason
from fpg_bench.envs.sb3_vec_env import VecMemory
from fpg_bench.game.batch import ActionError
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.training.algorithms import Algorithm, find_algorithm
from fpg_bench.training.hyperparameters import Hyperparameters
from fpg_bench.training.rl_zoo3_format import LARGEST, SCHEDULED, Entry, net_arch

# Elementwise activations of torch that ONNX also has, without weights and randomness.
# LogSigmoid is left out because its export differs by 8e-4.
_NAMES = (
    "CELU ELU GELU Hardshrink Hardsigmoid Hardswish Hardtanh LeakyReLU Mish ReLU ReLU6 SELU SiLU Sigmoid "
    "Softplus Softshrink Softsign Tanh Tanhshrink"
)
ACTIVATIONS: dict[str, type[nn.Module]] = {name: getattr(nn, name) for name in _NAMES.split()}


def by_side(model: BaseAlgorithm, sides: Sequence[str]) -> dict[str, BaseAlgorithm]:
    """Return the model of each learning side; with a single side, that is the model itself."""
    players = [model] if len(sides) == 1 else model.players  # type: ignore[attr-defined]
    return dict(zip(sides, players, strict=True))


def make_model(
    algorithm: str | Algorithm, games: VecEnv, parameters: Hyperparameters, seed: int
) -> BaseAlgorithm:
    """Make the model of an algorithm on a batch of games, with the wrappers of the hyper-parameters.

    The games keep their match seeds. SB3's own ``seed`` argument would reseed them with the training seed, so
    that neighbouring training seeds would play nearly the same matches.

    Raises:
        UserError: a hyper-parameter that the algorithm does not have, or an invalid value.
    """
    if not isinstance(algorithm, Algorithm):
        algorithm = find_algorithm(algorithm)
    where = f"hyper-parameters of {algorithm.name}"
    arguments = _constructor_arguments(algorithm, parameters.algorithm, where)
    unused = [name for name in ("normalize", "frame_stack", "memory") if getattr(parameters, name)]
    if unused and (algorithm.joint or (algorithm.offline and parameters.memory)):
        raise UserError(f"{where}: {algorithm.name} does not support {unused[-1]}")
    games = _wrapped(games, parameters, where)
    try:
        set_random_seed(seed)
        model: BaseAlgorithm = algorithm.kind(env=games, **arguments)
    except UserError:
        raise
    except AssertionError as error:
        raise _misfit(algorithm, games, error) or UserError(f"{where}: {error}") from error
    except Exception as error:
        if isinstance(error, MemoryError) or "can't allocate memory" in str(error):
            raise UserError(
                f"{where}: too little memory ({first_line(error)}); lower buffer_size, n_steps, n_envs or "
                "net_arch"
            ) from error
        if not algorithm.custom and not isinstance(error, TypeError | ValueError):
            raise
        raise UserError(f"{where}: {reason(error) if algorithm.custom else one_line(error)}") from error
    model.action_space.seed(seed)
    return model


def _misfit(algorithm: Algorithm, games: VecEnv, error: AssertionError) -> UserError | None:
    """Return the error for an unsupported action space; None for any other assertion."""
    supported, is_misfit, _ = str(error).partition("as action spaces")
    if not is_misfit:
        return None
    fitting = "discrete" if "Discrete" in supported else "continuous"
    kind = "choices from a list" if fitting == "discrete" else "nine numbers"
    return UserError(
        f"{algorithm.name}: needs actions that are {kind}, and the action space is {games.action_space}; "
        f"add --actions {fitting} (actions={fitting!r})"
    )


def _wrapped(games: VecEnv, parameters: Hyperparameters, where: str) -> VecEnv:
    """Wrap the games for a model: observations are stacked, then normalized.

    rl-zoo3 normalizes first. SB3's replay buffer stores what ``VecNormalize`` returns, so with SAC and TD3
    that has to be the whole stack. Without ``norm_obs`` both orders are the same.

    Raises:
        UserError: an argument that ``VecNormalize`` does not have, or stacked frames of a waterfall.
    """
    if parameters.frame_stack is not None:
        if len(games.observation_space.shape or ()) > 1:
            raise UserError(f"{where}: frame_stack: a waterfall is already a stack; set its history instead")
        games = VecFrameStack(games, parameters.frame_stack)
    if parameters.memory:
        games = VecMemory(games)
    if parameters.normalize is None:
        return games
    return VecNormalize(games, **{"gamma": parameters.algorithm.get("gamma", 0.99), **parameters.normalize})


def _constructor_arguments(algorithm: Algorithm, values: Entry, where: str) -> Entry:
    """Translate rl-zoo3's values into arguments of the algorithm's constructor."""
    arguments: Entry = {"device": "cpu", **copy.deepcopy(values)}  # SB3 writes into policy_kwargs
    noise_type, noise_std = arguments.pop("noise_type", None), arguments.pop("noise_std", None)
    if (noise_type, noise_std) != (None, None):
        if noise_type != "normal":
            raise UserError(
                f"{where}: expected noise_type: normal with a noise_std, got {shown(noise_type)}, "
                f"{shown(noise_std)}"
            )
        sigma = np.array(_per_action(noise_std, f"{where}: noise_std", least=0))
        arguments["action_noise"] = NormalActionNoise(np.zeros(ACTION_SIZE), sigma)
    policy: Any = mapping(arguments.get("policy_kwargs", {}), f"{where}: policy_kwargs")
    if "log_std_init" in policy:
        numbers = _per_action(policy["log_std_init"], f"{where}: log_std_init")
        if isinstance(policy["log_std_init"], list):  # one per action
            policy["log_std_init"] = torch.tensor(numbers)
    if isinstance(name := policy.get("features_extractor_class"), str):
        policy["features_extractor_class"] = imported(name, f"{where}: features_extractor_class")
    if "net_arch" in policy:
        policy["net_arch"] = net_arch(policy["net_arch"], f"{where}: net_arch")
    if "activation_fn" in policy:
        policy["activation_fn"] = as_activation(policy["activation_fn"], f"{where}: activation_fn")
    for name in SCHEDULED:
        if isinstance(arguments.get(name), str):
            arguments[name] = _schedule(arguments[name], f"{where}: {name}")
    if isinstance(arguments.get("train_freq"), list):
        arguments["train_freq"] = tuple(arguments["train_freq"])
    return arguments


def _per_action(value: Any, where: str, least: float = -LARGEST) -> list[float]:
    """Return one number per action, from a single number or a list."""
    values = value if isinstance(value, list) else [value] * ACTION_SIZE
    are_numbers = all(type(each) in (int, float) and least <= each <= LARGEST for each in values)
    if len(values) != ACTION_SIZE or not are_numbers:
        kind = "a number, 0 or more" if least == 0 else "a number"
        raise UserError(f"{where}: expected {kind}, or {ACTION_SIZE} of them, got {shown(value)}")
    return [float(each) for each in values]


def _schedule(text: str, where: str) -> LinearSchedule:
    """Return the schedule of a text such as ``lin_0.001``: linear from that value to zero over the budget."""
    try:
        if not text.startswith("lin_"):
            raise ValueError
        start = float(text.removeprefix("lin_"))
        if not 0 < start <= LARGEST:
            raise ValueError
        return LinearSchedule(start, 0.0, 1.0)
    except ValueError as error:
        raise UserError(
            f"{where}: expected a number (1.0e-4, not 1e-4) or lin_<number>, got {shown(text)}"
        ) from error


def as_activation(value: object, where: str) -> type[nn.Module]:
    """Return the activation class of a name such as ``ReLU``; a module class is returned unchanged.

    Raises:
        UserError: no such name, or something else; ``where`` begins the message.
    """
    if isinstance(value, type) and issubclass(value, nn.Module):
        return value
    name = of_kind(value, where, "the name of an activation such as ReLU", str)
    name = name.rpartition("nn.")[2]  # as rl-zoo3 writes it
    if name not in ACTIVATIONS:
        raise UserError(f"{where}: unknown activation {shown(name)}{nearest(name, ACTIVATIONS)}")
    return ACTIVATIONS[name]


def tells_divergence(error: Exception, sides: Sequence[str]) -> bool:
    """Return True for an error caused by a policy without finite actions.

    Either an action of a learning side is NaN, or torch rejects the parameters of the action distribution: a
    mean of NaN, or a standard deviation of 0, which can occur even if all weights are finite.

    Args:
        error: the error that stopped the training.
        sides: the sides that learn.
    """
    is_own_action = isinstance(error, ActionError) and str(error).startswith(tuple(sides))
    return is_own_action or "found invalid values" in str(error)


def is_finite(model: BaseAlgorithm) -> bool:
    """Return True if all weights of a model's policy are finite."""
    return all(bool(torch.isfinite(weights).all()) for weights in model.policy.parameters())
