"""Trace figures back to rounds: how a rival was trained, and the command that plays a round again."""

from __future__ import annotations

from collections.abc import Iterable

from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.agent import suites_folder
from fpg_bench.players.card import FILE, AgentCard
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.submission import Submission
from fpg_bench.products.leaderboard.tracks import SCENARIOS


def training_of(rival: Rival) -> str:
    """Describe how a rival that is part of a suite was trained; empty for others.

    Returns:
        Such as ``PPO-stack8, trained against expert, ally-population/td3``.
    """
    path = suites_folder() / rival.players[0] / FILE
    if len(rival.players) > 1 or not path.is_file():
        return ""
    card = AgentCard.read(path)
    names = [
        name.removeprefix("leaderboard/submissions/").partition("/seed_")[0] for name in card.game.others
    ]
    base, dash, variant = card.algorithm.partition("-")
    return f"{base.upper()}{dash}{variant}, trained against {', '.join(dict.fromkeys(names))}"


def play_options(suite: Suite, rival: Rival) -> str:
    """Return the options of ``fpg-bench play`` for the first round against a rival.

    Empty if that command does not offer the game: with planners, several players or changed rules.
    """
    path = rival.scenario.opponent_path
    presets = [
        preset for preset in SCENARIOS if rival.scenario == as_scenario(preset, opponent_path=path)
    ]  # none where rules were changed
    is_planned = suite.side == PLANNER or rival.planner is not None
    if is_planned or len(rival.players) > 1 or not isinstance(path, str) or not presets:
        return ""
    scenario = "" if presets[0] == "standard" else f" --scenario {presets[0]}"
    seed = evaluation_seeds(1, suite.season)[0]
    return f"--{suite.other_side} {rival.players[0]}{scenario} --path {path} --seed {seed}"


def player_of(submission: Submission) -> str | None:
    """Return what ``fpg-bench play`` calls a submission's script or first policy; None for planners."""
    return submission.players[0] if submission.track in SIDES else None


def first_returns(records: Iterable[Record]) -> dict[str, float]:
    """Return the first training seed's return in the first round against each rival."""
    ordered = sorted(records, key=lambda record: -(record.training_seed or 0))
    return {record.rival: record.returns[0] for record in ordered}
