"""A batch of G games of two teams, stepped together."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.common.checks import check_keys, integer, one_of
from fpg_bench.common.errors import UserError
from fpg_bench.game.batch import Seeds, load_actions, number_rounds, read_only
from fpg_bench.game.flight import LEARNED, PURSUIT
from fpg_bench.game.metrics import CLEAN, measures, pool
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import ACTION_SIZE, GAME, TALLY
from fpg_bench.products.teams import step as kernel
from fpg_bench.products.teams.link import WORK, Seats
from fpg_bench.products.teams.rules import (
    FOUND,
    MATES,
    MOST_ALLIES,
    MOST_JAMMERS,
    SENSED,
    SIDES,
    TEAM_OBSERVATION_SIZE,
    TeamRules,
    check_playable,
)

_CURVE = 14  # numbers that the state has of each ally's flight
TEAM_STATE_SIZE = (MOST_ALLIES + MOST_JAMMERS) * TEAM_OBSERVATION_SIZE + MOST_ALLIES * _CURVE + 1


class TeamBatch:
    """G games of N allies and M jammers in one scenario; in each round a part of the seats may be absent.

    The attributes are buffers that every call reuses; copy what you keep. Observations are read-only. What
    belongs to absent seats is 0.

    >>> from fpg_bench.game.scenario import preset
    >>> batch = TeamBatch(preset("link"), TeamRules(allies=3, jammers=2), games=64)
    >>> batch.reset(seeds=0)
    >>> batch.step(np.zeros((64, 3, 9)), np.zeros((64, 2, 9)))
    >>> batch.ally_observations.shape, batch.rewards("ally").shape
    ((64, 3, 67), (64, 3))

    Args:
        scenario: the rules of the game, of the radio model ``link``.
        team: the rules of teams.
        games: number of games, G.
        mates: what seats observe of their mates: ``none``, ``place`` (where they are) or ``full`` (also what
            they do and know), or a mapping from ``ally`` and ``opponent`` to one each.

    Attributes:
        games: ``(G,)`` records of dtype ``state.GAME``, those of the first allies: seeds, rounds and steps.
        allies: ``(G, N)`` records of dtype ``state.GAME``: each ally's duel with its nearest jammer.
        opponents: ``(G, M)`` of them: each jammer's duel with the ally of its strongest find.
        sensed, found: ``(G, N, M)`` and ``(G, M, N)`` records of ``team_rules``: of each pair.
        rivals: ``(G, M)`` int64, the ally of each jammer's strongest find; at first ally j mod N, at which
            pursuit aims all the time.
        counts: ``(G, 2)`` int64, the allies and jammers that are present.
        tallies, histograms: ``(G, N)`` and ``(G, N, 2, points)``, each ally's; see
            :class:`fpg_bench.game.batch.GameBatch`. Checks count as heard where any jammer found the ally.
        ally_observations, opponent_observations: ``(G, N, 67)`` and ``(G, M, 67)`` float32 in [-1, 1].

    Raises:
        UserError: a scenario that teams cannot play, or an option out of range.
    """

    def __init__(
        self,
        scenario: Scenario,
        team: TeamRules | None = None,
        games: int = 1,
        mates: str | dict[str, str] = "full",
    ) -> None:
        check_playable(scenario)
        self.scenario, self.team = scenario, TeamRules() if team is None else team
        self.count = integer(games, "games")
        self.mates = mates if isinstance(mates, dict) else dict.fromkeys(SIDES, mates)
        check_keys(self.mates, SIDES, "mates", SIDES)
        self._mates = np.array([MATES.index(one_of(self.mates[side], "mates", MATES)) for side in SIDES])
        n, m = self.team.most
        shape = (self.count, n, m)
        self.counts = np.zeros((self.count, 2), np.int64)
        self.allies, self.opponents = np.zeros(shape[:2], GAME), np.zeros((self.count, m), GAME)
        self.games = self.allies[:, 0]
        self.sensed, self.found = np.zeros(shape, SENSED), np.zeros((self.count, m, n), FOUND)
        self.rivals = np.zeros((self.count, m), np.int64)
        self.tallies = np.zeros((self.count, n), TALLY)
        self.histograms = np.zeros((self.count, n, 2, scenario.frequency_points), np.int32)
        shapes = ((self.count, seats, TEAM_OBSERVATION_SIZE) for seats in (n, m))
        self._observations = tuple(np.zeros(each, np.float32) for each in shapes)
        self._ally_actions = np.zeros((self.count, n, ACTION_SIZE), np.float32)
        self._opponent_actions = np.zeros((self.count, m, ACTION_SIZE), np.float32)
        self._records = (
            rules_record(scenario),
            radio_record(scenario),
            self.team.record(),
            np.zeros(1, WORK),
        )
        self._begun = False
        self._bind()

    def _bind(self) -> None:
        """Collect what the kernel takes."""
        self._seats = Seats(self.allies, self.opponents, self.sensed, self.found, self.rivals)
        self.ally_observations, self.opponent_observations = map(read_only, self._observations)
        self._no_waypoints = np.zeros((1, 3))

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Seeds | None = None,
        horizons: np.ndarray | None = None,
        new_match: bool = False,
    ) -> None:
        """Begin rounds in the masked games; see :meth:`fpg_bench.game.batch.GameBatch.reset`."""
        mask = np.ones(self.count, bool) if mask is None else np.asarray(mask, bool)
        number_rounds(self.games, mask, seeds, horizons, new_match, self.scenario, self._begun)
        self.allies[mask, 1:] = np.zeros((), GAME)
        for records in (self.opponents, self.sensed, self.found):
            records[mask] = np.zeros((), records.dtype)
        self.tallies[mask] = np.zeros((), TALLY)
        self.histograms[mask] = 0
        self._begun = True
        kernel.begin(mask, self.counts, self._seats, self._observations, self._mates, self._records)

    def step(self, ally_actions: np.ndarray, opponent_actions: np.ndarray) -> None:
        """Play one step of every game whose round is not over; other games do not change.

        Args:
            ally_actions, opponent_actions: ``(G, N, 9)`` and ``(G, M, 9)`` floats, clipped to [-1, 1]; those
                of absent seats are not read.

        Raises:
            ActionError: a wrong shape or dtype, or NaN or infinity; nothing has been played then.
            UserError: called before the first reset.
        """
        if not self._begun:
            raise UserError("a game batch is reset before its first step")
        load_actions(self._ally_actions, ally_actions, "ally")
        load_actions(self._opponent_actions, opponent_actions, "opponent")
        kernel.play(
            self.counts,
            self._seats,
            self.tallies,
            self.histograms,
            (self._ally_actions, self._opponent_actions),
            self._observations,
            self._mates,
            self._no_waypoints,
            self._records,
        )

    def received(self, side: str) -> np.ndarray:
        """Return a side's actions of the last step, ``(G, K, 9)`` float32 in [-1, 1]; a read-only buffer."""
        return read_only(self._ally_actions if side == "ally" else self._opponent_actions)

    def playing(self, side: str) -> np.ndarray:
        """Return ``(G, N)`` or ``(G, M)`` bool: the seats that play in these rounds."""
        seats = np.arange(self.team.most[SIDES.index(side)])
        return np.asarray(seats < self.counts[:, SIDES.index(side), None])

    def rewards(self, side: str, reward: str = "own") -> np.ndarray:
        """Return the rewards of the last step, ``(G, N)`` or ``(G, M)`` float64, 0 of absent seats.

        Args:
            side: ``ally`` or ``opponent``.
            reward: ``own``: an ally's, or that of a jammer's duel with its rival. ``team``: the mean of the
                allies', or of what jammers took of each of them.
        """
        own = self.allies["ally_reward"] if side == "ally" else self.opponents["opponent_reward"]
        if reward == "own":
            return own.copy()
        mean = self.allies[f"{side}_reward"].sum(axis=1) / self.counts[:, 0]
        return np.where(self.playing(side), mean[:, None], 0.0)

    def state(self) -> np.ndarray:
        """Return the full state, ``(G, 607)`` float32 in [-1, 1].

        The observations of all seats, 5 allies and then 3 jammers; each ally's control points, direction and
        place on its curve; the share of the round played.
        """
        state = np.zeros((self.count, TEAM_STATE_SIZE), np.float32)
        first = 0
        for seen, most in zip(self._observations, (MOST_ALLIES, MOST_JAMMERS), strict=True):
            state[:, first : first + seen[0].size] = seen.reshape(self.count, -1)
            first += most * TEAM_OBSERVATION_SIZE
        allies, is_there = self.allies, self.playing("ally")[..., None]
        points = 2 * allies["control_points"] / np.asarray(self.scenario.box_m) - 1
        along = allies["chord_offset_m"] / np.maximum(allies["chord_length_m"], 1e-9)
        flight = (
            points.reshape(*allies.shape, 12),
            np.where(allies["outbound"], 1, -1)[..., None],
            ((allies["chord"] + along) / self.scenario.ally_path_chords)[..., None],
        )
        curves = np.where(is_there, np.concatenate(flight, axis=2), 0).reshape(self.count, -1)
        state[:, first : first + curves.shape[1]] = curves
        state[:, -1] = self.games["step"] / self.scenario.steps_per_round
        return state

    def clean_sum(self, seats: Any = slice(None)) -> dict[str, float]:
        """Return the sum of some allies' rates without jamming in this round, to go beside their tally.

        Args:
            seats: an index into ``(G, N)``.
        """
        return {CLEAN: float(self.allies["clean_mbit"][seats].sum())}

    def measures(self, game: int, seat: int | None = None) -> dict[str, float | None]:
        """Return the measures of one game's present round; see ``TeamGame.measures``."""
        of = slice(None) if seat is None else slice(seat, seat + 1)
        tally = pool(self.tallies[game, of]) | self.clean_sum((game, of))
        allies = 1 if seat is not None else self.counts[game, 0]
        tally |= {f"{side}_return": tally[f"{side}_return"] / allies for side in SIDES}
        return measures(tally, self.histograms[game, of].sum(axis=0))

    def pursue(self, mask: np.ndarray) -> None:
        """Make jammers pursue their allies in this round instead of flying themselves (path ``learned``).

        Args:
            mask: ``(G, M)`` bool, the seats.
        """
        self.opponents["path"][mask & (self.opponents["path"] == LEARNED)] = PURSUIT

    def __getstate__(self) -> dict[str, Any]:
        views = ("_seats", "ally_observations", "opponent_observations", "games")
        return {k: v for k, v in self.__dict__.items() if k not in views}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.games = self.allies[:, 0]
        self._bind()
