"""The interceptor: fits the ally's path to own positions and rewards, and flies to meet it.

It is a model-based heuristic, not a language model: it knows the rules of the game (how the reward falls
with distance, that the ally flies a cubic Bezier curve there and back, where the base station stands),
and of a match only its history.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from fpg_bench.game.scenario import Scenario
from fpg_bench.planning import curve_fit, curve_flight
from fpg_bench.planning.interception import chase_waypoints
from fpg_bench.planning.patterns import Patrol
from fpg_bench.planning.planner import BatchPlanner, Plan, Request

CURVES = 24  # refined in each fit
KEPT = 16  # of them come from the fit of the round before
LIBRARY, FRESH = 256, 64
STEPS, FINALS, FINAL_STEPS = 6, 8, 12
SPEED_SD_M_S = 1.0
_MOST_REMEMBERED = 4096


class Interceptor(BatchPlanner):
    """Flies to meet the ally on the path that explains the rewards best; the first round flies the circle.

    A plan depends on the history alone: fits of shorter histories are remembered, and made again where
    they are not.

    Args:
        scenario: what is played; its rules are used, but not a fixed curve that it may hold.
    """

    name, tier = "interceptor", "history"

    def __init__(self, scenario: Scenario) -> None:
        self._first = Patrol("circle", scenario)
        self._n, rounds_s = scenario.waypoints, scenario.steps_per_round
        parts = np.arange(self._n)
        starts, ends = -(-parts * rounds_s // self._n), -(-(parts + 1) * rounds_s // self._n)
        self._times = (starts + ends) // 2 + 1.0  # when the history's positions were taken
        self._seconds = np.arange(rounds_s + 1.0)
        self._rules = np.array(
            [*scenario.base_station_m, scenario.distance_reward, max(scenario.distance_reward_m, 1.0)]
        )
        share = np.linspace(0, 1, curve_flight.CHORDS + 1)[:, None]
        self._bernstein = np.array([1, 3, 3, 1]) * share ** np.arange(4) * (1 - share) ** np.arange(3, -1, -1)
        self._set_prior(scenario)
        self._room = _room(self._n)
        self._draw_library()
        self._fits: OrderedDict[bytes, tuple[np.ndarray, float]] = OrderedDict()

    def _set_prior(self, scenario: Scenario) -> None:
        """Control points uniform where the rules draw them; the speed at its greatest, or not far below."""
        altitudes, (slow, fast) = scenario.ally_path_altitude_m, scenario.ally_speed_m_s
        low = np.append(np.tile([0.0, 0.0, altitudes[0]], 4), slow)
        high = np.append(np.tile([*scenario.box_m[:2], altitudes[1]], 4), fast)
        self._bounds = np.stack([low, high])
        self._prior = np.stack([(low + high) / 2, np.maximum(high - low, 1.0) / np.sqrt(12)])
        self._prior[:, curve_flight.SPEED] = fast, SPEED_SD_M_S

    def _draw_library(self) -> None:
        """Curves as the rules draw them, three in four at full speed."""
        rng = np.random.default_rng(0)
        self._library = rng.uniform(self._bounds[0], self._bounds[1], (LIBRARY, curve_fit.PARAMETERS))
        self._library[LIBRARY // 4 :, curve_flight.SPEED] = self._bounds[1, curve_flight.SPEED]
        self._library_places = np.stack([self._trace(curve, self._times) for curve in self._library])

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """The plans for some games, all fitted together."""
        fits = self.fit([request.history for request in requests])
        return [self._plan(request, fit) for request, fit in zip(requests, fits, strict=True)]

    def _plan(self, request: Request, fit: tuple[np.ndarray, float] | None) -> Plan:
        if fit is None:
            return self._first.plan_batch([request])[0]
        path = self._trace(fit[0][0], self._seconds)
        return Plan(chase_waypoints(path, request.current_position, request.limits), self.name)

    def fit(self, histories: Sequence[np.ndarray]) -> list[tuple[np.ndarray, float] | None]:
        """The curves that explain some histories best, and what share of the rewards' variance they do.

        Args:
            histories: one ``(rounds, n, 4)`` a game.

        Returns:
            For each game the parameters ``(KEPT, 13)`` of its curves, best first (four control points in
            m, speed in m/s), and the share that the first explains; None without any round.
        """
        keys = [[_digest(h[: r + 1]) for r in range(len(h))] for h in histories]
        most = max(_MOST_REMEMBERED, 2 * len(histories))
        for rounds in range(1, 1 + max(map(len, histories), default=0)):
            # Later fits begin where earlier ones ended, so a match seen for the first time is fitted in order
            missing = {
                key[rounds - 1]: (history[:rounds], key[rounds - 2] if rounds > 1 else None)
                for history, key in zip(histories, keys, strict=True)
                if len(history) >= rounds and not any(k in self._fits for k in key[rounds - 1 :])
            }
            if missing:
                self._fit_round(list(missing), *zip(*missing.values(), strict=True))
        found = [self._fits[key[-1]] if key else None for key in keys]
        for key in keys:
            if key:
                self._fits.move_to_end(key[-1])
        while len(self._fits) > most:
            self._fits.popitem(last=False)
        return found

    def _fit_round(
        self, keys: Sequence[bytes], histories: Sequence[np.ndarray], before: Sequence[bytes | None]
    ) -> None:
        """Fit games of equally many rounds, in one compiled call, and remember what was found."""
        measured = np.stack(histories).reshape(len(histories), -1, 4)
        curves = np.zeros((len(histories), CURVES, curve_fit.PARAMETERS))
        kept, fresh = 0, slice(None)
        if before[0] is not None:
            kept, start = KEPT, measured.shape[1] // self._n * FRESH % LIBRARY
            fresh = slice(start, start + FRESH)  # another part of the library in each round
            curves[:, :KEPT] = [self._fits[key][0] for key in before if key is not None]
        explained = np.empty(len(histories))
        curve_fit.fit_games(
            measured, self._library[fresh], self._library_places[fresh], self._times, self._bernstein,
            self._rules, self._prior, self._bounds, kept, STEPS, FINALS, FINAL_STEPS,
            curves, np.empty(curves.shape[:2]), explained, np.empty(LIBRARY),
            (np.empty(measured.shape[1]), np.empty(measured.shape[1]), *self._room),
        )  # fmt: skip
        for key, found, share in zip(keys, curves, explained.tolist(), strict=True):
            self._fits[key] = found[:KEPT].copy(), share

    def _trace(self, curve: np.ndarray, times: np.ndarray) -> np.ndarray:
        places = np.empty((len(times), 3))
        curve_flight.trace(curve, times, self._bernstein, places, *self._room[-2:])
        return places


def _room(n: int) -> tuple[np.ndarray, ...]:
    """What a fit works in, after the two arrays that depend on the number of measurements."""
    p, chords = curve_fit.PARAMETERS, curve_flight.CHORDS
    fit = [3, (p, p), (p, p), p, p, p, (2, p), (3, 6)]
    shapes = [*fit, (n, 3), (chords + 1, p - 1), (n, 3, p), (chords + 1, 3), chords + 1]
    return tuple(np.zeros(shape) for shape in shapes)


def _digest(history: np.ndarray) -> bytes:
    return hashlib.blake2b(np.ascontiguousarray(history).tobytes(), digest_size=16).digest()
