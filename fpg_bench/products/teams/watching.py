"""Watching a round of teams: as text, as a picture or as a film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.canvas import FIGURES, write_figure
from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError
from fpg_bench.common.products import load
from fpg_bench.game.jamming import covers
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.players.player import PlayerSpec
from fpg_bench.players.registry import player_name
from fpg_bench.products.rendering.recording import FIELDS, FRAME
from fpg_bench.products.rendering.watching import checked_target, shown_measures
from fpg_bench.products.teams.batch import TeamBatch
from fpg_bench.products.teams.match import play_teams
from fpg_bench.products.teams.picture import TeamPicture
from fpg_bench.products.teams.rules import TeamRules, check_playable

_FLAGS = "flags: C covered, H hop, S spreading"
_WIDTH = 23  # of a cell of text
SUFFIXES = (*FIGURES, ".gif", ".mp4")  # pictures and films


@dataclass(frozen=True)
class TeamRecording:
    """A round of N allies and M jammers; the first frame is its start.

    Attributes:
        scenario: what was played.
        seed: seed of the match.
        control_points: ``(4, 3)`` in m, the first ally's Bezier curve.
        frames: ``(steps + 1, N)`` records of dtype ``recording.FRAME``, the allies'.
        jammers: ``(steps + 1, M)`` of them.
        jams: ``(steps + 1, M, N)`` bool: whether a jammer covers a part of an ally's channel.
        measures: those of the round.
    """

    scenario: Scenario
    seed: int
    control_points: np.ndarray
    frames: np.ndarray
    jammers: np.ndarray
    jams: np.ndarray
    measures: dict[str, float | None]


def record_team(
    allies: Sequence[PlayerSpec],
    opponents: Sequence[PlayerSpec],
    seed: int = 0,
    scenario: Scenario | str = "link",
    team: TeamRules | None = None,
) -> TeamRecording:
    """Play the first round of a match and return it; arguments and errors as in :func:`watch_team`."""
    scenario = as_scenario(scenario)
    check_playable(scenario)
    rules, radio = rules_record(scenario)[0], radio_record(scenario)[0]  # type: ignore[index]
    kept, batches = [], []

    def keep(batch: TeamBatch) -> None:
        n, m = batch.counts[0]
        allies, jammers = batch.allies[0, :n], batch.opponents[0, :m]
        jams = [
            [
                covers(kind, mhz, ally["frequency_mhz"], ally["spreading"], rules, radio)
                if kind >= 0
                else False
                for ally in allies
            ]
            for kind, mhz in jammers[["jamming_type", "jamming_mhz"]]
        ]
        kept.append((*(seats[list(FIELDS)].astype(FRAME) for seats in (allies, jammers)), np.array(jams)))
        batches.append(batch)

    play_teams(allies, opponents, scenario, team or TeamRules(), 1, seeds=seed, on_step=keep)
    frames, jammers, jams = (np.stack(each) for each in zip(*kept, strict=True))
    curve = batches[0].allies[0, 0]["control_points"].copy()
    return TeamRecording(scenario, seed, curve, frames, jammers, jams, batches[0].measures(0))


def print_team(
    allies: Sequence[PlayerSpec], opponents: Sequence[PlayerSpec], every: int = 1, **options: Any
) -> TeamRecording:
    """Play a round, and print each n-th step and the last; further arguments as in :func:`record_team`."""
    integer(every, "every")
    recording = record_team(allies, opponents, **options)
    steps, n = len(recording.frames) - 1, recording.frames.shape[1]
    print(f"{_names(allies)} against {_names(opponents)}", f"seed {recording.seed}", _FLAGS, sep="\n")
    heads = [f"ally_{k} MHz, reward" for k in range(n)]
    heads += [f"opponent_{k}, centre MHz" for k in range(recording.jammers.shape[1])]
    print(" step", *(f"{head:>{_WIDTH}}" for head in heads))
    for step in (k for k in range(1, steps + 1) if k % every == 0 or k == steps):
        cells = [_ally_cell(recording, step, k) for k in range(n)]
        cells += [
            f"{JAMMING_TYPES[of['jamming_type']]:>13}{of['jamming_mhz']:9.2f}"
            for of in recording.jammers[step]
        ]
        print(f"{step:5d}", *(f"{cell:>{_WIDTH}}" for cell in cells))
    print(f"seed {recording.seed}: {shown_measures(recording.measures)}")
    return recording


def _ally_cell(recording: TeamRecording, step: int, seat: int) -> str:
    frame, is_covered = recording.frames[step, seat], recording.jams[step, :, seat].any()
    flags = ((is_covered, "C"), (frame["hopped"], "H"), (frame["spreading"], "S"))
    shown = "".join(sign if on else "." for on, sign in flags)
    return f"{frame['frequency_mhz']:.2f} {shown}{frame['ally_reward']:7.2f}"


def watch_team(
    allies: Sequence[PlayerSpec],
    opponents: Sequence[PlayerSpec],
    out: str | Path,
    *,
    seed: int = 0,
    step: int | None = None,
    every: int = 1,
    scenario: Scenario | str = "link",
    team: TeamRules | None = None,
) -> TeamRecording:
    """Play a round of two teams, and draw or film it.

    Both show who jams whom, points over time with a colour for each ally, the jammers' bands, and rewards.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     played = watch_team(["allotment"], ["tone", "assign"], f"{folder}/round.png", seed=7)
    >>> played.frames.shape, played.jammers.shape
    ((301, 3), (301, 2))

    Args:
        allies, opponents: players as :func:`fpg_bench.products.teams.scripts.as_team_player` takes them: one
            in all seats, or one for each seat.
        out: the file: ``.png``, ``.svg`` or ``.pdf`` of one step, or a film, ``.gif`` or ``.mp4``.
        seed: seed of the match, a whole number in [0, 2^63).
        step: the step that a picture shows, with the two minutes before it; None: the last.
        every: a film shows every n-th step, and the last.
        scenario: the rules of the game.
        team: the rules of teams; None: three allies in convoy against two jammers.

    Returns:
        The round.

    Raises:
        UserError: an unknown player, scenario or suffix, a step that the round does not have, a file that is
            there already or cannot be written, or an extra that is not installed.
    """
    scenario = as_scenario(scenario)
    integer(every, "every")
    if step is not None and integer(step, "step") > scenario.steps_per_round:
        raise UserError(f"step: a round has {scenario.steps_per_round}, got {step}")
    path, picture = checked_target(Path(out), SUFFIXES), TeamPicture
    recording = record_team(allies, opponents, seed, scenario, team)
    title = f"{_names(allies)} against {_names(opponents)}"
    if path.suffix.lower() in FIGURES:
        write_figure(picture(recording, title).show(step), path)
    else:
        load("rendering", path.suffix.lower())([recording], path, title, every, picture)
    return recording


def _names(players: Sequence[PlayerSpec]) -> str:
    return ", ".join(dict.fromkeys(map(player_name, players)))
