"""How good a policy is while it is trained or tuned: a suite on tuning seeds, as one batch."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.play import match_of
from fpg_bench.evaluation.record import Pooled
from fpg_bench.evaluation.rounds import MatchBatch, play_round
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.suite import PLANNER, Scale, Suite, load_suite
from fpg_bench.game.metrics import pool
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.players.player import Player
from fpg_bench.players.scripted import player_seeds

MATCHES = 10


class PolicyEvaluator:
    """Scores a player of one side against a suite's rivals; the same matches for everybody.

    Args:
        suite: a suite's name, file, or the suite itself.
        rounds: per rival, rounded up to whole matches.
        scenario: what is played instead of the suite's own, paths and changes aside; scores are then returns
            a step, as the suite's scale speaks of its own game. None: the suite's.
        side: the side that must be measured; None: the suite's.

    Raises:
        UserError: no such suite, or one of the other side or of planners.
    """

    def __init__(
        self,
        suite: str | Suite,
        rounds: int = MATCHES,
        scenario: Scenario | None = None,
        side: str | None = None,
    ) -> None:
        found = load_suite(suite) if isinstance(suite, str) else suite
        if side not in (None, found.side) or found.side == PLANNER:
            raise UserError(
                f"suite {found.name}: measures the {found.side}, not the {side or 'ally or opponent'}"
            )
        found = found if scenario is None else _played_in(found, scenario)
        self.suite = dataclasses.replace(found, matches=-(-rounds // found.rounds_per_match))

    def score(self, player: Player) -> dict[str, Any]:
        """What a player is worth.

        Returns:
            ``score``, on the suite's scale; ``return``, a step; ``rivals``, the return a step against
            each; ``measures``, pooled over all rounds.
        """
        rewards, found = self._play(player)
        each = rewards.mean(axis=1)
        names = [rival.name for rival in self.suite.rivals]
        return {
            "score": round(float(self.suite.scale.score(each.mean())), 3),
            "return": round(float(each.mean()), 4),
            "rivals": {name: round(x, 4) for name, x in zip(names, each.tolist(), strict=True)},
            "measures": {name: None if x is None else round(x, 5) for name, x in found.items()},
        }

    def scores(self, player: Player) -> np.ndarray:
        """``(rivals, matches)`` scores of a player."""
        found: np.ndarray = self.suite.scale.score(self._play(player)[0])
        return found

    def _play(self, player: Player) -> tuple[np.ndarray, dict[str, float | None]]:
        """All rounds of new matches: returns a step ``(rivals, matches)``, and the pooled measures."""
        tables = self._tables(player)
        returns, tallies = [], []
        points: Any = 0
        for number in range(self.suite.rounds_per_match):
            play_round(*tables, seeds=None if number else np.array(tuning_seeds(self.suite.matches)))
            batches = [table.duel.batch for table in tables]
            returns.append([batch.tallies[self.suite.return_name].copy() for batch in batches])
            tallies += [batch.tallies.copy() for batch in batches]
            points = points + sum(batch.histograms.sum(axis=0) for batch in batches)
        by_round = np.array(returns).transpose(1, 2, 0)  # (rivals, matches, rounds)
        rewards = np.array([self.suite.rewards(of.ravel()) for of in by_round])
        played = np.concatenate(tallies)
        return rewards, Pooled(pool(played), points, len(played), 0, None).measures

    def _tables(self, player: Player) -> list[MatchBatch]:
        tables = [match_of(player, self.suite, rival) for rival in self.suite.rivals]
        together = _Together(player, self.suite.side, tables)
        runners: list[dict[str, Any]] = [{self.suite.side: runner} for runner in together.runners]
        return [dataclasses.replace(table, **runner) for table, runner in zip(tables, runners, strict=True)]


def _played_in(suite: Suite, scenario: Scenario) -> Suite:
    """The suite's rivals in another scenario, each with its own path."""
    if scenario.hash == suite.scenario.hash:
        return suite
    rivals = tuple(
        dataclasses.replace(c, scenario=as_scenario(scenario, opponent_path=c.scenario.opponent_path))
        for c in suite.rivals
    )
    pairs = zip(rivals, suite.rivals, strict=True)
    alike = all(mine.scenario.hash == own.scenario.hash for mine, own in pairs)
    scale = suite.scale if alike else Scale()
    return dataclasses.replace(suite, scenario=scenario, rivals=rivals, scale=scale)


class _Together:
    """A player that is asked about the games of several tables at once."""

    def __init__(self, player: Player, side: str, tables: Sequence[MatchBatch]) -> None:
        self._player, self._side = player, side
        self._games = [table.duel.batch.games for table in tables]
        self._views = [getattr(table.duel.batch, f"{side}_observations") for table in tables]
        self._cuts = np.cumsum([table.duel.count for table in tables])[:-1]
        self._memory: Any = None
        self._starts = np.zeros(sum(table.duel.count for table in tables), bool)
        self._answers: list[np.ndarray] = []
        self.runners = [_Part(self, k) for k in range(len(tables))]

    def begin(self, index: int, mask: np.ndarray) -> None:
        np.split(self._starts, self._cuts)[index][mask] = True

    def actions(self, index: int) -> np.ndarray:
        """The actions at one table; the first asks for all."""
        if index == 0:
            if self._starts.any() and hasattr(self._player, "reset"):
                keys = np.concatenate([games["round_key"] for games in self._games])
                self._player.reset(self._starts.copy(), player_seeds(keys, self._side))
            seen = np.concatenate(self._views)
            actions, self._memory = self._player.predict(seen, self._memory, self._starts.copy(), True)
            self._starts[:] = False
            self._answers = np.split(actions, self._cuts)
        return self._answers[index]


@dataclasses.dataclass(frozen=True)
class _Part:
    """The seat of such a player at one table."""

    whole: _Together
    index: int

    def begin(self, mask: np.ndarray) -> None:
        self.whole.begin(self.index, mask)

    def act(self) -> np.ndarray:
        return self.whole.actions(self.index)
