"""Discrete actions: lists of choices, each of which stands for the nine floats of an action."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from statistics import NormalDist

import numpy as np

from fpg_bench.common.checks import one_of
from fpg_bench.common.ids import action_modes
from fpg_bench.game.actions import (
    HOP_GATE,
    IN_BAND_GATE,
    KNOWLEDGE_GATE,
    PREFERENCE,
    SPEED,
    SPREAD_GATE,
    TUNING,
    TYPE_SCORES,
    VELOCITY,
)
from fpg_bench.game.batch import ActionError, described
from fpg_bench.game.compiling import compiled
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import RELATIVE_POSITION
from fpg_bench.game.state import ACTION_SIZE

OFFSETS = (-2, -1, 0, 1, 2)  # of the jamming from the known frequency, in frequency points
PURSUIT_M = 10.0  # closer than this, an opponent that flies at the ally slows down


@dataclass(frozen=True)
class ChoiceList:
    """A list of choices.

    Attributes:
        name: name of the list.
        names: descriptions of the n choices.
        rows: ``(n, 9)`` float32, the floats of each; those that the list does not choose are 0.
        homing: ``(n,)`` float32, added to the velocity: 1 flies at the ally, -1 away from it.
        allowed: ``(n,)`` bool, false where the scenario forbids the choice.
        drawn: ``(n,)`` float32, 1 where the point to hop to is drawn uniformly.
    """

    name: str
    names: tuple[str, ...]
    rows: np.ndarray
    homing: np.ndarray
    allowed: np.ndarray
    drawn: np.ndarray

    def __len__(self) -> int:
        return len(self.names)


class Choices:
    """The choices of one side in an action mode, and the actions that they stand for.

    In mode ``discrete`` an action is one whole number, the index of a choice. In mode ``multi-discrete`` it
    is one whole number for each of several lists, whose rows add up. Two more modes of the ally have one
    list: ``discrete-uniform`` that of ``discrete`` and hops to a uniformly drawn point; ``uniform-hop``
    these hops and staying alone, so the ally chooses when to hop and not where.

    A point is drawn by the standard normal number of the player's seed and step that an agent's input
    ``noise`` has, compared with the quantiles of the points. Comparing is exact, so an environment and an
    exported agent draw the same points on every machine.

    >>> from fpg_bench.game.scenario import preset
    >>> choices = Choices("ally", "discrete", preset("standard"))
    >>> choices.decode(np.array([0, 1]), np.zeros((2, 15), np.float32)).shape
    (2, 9)

    Args:
        side: ``ally`` or ``opponent``.
        mode: an action mode of the side but ``continuous``.
        scenario: the rules; they fix the number of frequency points, the forbidden choices, and whether an
            opponent flies itself.

    Attributes:
        lists: one list, or several.
        box_m: ``(3,)`` float32, size of the box, by which relative positions are scaled.
        is_homing: true if the velocity of a choice depends on where the ally is.
        is_drawn: true if the point of a choice is drawn; then :meth:`decode` needs ``noise``.
        quantiles: ``(points - 1,)`` float32, of the standard normal distribution; the number of those that
            are at most the noise is the drawn point.
        preferences: ``(points,)`` float32, the preferred frequency of each point.
    """

    def __init__(self, side: str, mode: str, scenario: Scenario) -> None:
        self.side, self.mode = side, mode
        lists = _ally_lists(scenario) if side == "ally" else _opponent_lists(scenario)
        if mode != "multi-discrete":
            ally = side == "ally"
            chosen = _ally_combinations(mode, scenario) if ally else _opponent_combinations(lists)
            lists = [_combined(lists, chosen)]
        elif side == "ally":
            lists[0] = _first(lists[0], len(lists[0]) - 1)  # without the drawn hop
        self.lists = tuple(lists)
        self._columns = (len(lists),) if mode == "multi-discrete" else ()
        self.box_m = np.array(scenario.box_m, np.float32)
        every = _combined(lists, list(product(*map(range, self.sizes)))) if self.is_multi else lists[0]
        self.is_homing, self.is_drawn = bool(every.homing.any()), bool(every.drawn.any())
        points, normal = scenario.frequency_points, NormalDist()
        self.quantiles = np.array([normal.inv_cdf(k / points) for k in range(1, points)], np.float32)
        self.preferences = np.linspace(-1.0, 1.0, points).astype(np.float32)
        drawing = (every.drawn, self.quantiles, self.preferences)
        shown = (every.rows, every.allowed, every.homing, self.box_m, *drawing)
        self._table = (np.array(self.sizes), *map(np.copy, shown))  # apart from what callers may write into

    @property
    def is_multi(self) -> bool:
        """True in mode ``multi-discrete``."""
        return self.mode == "multi-discrete"

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of choices of each list."""
        return tuple(map(len, self.lists))

    @property
    def mask(self) -> np.ndarray:
        """``(sum of sizes,)`` bool: the allowed choices of all lists, one after the other."""
        return np.concatenate([each.allowed for each in self.lists])

    def decode(
        self,
        choices: np.ndarray,
        observations: np.ndarray,
        whose: str = "actions",
        noise: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the ``(N, 9)`` float32 actions that choices stand for.

        Args:
            choices: whole numbers, ``(N,)``, and ``(N, lists)`` in mode ``multi-discrete``.
            observations: ``(N, 15)`` of the side.
            whose: begins the message of an error.
            noise: ``(N, 1)`` float32, standard normal numbers of the players' seeds and steps
                (:func:`fpg_bench.players.scripted.player_noise`), by which points are drawn.

        Raises:
            ActionError: another shape or dtype, a number out of range, or a choice that the scenario
                forbids; the message names the game and the choice. Also if points are drawn without noise.
        """
        shape = (len(observations), *self._columns)
        if not isinstance(choices, np.ndarray) or choices.dtype.kind not in "iu" or choices.shape != shape:
            raise ActionError(
                f"{whose}: expected whole numbers of shape {shape}, got {described(choices)} "
                f"(actions={self.mode!r})"
            )
        if noise is None:
            if self.is_drawn:
                raise ActionError(f"{whose}: actions={self.mode!r} draws points by noise, and none is given")
            noise = np.zeros((shape[0], 1), np.float32)
        columns = np.ascontiguousarray(choices, np.int64).reshape(shape[0], -1)
        actions = np.empty((shape[0], ACTION_SIZE), np.float32)
        seen = np.require(observations, np.float32, ("C", "A", "W"))
        if not _look_up(columns, seen, noise, actions, *self._table):
            raise self._error(columns, whose)
        return actions

    def encode(self, actions: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Return the allowed choices that are nearest to actions, by the squared distance of the floats.

        The distance of a choice with a drawn point is the expected one, so a hop to a point of the list is
        nearer to it than a drawn hop is.

        Args:
            actions: ``(N, 9)`` floats.
            observations: ``(N, 15)`` float32 of the side.

        Returns:
            Choices as :meth:`decode` takes them.
        """
        _, rows, allowed, homing, box_m, drawn, _, preferences = self._table
        towards = np.zeros((len(actions), ACTION_SIZE), np.float32)
        if self.is_homing:
            for seen, velocity in zip(observations, towards, strict=True):
                _home(seen, 1.0, box_m, velocity)
        away = actions[:, None] - rows - homing[:, None] * towards[:, None]
        variance = drawn * np.square(preferences).mean()
        distances = np.where(allowed, np.square(away).sum(axis=2) + variance, np.inf)
        chosen = distances.argmin(axis=1)
        return np.stack(np.unravel_index(chosen, self.sizes), axis=1) if self.is_multi else chosen

    def _error(self, choices: np.ndarray, whose: str) -> ActionError:
        """Return the error of the first choice that is out of range or forbidden."""
        for of, column in zip(self.lists, choices.T, strict=True):
            for game, chosen in enumerate(column.tolist()):
                where = f"{whose}: {of.name} of game {game}: {chosen}"
                if not 0 <= chosen < len(of):
                    return ActionError(f"{where} is outside [0, {len(of) - 1}]")
                if not of.allowed[chosen]:
                    return ActionError(f"{where} ({of.names[chosen]}) is forbidden by the scenario")
        raise AssertionError("all choices are valid")


@compiled
def _look_up(
    choices: np.ndarray,
    seen: np.ndarray,
    noise: np.ndarray,
    actions: np.ndarray,
    sizes: np.ndarray,
    rows: np.ndarray,
    allowed: np.ndarray,
    homing: np.ndarray,
    box_m: np.ndarray,
    drawn: np.ndarray,
    quantiles: np.ndarray,
    preferences: np.ndarray,
) -> bool:
    """Fill the actions of choices ``(N, lists)``; returns False for one out of range or forbidden."""
    for i in range(choices.shape[0]):
        index = 0
        for j in range(choices.shape[1]):
            if not 0 <= choices[i, j] < sizes[j]:
                return False
            index = index * sizes[j] + choices[i, j]
        if not allowed[index]:
            return False
        for j in range(ACTION_SIZE):
            actions[i, j] = rows[index, j]
        if homing[index] != 0.0:
            _home(seen[i], homing[index], box_m, actions[i])
        if drawn[index] != 0.0:
            point = 0
            for quantile in quantiles:
                if noise[i, 0] >= quantile:
                    point += 1
            actions[i, PREFERENCE] += preferences[point]
    return True


@compiled
def _home(seen: np.ndarray, homing: float, box_m: np.ndarray, action: np.ndarray) -> None:
    """Add the velocity of an opponent that flies at the ally: of length 1, and less within 10 m of it."""
    squares = 0.0
    for axis in range(3):
        root = seen[RELATIVE_POSITION + axis]
        squares += (root * root * box_m[axis]) ** 2
    reach = max(math.sqrt(squares), PURSUIT_M)
    for axis in range(3):
        root = seen[RELATIVE_POSITION + axis]
        action[VELOCITY + axis] += homing * root * abs(root) * box_m[axis] / reach


def action_choices(side: str, mode: str, scenario: Scenario) -> Choices | None:
    """Return the choices of an action mode; None for ``continuous``.

    Raises:
        UserError: a mode that the side does not have.
    """
    one_of(mode, f"actions of the {side}", action_modes(side))
    return None if mode == "continuous" else Choices(side, mode, scenario)


def _ally_lists(scenario: Scenario) -> list[ChoiceList]:
    """Return the lists of the ally: hop, the last to a drawn point, spread and speed."""
    points = scenario.frequency_points
    known, uniform = points + 1, points + 2
    hop = np.zeros((points + 3, ACTION_SIZE), np.float32)
    hop[:, HOP_GATE], hop[0, HOP_GATE] = 1.0, -1.0
    hop[:, KNOWLEDGE_GATE], hop[known, KNOWLEDGE_GATE] = -1.0, 1.0
    hop[1:known, PREFERENCE] = np.linspace(-1.0, 1.0, points)
    to_points = (f"hop to point {point}" for point in range(points))
    names = ["stay", *to_points, "hop by the knowledge base", "hop to a random point"]
    allowed = np.ones(points + 3, bool)
    allowed[known] = scenario.knowledge_base is not None
    spread, speed = np.zeros((2, ACTION_SIZE), np.float32), np.zeros((3, ACTION_SIZE), np.float32)
    spread[:, SPREAD_GATE] = -1.0, 1.0
    speed[:, SPEED] = 1.0, 0.0, -1.0
    return [
        _list("hop", names, hop, allowed=allowed, drawn=np.arange(points + 3) == uniform),
        _list("spread", ["unspread", "spread"], spread),
        _list("speed", ["full speed", "mean speed", "least speed"], speed),
    ]


def _ally_combinations(mode: str, scenario: Scenario) -> list[tuple[int, ...]]:
    """Return the choices of an ally in a mode of one list.

    In mode ``discrete`` these are every hop, and spreading without a hop or with one by the knowledge base;
    ``discrete-uniform`` adds the hop to a drawn point, with and without spreading, behind them; and
    ``uniform-hop`` has staying and that hop, each with and without spreading.

    All at full speed and, where flying costs, also at the mean one, near which a rotary wing needs least
    power. Hops to each point while spreading as well make a list of 34, from
    which PPO learned no more.
    """
    known, uniform = scenario.frequency_points + 1, scenario.frequency_points + 2
    speeds = (0, 1) if scenario.flight_cost_per_w else (0,)
    named = [*((hop, 0) for hop in range(known + 1)), (0, 1), (known, 1)]
    drawn = [(uniform, 0), (uniform, 1)]
    groups = {
        "discrete": [named],
        "discrete-uniform": [named, drawn],
        "uniform-hop": [[(0, 0), (0, 1), *drawn]],
    }
    return [(*way, speed) for ways in groups[mode] for speed in speeds for way in ways]


def _opponent_lists(scenario: Scenario) -> list[ChoiceList]:
    """Return the lists of the opponent: type, centre, and where it flies if it flies itself."""
    points, types = scenario.frequency_points, len(JAMMING_TYPES)
    kind = np.zeros((types, ACTION_SIZE), np.float32)
    kind[:, TYPE_SCORES : TYPE_SCORES + types] = 2.0 * np.eye(types) - 1.0
    centre = np.zeros((len(OFFSETS) + points, ACTION_SIZE), np.float32)
    centre[: len(OFFSETS), TUNING] = np.clip(
        np.array(OFFSETS) * scenario.point_spacing_mhz / max(scenario.tuning_span_mhz, 1e-9), -1.0, 1.0
    )
    centre[len(OFFSETS) :, TUNING] = np.linspace(-1.0, 1.0, points)
    centre[:, IN_BAND_GATE] = np.repeat((-1.0, 1.0), (len(OFFSETS), points))
    names = [*map(_offset_name, OFFSETS), *(f"point {point}" for point in range(points))]
    lists = [
        _list("type", list(JAMMING_TYPES), kind, allowed=np.isin(JAMMING_TYPES, scenario.jamming_types)),
        _list("centre", names, centre),
    ]
    if "learned" in scenario.paths:
        flight = np.zeros((8, ACTION_SIZE), np.float32)
        flight[2:, VELOCITY:] = np.concatenate((np.eye(3), -np.eye(3)))
        ways = ["at the ally", "hold", *(f"along {sign}{axis}" for sign in "+-" for axis in "xyz")]
        lists.append(_list("flight", ways, flight, homing=np.array([1.0, *[0.0] * 7])))
    return lists


def _offset_name(offset: int) -> str:
    return f"known point {offset:+d}" if offset else "known point"


def _opponent_combinations(lists: Sequence[ChoiceList]) -> list[tuple[int, ...]]:
    """Return each type near the known frequency, and narrowband and broadband at each point.

    An opponent that flies itself has each of them flying at the ally and holding its place.
    """
    types, centres, *flights = lists
    narrowband, broadband = JAMMING_TYPES.index("narrowband"), JAMMING_TYPES.index("broadband")
    near = list(product(range(len(types)), range(len(OFFSETS))))
    far = list(product((narrowband, broadband), range(len(OFFSETS), len(centres))))
    if not flights:
        return [*near, *far]
    return [(*each, flight) for flight in range(2) for each in (*near, *far)]


def _list(
    name: str,
    names: Sequence[str],
    rows: np.ndarray,
    homing: np.ndarray | None = None,
    allowed: np.ndarray | None = None,
    drawn: np.ndarray | None = None,
) -> ChoiceList:
    count = len(names)
    return ChoiceList(
        name,
        tuple(names),
        rows,
        np.zeros(count, np.float32) if homing is None else homing.astype(np.float32),
        np.ones(count, bool) if allowed is None else allowed,
        np.zeros(count, np.float32) if drawn is None else drawn.astype(np.float32),
    )


def _first(of: ChoiceList, count: int) -> ChoiceList:
    """Return the first choices of a list."""
    arrays = (of.rows, of.homing, of.allowed, of.drawn)
    return ChoiceList(of.name, of.names[:count], *(array[:count] for array in arrays))


def _combined(lists: Sequence[ChoiceList], chosen: Sequence[tuple[int, ...]]) -> ChoiceList:
    """Return one list of combinations, given as indices into the lists."""
    columns = list(zip(*chosen, strict=True))
    pairs = [(of, np.array(column)) for of, column in zip(lists, columns, strict=True)]
    varied = [(of, column) for of, column in pairs if (column != column[0]).any()]
    names = [", ".join(of.names[column[row]] for of, column in varied) for row in range(len(chosen))]
    return ChoiceList(
        "choice",
        tuple(names),
        np.sum([of.rows[column] for of, column in pairs], axis=0),
        np.sum([of.homing[column] for of, column in pairs], axis=0),
        np.all([of.allowed[column] for of, column in pairs], axis=0),
        np.sum([of.drawn[column] for of, column in pairs], axis=0),
    )
