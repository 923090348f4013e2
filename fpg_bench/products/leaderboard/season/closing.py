"""Close a season: draw recipes, train candidates, let all entries play them, and select the season suite."""

from __future__ import annotations

import contextlib
import logging
import re
import shutil
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.ids import other_side
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Job, Workers, check_all_done, folder_job, run_jobs
from fpg_bench.evaluation.run_description import RunDescription
from fpg_bench.evaluation.seeds import PROTOCOL, season_label
from fpg_bench.evaluation.store import Pairing, Store
from fpg_bench.players.agent import read_card
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.season.candidates import (
    PROFILE,
    against_candidate,
    earned,
    play_candidate,
    train_candidate,
)
from fpg_bench.products.leaderboard.season.entries import (
    SeasonEntry,
    entries_of_side,
    read_entries,
    season_seed,
)
from fpg_bench.products.leaderboard.season.recipes import Recipe, draw_recipes
from fpg_bench.products.leaderboard.season.season import (
    FILE,
    Season,
    SeasonMember,
    load_season,
    write_season,
    write_suites,
)
from fpg_bench.products.leaderboard.season.selection import (
    PROBE,
    PROBES,
    Meeting,
    entry_returns,
    group_candidates,
    limit_influence,
    select_by_group,
    select_diverse,
)
from fpg_bench.products.leaderboard.tracks import SCENARIOS
from fpg_bench.training.run_folder import RunFolder

_logger = logging.getLogger(__name__)

CANDIDATES, SIZE = 24, 12
PLAN = "plan.yml"


@dataclass(frozen=True)
class Closing:
    """Settings of the closing of a season.

    Attributes:
        name: name of the season suite, such as ``season-1``.
        number: the season's number; None for a training population.
        entries: the entries that the season is closed over.
        work: folder of the candidates, which is kept so that an interrupted closing can be resumed.
        candidates, size: number of trained and of selected candidates per side.
        scenario: the preset that entries and candidates play.
    """

    name: str
    number: int | None
    entries: tuple[SeasonEntry, ...]
    work: Path
    candidates: int = CANDIDATES
    size: int = SIZE
    scenario: str = "standard"

    @property
    def seed(self) -> str:
        """The season's seed; for a training population, it follows from the name instead of a number."""
        label = self.name if self.number is None else season_label(self.number, self.scenario)
        return season_seed(PROTOCOL, label, self.entries)

    def rival_entries(self, side: str) -> list[SeasonEntry]:
        """Return the entries that play against the candidates of a side."""
        return entries_of_side(self.entries, other_side(side))

    def recipes(self, side: str) -> list[Recipe]:
        """Return the recipes of a side's candidates."""
        return draw_recipes(self.seed, side, self.candidates, self.rival_entries(side))

    def folder(self, recipe: Recipe) -> Path:
        """Return the folder of a candidate."""
        return self.work / recipe.side / recipe.name


def make_closing(
    name: str,
    board: str | Path,
    work: Path,
    candidates: int = CANDIDATES,
    size: int = SIZE,
    scenario: str = "standard",
) -> Closing:
    """Return the settings for closing a season (by number) or a training population (by name).

    Args:
        name: the number or name.
        board: the leaderboard's folder.
        work, candidates, size, scenario: see :class:`Closing`.

    Raises:
        UserError: an invalid name, or an invalid entry.
    """
    if not re.fullmatch(r"[1-9]\d{0,3}|[a-z][a-z0-9-]{0,39}", name) or name.startswith("season"):
        raise UserError(f"season: expected a number, or a word for a training population, got {name!r}")
    number = int(name) if name.isdigit() else None
    if scenario not in SCENARIOS:
        raise UserError(f"scenario: expected {' or '.join(SCENARIOS)}, got {scenario!r}")
    entries = tuple(read_entries(board, scenario=scenario))
    if number is not None:
        name = f"season-{season_label(number, scenario)}"
    return Closing(name, number, entries, work, candidates, size, scenario)


def close_season(
    closing: Closing,
    out: Path,
    sides: Sequence[str] = SIDES,
    *,
    workers: Workers | int = 2,
) -> Season | None:
    """Close a season, or resume its closing with the same result.

    Args:
        closing: settings of the closing.
        out: the season's folder; ``season.yml`` is written last.
        sides: train candidates of these sides only; the season is closed once those of both are trained.
        workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The season; None while candidates of the other side are missing.

    Raises:
        UserError: the season is closed already, a side has no entries, another process is closing the
            season, the folder holds candidates of another closing, a candidate could not be trained, or its
            actions are not finite.
        KeyboardInterrupt: stopped by the user.
    """
    if (out / FILE).exists():
        raise UserError(f"season: {out} is closed already; choose another number, name or folder")
    with contextlib.ExitStack() as locks:
        for side in sides:  # otherwise two processes would both fill a profile, which never becomes complete
            locks.enter_context(locked(closing.work / f"at-work-{side}", f"season: {closing.work}, {side}"))
        _check_plan(closing)
        jobs = [_candidate_job(closing, recipe) for side in sides for recipe in closing.recipes(side)]
        done = sum(job.done() for job in jobs)
        _logger.info(f"{closing.name}, seed {closing.seed[:16]}: {len(jobs)} candidates, {done} of them done")
        check_all_done(run_jobs(jobs, workers))
        missing = [
            side
            for side in SIDES
            if not all(_candidate_job(closing, recipe).done() for recipe in closing.recipes(side))
        ]
        if missing:
            sides_missing = " and ".join(missing)
            _logger.info(f"{closing.name}: not closed yet: candidates of the {sides_missing} are missing")
            return None
        locks.enter_context(locked(closing.work / "at-work-publish", f"season: {closing.work}"))
        if (out / FILE).exists():  # by a process that trained the other side
            return load_season(out)
        return _publish(closing, out, {side: _select_members(closing, side) for side in SIDES})


def _check_plan(closing: Closing) -> None:
    """Store the closing's seed and settings in its folder; raise UserError if it belongs to another one."""
    file = closing.work / PLAN
    plan = {"seed": closing.seed, "candidates": closing.candidates, "scenario": closing.scenario}
    if not file.exists():
        write_whole(file, "".join(f"{key}: {value}\n" for key, value in plan.items()))
    stored = read_yaml(file, "closing")
    for key, value in plan.items():
        if stored.get(key) != value:
            raise other_content(
                f"season: {closing.work}",
                f"candidates of another closing ({key}: {stored.get(key)}, now {value}; a seed changes with "
                "the entries)",
            )


def _candidate_job(closing: Closing, recipe: Recipe) -> Job:
    folder = closing.folder(recipe)
    make, done = partial(_make_candidate, closing, recipe), partial(_is_complete, closing, recipe)
    return folder_job(f"{recipe.side}/{recipe.name}", folder, make, done)


def _make_candidate(closing: Closing, recipe: Recipe, folder: Path) -> None:
    """Train a candidate and play all entries and probes against it; skips what is done already."""
    train_candidate(recipe, folder, closing.scenario)
    side = other_side(recipe.side)

    def against(player: str, path: str, name: str, number: int | None = None) -> Pairing:
        where = str(folder / "agent"), path, closing.seed, closing.scenario
        return against_candidate(player, side, *where, name=name, number=number)

    wanted = [
        against(player, recipe.path if recipe.side == "opponent" else entry.path, entry.name, number)
        for entry in closing.rival_entries(recipe.side)
        for number, player in enumerate(entry.players)
    ]
    wanted += [against(script, recipe.path, PROBE) for script in PROBES[recipe.side]]
    Store(folder / PROFILE).fill(wanted, play_candidate)


def _is_complete(closing: Closing, recipe: Recipe) -> bool:
    folder, entries = closing.folder(recipe), closing.rival_entries(recipe.side)
    count = sum(len(entry.players) for entry in entries) + len(PROBES[recipe.side])
    return RunFolder(folder).is_finished() and len(Store(folder / PROFILE).records()) == count


def _profile(closing: Closing, recipe: Recipe) -> list[Meeting]:
    """Return the meetings of a candidate with all entries and probes."""
    side = other_side(recipe.side)
    return [
        Meeting(record.entry, record.fingerprint, earned(record, side, closing.scenario))
        for record in Store(closing.folder(recipe) / PROFILE).records()
    ]


def _select_members(closing: Closing, side: str) -> tuple[SeasonMember, ...]:
    recipes = closing.recipes(side)
    profiles = [_profile(closing, recipe) for recipe in recipes]
    other = other_side(side)
    returns = entry_returns(profiles, other)
    limited = limit_influence(returns)
    probes = [
        {met.player: met.returns[other] for met in meetings if met.entry == PROBE} for meetings in profiles
    ]
    first, second = PROBES[side]
    groups: list[str] | None = None
    size = min(closing.size, len(recipes))
    if closing.number is None:
        selected = select_diverse(limited, size)
    else:
        groups = group_candidates(
            limited, np.array([earned[first] - earned[second] for earned in probes]), side
        )
        selected = select_by_group(limited, groups, size)
    members = []
    for index in selected:
        card = read_card(closing.folder(recipes[index]) / "agent")
        earn = round(statistics.fmean(returns[:, index]), 3)
        member = dict(recipes[index]) | {"policy_sha256": card.policy_sha256, "entries_earn": earn}
        member |= {} if groups is None else {"group": groups[index]}
        members.append(SeasonMember(**member))
    return tuple(members)


def _publish(closing: Closing, out: Path, members: dict[str, tuple[SeasonMember, ...]]) -> Season:
    """Copy the members and write the suites of the season's tracks; ``season.yml`` is written last."""
    first = closing.folder(members["opponent"][0])
    season = Season(
        folder=out,
        name=closing.name,
        number=closing.number,
        protocol=PROTOCOL,
        seed=closing.seed,
        candidates=dict.fromkeys(SIDES, closing.candidates),
        entries={entry.name: list(entry.hashes) for entry in closing.entries},
        members=members,
        versions=RunDescription.read(first).versions,
        scenario=closing.scenario,
    )
    for side in SIDES:
        shutil.rmtree(out / side, ignore_errors=True)  # left by a closing that was killed here
    for side, member in season.all_members():
        for file in ("agent.json", "policy.onnx"):
            data = (closing.folder(member) / "agent" / file).read_bytes()
            write_whole(season.agent(side, member) / file, data)
    if closing.number is not None:
        write_suites(season, closing.number)
    write_season(season)
    return season
