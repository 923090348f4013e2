"""Evaluation of a policy during training and tuning: a suite on tuning seeds, as one batch."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypedDict

import numpy as np

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import RoundSums, match_of
from fpg_bench.evaluation.record import Record, pool
from fpg_bench.evaluation.rounds import MatchBatch, play_round
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.suite import PLANNER, Scale, Suite, load_suite
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.player import Abilities, Memory, Player, PlayerSpec
from fpg_bench.players.scripted import player_seeds

MATCHES = 10


Scored = TypedDict(
    "Scored",
    {"score": float, "return": float, "rivals": dict[str, float], "measures": dict[str, float | None]},
)


class PolicyEvaluator:
    """Evaluator of players of one side on a suite's rivals, over the same matches for all players.

    The matches are of tuning seeds, which no result is reported on, so a training loop may choose by its
    scores; :func:`fpg_bench.log_evaluation` also writes them down.

    >>> evaluator = PolicyEvaluator("ally-v2", rounds=1)
    >>> evaluator.score("expert")["score"] > evaluator.score("idle")["score"]
    True

    Args:
        suite: a suite's name, file, or the suite itself.
        rounds: per rival, rounded up to whole matches.
        scenario: if it is not the suite's, see :meth:`fpg_bench.evaluation.suite.Suite.is_of`, it replaces
            that of all rivals, but for their paths, and scores are returns per step. None: the suite's.
        side: the side that must be measured; None: the suite's.
        allow: the code and agents of the Hub that the suite's file may name; see
            :func:`fpg_bench.evaluation.suite.load_suite`.
        game: of a suite of teams, a game whose sizes and rules of teams replace the suite's; where they
            differ, scores are returns per step.

    Raises:
        UserError: no such suite, or one of the other side or of planners.
    """

    def __init__(
        self,
        suite: str | Suite,
        rounds: int = MATCHES,
        scenario: Scenario | None = None,
        side: str | None = None,
        allow: Collection[str] = (),
        game: GameSpec | None = None,
    ) -> None:
        loaded = suite if isinstance(suite, Suite) else load_suite(suite, allow=allow)
        if side not in (None, loaded.side) or loaded.side == PLANNER:
            raise UserError(
                f"suite {loaded.name}: measures the {loaded.side}, not the {side or 'ally or opponent'}"
            )
        played = loaded if scenario is None else in_scenario(loaded, scenario)
        if loaded.game is not None and game is not None and (own := loaded.game.like(game)) != loaded.game:
            played = replace(played, game=own, scale=Scale())
        self.suite = replace(played, matches=-(-integer(rounds, "rounds") // played.rounds_per_match))

    def score(self, player: PlayerSpec) -> Scored:
        """Evaluate a player: anything with ``predict``, or a name.

        Returns:
            ``score``, on the suite's scale; ``return``, per step; ``rivals``, the return per step against
            each; ``measures``, pooled over all rounds.
        """
        rewards, records = self._play(player)
        each, measures = rewards.mean(axis=1), pool(records).measures
        names = [rival.name for rival in self.suite.rivals]
        return {
            "score": round(float(self.suite.scale.score(each.mean())), 3),
            "return": round(float(each.mean()), 4),
            "rivals": {name: round(x, 4) for name, x in zip(names, each.tolist(), strict=True)},
            "measures": {name: None if x is None else round(x, 5) for name, x in measures.items()},
        }

    def scores(self, player: PlayerSpec) -> np.ndarray:
        """Return the scores ``(rivals, matches)`` of a player."""
        return self.suite.scale.score(self._play(player)[0])

    def _play(self, spec: PlayerSpec) -> tuple[np.ndarray, list[Record]]:
        """Play new matches; return the rewards per step ``(rivals, matches)`` and the records."""
        suite, side = self.suite, self.suite.side
        player = suite.as_player(spec, side, suite.scenario)
        batches = [match_of(player, suite, rival) for rival in suite.rivals]
        sums = [RoundSums(suite, batch) for batch in batches]
        groups = [[batch] for batch in batches]
        if suite.game is None:  # else the player has seats, and meets one rival after the other
            shared = _SharedPlayer(player, side, batches)
            groups = [[replace(of, **{side: _Part(shared, k)}) for k, of in enumerate(batches)]]  # type: ignore[arg-type]
        for number in range(suite.rounds_per_match):
            seeds = None if number else np.array(tuning_seeds(suite.matches))
            for k, group in enumerate(groups):
                counted = sums[k : k + 1] if suite.game is not None else sums
                play_round(*group, seeds=seeds, on_step=partial(_count, counted))
            for each in sums:
                each.add(np.zeros(suite.matches, bool))
        rewards = [suite.rewards(np.array(each.returns).T.ravel()) for each in sums]
        entry = player_entry(player, "tuned")
        records = [each.record(entry, rival) for each, rival in zip(sums, suite.rivals, strict=True)]
        return np.array(rewards), records


def _count(sums: Sequence[RoundSums]) -> None:
    for each in sums:
        each.hops.count()


def in_scenario(suite: Suite, scenario: Scenario) -> Suite:
    """Return the suite in a scenario; in one that is not its own, each rival keeps its path alone."""
    if suite.is_of(scenario):
        return suite
    rivals = tuple(
        replace(rival, scenario=as_scenario(scenario, opponent_path=rival.scenario.opponent_path))
        for rival in suite.rivals
    )
    return replace(suite, scenario=scenario, rivals=rivals, scale=Scale())


class _SharedPlayer:
    """A player that predicts for the games of several match batches at once."""

    def __init__(self, player: Player, side: str, batches: Sequence[MatchBatch]) -> None:
        self._player, self._side, self._reset = player, side, Abilities.of(player).reset
        self._games = [batch.duel.batch.games for batch in batches]
        self._observations = [getattr(batch.duel.batch, f"{side}_observations") for batch in batches]
        self._cuts = np.cumsum([batch.duel.count for batch in batches])[:-1]
        self._memory: Memory = None
        self._starts = np.zeros(sum(batch.duel.count for batch in batches), bool)
        self._actions: list[np.ndarray] = []

    def begin(self, index: int, mask: np.ndarray) -> None:
        np.split(self._starts, self._cuts)[index][mask] = True

    def actions(self, index: int) -> np.ndarray:
        """Return the actions of one match batch; the first call predicts for all of them."""
        if index == 0:
            if self._starts.any() and self._reset is not None:
                keys = np.concatenate([games["round_key"] for games in self._games])
                self._reset(self._starts.copy(), player_seeds(keys, self._side))
            observations = np.concatenate(self._observations)
            actions, self._memory = self._player.predict(
                observations, self._memory, self._starts.copy(), True
            )
            self._starts[:] = False
            self._actions = np.split(actions, self._cuts)
        return self._actions[index]


@dataclass(frozen=True)
class _Part:
    """Part of a shared player in one match batch."""

    player: _SharedPlayer
    index: int

    def begin(self, mask: np.ndarray) -> None:
        self.player.begin(self.index, mask)

    def act(self) -> np.ndarray:
        return self.player.actions(self.index)
