"""Whether a scenario can be played."""

from __future__ import annotations

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.matches.rounds import play_round, seated
from fpg_bench.planning import as_planner
from fpg_bench.testing.requiring import require


def check_scenario(scenario: Scenario | str | None) -> None:
    """Check that a scenario can be played: whole rounds, sound numbers, the same game for the same seed.

    Says so in a line where it can.

    Args:
        scenario: a scenario, a preset's name or a YAML file.

    Raises:
        AssertionError: the first thing that is wrong, with the step.
        UserError: no such scenario.
    """
    played = as_scenario(scenario)
    for allies, opponents in (("random", "random"), ("expert-spread", "adaptive")):
        together = _played_round(played, allies, opponents, games=3, seed=11)
        again = _played_round(played, allies, opponents, games=3, seed=11)
        alone = _played_round(played, allies, opponents, games=1, seed=13)
        for k, (x, y, z) in enumerate(zip(together, again, alone, strict=True)):
            require((x == y).all(), f"scenario: the same seed gave another game at step {k}")
            require(
                (x[2] == z[0]).all(), f"scenario: game 2 of a batch of seed s is not seed s + 2 at step {k}"
            )
    print(f"scenario {played.hash[:12]}: can be played")


def duel_of(scenario: Scenario, games: int) -> Duel:
    """A duel of a scenario; one whose path is planned flies random plans."""
    planner = as_planner("random", scenario) if "waypoints" in scenario.paths else None
    return Duel(scenario, games, planner)


def _played_round(scenario: Scenario, ally: str, opponent: str, games: int, seed: int) -> list[np.ndarray]:
    """Everything that a whole round shows, ``(games, ...)`` per step, checked to be sound."""
    table = seated(duel_of(scenario, games), ally, opponent)
    shown: list[np.ndarray] = []

    def look() -> None:
        duel, k = table.duel, len(shown)
        step = duel.present()
        _check_shown(step.ally_observations, step.opponent_observations, duel.state(), k)
        rewards = np.column_stack([step.ally_rewards, step.opponent_rewards])
        require(
            np.isfinite(rewards).all(),
            f"scenario: a reward at step {k} is NaN or infinite: {rewards.tolist()}",
        )
        over = step.truncated.all() if k + 1 == scenario.steps_per_round else not step.truncated.any()
        require(
            over, f"scenario: a round of {scenario.steps_per_round} steps did not end with its last one ({k})"
        )
        shown.append(np.column_stack([step.ally_observations, step.opponent_observations, rewards]))

    play_round(table, seeds=seed, on_step=look)
    return shown


def _check_shown(ally: np.ndarray, opponent: np.ndarray, state: np.ndarray, k: int) -> None:
    for name, shown in (
        ("ally's observation", ally),
        ("opponent's observation", opponent),
        ("full state", state),
    ):
        bad = ~(np.abs(shown) <= 1).all(axis=0)
        require(
            not bad.any(),
            f"scenario: index {bad.argmax()} of the {name} at step {k} lies outside [-1, 1] or is NaN",
        )
