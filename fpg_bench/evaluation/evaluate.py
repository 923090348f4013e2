"""An evaluation: entries against a field into a results folder, and the summaries made of it."""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.checks import whole
from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import Entry, check_kept, check_seeds, entries_of
from fpg_bench.evaluation.field import Counterpart, Field, load_field
from fpg_bench.evaluation.line import Line, read_lines
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.summary import Summary, summarise
from fpg_bench.evaluation.table import Results
from fpg_bench.files import read_json, write_json
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import Workers, run_jobs
from fpg_bench.rows import RowFile

LINES, ABOUT = "lines.jsonl", "evaluation.json"  # the files of a results folder
Progress = Callable[[Entry, Counterpart, int], None]  # told how many rounds of each match were played
_ALONE = Workers()


def evaluate(
    players: Sequence[Any] | Mapping[str, Any],
    field: str = "ally-v1",
    out: str | Path | None = None,
    *,
    matches: int | None = None,
    name: str | None = None,
    progress: Progress = lambda entry, counterpart, rounds: None,
    say: Callable[[str], None] = print,
    **workers: Any,
) -> Results:
    """Play players against a field; what is in the folder already is not played again.

    Args:
        players: names by the one grammar of players, ``all-scripted``, or anything with ``predict``; agents
            that differ by their training seed alone become one entry. Of a mapping, each key is the name of
            one entry: a player, or a list of agents.
        field: a field's name or YAML file.
        out: the results folder; ``lines.jsonl`` grows as counterparts are met. None: nothing is kept.
        matches: per counterpart and training seed; None: the field's own.
        name: what lines and tables call the agents given; None: their algorithm. Not a script's name.
        progress: called before each meeting and after each of its rounds, where they are played one by one.
        say: told a line per meeting that begins or ends, where several are played at once.
        **workers: ``jobs``, how many meetings are played at once (the lines are the same, their order may
            differ), ``backend`` and ``address``; see :class:`fpg_bench.jobs.run.Workers`.

    Returns:
        The summaries of all entries in the folder, best first, with ``table()`` and ``dataframe()``.

    Raises:
        UserError: something unknown, of the wrong side, a folder that holds another field's lines, or one
            for players that have no name by which they could be known again.
    """
    played = with_matches(load_field(field), matches)
    if played.side not in ("ally", "opponent"):
        raise UserError(f"field {field}: measures planners; write fpg-bench plan compare --field {field}")
    entries = entries_of(players, played, name)
    if out is not None:
        check_kept(entries)
    crew = Workers(**workers)
    with tempfile.TemporaryDirectory() if out is None else contextlib.nullcontext(out) as folder:
        found = play_into(Path(folder), field, played, entries, progress, crew, say)
    return Results(found)


def play_into(
    out: Path,
    name: str,
    field: Field,
    entries: Sequence[Entry],
    progress: Progress = lambda entry, counterpart, rounds: None,
    workers: Workers = _ALONE,
    say: Callable[[str], None] = print,
) -> list[Summary]:
    """Play entries against a field into a results folder; raises as :func:`evaluate` does.

    Args:
        out: the folder.
        name: the field's name or YAML file.
        field: that field.
        entries: who is measured.
        progress: see :func:`evaluate`.
        workers: how many meetings are played at once, and where.
        say: see :func:`evaluate`.
    """
    check_seeds(entries)
    claim(out, name, field)
    file = RowFile(out / LINES)
    with file.locked():
        _claim_names(out, entries)
        missing = list(_missing(entries, field, file))
        if workers.alone:
            for entry, counterpart in missing:
                progress(entry, counterpart, 0)
                file.append(
                    [play(entry, field, counterpart, on_round=partial(progress, entry, counterpart)).row()]
                )
        else:
            jobs = [_job(entry, field, counterpart, file) for entry, counterpart in missing]
            check_all_done(run_jobs(jobs, workers.jobs, workers.backend, workers.address, say))
    return summarise(lines_of(file), field)


def lines_of(file: RowFile) -> list[Line]:
    """The lines in a file of them; raises UserError where a row is none."""
    return read_lines(file.read(), f"lines {file.path}")


def read_results(folder: str | Path) -> tuple[list[Summary], Field]:
    """The summaries of a results folder, and its field.

    Raises:
        UserError: no results folder, or one of a field that is not this version's.
    """
    folder = Path(folder)
    about = _about(folder)
    field = with_matches(load_field(about["field"]), about["matches"])
    if field.hash != about.get("field_hash"):
        raise UserError(f"results {folder}: played under another version of {about['field']}; evaluate again")
    return summarise(lines_of(RowFile(folder / LINES)), field), field


def with_matches(field: Field, matches: int | None) -> Field:
    """The same field over another number of matches; raises UserError where it is none."""
    return field if matches is None else dataclasses.replace(field, matches=whole(matches, "matches"))


def claim(out: Path, name: str, field: Field) -> None:
    """Say in a folder which field its lines are of, and how many matches they have.

    Raises:
        UserError: it holds lines of another field.
    """
    path, lines = out / ABOUT, out / LINES
    about = {"field": name, "field_hash": field.hash, "matches": field.matches}
    found = _about(out) if path.exists() else None
    if found is None or not lines.exists() or not lines.stat().st_size:
        write_json(path, about)
    elif found.get("field_hash") != field.hash:
        raise UserError(
            f"results {out}: hold lines of {found.get('field')} with {found.get('matches')} matches, or of "
            f"another version of it, not of {name} with {field.matches}; choose another folder"
        )


def _about(folder: Path) -> dict[str, Any]:
    """What a results folder says of itself; raises UserError where it does not say what it should."""
    about = read_json(folder / ABOUT, "results")
    if not isinstance(about.get("field"), str) or not isinstance(about.get("matches"), int):
        raise UserError(
            f"results {folder}: {ABOUT} names no field; it is of an older protocol: evaluate again into "
            "another folder"
        )
    if not isinstance(about.get("made", {}), dict):
        raise UserError(f"results {folder}: {ABOUT}: made: expected a mapping, got {about['made']!r:.40}")
    return about


def _claim_names(out: Path, entries: Sequence[Entry]) -> None:
    """Say in a folder how the agents of each name were made.

    Raises:
        UserError: it holds agents of a name that were made otherwise.
    """
    about = _about(out)
    made = dict(about.get("made", {}))
    for entry in entries:
        if entry.made is not None and made.setdefault(entry.name, entry.made) != entry.made:
            raise UserError(
                f"results {out}: hold {entry.name!r} with another budget, other hyper-parameters or other "
                "opponents; say --name to call this one otherwise"
            )
    write_json(out / ABOUT, about | {"made": made})


def _missing(entries: Sequence[Entry], field: Field, file: RowFile) -> Iterator[tuple[Entry, Counterpart]]:
    """Who has not met whom yet.

    Raises:
        UserError: the file holds lines of another field, or of another player under the same name.
    """
    known = {}
    for line in lines_of(file):
        if line.field_hash != field.hash[:16]:
            raise UserError(
                f"lines {file.path}: hold some of another field ({line.field}); choose another folder"
            )
        known[line.entry, line.training_seed, line.counterpart] = line.fingerprint
    for entry in entries:
        for counterpart in field.counterparts:
            found = known.get((entry.name, entry.training_seed, counterpart.name))
            if found is None:
                yield entry, counterpart
            elif found != entry.fingerprint[:16]:
                raise UserError(
                    f"lines {file.path}: hold lines of another {entry.name!r} (another policy, or its file "
                    "has changed); give this one another name or write to another folder"
                )


def _job(entry: Entry, field: Field, counterpart: Counterpart, file: RowFile) -> Job:
    seed = "" if entry.training_seed is None else f"/seed_{entry.training_seed}"
    name = f"{entry.name}{seed} - {counterpart.name}"
    return Job(name, partial(play, entry, field, counterpart), lambda line: file.append([line.row()]))
