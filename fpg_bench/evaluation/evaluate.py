"""Evaluation of entries on a suite into a results folder, and the summaries of the folder."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import tempfile
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pydantic

from fpg_bench.common.checks import integer, mapping
from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import as_path, check_writable, read_json, write_json
from fpg_bench.common.locks import own_folder
from fpg_bench.common.parallel import Workers
from fpg_bench.common.products import load
from fpg_bench.common.schema import PositiveInt, Strict, parse
from fpg_bench.evaluation.entry import MADE, EvaluatedPlayer, check_kept, check_seeds, entries_of, is_nameless
from fpg_bench.evaluation.rounds import Players
from fpg_bench.evaluation.store import RECORDS, Pairing, Progress, Store, pairings
from fpg_bench.evaluation.suite import PLANNER, Suite, load_suite, read_suite
from fpg_bench.evaluation.summary import Summary, TrainingCost, summarise
from fpg_bench.evaluation.table import Results
from fpg_bench.players.planner import asks_language_model
from fpg_bench.players.player import PlayerSpec

ABOUT = "evaluation.json"  # beside a results folder's records
_LOOP = 3  # evaluations of a live model by one name on one suite that look like a training loop
_live: Counter[tuple[str, str]] = Counter()
_logger = logging.getLogger(__name__)


def evaluate(
    players: Sequence[PlayerSpec] | Mapping[str, Players],
    suite: str = "ally-v2",
    out: str | Path | None = None,
    *,
    matches: int | None = None,
    progress: Progress = lambda entry, rival, rounds, done, total: None,
    workers: Workers | int = 1,
    allow: Collection[str] = (),
    reuse: bool = False,
    planner_options: Mapping[str, Any] = MappingProxyType({}),
) -> Results:
    """Evaluate players on a suite; records that the folder has already are not played again.

    Players of code (``package.module:object``) are, as what they read from elsewhere may have changed.

    The matches are held out: a training loop scores itself by :class:`fpg_bench.PolicyEvaluator`.

    >>> results = evaluate({"mine": "expert", "still": "idle"}, "ally-v2", matches=1)
    >>> [each.entry for each in results]
    ['mine', 'still']

    Args:
        players: names by the one grammar of players, ``all-scripted``, or anything with ``predict``; for a
            suite of planners, these. Agents that differ by their training seed alone become one entry. In a
            mapping, each key names an entry, and its value is a player or a list of agents.
        suite: a suite's name or YAML file.
        out: the results folder; ``records.jsonl`` grows by one record per rival. None: nothing is kept.
        matches: per rival and training seed; None: the suite's own.
        progress: called before each matchup and after each of its rounds, if there is one job, with the
            player, the rival, the rounds played of this matchup, those of all matchups, and their total.
        workers: number of matchups that are played at once, or :class:`fpg_bench.common.parallel.Workers`;
            the records are the same, in another order.
        allow: the code and agents of the Hub that the suite's file may name; see
            :func:`fpg_bench.evaluation.suite.load_suite`.
        reuse: keep the folder's records of players of code, and those against rivals of code, if the sources
            are the same. The table says from when they are.
        planner_options: options of language models that plan, by name. Their caps hold for all rivals
            together; answers are recorded in the folder's ``transcripts``, and played again from
            ``transcripts``.

    Returns:
        The summaries of all entries in the folder, best first, with ``table()`` and ``dataframe()``.

    Raises:
        UserError: an unknown player or suite, a player of the wrong side, a folder that holds other files or
            another suite's records, one with records against rivals of code that may not be reused, or a
            folder for players without a name to recognize them by.
    """
    played = with_matches(load_suite(suite, allow=allow), matches)
    kept = None if out is None else as_path(out, "out")
    with tempfile.TemporaryDirectory() if kept is None else contextlib.nullcontext(kept) as folder:
        entries = _entries(players, played, Path(folder), planner_options, workers)
        if kept is not None:
            check_writable(kept)
            check_kept(entries)
        _warn_of_loop(entries, played)
        return play_into(Path(folder), suite, played, entries, progress, workers, reuse)


def _entries(
    players: Any, suite: Suite, folder: Path, planner_options: Mapping[str, Any], workers: Workers | int
) -> list[EvaluatedPlayer]:
    """Return the entries of players; of language models that plan with their transcripts in the folder."""
    asked: list[str] = []
    if suite.side == PLANNER and isinstance(players, list | tuple):
        asked = [each for each in players if isinstance(each, str) and asks_language_model(each)]
        players = [each for each in players if each not in asked]
    if not asked and not mapping(planner_options, "planner_options"):
        return entries_of(players, suite)
    if asked and not Workers.of(workers).is_alone:
        raise UserError("n_jobs: one process asks a language model, several questions at once by concurrency")
    others = entries_of(players, suite) if players else []
    taken = [each.name for each in others]
    asking: list[EvaluatedPlayer] = load("language_model", "entries")(
        asked, suite, folder, planner_options, taken
    )
    return others + asking


def _warn_of_loop(entries: Sequence[EvaluatedPlayer], suite: Suite) -> None:
    """Warn once a process if a live model is evaluated again and again, as training loops do."""
    already = max(_live.values(), default=0) >= _LOOP
    _live.update((entry.name, suite.name) for entry in entries if is_nameless(entry))
    if not already and max(_live.values(), default=0) >= _LOOP:
        _logger.warning(
            "evaluate plays held-out evaluation seeds, for results alone; in a training loop use "
            "fpg_bench.PolicyEvaluator or fpg_bench.log_evaluation, which play tuning seeds"
        )


def play_into(
    out: Path,
    name: str,
    suite: Suite,
    entries: Sequence[EvaluatedPlayer],
    progress: Progress = lambda entry, rival, rounds, done, total: None,
    workers: Workers | int = 1,
    reuse: bool = False,
) -> Results:
    """Play entries against a suite into a results folder; raises as :func:`evaluate` does.

    Args:
        out: the folder.
        name: the suite's name or YAML file.
        suite: that suite.
        entries: the entries to measure.
        progress: see :func:`evaluate`.
        workers: see :func:`evaluate`.
        reuse: see :func:`evaluate`.
    """
    check_seeds(entries)
    store, wanted = Store(out / RECORDS), pairings(entries, suite)
    with own_folder(out, ABOUT, "results"):
        _claim(out, name, suite, wanted, store, reuse)
        store.fill(wanted, progress=progress, workers=workers)
    return _summaries(out, suite)


def _summaries(folder: Path, suite: Suite) -> Results:
    """Return the summaries of a folder's records, with the cost of agents' training where it is known."""
    summaries = summarise(Store(folder / RECORDS).records(), suite)
    about = _about(folder)
    return Results(
        dataclasses.replace(each, training=_training(about, each), played=about.played.get(each.entry))
        for each in summaries
    )


def _training(about: _ResultsFile, summary: Summary) -> TrainingCost:
    by_seed = about.training.get(summary.entry, {})
    elsewhere, is_search = (summary.entry in names for names in (about.elsewhere, about.searched))
    known = [by_seed.get(str(seed), {}) for seed in summary.seed_scores()]
    steps = [cost["steps"] for cost in known if "steps" in cost]
    seconds = [cost["seconds"] for cost in known if "seconds" in cost]
    if not steps:
        return TrainingCost(elsewhere=elsewhere, is_search=is_search)
    mean = sum(seconds) / len(seconds) if len(seconds) == len(known) else None
    return TrainingCost(round(sum(steps) / len(steps)), mean, elsewhere, is_search)


def read_results(folder: str | Path) -> tuple[Results, Suite]:
    """Return the summaries of a results folder, and its suite, whose players are not loaded.

    Raises:
        UserError: not a results folder, or one of another version of its suite.
    """
    folder = Path(folder)
    about = _about(folder)
    suite = with_matches(read_suite(about.suite), about.matches)
    if suite.hash != about.suite_hash:
        raise UserError(f"results {folder}: played under another version of {about.suite}; evaluate again")
    return _summaries(folder, suite), suite


def with_matches(suite: Suite, matches: int | None) -> Suite:
    """Return the suite with another number of matches; raises UserError for an invalid number."""
    return suite if matches is None else dataclasses.replace(suite, matches=integer(matches, "matches"))


class _ResultsFile(Strict):
    """Content of ``evaluation.json``: the suite, the making and the cost of agents, and when code played."""

    suite: str
    suite_hash: str
    matches: PositiveInt
    made: dict[str, str] = pydantic.Field(default_factory=dict)
    training: dict[str, dict[str, dict[str, int | float]]] = pydantic.Field(default_factory=dict)
    elsewhere: list[str] = pydantic.Field(default_factory=list)
    searched: list[str] = pydantic.Field(default_factory=list)
    played: dict[str, str] = pydantic.Field(default_factory=dict)


def _claim(out: Path, name: str, suite: Suite, wanted: Sequence[Pairing], store: Store, reuse: bool) -> None:
    """Write into a folder the suite of its records, and how its agents were made and at what cost.

    Records of players of code are dropped unless they may be reused.

    Raises:
        UserError: it holds records of another suite, or differently made agents of one of these names, or
            records against rivals of code that may not be reused.
    """
    about = _ResultsFile(suite=name, suite_hash=suite.hash, matches=suite.matches)
    if (out / ABOUT).exists():
        known = _about(out)
        if (records := out / RECORDS).exists() and records.stat().st_size:
            about = known
    if about.suite_hash != suite.hash:
        raise other_content(
            f"results {out}",
            f"records of {about.suite} with {about.matches} matches, or of another version of it, not of "
            f"{name} with {suite.matches}",
        )
    if suite.code and not reuse and store.records():
        raise other_content(
            f"results {out}",
            f"records against code ({', '.join(suite.code)}), which may have changed since",
            "add --reuse to keep them",
        )
    entries = [pairing.entry for pairing in wanted]
    replayed = set() if reuse else {entry.name for entry in entries if entry.is_code} & about.played.keys()
    for player in replayed:
        del about.played[player]
    for entry in entries:
        if entry.is_code or suite.code:
            about.played.setdefault(entry.name, f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")
        if entry.made is not None:
            before = about.made.get(entry.name, "")
            if before.startswith(MADE) and before != entry.made:
                raise UserError(
                    f"results {out}: hold {entry.name!r} with another budget, other hyper-parameters or "
                    "other opponents; give this one another name: NAME=PLAYER"
                )
            about.made[entry.name] = entry.made
        if entry.training:
            about.training.setdefault(entry.name, {})[str(entry.training_seed)] = entry.training
        if entry.elsewhere and entry.name not in about.elsewhere:
            about.elsewhere.append(entry.name)
        if entry.is_search and entry.name not in about.searched:
            about.searched.append(entry.name)
    store.claim(wanted, replayed)
    empty = {key for key in ("training", "elsewhere", "searched", "played") if not getattr(about, key)}
    write_json(out / ABOUT, about.model_dump(exclude=empty))


def _about(folder: Path) -> _ResultsFile:
    """Return the description of a results folder; raises UserError for a damaged one."""
    if not (folder / ABOUT).exists() and (folder / "run.json").is_file():
        raise UserError(
            f"results {folder}: is a training run without results; play it first: "
            f"fpg-bench evaluate {folder} --out DIR"
        )
    if not (folder / ABOUT).exists():
        raise UserError(
            f"results {folder}: there are none; make them first: fpg-bench evaluate PLAYERS --out {folder}"
        )
    content = read_json(folder / ABOUT, "results")
    try:
        return parse(_ResultsFile, content, f"results {folder}: {ABOUT}")
    except UserError as error:
        raise UserError(f"{error}; evaluate again into another folder") from error
