"""Models of other spaces as players: waterfalls to look at, and choices that become the nine floats."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from gymnasium import spaces

from fpg_bench.common.errors import UserError
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.waterfall import Waterfall
from fpg_bench.players.player import Memory, Player
from fpg_bench.players.seeded import Batched


class ModelPlayer(Batched):
    """Player of a model that sees a waterfall, predicts choices as Stable-Baselines3's DQN does, or both.

    Args:
        model: anything with ``predict``; its answers are floats ``(n, 9)`` or, with choices, whole numbers,
            ``(n,)`` or ``(n, lists)``.
        choices: what it chooses from; None: its actions are continuous.
        waterfall: what it sees; None: the 15 numbers.
    """

    def __init__(self, model: Player, choices: Choices | None, waterfall: Waterfall | None) -> None:
        self.model, self._choices, self._waterfall = model, choices, waterfall
        takes_masks = "action_masks" in inspect.signature(model.predict).parameters  # as MaskablePPO's
        self._mask = choices.mask if choices and takes_masks and not choices.mask.all() else None

    def _answer(
        self, seen: np.ndarray, state: Memory, starts: np.ndarray | None
    ) -> tuple[np.ndarray, Memory]:
        windows, state = (None, None) if state is None else state
        looked_at = seen
        if self._waterfall is not None:
            windows = self._waterfall.empty(len(seen)) if windows is None else windows
            looked_at = windows = self._waterfall.pushed(windows, seen, starts)
        masks: dict[str, Any] = {}
        if self._mask is not None:
            masks["action_masks"] = np.tile(self._mask, (len(seen), 1))
        actions, state = self.model.predict(looked_at, state, starts, True, **masks)
        if self._choices is not None:
            actions = self._choices.decode(np.asarray(actions), seen)
        return actions, (windows, state)


def as_model_player(player: Player, side: str, scenario: Scenario) -> Player:
    """Return a player of the 15 numbers and nine floats: the player itself, unless its spaces are others.

    Raises:
        UserError: the choices are not those of the side in this scenario, or the waterfall is another.
    """
    choices = _choices(player, side, scenario)
    waterfall = _waterfall(player, side, scenario)
    return player if choices is None and waterfall is None else ModelPlayer(player, choices, waterfall)


def _choices(player: Player, side: str, scenario: Scenario) -> Choices | None:
    """Return what a model chooses from, by its ``action_space``."""
    space = getattr(player, "action_space", None)
    if not isinstance(space, spaces.Discrete | spaces.MultiDiscrete):
        return None
    is_multi = isinstance(space, spaces.MultiDiscrete)
    choices = Choices(side, "multi-discrete" if is_multi else "discrete", scenario)
    sizes = tuple(space.nvec.tolist()) if isinstance(space, spaces.MultiDiscrete) else (int(space.n),)
    if sizes != choices.sizes:
        raise UserError(
            f"{side}: {type(player).__name__} chooses from {sizes}, the {side} here from {choices.sizes} "
            f"(actions={choices.mode!r})"
        )
    return choices


def _waterfall(player: Player, side: str, scenario: Scenario) -> Waterfall | None:
    """Return the waterfall that a model sees, by its ``observation_space``."""
    space = getattr(player, "observation_space", None)
    if not isinstance(space, spaces.Box) or len(space.shape) != 2:
        return None
    waterfall = Waterfall(scenario, space.shape[0])
    if side != "ally" or space.shape != waterfall.shape:
        seen = f"a waterfall of {waterfall.shape}" if side == "ally" else "15 numbers"
        raise UserError(f"{side}: {type(player).__name__} sees {space.shape}, the {side} here {seen}")
    return waterfall
