"""Models of discrete actions as players: their choices become the nine floats of an action."""

from __future__ import annotations

import inspect

import numpy as np
from gymnasium import spaces

from fpg_bench.common.errors import UserError
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.player import Memory, Player
from fpg_bench.players.seeded import Batched


class ChoosingPlayer(Batched):
    """Player of a model that predicts choices, as Stable-Baselines3's DQN does.

    Args:
        model: anything with ``predict`` that returns whole numbers, ``(n,)`` or ``(n, lists)``.
        choices: what it chooses from.
    """

    def __init__(self, model: Player, choices: Choices) -> None:
        self.model, self._choices = model, choices
        takes_masks = "action_masks" in inspect.signature(model.predict).parameters  # as MaskablePPO's
        self._mask = choices.mask if takes_masks and not choices.mask.all() else None

    def _answer(
        self, seen: np.ndarray, state: Memory, starts: np.ndarray | None
    ) -> tuple[np.ndarray, Memory]:
        masks = {} if self._mask is None else {"action_masks": np.tile(self._mask, (len(seen), 1))}
        chosen, state = self.model.predict(seen, state, starts, True, **masks)
        return self._choices.decode(np.asarray(chosen), seen), state


def with_floats(player: Player, side: str, scenario: Scenario) -> Player:
    """Return a player of floats: the player itself, unless its ``action_space`` is one of choices.

    Raises:
        UserError: the choices are not those of the side in this scenario.
    """
    space = getattr(player, "action_space", None)
    if not isinstance(space, spaces.Discrete | spaces.MultiDiscrete):
        return player
    is_multi = isinstance(space, spaces.MultiDiscrete)
    choices = Choices(side, "multi-discrete" if is_multi else "discrete", scenario)
    sizes = tuple(space.nvec.tolist()) if isinstance(space, spaces.MultiDiscrete) else (int(space.n),)
    if sizes != choices.sizes:
        raise UserError(
            f"{side}: {type(player).__name__} chooses from {sizes}, the {side} here from {choices.sizes} "
            f"(actions={choices.mode!r})"
        )
    return ChoosingPlayer(player, choices)
