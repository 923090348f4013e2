"""The interceptor: fits the ally's path to own positions and rewards, and flies to meet it.

A model-based heuristic, not a language model. It knows the rules of the game (the reward's fall with
distance, the ally's cubic Bezier curve there and back, the position of the base station), and of a match only
its history.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from fpg_bench.game.scenario import Scenario
from fpg_bench.players.planner import Array, BatchPlanner, Limits, Patrol, Plan, Request
from fpg_bench.products.planning.curve import CHORDS, PARAMETERS, SPEED, fit_games, trace
from fpg_bench.products.planning.pursuit import chase_waypoints

CURVES = 24  # refined in each fit
KEPT = 16  # of them come from the fit of the previous round
LIBRARY, FRESH = 256, 64
SPEED_SD_M_S = 1.0
_MOST_REMEMBERED = 4096  # fits


class Interceptor(BatchPlanner):
    """Flies to meet the ally on the path that explains the rewards best; the first round flies the circle.

    A plan depends on the history alone: fits of shorter histories are cached, and repeated where they are
    missing.

    Args:
        scenario: what is played; its rules are used, but not a fixed curve that it may hold.
    """

    name, tier = "interceptor", "history"

    def __init__(self, scenario: Scenario) -> None:
        self._circle = Patrol("circle", scenario)
        self._times = Limits.of(scenario).middles_s().astype(float)
        self._seconds = np.arange(scenario.steps_per_round + 1.0)
        self._rules = np.array(
            [*scenario.base_station_m, scenario.distance_reward, max(scenario.distance_reward_m, 1.0)]
        )
        share = np.linspace(0, 1, CHORDS + 1)[:, None]
        rest = 1 - share  # products: a power's last bit depends on the machine
        each = rest * rest * rest, 3 * share * rest * rest, 3 * share * share * rest, share * share * share
        self._bernstein = np.hstack(each)
        self._bounds, self._prior = _prior(scenario)
        # A library of curves as the rules draw them, three in four at full speed
        low, high = self._bounds
        self._library = np.random.default_rng(0).uniform(low, high, (LIBRARY, PARAMETERS))
        self._library[LIBRARY // 4 :, SPEED] = high[SPEED]
        self._library_places = np.stack(
            [trace(curve, self._times, self._bernstein) for curve in self._library]
        )
        self._fits: OrderedDict[bytes, Array] = OrderedDict()

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the plans of some games, all fitted together."""
        fits = self.fit([request.history for request in requests])
        return [self._plan(request, curves) for request, curves in zip(requests, fits, strict=True)]

    def _plan(self, request: Request, curves: Array | None) -> Plan:
        if curves is None:
            return self._circle.plan_batch([request])[0]
        path = trace(curves[0], self._seconds, self._bernstein)
        return Plan(chase_waypoints(path, request.current_position, request.limits), self.name)

    def fit(self, histories: Sequence[Array]) -> list[Array | None]:
        """Fit curves to some histories.

        Args:
            histories: one ``(rounds, n, 4)`` a game.

        Returns:
            For each game the parameters ``(KEPT, 13)`` of its curves, best first (four control points in
            m, speed in m/s); None without any round.
        """
        keys = [[_digest(history[: r + 1]) for r in range(len(history))] for history in histories]
        most = max(_MOST_REMEMBERED, 2 * len(histories))
        for rounds in range(1, 1 + max(map(len, histories), default=0)):
            # Later fits start from earlier ones, so a match seen for the first time is fitted in order
            missing = {
                key[rounds - 1]: (history[:rounds], key[rounds - 2] if rounds > 1 else None)
                for history, key in zip(histories, keys, strict=True)
                if len(history) >= rounds and not any(k in self._fits for k in key[rounds - 1 :])
            }
            if missing:
                self._fit_round(list(missing), *zip(*missing.values(), strict=True))
        fits = [self._fits[key[-1]] if key else None for key in keys]
        for key in filter(None, keys):
            self._fits.move_to_end(key[-1])
        while len(self._fits) > most:
            self._fits.popitem(last=False)
        return fits

    def _fit_round(
        self, keys: Sequence[bytes], histories: Sequence[Array], before: Sequence[bytes | None]
    ) -> None:
        """Fit games of equally many rounds in one compiled call, and cache the result."""
        measured = np.stack(histories).reshape(len(histories), -1, 4)
        curves = np.zeros((len(histories), CURVES, PARAMETERS))
        kept, fresh = 0, slice(None)
        if before[0] is not None:
            kept, start = KEPT, measured.shape[1] // len(self._times) * FRESH % LIBRARY
            fresh = slice(start, start + FRESH)  # another part of the library in each round
            curves[:, :KEPT] = [self._fits[key] for key in before if key is not None]
        fit_games(
            measured,
            curves,
            kept,
            self._library[fresh],
            self._library_places[fresh],
            self._times,
            self._bernstein,
            self._rules,
            self._prior,
            self._bounds,
        )
        for key, fitted in zip(keys, curves, strict=True):
            self._fits[key] = fitted[:KEPT].copy()


def _prior(scenario: Scenario) -> tuple[Array, Array]:
    """Return the parameters' bounds, and their prior mean and standard deviation, each ``(2, 13)``.

    Control points are uniform where the rules draw them; the speed is at its greatest, or not far below.
    """
    altitudes, (slow, fast) = scenario.ally_path_altitude_m, scenario.ally_speed_m_s
    low = np.append(np.tile([0.0, 0.0, altitudes[0]], 4), slow)
    high = np.append(np.tile([*scenario.box_m[:2], altitudes[1]], 4), fast)
    prior = np.stack([(low + high) / 2, np.maximum(high - low, 1.0) / np.sqrt(12)])
    prior[:, SPEED] = fast, SPEED_SD_M_S
    return np.stack([low, high]), prior


def _digest(history: Array) -> bytes:
    return hashlib.blake2b(np.ascontiguousarray(history).tobytes(), digest_size=16).digest()
