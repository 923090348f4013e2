"""Closing a season: candidates are drawn, trained and met by all entries; the field is chosen from them."""

from __future__ import annotations

import re
import shutil
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import Counterpart, Field
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.files import read_json, read_yaml, write_whole
from fpg_bench.game.scenario import STANDARD, as_scenario
from fpg_bench.jobs.folders import folder_job
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import run_jobs
from fpg_bench.players.player import SIDES
from fpg_bench.rows import Row, RowFile
from fpg_bench.seasons.candidates import train_candidate
from fpg_bench.seasons.choosing import diverse, representative
from fpg_bench.seasons.entries import SeasonEntry, apart, of_side, read_entries, season_seed
from fpg_bench.seasons.recipe import Recipe, draw_recipes
from fpg_bench.seasons.season import FILE, Season, SeasonMember, write_fields, write_season
from fpg_bench.training.run_folder import RunFolder

CANDIDATES, SIZE, ROUNDS = 24, 12, 60
PROFILE, PLAN = "profile.jsonl", "plan.yml"
Say = Callable[[str], None]
OTHER = {"ally": "opponent", "opponent": "ally"}


@dataclass(frozen=True)
class Closing:
    """A season that is being closed.

    Attributes:
        name: of the field, ``season-1``.
        number: of the season; None for a training population.
        entries: over whom.
        work: where candidates are trained; kept, so that what was stopped goes on.
        candidates, size: of each side, trained and chosen.
        rounds: that each entry plays against each candidate.
        scale: multiplies all budgets; 1 but for tests.
    """

    name: str
    number: int | None
    entries: tuple[SeasonEntry, ...]
    work: Path
    candidates: int = CANDIDATES
    size: int = SIZE
    rounds: int = ROUNDS
    scale: float = 1.0

    @property
    def seed(self) -> str:
        """The season's seed; a training population's follows from its name in the place of a number."""
        return season_seed(PROTOCOL, self.name if self.number is None else self.number, self.entries)

    def met_by(self, side: str) -> list[SeasonEntry]:
        """The entries that meet the candidates of a side."""
        return apart(of_side(self.entries, OTHER[side]))

    def recipes(self, side: str) -> list[Recipe]:
        """How the candidates of a side are trained."""
        return draw_recipes(
            self.seed, side, self.candidates, [e.target() for e in self.met_by(side)], self.scale
        )

    def folder(self, recipe: Recipe) -> Path:
        """Where a candidate is trained."""
        return self.work / recipe.side / recipe.name


def close(
    closing: Closing,
    out: Path,
    sides: Sequence[str] = SIDES,
    *,
    workers: int = 2,
    backend: str = "loky",
    address: str | None = None,
    say: Say = print,
) -> Season | None:
    """Close a season, or go on closing it: what is finished is not done again, and the result is the same.

    Args:
        closing: what is closed.
        out: the field's folder; ``season.yml`` is written last.
        sides: whose candidates to train now; the season is closed once those of both are there.
        workers, backend, address: see :func:`fpg_bench.jobs.run.run_jobs`.
        say: told a line per candidate that begins or ends.

    Returns:
        The season; None where candidates of the other side are still to be trained.

    Raises:
        UserError: it is closed already, no entries of a side, a folder with candidates of another closing, a
            candidate that failed, or one that answers with numbers that are none.
        KeyboardInterrupt: stopped by the user.
    """
    if (out / FILE).exists():
        raise UserError(f"season: {out} is closed already; the next one has another number")
    _check_same(closing)
    jobs = [_job(closing, recipe) for side in sides for recipe in closing.recipes(side)]
    done = sum(job.done() for job in jobs)
    say(f"{closing.name}, seed {closing.seed[:16]}: {len(jobs)} candidates, {done} of them done")
    check_all_done(run_jobs(jobs, workers, backend, address, say))
    whole = [side for side in SIDES if all(_job(closing, recipe).done() for recipe in closing.recipes(side))]
    members = {side: _chosen(closing, side) for side in whole}
    if lacking := [side for side in SIDES if side not in members]:
        say(f"{closing.name}: candidates of the {' and '.join(lacking)} are not there yet; it is not closed")
        return None
    return _publish(closing, out, members)


def _check_same(closing: Closing) -> None:
    """Keep in the working folder what it is for; raise UserError where it is for something else."""
    file = closing.work / PLAN
    plan = {
        "seed": closing.seed,
        "candidates": closing.candidates,
        "rounds": closing.rounds,
        "scale": closing.scale,
    }
    if not file.exists():
        write_whole(file, "".join(f"{key}: {value}\n" for key, value in plan.items()))
    found = read_yaml(file, "closing")
    if different := [key for key in plan if found.get(key) != plan[key]]:
        raise UserError(
            f"season: {closing.work} holds candidates of another closing ({different[0]}: "
            f"{found.get(different[0])}, "
            f"now {plan[different[0]]}; a seed changes with the entries); choose another folder"
        )


def _job(closing: Closing, recipe: Recipe) -> Job:
    folder = closing.folder(recipe)
    meet = [
        (entry.name, entry.path, player) for entry in closing.met_by(recipe.side) for player in entry.players
    ]
    folder.parent.mkdir(parents=True, exist_ok=True)
    run = partial(_make, recipe, meet, closing.seed, closing.rounds)
    return folder_job(f"{recipe.side}/{recipe.name}", folder, run, partial(_is_met, folder, len(meet)))


def _make(recipe: Recipe, meet: list[tuple[str, str, str]], seed: str, rounds: int, folder: Path) -> None:
    """Train a candidate and let all entries play against it; what is there is not done again."""
    train_candidate(recipe, folder)
    file = RowFile(folder / PROFILE)
    there = {row["player"] for row in file.read()}
    for entry, path, player in meet:
        if player not in there:
            path = recipe.path if recipe.side == "opponent" else path
            found = played(player, OTHER[recipe.side], str(folder / "agent"), path, seed, rounds)
            file.append([{"entry": entry, "player": player, **found}])


def _is_met(folder: Path, players: int) -> bool:
    return RunFolder(folder).is_finished() and len(RowFile(folder / PROFILE).read()) == players


def played(
    player: Any, side: str, other: Any, path: str, season: str, rounds: int = ROUNDS
) -> dict[str, Any]:
    """Rounds of a player against one of the other side, pooled.

    Args:
        player: whose profile it is: a name, or an object with ``predict``.
        side: which it plays.
        other: whom it meets.
        path: how the opponent of the two flies.
        season: the season's seed, from which the evaluation seeds follow.
        rounds: how many.

    Returns:
        ``n`` rounds, and the mean returns a step ``ally`` and ``opponent``.

    Raises:
        UserError: no such player, one of the wrong side, or actions that are no numbers.
    """
    counterpart = Counterpart("season", (other,), as_scenario(STANDARD, opponent_path=path))
    field = Field("season", side, STANDARD, rounds, (counterpart,), season=season)
    try:
        line = play(player_entry(player), field, counterpart)
    except UserError as error:
        raise UserError(f"{player} against {other}: {error}") from error
    returns = {name: line.tally[f"{name}_return"] / line.tally["steps"] for name in ("ally", "opponent")}
    return {"n": len(line.returns), **{name: round(value, 6) for name, value in returns.items()}}


def profile(folder: Path, side: str) -> list[float]:
    """What players of the other side earn a step against a candidate, in the order of entries."""
    return [row[OTHER[side]] for row in RowFile(folder / PROFILE).read()]


def _chosen(closing: Closing, side: str) -> tuple[SeasonMember, ...]:
    """The members of a side, in the order in which they were chosen."""
    recipes = closing.recipes(side)
    returns = np.array([profile(closing.folder(recipe), side) for recipe in recipes]).T
    choose = diverse if closing.number is None else representative
    found = []
    for index in choose(returns, min(closing.size, len(recipes))):
        about = read_json(closing.folder(recipes[index]) / "agent" / "agent.json", "agent")
        earn = round(statistics.fmean(returns[:, index]), 3)
        found.append(SeasonMember(recipes[index], about["policy_sha256"], earn))
    return tuple(found)


def _publish(closing: Closing, out: Path, members: dict[str, tuple[SeasonMember, ...]]) -> Season:
    """Copy the members beside ``season.yml``, write the tracks' fields of a season, and that file last."""
    first = members["opponent"][0].recipe
    versions: Row = read_json(closing.folder(first) / "run.json", "run")["versions"]
    hashes = {entry.name: list(entry.hashes) for entry in closing.entries}
    counts = dict.fromkeys(SIDES, closing.candidates)
    season = Season(
        out, closing.name, closing.number, PROTOCOL, closing.seed, counts, hashes, members, versions
    )
    for side in SIDES:
        shutil.rmtree(out / side, ignore_errors=True)  # of a closing that was killed here
    for side, member in season.everyone():
        for file in ("agent.json", "policy.onnx"):
            data = (closing.folder(member.recipe) / "agent" / file).read_bytes()
            write_whole(season.agent(side, member) / file, data)
    if closing.number is not None:
        write_fields(season, closing.number)
    write_season(season)
    return season


def closing_of(name: str, board: str | Path, work: Path, **words: Any) -> Closing:
    """The closing of a season (by its number) or a training population (by its name) over a board.

    Raises:
        UserError: a name that is no plain word, or entries that are not sound.
    """
    if not re.fullmatch(r"[1-9]\d{0,3}|[a-z][a-z0-9-]{0,39}", name) or name.startswith("season"):
        raise UserError(f"season: expected a number, or a word for a training population, got {name!r}")
    number = int(name) if name.isdigit() else None
    entries = tuple(read_entries(board))
    return Closing(f"season-{name}" if number else name, number, entries, work, **words)
