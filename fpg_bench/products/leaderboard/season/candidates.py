"""Candidates of a season: training one by its recipe, and playing the entries against it."""

from __future__ import annotations

import shutil
import statistics
from functools import cache, partial
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import policy_env
from fpg_bench.evaluation.entry import EvaluatedPlayer
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.store import RECORDS, Pairing
from fpg_bench.evaluation.suite import Rival, Scale, Suite, load_suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.registry import as_player, named_card
from fpg_bench.products.leaderboard.season.recipes import DISCRETE, Recipe, hyperparameters
from fpg_bench.products.leaderboard.tracks import track_of
from fpg_bench.training.config import RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

ROUNDS = 60  # of each entry against each candidate
PROFILE = RECORDS


def train_candidate(recipe: Recipe, folder: Path, scenario: str = "standard") -> None:
    """Train a candidate and keep only its agent, its run's rows, and who has met it.

    A finished run is not trained again; an unfinished one starts anew, so the result is always the same.

    Args:
        recipe: the recipe.
        folder: the run's folder.
        scenario: the preset.

    Raises:
        UserError: the folder holds an unfinished run of another kind, or training diverged.
    """
    algorithm = recipe.algorithm.removesuffix(DISCRETE)
    run = RunConfig(
        algorithm,
        GameSpec.of(
            policy_env(recipe.side).id,
            against=recipe.targets,
            reward=recipe.reward,
            path=recipe.path,
            actions=None if algorithm == recipe.algorithm else "discrete",
            scenario=None if scenario == "standard" else scenario,
        ),
        recipe.training_seed,
        recipe.steps,
        hyperparameters(recipe),
    )
    if not RunFolder(folder).is_finished():
        (folder / PROFILE).unlink(missing_ok=True)
        train(run, folder, evaluations=0, progress=False, restart=True)
    for path in folder.iterdir():
        if path.name not in ("agent", "run.json", "evaluations.jsonl", PROFILE):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def against_candidate(
    player: str,
    side: str,
    candidate: str,
    path: str,
    seed: str,
    scenario: str = "standard",
    *,
    name: str | None = None,
    number: int | None = None,
) -> Pairing:
    """Return the pairing of a player of an entry with a candidate.

    Args:
        player: its name.
        side: the player's side.
        candidate: the candidate's name, or the folder of its agent.
        path: the opponent's path.
        seed: the season's seed, from which the evaluation seeds follow.
        scenario: the preset.
        name: the entry's name; None: the player's.
        number: of the entry's players; None: it has a single one.

    Raises:
        UserError: an unknown player, or one of the wrong side.
    """
    preset = as_scenario(scenario)
    rival = Rival("season", (candidate,), as_scenario(preset, opponent_path=path))
    suite = Suite("season", side, preset, ROUNDS, (rival,), season=seed, scale=scale_of(side, scenario))
    card = named_card(player, side)
    fingerprint = player if card is None else card.policy_sha256
    entry = EvaluatedPlayer(name or player, number, fingerprint, partial(_load, player, side))
    return Pairing(entry, suite, rival)


def _load(player: str, side: str, rival: Rival) -> Player:
    """Return a player when its turn has come: all of a board's policies at once would fill the memory."""
    return as_player(player, side, rival.scenario)


def play_candidate(entry: EvaluatedPlayer, suite: Suite, rival: Rival, **more: Any) -> Record:
    """Play a pairing of :func:`against_candidate`; the error of one that cannot be played names both."""
    try:
        return play(entry, suite, rival, **more)
    except UserError as error:
        raise UserError(f"{entry.name} against {rival.players[0]}: {error}") from error


def earned(record: Record, side: str, scenario: str = "standard") -> dict[str, float]:
    """Return the mean return per step of both sides, by side, where a player of a side met a candidate.

    In the player's own mean, rounds that it lost by an invalid answer count as in
    :func:`fpg_bench.evaluation.play.play`.
    """
    means = {name: record.tally[f"{name}_return"] / record.tally["steps"] for name in SIDES}
    if record.lost:
        means[side] = statistics.fmean(record.returns) / as_scenario(scenario).steps_per_round
    return {name: round(value, 6) for name, value in means.items()}


@cache
def scale_of(side: str, scenario: str) -> Scale:
    """Return the scale of a side's public suite, which gives a lost round its return."""
    path = "pursuit" if side == "opponent" else None
    return load_suite(track_of(side, path, scenario).public).scale
