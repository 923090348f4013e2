"""Checks of submitted transcripts of a language model; no model is asked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from string import Template

import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import PACKED, read_json
from fpg_bench.common.rows import Row
from fpg_bench.common.schema import parse
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import Suite
from fpg_bench.players.planner import Limits
from fpg_bench.products.language_models.comparison import (
    ABOUT,
    PROMPT,
    nonce_of,
    transcript_file,
    transcript_name,
)
from fpg_bench.products.language_models.llm_planner import request_problem
from fpg_bench.products.language_models.prompts import CONTROLS, Prompt, load_prompt
from fpg_bench.products.language_models.transcript import FIRST, LAST, Attempt, RunHeader, Where, packed_rows
from fpg_bench.products.leaderboard.folders import folder_problem, list_names
from fpg_bench.products.leaderboard.season_keys import current_season, season_seed

FOLDER = "transcripts"
LARGEST_FOLDER = 10_000_000  # bytes, as it lies in the repository; a terse model's is 0.1 MB
_LARGEST = {ABOUT: 10_000, PROMPT: 16_000}
_MOST_REPEATS = 2  # of the history in a prompt: more would make one that fills the memory
_LONGEST_NAME = 100
_LIMITS = {"seconds": 1e7, "calls": 1e4, "tokens_in": 1e9, "tokens_out": 1e9}
_RAW_CUT = 10_000  # characters that are kept of a long raw reply


def check_transcripts(folder: Path, suite: Suite) -> list[str]:
    """Return the problems of a submission's transcripts, one line each.

    Whether the prompts match the game is checked only when the transcripts are replayed.

    Args:
        folder: the submission's folder.
        suite: the suite that was to be played.
    """
    where = folder / FOLDER
    if problems := list(_file_problems(where, suite)):
        return problems
    try:
        about, _ = read_recording(folder, suite)
    except UserError as error:
        return [local(error, folder)]
    for ally in suite.rivals:
        try:
            _check_transcript(transcript_file(where, ally.name), about, suite)
        except UserError as error:
            problems.append(local(error, folder))
    return problems


def local(error: Exception, folder: Path) -> str:
    """Return an error's text in one line, with file names relative to the submission's folder."""
    return " ".join(str(error).replace(f"{folder}/", "").split())


def read_recording(folder: Path, suite: Suite) -> tuple[RunHeader, Prompt]:
    """Return the contents of ``planner.json`` of a submission, and the prompt of its transcripts.

    Args:
        folder: the submission's folder.
        suite: the suite that was played.

    Raises:
        UserError: they cannot be read, or are of other matches or another prompt.
    """
    file = folder / FOLDER / PROMPT
    about = _about(folder / FOLDER / ABOUT, suite)
    _check_plain(file)
    prompt = load_prompt(str(file))
    if prompt.hash != about.prompt_hash:
        raise UserError(f"{file}: does not match the prompt_hash in {ABOUT}")
    _check_nonce(folder / FOLDER / ABOUT, about)
    return about, prompt


# Files


def _file_problems(where: Path, suite: Suite) -> Iterator[str]:
    if problem := folder_problem(where):
        yield f"{FOLDER}: {problem}; it holds what evaluate has recorded"
        return
    needed = [transcript_name(ally.name) for ally in suite.rivals]
    known = {*_LARGEST, *needed, *(name + PACKED for name in needed)}
    size = 0
    for path in (where / name for name in list_names(where)):
        if path.is_dir() and not path.is_symlink():
            yield f"{FOLDER}/{path.name!r:.60}: is a folder; put the files into {FOLDER} itself"
        elif path.is_symlink() or not path.is_file():
            yield f"{FOLDER}/{path.name!r:.60}: not a plain file"
        elif path.name not in known:
            yield f"{FOLDER}/{path.name!r:.60}: does not belong here"
        elif (large := path.stat().st_size) > (most := _LARGEST.get(path.name, LARGEST_FOLDER)):
            yield f"{FOLDER}/{path.name}: {large:,} bytes, more than {most:,}; pack transcripts by gzip -9"
        else:
            size += large
    if size > LARGEST_FOLDER:
        yield f"{FOLDER}: {size:,} bytes, more than {LARGEST_FOLDER:,}; pack transcripts by gzip -9"
    for name in [*_LARGEST, *needed]:
        there = [path for path in (where / name, where / f"{name}{PACKED}") if path.exists()]
        if len(there) != 1:
            yield f"{FOLDER}/{name}: {'is missing' if not there else 'is there both packed and unpacked'}"


def _about(file: Path, suite: Suite) -> RunHeader:
    about = parse(RunHeader, read_json(file, FOLDER), str(file))
    for key in ("model", "server", "prompt_hash", "begun"):
        if len(getattr(about, key)) > _LONGEST_NAME:
            raise UserError(f"{file}: {key}: expected a line of at most {_LONGEST_NAME} characters")
    if about.control not in CONTROLS:
        raise UserError(f"{file}: control: expected one of {', '.join(CONTROLS)}")
    if about.suite_hash != suite.hash:
        asked = f"--suite {suite.name} --matches {suite.matches}"
        raise UserError(f"{file}: is of other matches; record those of evaluate {asked}")
    return about


def _check_nonce(file: Path, about: RunHeader) -> None:
    """Raise UserError if the nonce does not show that the run began after a season was closed.

    Runs that began before the first season have no nonce.
    """
    current, number = current_season(), about.season
    if number is None and about.nonce is None:
        return
    if number is None or current is None or not 1 <= number <= current.number:
        raise UserError(f"{file}: season: expected the number of a closed one, got {number!r:.40}")
    if about.nonce != nonce_of(about, season_seed(number)):
        raise UserError(f"{file}: nonce: does not follow from the seed of season {number} and what was asked")


def _check_plain(file: Path) -> None:
    """Raise UserError for a prompt that expands to far more text than it holds."""
    text = file.read_bytes()
    try:
        repeated = any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.SafeLoader))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise UserError(f"{file}: not valid YAML: {error}") from error
    names = [match.group() for match in Template.pattern.finditer(text.decode("utf-8", "replace"))]
    if repeated:
        raise UserError(f"{file}: holds an alias (*name); write out what it stands for")
    for word in ("history", "rounds"):
        if sum(word in name for name in names) > _MOST_REPEATS:
            raise UserError(f"{file}: uses ${word} more than {_MOST_REPEATS} times")


# Attempts


def _check_transcript(file: Path, about: RunHeader, suite: Suite) -> None:
    """Check that a transcript holds exactly the attempts at the plans of its matches."""
    attempts: dict[Where, Attempt] = {}
    rows, limits = packed_rows(file), Limits.of(suite.scenario)
    for number, row in enumerate(rows, 1):
        where = f"transcript {file}: line {number}"
        attempt = _attempt(row, where)
        _check_made(attempt, row, about, where)
        if problem := request_problem(attempt, about, limits):
            raise UserError(f"{where} {problem}")
        if attempts.setdefault(attempt.where, attempt) is not attempt:
            raise UserError(f"{where} is another attempt at what was asked before{_at(attempt.where)}")
    plans = [
        (seed, 0, k)
        for seed in evaluation_seeds(suite.matches, suite.season)
        for k in range(suite.rounds_per_match)
    ]
    expected: set[Where] = {(*plan, FIRST) for plan in plans}
    if lacking := sorted(expected - attempts.keys()):
        raise UserError(f"transcript {file}: lacks {len(lacking)} of {len(plans)} plans{_at(lacking[0])}")
    again = {(*plan, LAST) for plan in plans if attempts[*plan, FIRST].asks_again}
    if lacking := sorted(again - attempts.keys()):
        raise UserError(f"transcript {file}: lacks the second attempt{_at(lacking[0])}")
    if extra := sorted(attempts.keys() - expected - again):
        raise UserError(f"transcript {file}: holds an attempt that nothing asks for{_at(extra[0])}")


def _at(where: Where) -> str:
    return f": seed {where[0]}, match {where[1]}, round {where[2]}, attempt {where[3]}"


def _attempt(row: Row, where: str) -> Attempt:
    if row.get("kind") != "attempt":
        raise UserError(f"{where} is not an attempt; a transcript has no other rows")
    attempt = Attempt.read(row, where)
    for name in ("seed", "match", "round", "attempt", *_LIMITS):
        value = getattr(attempt, name)
        if isinstance(value, bool) or (value is not None and not 0 <= value <= _LIMITS.get(name, math.inf)):
            raise UserError(f"{where}: {name}: {value!r:.40} is not possible")
    try:
        changed = attempt.changed_field(row.get("raw"))
        own_key = row.get("key") == attempt.key
    except (RecursionError, ValueError) as error:
        raise UserError(f"{where} is too deep to be read") from error
    if changed:
        raise UserError(f"{where} is changed: its {changed} is not what its raw reply says")
    if not own_key:
        raise UserError(f"{where} is changed: its key does not match its request")
    return attempt


def _check_made(attempt: Attempt, row: Row, about: RunHeader, where: str) -> None:
    """Check that an attempt was made as ``planner.json`` says, and shows its request and reply."""
    unasked = attempt.error == "budget" and attempt.text is None
    if attempt.request is None and not unasked:
        raise UserError(f"{where} does not show what was asked")
    if attempt.request is not None and not {"model", "messages"} <= attempt.request.keys():
        raise UserError(f"{where} does not show the model and messages of its request")
    model = about.model if attempt.request is None else attempt.request["model"]
    made = {"model": model, "prompt_hash": attempt.prompt_hash, "control": attempt.control}
    for name, value in made.items():
        if value != (stated := getattr(about, name)):
            raise UserError(f"{where} was made with {name} {value!r:.60}, and not {stated!r:.60}")
    raw = row.get("raw")
    is_shown = isinstance(raw, dict) or (isinstance(raw, str) and len(raw) == _RAW_CUT)
    if attempt.text is not None and not is_shown:
        raise UserError(f"{where} does not show the raw reply")
    choices = raw.get("choices") if isinstance(raw, dict) else None
    if isinstance(choices, list) and len(choices) > 1:
        raise UserError(f"{where} was answered {len(choices)} times at once; one answer is asked for")
