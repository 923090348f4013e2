"""Preprocessing between a game and the policy of a Stable-Baselines3 model: statistics, frames, wrappers.

Live players and the export both take it from here, so that a model plays as it did in training.
"""

from __future__ import annotations

import copy
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.game.choices import Choices
from fpg_bench.game.spec import GameSpec, observation_size
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.game.waterfall import Waterfall
from fpg_bench.players.memory import MEMORY_SIZES, remember
from fpg_bench.players.planner import asks_language_model
from fpg_bench.players.player import Abilities, Player
from fpg_bench.players.scripted import player_seeds

GREATEST_DIFFERENCE = 1e-4  # of an action entry, between a model and what plays in its place
# Wrappers of known packages that change neither observations nor actions; recorders would film a copy, too.
_RECORDERS = {"VecVideoRecorder", "RecordVideo", "RenderCollection", "HumanRendering"}
_HARMLESS = {"Monitor", "OrderEnforcing", "PassiveEnvChecker", "TimeLimit", "Autoreset", "ClipAction"}
_HARMLESS |= {"RecordEpisodeStatistics", "NormalizeReward", "TransformReward", "ClipReward", *_RECORDERS}
_HARMLESS |= {"VecMonitor", "VecCheckNan", "SuperSuitVecEnv", "SB3VecEnvWrapper"}
_PACKAGES = {"gymnasium", "pettingzoo", "stable_baselines3", "supersuit", "fpg_bench"}
_INSTEAD = (
    "train with VecNormalize, VecFrameStack and VecMemory alone, or write the whole policy as ONNX and call "
    "fpg_bench.write_agent"
)
Layer = type | str  # the class of a wrapper, or its name if it is in another process


@dataclass(frozen=True)
class Preprocessing:
    """Preprocessing of a side's numbers for a model, with the memory of a batch of games.

    Attributes:
        size: how many numbers the side sees, 15, or those of a seat of a team.
        frames: number of stacked observations, 1 for none.
        memory: the side whose memory follows the frames, empty for none; see :mod:`fpg_bench.players.memory`.
        waterfall: None for the 15 numbers.
        before, after: ``VecNormalize`` wrappers, of each frame before stacking and of the whole stack.
    """

    size: int = OBSERVATION_SIZE
    frames: int = 1
    memory: str = ""
    waterfall: Waterfall | None = None
    before: tuple[Any, ...] = ()
    after: tuple[Any, ...] = ()

    @property
    def is_needed(self) -> bool:
        """False if the model sees the 15 numbers as they are."""
        return bool(self.frames > 1 or self.memory or self.waterfall or self.before or self.after)

    def pushed(self, stack: np.ndarray | None, seen: np.ndarray, starts: np.ndarray | None) -> np.ndarray:
        """Return the stack with the frames of a step added; None begins with an empty one."""
        if stack is None:
            width = self.frames * self.size + MEMORY_SIZES.get(self.memory, 0)
            shape = (width,) if self.waterfall is None else self.waterfall.shape
            stack = np.zeros((len(seen), *shape), np.float32)
        if self.waterfall is not None:
            return self.waterfall.pushed(stack, seen, starts)
        for normalize in self.before:
            seen = normalize.normalize_obs(seen)
        kept = stack[:, self.size :]
        if starts is not None:
            kept = np.where(np.asarray(starts)[:, None], np.float32(0), kept)
        frames, past = np.split(kept, [(self.frames - 1) * self.size], axis=1)
        return np.concatenate((frames, seen, *remember(self.memory, seen, past)), axis=1)

    def shown(self, stack: np.ndarray) -> np.ndarray:
        """Return the observations of the model for a stack, an array of its own."""
        shown = stack.copy()
        for normalize in self.after:
            shown = normalize.normalize_obs(shown)
        return shown


def preprocessing_of(
    model: Any, waterfall: Waterfall | None = None, game: GameSpec | None = None
) -> Preprocessing:
    """Return what stands between a game and the policy of a model, but for the wrappers of :func:`unknown`.

    Args:
        model: a model of Stable-Baselines3, or anything else with ``predict``.
        waterfall: the waterfall that it sees; None for the 15 numbers.
        game: the game of a model without games; None: the duel.

    Raises:
        UserError: wrappers that no player can have, observations of another size, statistics that are lost,
            or weights that are not float32.
    """
    name, env, core = type(model).__name__, games_of(model), core_of(model)
    _check_weights(name, model)
    size = observation_size(game if core is None else core.game_spec)
    frames, memory, before, after = 1, "", [], []
    for wrapper in reversed(list(_vec_wrappers(env))):
        kinds = {kind.__name__ for kind in type(wrapper).__mro__}
        if "VecNormalize" in kinds and wrapper.norm_obs:
            after.append(wrapper)
        elif "VecFrameStack" in kinds:
            if frames > 1 or memory or waterfall is not None:
                raise UserError(
                    f"{name}: frames can be stacked once, under VecMemory, and those of a waterfall never"
                )
            frames, before, after = wrapper.stacked_obs.n_stack, after, []
        elif "VecMemory" in kinds:
            if memory or before or after:
                raise UserError(f"{name}: VecMemory stands once, on the games or on VecFrameStack")
            memory = wrapper.side
    if refused := _names(env, _is_refused):
        raise UserError(f"{name}: its games have {', '.join(refused)}, which no player has; {_INSTEAD}")
    if not (after or before):
        _check_not_normalized(name, model)
    space = getattr(model, "observation_space", None)
    if isinstance(space, gymnasium.spaces.Box):
        rest = space.shape[0] % size if len(space.shape) == 1 else 1
        if core is None and frames == 1 and waterfall is None and not rest:
            frames = space.shape[0] // size  # all that is known of a model without its games
        expected = (frames * size + MEMORY_SIZES.get(memory, 0),) if waterfall is None else waterfall.shape
        if space.shape != expected:
            behind = f" behind {', '.join(unknown(model))}" if unknown(model) else ""
            raise UserError(
                f"{name}: it sees observations of shape {space.shape}{behind}, not {expected}, frames of "
                f"the {size} numbers of a side; {_INSTEAD}"
            )
    return Preprocessing(size, frames, memory, waterfall, tuple(before), tuple(after))


def games_of(model: Any) -> Any:
    """Return the ``VecEnv`` of a model; None if it has none."""
    return getattr(model, "get_env", lambda: None)()


def core_of(model: Any) -> Any:
    """Return the core of a model's games; None if it has no games of this package."""
    env = games_of(model)
    try:
        return env.get_attr("core")[0] if env is not None and env.has_attr("core") else None
    except AttributeError:  # SuperSuit's own classes lack has_attr
        return None


def unknown(model: Any) -> list[str]:
    """Return the names of wrappers of a model's games that may change what it sees or does."""
    return _names(games_of(model), lambda layer: not _is_harmless(layer))


def check_difference(model: Any, difference: float | None) -> None:
    """Raise UserError if wrappers of a model's games change its play, or cannot be looked into.

    Args:
        model: a trained model.
        difference: of :func:`difference_in_own_games`, from a player without these wrappers.
    """
    if (names := unknown(model)) and (difference is None or not difference <= GREATEST_DIFFERENCE):
        what = "can't be copied, to compare its play" if difference is None else "change what it sees or does"
        raise UserError(f"{type(model).__name__}: {', '.join(names)} of its games {what}; {_INSTEAD}")


def difference_in_own_games(
    model: Any, player: Player, choices: Choices | None = None, steps: int = 200
) -> float | None:
    """Return the largest difference of any action entry between a model and a player in the model's games.

    A copy of the games is played, through all of their wrappers. The model sees what the wrappers show, the
    player the numbers of the game. What the game receives is compared; a step that is not one step of the
    game makes the difference infinite. If two choices have almost equal values, rounding decides between
    them. So one in a hundred discrete actions may differ, and is left out.

    Args:
        model: a trained model.
        player: what plays in its place.
        choices: the choices of a discrete model; None for continuous actions.
        steps: number of steps.

    Returns:
        The difference; None if the games cannot be copied, or are not of this package.
    """
    games = _copied_games(model)
    if games is None:
        return None
    games.seed(0)
    seen = games.reset()
    cores = games.get_attr("core")
    batches = [(core.side, core.batch) for core in (cores[:1] if cores[0].count > 1 else cores)]
    starts, model_state, player_state, differences = np.ones(games.num_envs, bool), None, None, []
    for _ in range(steps):
        if starts.any() and (reset := Abilities.of(player).reset) is not None:
            keys = [player_seeds(batch.games["round_key"], side) for side, batch in batches]
            reset(starts, np.concatenate(keys))
        numbers = np.concatenate([getattr(batch, f"{side}_observations") for side, batch in batches])
        step = np.concatenate([batch.games["step"] for _, batch in batches])
        masks: dict[str, np.ndarray] = {}
        if choices is not None and takes_masks(model):
            masks["action_masks"] = np.stack(games.env_method("action_masks"))
        actions, model_state = model.predict(seen, model_state, starts, True, **masks)
        answers, player_state = player.predict(numbers, player_state, starts, True)
        seen, _, starts, _ = games.step(actions)
        received = np.concatenate([batch.received(side) for side, batch in batches])
        after = np.concatenate([batch.games["step"] for _, batch in batches])
        is_one_step = starts | (after == step + 1)
        differences.append(np.where(is_one_step, np.abs(received - answers).max(axis=1), np.inf))
    return largest(differences, choices)


def largest(differences: list[np.ndarray], choices: Choices | None) -> float:
    """Return the largest of differences; of discrete actions without one in a hundred."""
    each = np.sort(np.concatenate(differences))
    return float(each[-1] if choices is None else each[-1 - len(each) // 100])


def takes_masks(model: Player) -> bool:
    """Return True for a model whose ``predict`` takes masks, as MaskablePPO's."""
    return "action_masks" in inspect.signature(model.predict).parameters


def _vec_wrappers(env: Any) -> Iterator[Any]:
    """Yield the wrappers of a ``VecEnv``, the outermost first."""
    while env is not None and "venv" in vars(env):
        yield env
        env = env.venv


def _layers(env: Any) -> Iterator[Layer]:
    """Yield the wrappers between games and a policy but for those that a player has, too."""
    base, games = env, []
    for wrapper in _vec_wrappers(env):
        if type(wrapper).__name__ not in ("VecNormalize", "VecFrameStack", "VecMemory"):
            yield type(wrapper)
        base = wrapper.venv
        games += vars(wrapper).get("games", [])  # of the bridge over SuperSuit
    for game in (*games, *getattr(base, "envs", ())):
        while game is not game.unwrapped:
            yield type(game)
            game = game.env
    if hasattr(base, "remotes"):
        yield from re.findall(r"<(\w+)(?=<\w+[< ])", base.env_method("__str__", indices=[0])[0])


def _names(env: Any, is_meant: Callable[[Layer], bool]) -> list[str]:
    """Return the names of the wrappers that are meant, each once."""
    layers = filter(is_meant, _layers(env))
    return list(dict.fromkeys(each if isinstance(each, str) else each.__name__ for each in layers))


def _is_harmless(layer: Layer) -> bool:
    """Return True for a wrapper that changes neither observations nor actions."""
    if isinstance(layer, str):
        return layer in _HARMLESS
    is_known = layer.__name__ in _HARMLESS and layer.__module__.partition(".")[0] in _PACKAGES
    return is_known or issubclass(layer, gymnasium.RewardWrapper)


def _is_refused(layer: Layer) -> bool:
    changes = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper)
    return isinstance(layer, type) and issubclass(layer, changes) and not _is_harmless(layer)


def _check_weights(name: str, model: Any) -> None:
    parameters = getattr(getattr(model, "policy", None), "parameters", None)
    kinds = {str(each.dtype) for each in parameters()} if callable(parameters) else set()
    if others := sorted(kinds - {"torch.float32"}):
        raise UserError(
            f"{name}: its weights are {', '.join(others)}, and predict gives them float32; call "
            "model.policy.float() first"
        )


def _check_not_normalized(name: str, model: Any) -> None:
    """Raise UserError if the last observation that a model saved lies outside its space."""
    last, space = getattr(model, "_last_obs", None), getattr(model, "observation_space", None)
    if not (isinstance(last, np.ndarray) and isinstance(space, gymnasium.spaces.Box)):
        return
    if (last < space.low).any() or (last > space.high).any():
        raise UserError(
            f"{name}: it was trained with VecNormalize, whose statistics are not with it; load it with "
            f"{name}.load(path, env=VecNormalize.load(statistics, fpg_bench.make_sb3(id)))"
        )


def _copied_games(model: Any) -> Any:
    """Return a copy of a model's games that does not learn; None if they cannot be copied or played."""
    env, core = games_of(model), core_of(model)
    asks = asks_language_model(getattr(core, "planner", None))
    if core is None or asks or _RECORDERS & set(_names(env, lambda layer: True)):
        return None
    try:
        return _copied(env)
    except Exception:  # files, windows, processes and whatever else a wrapper has
        return None


def _copied(env: Any) -> Any:
    """Return a deep copy of a ``VecEnv``; ``VecNormalize`` leaves its games out of its own."""
    if "venv" not in vars(env):
        if hasattr(env, "remotes"):
            raise TypeError("a copy would close the pipes of the games")
        return copy.deepcopy(env)
    twin = object.__new__(type(env))
    for name, value in vars(env).items():
        is_shared = name == "class_attributes"
        vars(twin)[name] = _copied(value) if name == "venv" else value if is_shared else copy.deepcopy(value)
    if "norm_obs" in vars(twin):
        twin.training = False
    return twin
