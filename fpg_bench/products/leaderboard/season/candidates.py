"""Candidates of a season: training one by its recipe, and playing the entries against it."""

from __future__ import annotations

import shutil
import statistics
import time
from functools import cache, partial
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import other_side, policy_env
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.entry import EvaluatedPlayer
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.store import RECORDS, Pairing
from fpg_bench.evaluation.suite import Rival, Scale, Suite, load_suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.registry import as_player, named_card
from fpg_bench.products.leaderboard.season.recipes import DISCRETE, SEARCHED, Recipe, hyperparameters
from fpg_bench.products.leaderboard.tracks import track_of
from fpg_bench.products.league.best_responses import draw_features
from fpg_bench.products.league.categorical import CategoricalSearch
from fpg_bench.products.league.folder import write_found
from fpg_bench.products.league.rule_search import RuleSearch, rule_of
from fpg_bench.products.league.rules import rule_graph, rule_values
from fpg_bench.products.league.tabular import TableSearch, table_onnx
from fpg_bench.training.config import RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

ROUNDS = 60  # of each entry against each candidate
PROFILE = RECORDS


def make_candidate(recipe: Recipe, folder: Path, scenario: str = "standard") -> None:
    """Train or search a candidate and keep only its agent, the rows of its run, and who has met it.

    A finished one is not made again; an unfinished one starts anew, so the result is always the same.

    Args:
        recipe: the recipe.
        folder: its folder.
        scenario: the preset.

    Raises:
        UserError: the folder holds an unfinished run of another kind, or training diverged.
    """
    algorithm = recipe.algorithm.removesuffix(DISCRETE)
    game = GameSpec.of(
        policy_env(recipe.side).id,
        against=recipe.targets,
        reward=recipe.reward,
        path=recipe.path,
        actions=None if algorithm == recipe.algorithm else "discrete",
        scenario=None if scenario == "standard" else scenario,
    )
    if not is_made(recipe, folder):
        (folder / PROFILE).unlink(missing_ok=True)
        if recipe.algorithm in SEARCHED:
            _search(recipe, game, folder / "agent")
        else:
            run = RunConfig(algorithm, game, recipe.training_seed, recipe.steps, hyperparameters(recipe))
            train(run, folder, evaluations=0, progress=False, restart=True)
    for path in folder.iterdir():
        if path.name not in ("agent", "run.json", "evaluations.jsonl", PROFILE):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def is_made(recipe: Recipe, folder: Path) -> bool:
    """Return True if a candidate is trained or found."""
    if recipe.algorithm in SEARCHED:
        return (folder / "agent" / "agent.json").exists()
    return RunFolder(folder).is_finished()


def _search(recipe: Recipe, game: GameSpec, agent: Path) -> None:
    """Search a rule or a table that earns most from a candidate's targets, and write it as an agent."""
    scenario, other = game.resolve(), other_side(recipe.side)
    rivals = [as_player(name, other, scenario) for name in recipe.targets]
    if recipe.algorithm == "rule":
        search: CategoricalSearch = RuleSearch(recipe.side, rivals, scenario, seed=recipe.training_seed)
    else:
        features = draw_features(recipe.side, recipe.training_seed)
        search = TableSearch(recipe.side, rivals, scenario, features, seed=recipe.training_seed)
    began = time.process_time()
    while search.generation < recipe.steps:
        search.run()
    if recipe.algorithm == "rule":
        best = search.simplify()
        model = rule_graph(recipe.side, scenario, rule_values(recipe.side, best[None], scenario)[0])
        found: JsonObject = {"rule": rule_of(recipe.side, best)}
    else:
        best = search.best
        model = table_onnx(recipe.side, features, scenario, best.tolist())
        found = {"features": features, "cells": best.tolist()}
    write_found(agent, model, search, game, recipe.algorithm, round(time.process_time() - began, 1), found)


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
