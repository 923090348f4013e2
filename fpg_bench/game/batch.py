"""A batch of N games, stepped together: the only interface to the rules."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, cast

import numpy as np

from fpg_bench.common.checks import integer, is_integer
from fpg_bench.common.errors import UserError, shown
from fpg_bench.game import rng
from fpg_bench.game import step as kernel
from fpg_bench.game.flight import LEARNED, PURSUIT
from fpg_bench.game.metrics import CLEAN
from fpg_bench.game.rules import round_rules
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import ACTION_SIZE, GAME, OBSERVATION_SIZE, TALLY

_GAMES_WORTH_A_THREAD = 512
MAX_SEED = 2**63 - 1
Seeds = int | Sequence[int] | np.ndarray  # one whole number in [0, 2^63) per game, or one for all of them


class ActionError(UserError):
    """Invalid actions; the message names the side and the game."""


class GameBatch:
    """N games of one scenario, or of its variants, of which each round draws one.

    The attributes are buffers that every call reuses; copy what you keep. Observations are read-only.

    >>> from fpg_bench.game.scenario import preset
    >>> batch = GameBatch(preset("standard"), games=64)
    >>> started = batch.reset(seeds=0)
    >>> batch.step(np.zeros((64, 9)), np.zeros((64, 9)))
    >>> batch.ally_observations.shape
    (64, 15)

    Attributes:
        drawn: the scenarios that rounds are drawn from; ``games["rules"]`` is each game's index into them.
        games: ``(N,)`` records of dtype ``state.GAME``: the full state.
        tallies: ``(N,)`` records of dtype ``state.TALLY``: the sums of the present round.
        histograms: ``(N, 2, points)`` int32, steps per frequency point: the ally's centre, the jammer's.
        segments: ``(N, waypoints, 4)`` float64: per part of the round, the opponent's position in m in
            its middle and its mean reward; the history that a path planner may learn from.
        waypoints: ``(N, waypoints, 3)`` float64 in m, flown where the path is ``waypoints``.
        ally_observations, opponent_observations: ``(N, 15)`` float32 in [-1, 1].
        flown_m: ``(N, T + 1, 3)`` float64, each ally's position after each second of its round; None unless
            :meth:`keep_flown` was called.

    Args:
        scenario: the rules of the games.
        games: number of games, N.
        threads: number of threads that step a large batch; results do not depend on it. None: two if the
            machine has them.
    """

    def __init__(self, scenario: Scenario, games: int = 1, threads: int | None = None) -> None:
        threads = min(2, os.cpu_count() or 1) if threads is None else threads
        self.scenario = scenario
        self.count = integer(games, "games")
        self.threads = integer(threads, "threads")
        self.drawn, self._rules, self._radio = round_rules(scenario)
        self._channel = None if scenario.channel_grid is None else tuple(scenario.channel_grid)
        self.games = np.zeros(self.count, GAME)
        self.tallies = np.zeros(self.count, TALLY)
        self.histograms = np.zeros((self.count, 2, scenario.frequency_points), np.int32)
        self.segments = np.zeros((self.count, scenario.waypoints, 4))
        self.waypoints = np.zeros((self.count, scenario.waypoints, 3))
        self._ally_observations = np.zeros((self.count, OBSERVATION_SIZE), np.float32)
        self._opponent_observations = np.zeros((self.count, OBSERVATION_SIZE), np.float32)
        self._ally_actions = np.zeros((self.count, ACTION_SIZE), np.float32)
        self._opponent_actions = np.zeros((self.count, ACTION_SIZE), np.float32)
        self.flown_m: np.ndarray | None = None
        self._pool: ThreadPoolExecutor | None = None
        self._begun = False
        self._bind()

    def _bind(self) -> None:
        """Collect the kernel's arguments once, as a call takes a few hundred nanoseconds."""
        self.ally_observations = read_only(self._ally_observations)
        self.opponent_observations = read_only(self._opponent_observations)
        self._arguments: tuple[Any, ...] = (
            self.games,
            self.tallies,
            self.histograms,
            self.segments,
            self.waypoints,
            self._ally_actions,
            self._opponent_actions,
            self._ally_observations,
            self._opponent_observations,
            self._channel,
            self._rules,
            self._radio,
        )

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Seeds | None = None,
        horizons: np.ndarray | None = None,
        new_match: bool = False,
    ) -> None:
        """Begin rounds: new matches if ``seeds`` are given, otherwise the next round of each match.

        After a match's last round the game goes on with the next match of its own seed.

        Args:
            mask: ``(N,)`` bool, the games to begin; None: all.
            seeds: None, one whole number in [0, 2^63) (:func:`check_seeds`), or ``(N,)`` of them, of which
                those of masked games are used.
            horizons: ``(N,)`` whole numbers: the step at which this round is cut; None: the scenario's.
            new_match: without ``seeds``: leave the present match and begin the seed's next one.

        Raises:
            UserError: a seed or horizon out of range, a mask of another shape, or a first call that has no
                seeds or leaves games out.
        """
        mask = np.ones(self.count, bool) if mask is None else np.asarray(mask, bool)
        number_rounds(self.games, mask, seeds, horizons, new_match, self.scenario, self._begun)
        self.tallies[mask] = np.zeros((), TALLY)
        self.histograms[mask] = 0
        self._begun = True
        kernel.begin(
            self.games,
            mask,
            self._ally_observations,
            self._opponent_observations,
            self.segments,
            self._channel,
            self._rules,
            self._radio,
        )
        self._record_flown()

    def check_reset(self, mask: np.ndarray, horizons: np.ndarray | None) -> None:
        """Raise UserError for a mask of the wrong shape, or a horizon outside the round."""
        check_reset(self.count, self.scenario, mask, horizons)

    def step(self, ally_actions: np.ndarray, opponent_actions: np.ndarray) -> None:
        """Play one step of every game whose round is not over; other games do not change.

        Args:
            ally_actions, opponent_actions: ``(N, 9)`` floats, clipped to [-1, 1].

        Raises:
            ActionError: a wrong shape or dtype, or NaN or infinity; nothing has been played then.
            UserError: called before the first reset.
        """
        if not self._begun:
            raise UserError("a game batch is reset before its first step")
        load_actions(self._ally_actions, ally_actions, "ally")
        load_actions(self._opponent_actions, opponent_actions, "opponent")
        if self.threads < 2 or self.count < 2 * _GAMES_WORTH_A_THREAD:
            kernel.play(0, self.count, *self._arguments)
        else:
            self._step_in_threads()
        self._record_flown()

    def received(self, side: str) -> np.ndarray:
        """Return a side's actions of the last step, ``(N, 9)`` float32 within [-1, 1]; a read-only buffer."""
        return read_only(self._ally_actions if side == "ally" else self._opponent_actions)

    def keep_flown(self) -> None:
        """Record from now on the ally's position after each second of its round."""
        self.flown_m = np.zeros((self.count, self.scenario.steps_per_round + 1, 3))

    def _record_flown(self) -> None:
        if self.flown_m is not None:
            self.flown_m[np.arange(self.count), self.games["step"]] = self.games["ally_position"]

    def _step_in_threads(self) -> None:
        """Divide the games among threads; the calling thread takes the last part."""
        if self._pool is None:
            kernel.play(0, 0, *self._arguments)  # compile before the threads meet
            self._pool = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="game-batch")
        cuts = [self.count * part // self.threads for part in range(self.threads + 1)]
        parts = [
            self._pool.submit(kernel.play, low, high, *self._arguments) for low, high in pairwise(cuts[:-1])
        ]
        kernel.play(cuts[-2], cuts[-1], *self._arguments)
        for part in parts:
            part.result()

    def set_waypoints(self, game: int, waypoints: np.ndarray) -> None:
        """Set the waypoints of one game, which its opponent flies under the path ``waypoints``.

        Args:
            game: its index.
            waypoints: ``(waypoints, 3)`` in m, point i due at (i + 1) T / n.

        Raises:
            UserError: another shape, not finite, or outside the box.
        """
        waypoints = np.asarray(waypoints, float)
        if waypoints.shape != self.waypoints.shape[1:]:
            raise UserError(
                f"waypoints: expected the shape {self.waypoints.shape[1:]}, got {waypoints.shape}"
            )
        inside = (waypoints >= 0) & (waypoints <= np.asarray(self.scenario.box_m))
        if not inside.all():
            index = int(np.argwhere(~inside)[0, 0])
            raise UserError(
                f"waypoint {index}: {waypoints[index].tolist()} lies outside the box {self.scenario.box_m}"
            )
        self.waypoints[game] = waypoints

    def clean_sum(self, games: Sequence[int] | slice = slice(None)) -> dict[str, float]:
        """Return the sum of some games' rates without jamming in this round, to go beside their tally.

        Returns:
            ``clean_mbit_s`` in the model ``link``; nothing in others, which do not compute such rates.
        """
        return {} if self._radio is None else {CLEAN: float(self.games["clean_mbit"][games].sum())}

    def pursue(self, mask: np.ndarray) -> None:
        """Make opponents pursue the ally in this round instead of flying themselves (path ``learned``).

        Call it before the round's first step; other paths stay as they are.

        Args:
            mask: ``(N,)`` bool, the games.
        """
        self.games["path"][mask & (self.games["path"] == LEARNED)] = PURSUIT

    def ally_path(self, game: int) -> np.ndarray:
        """Return the ally's positions in one game after each second of its round, at full speed.

        Returns:
            ``(steps_per_round + 1, 3)`` in m, its start first.
        """
        path = np.empty((self.scenario.steps_per_round + 1, 3))
        kernel.trace_ally(path, self.games[game : game + 1].copy(), self._rules)
        return path

    def __getstate__(self) -> dict[str, object]:
        views = dict.fromkeys(("_arguments", "ally_observations", "opponent_observations"))
        return {**self.__dict__, "_pool": None, **views}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._bind()


def number_rounds(
    games: np.ndarray,
    mask: np.ndarray,
    seeds: Seeds | None,
    horizons: np.ndarray | None,
    new_match: bool,
    scenario: Scenario,
    begun: bool,
) -> None:
    """Set ``seed``, ``match``, ``round`` and ``horizon`` of the rounds that masked games begin.

    Args:
        games: ``(N,)`` records of dtype ``state.GAME``, changed in place.
        mask, seeds, horizons, new_match: as in :meth:`GameBatch.reset`.
        scenario: what is played.
        begun: whether the games have been reset before.

    Raises:
        UserError: as :func:`check_reset` does, or no seeds for every game at the first reset.
    """
    check_reset(len(games), scenario, mask, horizons)
    if not begun and not (mask.all() and seeds is not None):
        raise UserError("the first reset of a game batch begins every game and needs seeds")
    if seeds is not None:
        games["seed"][mask] = check_seeds(seeds, len(games))[mask]
        games["match"][mask] = 0
        games["round"][mask] = 0
    else:
        games["round"][mask] += 1
        over = mask & (new_match | (games["round"] >= scenario.rounds_per_match))
        games["match"][over] += 1
        games["round"][over] = 0
    games["horizon"][mask] = scenario.steps_per_round if horizons is None else np.asarray(horizons)[mask]


def check_reset(count: int, scenario: Scenario, mask: np.ndarray, horizons: np.ndarray | None) -> None:
    """Raise UserError for a mask of another shape than ``(count,)``, or a horizon outside the round."""
    if mask.shape != (count,):
        hint = "; seeds are named: reset(seeds=0)" if mask.ndim == 0 else ""
        raise UserError(f"reset: expected a mask of shape ({count},), got {mask.shape}{hint}")
    longest = scenario.steps_per_round
    if horizons is not None and not (np.min(horizons) >= 1 and np.max(horizons) <= longest):
        raise UserError(f"reset: expected horizons of 1 to {longest} steps, got {horizons!r}")


def load_actions(target: np.ndarray, actions: np.ndarray, side: str) -> None:
    """Copy actions of ``(games, ..., 9)`` floats, clipped to [-1, 1].

    Raises:
        ActionError: another shape or dtype, or NaN or infinity.
    """
    if not isinstance(actions, np.ndarray) or actions.dtype.kind != "f" or actions.shape != target.shape:
        expected = f"expected a float array of shape {target.shape}"
        raise ActionError(f"{side} actions: {expected}, got {described(actions)}")
    target[...] = actions
    if not kernel.clip_actions(target.ravel()):
        target[...] = actions
        game, *seat, index = np.argwhere(~np.isfinite(target))[0].tolist()
        where = f" {seat[0]}" if seat else ""
        where += f" of game {game}" if len(target) > 1 else ""
        raise ActionError(f"{side} action{where}: index {index} is {target[(game, *seat, index)]}")


def described(actions: object) -> str:
    """Return the dtype and shape of an array, or the type of anything else, for an error message."""
    return f"{actions.dtype} {actions.shape}" if isinstance(actions, np.ndarray) else type(actions).__name__


def check_seeds(seeds: Seeds, count: int) -> np.ndarray:
    """Return ``(count,)`` seeds as uint64: those given one per game, or the streams of one whole number.

    Of one number s, game 0 plays the matches of s, and game i those of a stream that is keyed by (s, i), so
    batches of other seeds share none of their games.

    Raises:
        UserError: a seed that is not a whole number in [0, 2^63), or another number of seeds.
    """
    if isinstance(seeds, np.ndarray) and not seeds.ndim:
        seeds = seeds.item()
    is_one = not isinstance(seeds, Sequence | np.ndarray)
    each: list[Any] = [seeds] if is_one else list(cast(Sequence[int], seeds))
    is_sound = all(is_integer(seed, least=0) and seed <= MAX_SEED for seed in each)
    if not is_sound or len(each) != (1 if is_one else count):
        several = f" or {count} of them" if count > 1 else ""
        raise UserError(f"seed: expected a whole number in [0, 2^63){several}, got {shown(seeds)}")
    if not is_one:
        return np.array(each, np.uint64)
    streams = np.empty(count, np.uint64)
    rng.batch_seeds(streams, np.uint64(each[0]))
    return streams


def read_only(array: np.ndarray) -> np.ndarray:
    """Return a view of an array that cannot be written."""
    view = array.view()
    view.flags.writeable = False
    return view
