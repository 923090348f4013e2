"""Close a season: draw recipes, train candidates, let all entries play them, and select the season suite."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import shutil
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.ids import ALL_TACTICS, SCRIPTED, SCRIPTS, other_side
from fpg_bench.common.locks import locked
from fpg_bench.common.parallel import Job, Workers, check_all_done, folder_job, run_jobs
from fpg_bench.evaluation.run_description import RunDescription
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.store import Pairing, Store
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.agent import read_card
from fpg_bench.players.player import SIDES
from fpg_bench.players.tactics import draw_variants
from fpg_bench.products.leaderboard.season.candidates import (
    PROFILE,
    against_candidate,
    earned,
    is_made,
    make_candidate,
    play_candidate,
)
from fpg_bench.products.leaderboard.season.checks import Evidence, check_members
from fpg_bench.products.leaderboard.season.entries import (
    SeasonEntry,
    entries_of_side,
    read_entries,
    season_seed,
)
from fpg_bench.products.leaderboard.season.recipes import (
    SEARCHED,
    STRANGERS,
    Recipe,
    draw_number,
    draw_recipes,
    kind_of,
)
from fpg_bench.products.leaderboard.season.season import (
    FILE,
    Season,
    SeasonCheck,
    SeasonMember,
    load_season,
    target_pool,
    write_season,
    write_suites,
)
from fpg_bench.products.leaderboard.season.selection import limit_influence, select_representative
from fpg_bench.products.leaderboard.season_keys import season_label
from fpg_bench.products.leaderboard.tracks import SCENARIOS

_logger = logging.getLogger(__name__)

FEWEST = 12  # members of a side, unless fewer are asked
N_STRANGERS = 6  # trained ones, and as many scripts with drawn constants: the best of N_VARIANTS
N_VARIANTS = 24
ORACLE = "oracle"
PLAN = "plan.yml"


@dataclass(frozen=True)
class Closing:
    """Settings of the closing of a season.

    Attributes:
        number: the season's number.
        entries: the entries that the season is closed over.
        work: folder of the candidates, which is kept so that an interrupted closing can be resumed.
        candidates, size: number of candidates of each side, and of those that are selected at most.
        scenario: the preset that entries and candidates play.
    """

    number: int
    entries: tuple[SeasonEntry, ...]
    work: Path
    candidates: int = 24
    size: int = 24
    scenario: str = "standard"

    @property
    def label(self) -> int | str:
        """The season's number, with the scenario unless that is the standard one."""
        return season_label(self.number, self.scenario)

    @property
    def name(self) -> str:
        """Name of the season's suite, such as ``season-1``."""
        return f"season-{self.label}"

    @property
    def seed(self) -> str:
        """The season's seed, which follows from its entries."""
        return season_seed(PROTOCOL, self.label, self.entries)

    def rival_entries(self, side: str) -> list[SeasonEntry]:
        """Return the entries that play against the candidates of a side."""
        return entries_of_side(self.entries, other_side(side))

    def recipes(self, side: str) -> Sequence[Recipe]:
        """Return the recipes of a side's candidates."""
        return _draw(self, side).candidates

    def strangers(self, side: str) -> Sequence[Recipe]:
        """Return the recipes of the trained players that check a side's members."""
        return _draw(self, side).strangers

    def scripts(self, side: str) -> Sequence[str]:
        """Return the scripts of a side, which set the floor, then the drawn ones."""
        return _draw(self, side).scripts

    def rivals(self, side: str) -> list[Recipe | str]:
        """Return all that the entries meet: candidates, strangers and scripts."""
        return [*self.recipes(side), *self.strangers(side), *self.scripts(side)]

    def folder(self, side: str, rival: Recipe | str) -> Path:
        """Return the folder of a candidate or stranger, or of a script, by its name with all constants."""
        if isinstance(rival, str):
            return self.work / side / f"script-{hashlib.sha256(rival.encode()).hexdigest()[:16]}"
        return self.work / side / rival.name


class _Drawn(NamedTuple):
    candidates: list[Recipe]
    strangers: list[Recipe]
    scripts: list[str]


@cache
def _draw(closing: Closing, side: str) -> _Drawn:
    """Draw the rivals that the entries of the other side meet."""
    seed = closing.seed
    pool = target_pool(closing.entries, other_side(side), closing.scenario, closing.name)
    candidates = draw_recipes(seed, side, closing.candidates, pool)
    key = draw_number(2**32, seed, side, "variants")
    variants = draw_variants(side, N_VARIANTS, as_scenario(closing.scenario), key, ALL_TACTICS[side])
    strangers = draw_recipes(seed, side, N_STRANGERS, pool, STRANGERS, "s")
    return _Drawn(candidates, strangers, [*SCRIPTS[side], *variants])


def make_closing(
    number: int,
    board: str | Path,
    work: Path,
    candidates: int = 24,
    size: int = 24,
    scenario: str = "standard",
) -> Closing:
    """Return the settings for closing a season.

    Args:
        number: the season's number.
        board: the leaderboard's folder.
        work, candidates, size, scenario: see :class:`Closing`.

    Raises:
        UserError: a scenario without seasons, or an invalid entry.
    """
    if scenario not in SCENARIOS:
        raise UserError(f"scenario: expected {' or '.join(SCENARIOS)}, got {scenario!r}")
    entries = tuple(read_entries(board, scenario=scenario))
    return Closing(number, entries, work, candidates, size, scenario)


def close_season(
    closing: Closing,
    out: Path,
    sides: Sequence[str] = SIDES,
    *,
    accept_failures: bool = False,
    workers: Workers | int = 2,
) -> Season | None:
    """Close a season, or resume its closing with the same result.

    Args:
        closing: settings of the closing.
        out: the season's folder; ``season.yml`` is written last.
        sides: train candidates of these sides only; the season is closed once those of both are trained.
        accept_failures: close although a check fails; ``season.yml`` has all verdicts.
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
        jobs = [job for side in sides for job in _jobs(closing, side)]
        done = sum(job.done() for job in jobs)
        _logger.info(f"{closing.name}, seed {closing.seed[:16]}: {len(jobs)} rivals, {done} of them done")
        check_all_done(run_jobs(jobs, workers))
        missing = [side for side in SIDES if not all(job.done() for job in _jobs(closing, side))]
        if missing:
            sides_missing = " and ".join(missing)
            _logger.info(f"{closing.name}: not closed yet: candidates of the {sides_missing} are missing")
            return None
        locks.enter_context(locked(closing.work / "at-work-publish", f"season: {closing.work}"))
        if (out / FILE).exists():  # by a process that trained the other side
            return load_season(out)
        profiles = {side: _profiles(closing, side) for side in SIDES}
        members = {side: _select_members(closing, side, profiles[side]) for side in SIDES}
        evidence = [_evidence(closing, side, members[side], profiles[side]) for side in SIDES]
        checks = tuple(
            SeasonCheck(name=verdict.name, holds=verdict.is_good, line=verdict.line)
            for of in evidence
            for verdict in check_members(of)
        )
        for check in checks:
            _logger.info(f"{'holds' if check.holds else 'FAILS'}: {check.name}: {check.line}")
        failed = [check.name for check in checks if not check.holds]
        if failed and not accept_failures:
            raise UserError(
                f"season: {closing.name} does not close, its candidates stay in {closing.work}: "
                f"{'; '.join(failed)}; --accept-failures closes it and keeps them in its file"
            )
        return _publish(closing, out, members, checks)


def _check_plan(closing: Closing) -> None:
    """Store the closing's seed and settings in its folder; raise UserError if it belongs to another one."""
    file = closing.work / PLAN
    candidates = dict.fromkeys(SIDES, closing.candidates)
    plan = {"seed": closing.seed, "candidates": candidates, "scenario": closing.scenario}
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


def _jobs(closing: Closing, side: str) -> list[Job]:
    """Return a job for each rival that the entries meet."""
    return [
        folder_job(
            f"{side}/{_name(rival)}",
            closing.folder(side, rival),
            partial(_make_rival, closing, side, rival),
            partial(_is_complete, closing, side, rival),
        )
        for rival in closing.rivals(side)
    ]


def _make_rival(closing: Closing, side: str, rival: Recipe | str, folder: Path) -> None:
    """Train a rival that is no script, and let the entries meet it; skips what is done already."""
    if isinstance(rival, Recipe):
        make_candidate(rival, folder, closing.scenario)
    Store(folder / PROFILE).fill(_pairings(closing, side, rival), play_candidate)


def _is_complete(closing: Closing, side: str, rival: Recipe | str) -> bool:
    folder, entries = closing.folder(side, rival), closing.rival_entries(side)
    count = sum(len(entry.players[_seeds_met(rival)]) for entry in entries) + 1  # and the oracle
    has_player = isinstance(rival, str) or is_made(rival, folder)
    return has_player and len(Store(folder / PROFILE).records()) == count


def _seeds_met(rival: Recipe | str) -> slice:
    """Return which training seeds of an entry meet a rival: a script meets first ones alone."""
    return slice(1) if isinstance(rival, str) else slice(None)


def _pairings(closing: Closing, side: str, rival: Recipe | str) -> list[Pairing]:
    """Return the pairings of the entries and an oracle with a rival."""
    if isinstance(rival, str):
        player, path = rival, "pursuit"
    else:
        player, path = str(closing.folder(side, rival).absolute() / "agent"), rival.path

    def of(name: str, entry: str, its_path: str, number: int | None = None) -> Pairing:
        where = player, path if side == "opponent" else its_path, closing.seed, closing.scenario
        return against_candidate(name, other_side(side), *where, name=entry, number=number)

    wanted = [
        of(name, entry.name, entry.path, number)
        for entry in closing.rival_entries(side)
        for number, name in enumerate(entry.players[_seeds_met(rival)])
    ]
    return [*wanted, of(ORACLE, ORACLE, "pursuit")]


@dataclass(frozen=True)
class _Profile:
    """Returns per step where the entries meet a rival.

    Attributes:
        means: what each entry earns, a mean over its training seeds.
        firsts: what the first training seed of each earns.
        oracle: what an oracle of the entries' side earns.
        own: what the rival earns by its own rules, a mean over entries.
        hops: number of hops in all these rounds.
    """

    means: Mapping[str, float]
    firsts: Mapping[str, float]
    oracle: float
    own: float
    hops: float


def _read_profile(closing: Closing, side: str, rival: Recipe | str) -> _Profile:
    returns: dict[str, dict[int, dict[str, float]]] = {}
    records, other = Store(closing.folder(side, rival) / PROFILE).records(), other_side(side)
    for record in records:
        of = returns.setdefault(record.entry, {})
        of[record.training_seed or 0] = earned(record, other, closing.scenario)
    oracle = returns.pop(ORACLE)[0][other]

    def mean(name: str) -> dict[str, float]:
        return {entry: statistics.fmean(each[name] for each in of.values()) for entry, of in returns.items()}

    return _Profile(
        means=mean(other),
        firsts={entry: of[0][other] for entry, of in returns.items()},
        oracle=oracle,
        own=statistics.fmean(mean(side).values()),
        hops=sum(record.tally["hops"] for record in records),
    )


def _profiles(closing: Closing, side: str) -> dict[str, _Profile]:
    """Return the profiles of all rivals that the entries meet, by name."""
    return {_name(rival): _read_profile(closing, side, rival) for rival in closing.rivals(side)}


def _name(rival: Recipe | str) -> str:
    return rival if isinstance(rival, str) else rival.name


def _floor(side: str, profiles: Mapping[str, _Profile]) -> tuple[str, float]:
    """Return the script of ``SCRIPTED`` that a member must beat, and what it earns.

    It is the best one, of allies the best that never hops.
    """
    scripts = [script for script in SCRIPTED[side] if side == "opponent" or not profiles[script].hops]
    best = max(scripts, key=lambda script: profiles[script].own)
    return best, profiles[best].own


def _competent(
    closing: Closing, side: str, kind: str, names: list[str], profiles: Mapping[str, _Profile], fewest: int
) -> list[str]:
    """Return the rivals that earn more than the floor; raise UserError if they are fewer than asked."""
    script, floor = _floor(side, profiles)
    competent = [name for name in names if profiles[name].own > floor]
    if len(competent) < fewest:
        raise UserError(
            f"season: {closing.name} does not close: {len(competent)} of {len(names)} {kind} of the {side} "
            f"earn more than {script} ({floor:.2f}), {fewest} are asked; train more"
        )
    return competent


def _columns(closing: Closing, side: str, earn: Iterable[Mapping[str, float]]) -> np.ndarray:
    """Return what each entry earns from each rival, ``(entries, rivals)``."""
    names = [entry.name for entry in closing.rival_entries(side)]
    return np.array([[of[name] for name in names] for of in earn]).T


def _evidence(
    closing: Closing, side: str, members: Sequence[SeasonMember], profiles: Mapping[str, _Profile]
) -> Evidence:
    drawn = sorted(closing.scripts(side)[len(SCRIPTS[side]) :], key=lambda name: -profiles[name].own)
    strangers = [*(recipe.name for recipe in closing.strangers(side)), *drawn[:N_STRANGERS]]
    competent = _competent(closing, side, "strangers", strangers, profiles, (N_STRANGERS + 1) // 2)
    own = [profiles[member.name] for member in members]
    tables: dict[str, list[int]] = {}
    for row, entry in enumerate(closing.rival_entries(side)):
        tables.setdefault(entry.path if side == "ally" else "allies", []).append(row)
    return Evidence(
        side=side,
        tables=tables,
        scripts={row for row, entry in enumerate(closing.rival_entries(side)) if entry.is_script},
        kinds=[kind_of(member.algorithm) for member in members],
        members=_columns(closing, side, [each.firsts for each in own]),
        strangers=_columns(closing, side, [profiles[name].firsts for name in competent]),
        oracle=np.array([each.oracle for each in own]),
        earned={member.name: each.own for member, each in zip(members, own, strict=True)},
        floor=_floor(side, profiles),
    )


def _select_members(
    closing: Closing, side: str, profiles: Mapping[str, _Profile]
) -> tuple[SeasonMember, ...]:
    size = closing.size
    names = [recipe.name for recipe in closing.recipes(side)]
    competent = _competent(closing, side, "candidates", names, profiles, min(size, FEWEST))
    by_policy: dict[str, Recipe] = {}  # searches may find the same rule
    for recipe in closing.recipes(side):
        if recipe.name in competent:
            by_policy.setdefault(read_card(closing.folder(side, recipe) / "agent").policy_sha256, recipe)
    recipes = list(by_policy.values())
    returns = _columns(closing, side, [profiles[recipe.name].means for recipe in recipes])
    kinds = [kind_of(recipe.algorithm) for recipe in recipes]
    chosen = select_representative(limit_influence(returns), min(size, len(recipes)), kinds)
    return tuple(
        SeasonMember(
            **dict(recipes[index]),
            policy_sha256=list(by_policy)[index],
            entries_earn=round(statistics.fmean(returns[:, index]), 3),
        )
        for index in chosen
    )


def _publish(
    closing: Closing, out: Path, members: dict[str, tuple[SeasonMember, ...]], checks: tuple[SeasonCheck, ...]
) -> Season:
    """Copy the members and write the suites of the season's tracks; ``season.yml`` is written last."""
    versions: dict[str, str] = {}  # of a trained member: those that were searched have the package's alone
    for side in SIDES:
        for member in members[side]:
            if member.algorithm not in SEARCHED:
                versions |= RunDescription.read(closing.folder(side, member)).versions
    season = Season(
        folder=out,
        name=closing.name,
        number=closing.number,
        protocol=PROTOCOL,
        seed=closing.seed,
        candidates=dict.fromkeys(SIDES, closing.candidates),
        entries={entry.name: list(entry.hashes) for entry in closing.entries},
        members=members,
        versions=versions,
        checks=checks,
        scenario=closing.scenario,
    )
    for side in SIDES:
        shutil.rmtree(out / side, ignore_errors=True)  # left by a closing that was killed here
    for side, member in season.all_members():
        for file in ("agent.json", "policy.onnx"):
            data = (closing.folder(side, member) / "agent" / file).read_bytes()
            write_whole(season.agent(side, member) / file, data)
    write_suites(season, closing.number)
    write_season(season)
    return season
