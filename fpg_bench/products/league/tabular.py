"""Tabular responses: a choice for each cell of a few discretised features, without a network.

The features are read of the player's own observation and of a small memory, such as the seconds since its
last check. A table is found by evaluation alone (:mod:`fpg_bench.products.league.categorical`), and exported
as an ordinary agent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import other_side
from fpg_bench.common.imports import code_fingerprint
from fpg_bench.common.rows import Row
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.actions import IN_BAND_GATE, PREFERENCE, TUNING, TYPE_SCORES, VELOCITY
from fpg_bench.game.choices import PURSUIT_M, Choices
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    JAM_TYPE,
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    LAST_CHECK,
    NEXT_CHECK,
    SENSED_COVERS,
    SENSED_TYPE,
    SNR,
    SPREADING_TIME,
)
from fpg_bench.game.spec import GameSpec
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE, TYPES
from fpg_bench.players.player import Player
from fpg_bench.players.registry import as_player, policy_hash
from fpg_bench.products.league.candidates import Candidates, away_m, earnings
from fpg_bench.products.league.categorical import CategoricalSearch
from fpg_bench.products.league.folder import run_search, search_folder, write_found
from fpg_bench.training.export import Graph, Value, counted, rows_of

MOST_CELLS = 4096

# What features are read of: the observation, the squared distance in m2, the type that is seen (0 for none,
# else 1 and more), and the memory.
_DISTANCE, _TYPE, _MEMORY = range(OBSERVATION_SIZE, OBSERVATION_SIZE + 3)
_CLOCK, _RUN, _NEXT, _KNOWN = range(4)  # columns of the memory; the last two of an opponent alone
_MEMORY_SIZES = {"ally": 2, "opponent": 4}
_FIRST_TYPE = {"ally": SENSED_TYPE, "opponent": JAM_TYPE}


class _Feature(NamedTuple):
    """Feature of a side: an edge e is the threshold ``(e - offset) / scale`` of a column."""

    column: int
    scale: str | float = 1.0  # a field of the scenario, or a number
    offset: float = 0.5  # half a unit below, where values are whole


_DISTANCE_M = {"distance_m": _Feature(_DISTANCE, offset=0.0)}
FEATURES: Mapping[str, Mapping[str, _Feature]] = {
    "ally": {
        **_DISTANCE_M,
        "snr_db": _Feature(SNR, "snr_scale_db", 0.0),
        "spreading_s": _Feature(SPREADING_TIME, "spreading_scale_s"),
        "sensed_type": _Feature(_TYPE),
        "covered": _Feature(SENSED_COVERS, 2.0),
        "since_hit_s": _Feature(_MEMORY + _CLOCK),
        "hits": _Feature(_MEMORY + _RUN),
    },
    "opponent": {
        **_DISTANCE_M,
        "known_age_s": _Feature(KNOWN_AGE, "age_scale_s"),
        "next_check_s": _Feature(NEXT_CHECK, "check_scale_s"),
        "last_check": _Feature(LAST_CHECK, 2.0),
        "own_type": _Feature(_TYPE),
        "since_check_s": _Feature(_MEMORY + _CLOCK),
        "same_point": _Feature(_MEMORY + _RUN),
    },
}


def check_features(side: str, features: Mapping[str, Sequence[float]]) -> None:
    """Raise UserError for features that a side does not observe, or for invalid edges.

    An ally's are ``distance_m``, ``snr_db``, ``spreading_s``, ``sensed_type`` (0 for none, 1 for the first
    type and so on), ``covered`` (1 where the sensed jamming covers it), ``since_hit_s``, and ``hits`` in a
    row. An opponent's are ``distance_m``, ``known_age_s``, ``next_check_s``, ``last_check`` (1 where it heard
    the ally, -1 where not), ``own_type``, ``since_check_s``, and ``same_point``: how often in a row checks
    have found the ally where the one before had found it.
    """
    for name, edges in features.items():
        if name not in FEATURES[side]:
            known = ", ".join(FEATURES[side])
            raise UserError(f"features: the {side} does not observe {name!r}; it observes {known}")
        if not edges or not all(map(math.isfinite, edges)) or list(edges) != sorted(set(edges)):
            raise UserError(f"features: {name}: expected rising edges, one at least, got {list(edges)}")
    if not 1 < count_cells(features) <= MOST_CELLS:
        raise UserError(
            f"features: expected 2 to {MOST_CELLS} cells, got {count_cells(features)}; name "
            f"{'fewer' if features else 'some'}"
        )


def count_cells(features: Mapping[str, Sequence[float]]) -> int:
    """Return the number of cells of a table."""
    return math.prod(len(edges) + 1 for edges in features.values())


@dataclass(frozen=True)
class TableChoices:
    """Choices of a table.

    Attributes:
        names: of the n choices.
        rows: ``(n, 9)`` float32, the actions.
        drawn: ``(n,)`` bool, true where the frequency point is drawn uniformly.
        column: index of the drawn point in an action.
        quantiles, places: of the draw, and the points in the band; see
            :class:`fpg_bench.game.choices.Choices`.
    """

    names: tuple[str, ...]
    rows: np.ndarray
    drawn: np.ndarray
    column: int
    quantiles: np.ndarray
    places: np.ndarray

    @cached_property
    def drawn_rows(self) -> np.ndarray:
        """``(points, 9)`` float32, what a drawn point adds to an action."""
        rows = np.zeros((len(self.places), ACTION_SIZE), np.float32)
        rows[:, self.column] = self.places
        return rows


def table_choices(side: str, scenario: Scenario) -> TableChoices:
    """Return what a table chooses from.

    An ally stays or hops to a random point, with and without spreading. An opponent jams the known point or a
    random one by each type, and flies at the ally where it flies itself.
    """
    mode = "uniform-hop" if side == "ally" else "discrete"
    choices = Choices(side, mode, scenario)
    if side == "ally":
        of = choices.lists[0]
        names, rows, drawn, column = of.names, of.rows, of.drawn > 0, PREFERENCE
    else:
        kinds = [kind for kind, name in enumerate(JAMMING_TYPES) if name in scenario.jamming_types]
        ways = list(product(kinds, ("known", "random")))
        names = tuple(f"{JAMMING_TYPES[kind]} at the {point} point" for kind, point in ways)
        drawn, column = np.array([point == "random" for _, point in ways]), TUNING
        rows = np.zeros((len(ways), ACTION_SIZE), np.float32)
        rows[:, TYPE_SCORES : TYPE_SCORES + TYPES] = 2.0 * np.eye(TYPES)[[kind for kind, _ in ways]] - 1.0
        rows[:, IN_BAND_GATE] = np.where(drawn, 1.0, -1.0)
    return TableChoices(names, rows, drawn, column, choices.quantiles, choices.preferences)


def _thresholds(
    side: str, features: Mapping[str, Sequence[float]], scenario: Scenario
) -> list[tuple[int, np.ndarray]]:
    """Return the column of each feature, and its edges in the units of the column as float32."""
    check_features(side, features)
    found = []
    for name, edges in features.items():
        column, scale, offset = FEATURES[side][name]
        unit = getattr(scenario, scale) if isinstance(scale, str) else scale
        values = (np.array(edges, float) - offset) / unit
        found.append(
            (column, (values * np.abs(values) if column == _DISTANCE else values).astype(np.float32))
        )
    return found


def table_onnx(
    side: str, features: Mapping[str, Sequence[float]], scenario: Scenario, cells: Sequence[int] | None = None
) -> bytes:
    """Return a table as ONNX, with the inputs and outputs of :class:`fpg_bench.players.agent.OnnxPlayer`.

    Args:
        side: the side that it plays.
        features: see :func:`check_features`.
        scenario: the rules; they give the scales of observations and the choices.
        cells: the choice in each cell, an index into :func:`table_choices`, the last feature fastest; None:
            they are an input ``numbers``.
    """
    graph, choices = Graph(), table_choices(side, scenario)
    size = _MEMORY_SIZES[side]

    seen, state = Value(graph, "observation"), Value(graph, "state")
    later, longer = state.column(_CLOCK) + 1, state.column(_RUN) + 1
    if side == "ally":
        hit = seen.column(SENSED_COVERS) > 0
        memory = [hit.where(0, later), hit.where(longer, 0)]
    else:
        checked = state.column(_NEXT) < seen.column(NEXT_CHECK)
        same = state.column(_KNOWN).equals(seen.column(KNOWN_FREQUENCY))
        run = (seen.column(KNOWN_AGE) > 0).where(state.column(_RUN), same.where(longer, 0))
        memory = [checked.where(0, later), run, seen.column(NEXT_CHECK), seen.column(KNOWN_FREQUENCY)]
    away = away_m(seen, scenario)
    squares = away.dot(away)

    def values(column: int) -> str:
        if column == _DISTANCE:
            return squares.name
        if column == _TYPE:
            return kind_of(seen.column(_FIRST_TYPE[side], TYPES)).name
        return (seen.column(column) if column < OBSERVATION_SIZE else memory[column - _MEMORY]).name

    bins = [(values(column), edges) for column, edges in _thresholds(side, features, scenario)]
    cell = cell_of(graph, bins)
    if cells is None:
        place = graph.add("Unsqueeze", cell, graph.constant([1]))
        of_cell = graph.add("GatherElements", "numbers", place, axis=1)
        every = graph.constant(np.arange(len(choices.names), dtype=np.float32))
        is_chosen = Value(graph, graph.add("Equal", of_cell, every)).where(1, 0).name
        chosen = graph.add("ArgMax", is_chosen, axis=1, keepdims=0)
    else:
        chosen = graph.add("Gather", graph.constant(list(cells)), cell, axis=0)
    parts = [
        graph.add("Gather", graph.constant(choices.rows), chosen, axis=0),
        drawn_point(graph, "noise", chosen, choices.drawn, choices.quantiles, choices.drawn_rows),
    ]
    if side == "opponent":
        velocity = away / squares.of("Sqrt").at_least(PURSUIT_M)
        flight = np.eye(3, ACTION_SIZE, VELOCITY, np.float32)
        parts.append(graph.add("MatMul", velocity.name, graph.constant(flight)))
    graph.add("Sum", *parts, to="action")
    graph.add("Concat", *(each.name for each in memory), axis=1, to="next_state")
    inputs = [rows_of("observation", OBSERVATION_SIZE), rows_of("noise", 1), rows_of("state", size)]
    if cells is None:
        inputs.append(rows_of("numbers", count_cells(features)))
    return graph.to_bytes(inputs, [rows_of("action", ACTION_SIZE), rows_of("next_state", size)])


def kind_of(types: Value) -> Value:
    """Return 1 and more for the type of an observation's columns ``(n, 4)``, 0 for none."""
    graph = types.graph
    numbers = graph.constant(np.arange(1, TYPES + 1, dtype=np.float32)[:, None])
    return Value(graph, graph.add("MatMul", types.name, numbers))


def cell_of(graph: Graph, bins: Sequence[tuple[str, np.ndarray]]) -> str:
    """Add the cell of features, each with its edges; the last one varies fastest."""
    cell = ""
    for values, edges in bins:
        digit = counted(graph, graph.add("Less", values, graph.constant(edges)), (0, 1))
        place = graph.add("Mul", cell, graph.constant([len(edges) + 1])) if cell else ""
        cell = graph.add("Add", place, digit) if cell else digit
    return cell


def drawn_point(
    graph: Graph, noise: str, chosen: str, drawn: np.ndarray, quantiles: np.ndarray, rows: np.ndarray
) -> str:
    """Add what a point that the noise draws adds to an action; ``drawn`` says for which choices."""
    point = counted(graph, graph.add("Less", noise, graph.constant(quantiles)), (0, 1))
    is_drawn = graph.add("Gather", graph.constant(drawn[:, None].astype(np.float32)), chosen, axis=0)
    return graph.add("Mul", graph.add("Gather", graph.constant(rows), point, axis=0), is_drawn)


# Search

NAME = "tabular"  # of its files, and of the algorithm
DEFAULT_FEATURES: Mapping[str, Mapping[str, Sequence[float]]] = {
    "ally": {"since_hit_s": (1, 2, 3, 6), "sensed_type": (1, 2, 3, 4), "hits": (2, 3)},
    "opponent": {"known_age_s": (1, 2, 3, 4, 5), "own_type": (1, 2, 3), "distance_m": (60,)},
}


def table_search(
    game: GameSpec,
    features: Mapping[str, Sequence[float]],
    out: str | Path,
    *,
    budget: float = 200.0,
    seed: int = 0,
    progress: bool = True,
) -> float:
    """Search a table that responds to a fixed player.

    The rows of a search depend on its seed alone, and its budget decides how many there are. A stopped call
    is resumed, and a larger budget continues a finished one.

    Args:
        game: the table's game against the player.
        features: edges of each feature, see :func:`check_features`.
        out: a folder for ``tabular.jsonl``, a row per generation; ``agent``, the best table, whose ``recipe``
            has the cells; and ``tabular.json``, the settings.
        budget: CPU seconds of the search, over all calls; the generation that it ends in is finished.
        seed: training seed of the search.
        progress: log a line for each quarter of the budget.

    Returns:
        CPU seconds of all calls.

    Raises:
        UserError: a feature that the side does not observe, or a folder with other files or another search.
        KeyboardInterrupt: stopped by the user.
    """
    (player,), side, scenario, folder = game.others, game.config.side, game.resolve(), Path(out)
    check_features(side, features)
    rival = as_player(player, other_side(side), scenario)
    about: Row = {
        "policy": policy_hash(rival) or code_fingerprint(player),
        "scenario": scenario.hash,
        "reward": game.reward,
        "seed": seed,
        "features": {name: list(map(float, edges)) for name, edges in features.items()},
    }
    with search_folder(folder, f"{NAME}.json", f"{NAME}.jsonl", "tabular search"):
        search = TableSearch(side, [rival], scenario, features, game.reward or "own", seed)
        _, seconds = run_search(search, folder, NAME, about, budget, progress)
        cells = search.best.tolist()
        recipe: JsonObject = {"features": about["features"], "cells": cells}
        model = table_onnx(side, features, scenario, cells)
        write_found(folder / "agent", model, search, game, NAME, seconds, recipe)
    return seconds


class TableSearch(CategoricalSearch):
    """Search over the cells of a table.

    Args:
        side: side of the table.
        rivals: players of the other side.
        scenario: what is played.
        features: see :func:`check_features`.
        reward: ``own``, or ``zero_sum`` to lower the rivals' returns.
        seed: training seed.
    """

    def __init__(
        self,
        side: str,
        rivals: Sequence[Player],
        scenario: Scenario,
        features: Mapping[str, Sequence[float]],
        reward: str = "own",
        seed: int = 0,
    ) -> None:
        model = table_onnx(side, features, scenario)
        play = earnings(lambda cells: Candidates(model, cells), side, rivals, scenario, reward)
        choices = len(table_choices(side, scenario).names)
        super().__init__([choices] * count_cells(features), play, len(rivals), seed)
