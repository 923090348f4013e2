"""Self-play of two learners, each against the other's present policy."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from fpg_bench.products.league.config import SelfPlayConfig
from fpg_bench.products.league.search import SEED_STRIDE, Search, SearchResult
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import RIVAL, train, train_together


def self_play(config: SelfPlayConfig, out: str | Path, *, progress: bool = True) -> SearchResult:
    """Train a side and a rival at the same time (:func:`fpg_bench.training.train.train_together`).

    After each iteration a fresh response to each learner measures it; the learners never meet these.

    Args:
        config: the self-play.
        out: its folder; see :class:`fpg_bench.products.league.search.Search` for the files. ``rival`` is the
            policy that learned beside the exported one.
        progress: show the progress of each training.

    Returns:
        The result. ``high`` is what the policy or a fresh response earns from the rival, whichever is more.

    Raises:
        UserError: something unknown or out of range, or a folder with another search or other files.
        KeyboardInterrupt: stopped by the user.
    """
    return _SelfPlay(config, out, progress).run()


class _SelfPlay(Search):
    """Self-play, whose learners fresh responses measure."""

    def rival(self, iteration: int) -> RunFolder:
        """Return the folder of the rival's run in an iteration."""
        return RunFolder(self.policy(iteration).path / RIVAL)

    @property
    def exported(self) -> dict[str, Search.Runs]:
        """The agents that are exported, by folder: the runs of their iterations."""
        return super().exported | {RIVAL: self.rival}

    def learn(self, iteration: int) -> int:
        """Train both learners by the same algorithm; return the number of rivals, by their weights."""
        rivals, weight = self.game.others, self.config.weight
        learner = self.side_config(iteration, rivals)
        rival = dataclasses.replace(
            learner,
            game=self.response_game,
            seed=learner.seed + SEED_STRIDE // 4,
            start=self.rival(iteration - 1).path if iteration else None,
        )
        train_together(learner, rival, self.policy(iteration).path, weight=weight, progress=self.progress)
        return len(rivals) + weight

    def high(self, iteration: int) -> float:
        """Train a response of the side to the rival; return what it or the policy earns, if more."""
        answer, rival = RunFolder(self.runs / f"answer_{iteration}"), str(self.rival(iteration).agent)
        seed = SEED_STRIDE * self.config.seed + 3 * SEED_STRIDE // 4 + iteration
        run = dataclasses.replace(self.side_config(0, [rival]), seed=seed, steps=self.response_steps)
        train(run, answer.path, evaluations=0, progress=self.progress, resume=True)
        known = [str(answer.agent), str(self.policy(iteration).agent)]
        payoffs = self.payoffs(known, [rival])
        return max(payoffs.interval(name, rival).value for name in known)
