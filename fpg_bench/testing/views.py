"""The contract of views: what holds for each of them, whichever library it is made for."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.testing.kinds import Hands, Shown, hands_of
from fpg_bench.testing.requiring import require

Make = Callable[[], Any]
_SEED = 5


def check_view(make: Make) -> None:
    """Check that a view keeps the contract of all views.

    The same seed gives the same game, and game i of a batch is that of seed + i; rounds end by truncation,
    with their returns; what is handed out is the caller's; copies play on alone; what cannot be is refused
    in one line.

    Args:
        make: makes the view anew: of Gymnasium (one game or a batch), Stable-Baselines3, PettingZoo
            (parallel), or a duel; one derived from ours, too. Wrappers are taken off.

    Raises:
        AssertionError: the first thing that is wrong.
        UserError: a view of no kind that is known.
    """
    for check in VIEW_CHECKS.values():
        check(make)


def _tape(hands: Hands, steps: int, first: int = 0) -> np.ndarray:
    """Uniform actions ``(steps, games, width)``, of a tape for each game; ``first``: the first game's."""
    rows = [
        np.random.default_rng(first + game).uniform(-1, 1, (steps, hands.width))
        for game in range(hands.games)
    ]
    return np.stack(rows, axis=1).astype(np.float32)


def _played(hands: Hands, seed: Any, rounds: int = 2, first: int = 0) -> list[np.ndarray]:
    """All that a view shows in some rounds: observations at the beginning, then observations and rewards."""
    shown = [hands.reset(seed).copy()]
    for actions in _tape(hands, rounds * hands.scenario.steps_per_round, first):
        found = hands.step(hands.packed(actions))
        shown += [found.observations.copy(), found.rewards.copy()]
        if found.over.all():
            hands.next_round()
    return shown


def _same(first: list[np.ndarray], second: list[np.ndarray]) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(first, second, strict=True))


def check_spaces(make: Make) -> None:
    """All that is shown lies in the spaces, which are always the same objects."""
    hands = hands_of(make())
    seen = [hands.reset(_SEED), *(shown.observations for shown in _steps(hands))]
    outside = next((k for k, observations in enumerate(seen) if not hands.holds(observations)), None)
    require(outside is None, f"view: the observations of step {outside} are not in their space")
    same = all(x is y for x, y in zip(hands.spaces(), hands.spaces(), strict=True))
    require(same, "view: a space is made anew where it is asked for; keep it")


def _steps(hands: Hands) -> list[Shown]:
    """A whole round's steps."""
    return [hands.step(hands.packed(actions)) for actions in _tape(hands, hands.scenario.steps_per_round)]


def check_seeds(make: Make) -> None:
    """The same seed gives the same game, another seed another one, and none one by chance."""
    first = _played(hands_of(make()), _SEED)
    require(_same(first, _played(hands_of(make()), _SEED)), "view: the same seed gave another game")
    other = _played(hands_of(make()), _SEED + 100, rounds=1)
    require(not _same(first[: len(other)], other), "view: another seed gave the same game")
    here, there = (hands_of(make()).reset() for _ in range(2))
    require(not np.array_equal(here, there), "view: without a seed two games are the same")


def check_batch(make: Make) -> None:
    """Game i of a batch seeded s is that of seed s + i, whatever the others do."""
    first, second = (_played(hands_of(make()), _SEED + k, first=k) for k in (0, 1))
    same = _same([shown[1:] for shown in first], [shown[:-1] for shown in second])
    require(same, "view: game i of a batch of seed s is not game i - 1 of seed s + 1")


def check_rounds(make: Make) -> None:
    """A round ends by truncation with its last step and no other, and then says what it has earned."""
    hands = hands_of(make())
    hands.reset(_SEED)
    for _ in range(2):
        earned: Any = 0
        for k, shown in enumerate(_steps(hands), start=1):
            last = k == hands.scenario.steps_per_round
            earned = earned + shown.rewards.astype(float)
            require(not shown.terminated, f"view: a game was terminated in step {k}; rounds are truncated")
            require(
                shown.over.all() == shown.over.any() == last, f"view: not all rounds end at once in step {k}"
            )
            require(
                (shown.returns is not None) == last, f"view: measures belong to a round's last step, {k=}"
            )
        near = np.allclose(np.asarray(shown.returns, float), earned, rtol=1e-4, atol=1e-3)
        require(near, f"view: a round earned {earned.tolist()}, but its measures say {shown.returns}")
        hands.next_round()


def check_arrays(make: Make) -> None:
    """What is handed out is the caller's: writing there changes no game, and the view never writes again."""
    spoilt, clean = hands_of(make()), hands_of(make())
    spoilt.reset(_SEED)[...] = 7
    clean.reset(_SEED)
    kept = []
    for actions in _tape(clean, clean.scenario.steps_per_round + 2):
        here, there = spoilt.step(spoilt.packed(actions)), clean.step(clean.packed(actions))
        same = all(np.array_equal(x, y) for x, y in zip(here.handed, there.handed, strict=True))
        require(same, "view: writing into what was handed out changed the game; hand out copies")
        kept += [(array, array.copy()) for array in there.handed]
        for array in here.handed:
            array[...] = 1
        if there.over.all():
            spoilt.next_round()
            clean.next_round()
    unwritten = all(np.array_equal(array, then) for array, then in kept)
    require(unwritten, "view: an array that was handed out was written again; hand out copies")


def check_actions(make: Make) -> None:
    """Actions are left as they were."""
    hands = hands_of(make())
    hands.reset(_SEED)
    actions = hands.packed(np.full((hands.games, hands.width), 3.0, np.float32))
    before = copy.deepcopy(actions)
    hands.step(actions)
    require(_same(_arrays(actions), _arrays(before)), "view: it changed its actions; work on a copy")


def _arrays(actions: Any) -> list[np.ndarray]:
    parts = actions.values() if isinstance(actions, dict) else actions
    return [actions] if isinstance(actions, np.ndarray) else list(parts)


def check_copies(make: Make) -> None:
    """A copy, made in the middle of a round, plays on alone, into the next round."""
    hands = hands_of(make())
    hands.reset(_SEED)
    first, *rest = _tape(hands, hands.scenario.steps_per_round + 2)
    hands.step(hands.packed(first))
    twin = hands_of(copy.deepcopy(hands.view))
    for actions in rest:
        here, there = (each.step(each.packed(actions)) for each in (hands, twin))
        same = all(np.array_equal(x, y) for x, y in zip(here.handed, there.handed, strict=True))
        require(same, "view: a copy plays another game")
        if here.over.all():
            hands.next_round()
            twin.next_round()


def _refused(call: Callable[[], Any], *words: str) -> None:
    """Require a refusal in one line that holds these words."""
    try:
        call()
    except UserError as error:
        found = str(error)
        require("\n" not in found, f"view: a refusal takes more than one line: {found!r}")
        missing = [word for word in words if word not in found]
        require(not missing, f"view: the refusal {found!r} does not say {missing}")
    else:
        require(False, f"view: nothing was refused; expected a UserError that says {' and '.join(words)}")


def check_first_reset(make: Make) -> None:
    """Playing before the first reset is refused."""
    hands = hands_of(make())
    actions = hands.packed(np.zeros((hands.games, hands.width), np.float32))
    _refused(partial(hands.step, actions), "reset")


def check_bad_actions(make: Make) -> None:
    """Actions that are not finite are refused by their game, side and index, others by their shape."""
    hands = hands_of(make())
    hands.reset(_SEED)
    for bad in (np.nan, np.inf, -np.inf):
        actions = np.zeros((hands.games, hands.width), np.float32)
        actions[-1, -2] = bad
        packed = hands.packed(actions)
        game = f" of game {hands.games - 1}" if hands.games > 1 else ""
        side = hands.sides[-1] if hands.sides else hands.view.core.side
        _refused(partial(hands.step, packed), f"{side} action{game}: index 7 is {bad}")
    for actions in _misshapen(hands):
        _refused(partial(hands.step, actions), f"float array of shape {hands.shape}, got ")


def _misshapen(hands: Hands) -> list[Any]:
    """Actions that are too few, whole numbers, or no arrays."""
    good = hands.packed(np.zeros((hands.games, hands.width), np.float32))
    spoils: list[Callable[[np.ndarray], Any]] = [
        lambda part: part[..., :-1],
        lambda part: part.astype(int),
        lambda part: part[None],
    ]
    return [_spoilt(good, spoil) for spoil in spoils]


def _spoilt(actions: Any, spoil: Callable[[np.ndarray], Any]) -> Any:
    """Actions of which the last side's part is spoilt."""
    if isinstance(actions, dict):
        last = list(actions)[-1]
        return actions | {last: spoil(actions[last])}
    return (actions[0], spoil(actions[1])) if isinstance(actions, tuple) else spoil(actions)


def check_bad_seeds(make: Make) -> None:
    """A seed is a whole number from 0 on."""
    for seed in ("7", 1.5, True, -1, 2**63):
        hands = hands_of(make())
        _refused(partial(hands.reset, seed), "expected")


VIEW_CHECKS: dict[str, Callable[[Make], None]] = {
    "spaces": check_spaces,
    "seeds": check_seeds,
    "batch": check_batch,
    "rounds": check_rounds,
    "arrays": check_arrays,
    "actions": check_actions,
    "copies": check_copies,
    "first reset": check_first_reset,
    "bad actions": check_bad_actions,
    "bad seeds": check_bad_seeds,
}
