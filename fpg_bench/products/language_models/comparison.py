"""Language models that plan in evaluations: recorded, described and replayed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import PACKED, read_json, write_json, write_whole
from fpg_bench.common.products import load, offered
from fpg_bench.common.schema import parse
from fpg_bench.evaluation.entry import EvaluatedPlayer
from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.planner import PLANNERS
from fpg_bench.products.language_models.budget import CallBudget
from fpg_bench.products.language_models.llm_planner import LLM_CONTROLS, LLMPlanner, check_asked
from fpg_bench.products.language_models.options import EvaluationOptions
from fpg_bench.products.language_models.prompts import Prompt, load_prompt, prompt_file
from fpg_bench.products.language_models.servers import endpoint_from_environment
from fpg_bench.products.language_models.transcript import Header, RunHeader, Transcript

TRANSCRIPTS = "transcripts"  # in a results folder
ABOUT, PROMPT = "planner.json", "prompt.yml"  # beside a planner's transcripts, one per ally
_SAMPLING = ("temperature", "sampling_seed")
_DECIDING = ("model", "control", "prompt_hash", *_SAMPLING)
_CAPS = ("calls", "tokens", "seconds")


def entries(
    names: Sequence[str], suite: Suite, out: Path, options: Mapping[str, Any], taken: Collection[str]
) -> list[EvaluatedPlayer]:
    """Return the entries of language models, recorded in a results folder, and of those in other transcripts.

    Args:
        names: the planners that ask.
        suite: the suite that they will meet.
        out: the results folder; recorded answers are not asked again.
        options: the attributes of :class:`EvaluationOptions`.
        taken: names of the other planners.

    Raises:
        UserError: no endpoint, no such prompt, a folder with transcripts of another model or prompt, options
            and no planner that asks, or transcripts that do not hold these matches.
    """
    asking = {key: value for key, value in options.items() if key != "transcripts"}
    check_asked(bool(names), asking)
    llm = EvaluationOptions.of(options)
    recorded = [_recorded_entry(name, suite, out / TRANSCRIPTS / name, llm) for name in names]
    if llm.transcripts is None:
        return recorded
    return recorded + _replayed_entries(Path(llm.transcripts), suite, [*taken, *names])


def _recorded_entry(name: str, suite: Suite, folder: Path, llm: EvaluationOptions) -> EvaluatedPlayer:
    control, endpoint = LLM_CONTROLS[name], endpoint_from_environment(llm.server)
    prompt, season = llm.prompt or endpoint.server.prompt, _current_season()
    content = {
        "model": endpoint.model,
        "server": endpoint.server.name,
        "control": control,
        "prompt": prompt,
        "prompt_hash": load_prompt(prompt).hash,
        "temperature": endpoint.server.temperature if llm.temperature is None else llm.temperature,
        "sampling_seed": llm.sampling_seed or 0,
        "suite": suite.name,
        "suite_hash": suite.hash,
        "matches": suite.matches,
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
        "season": None if season is None else season.number,
        "nonce": None,
    }
    about = parse(RunHeader, content, f"planner {name}")
    if season is not None:
        about = about.model_copy(update={"nonce": nonce_of(about, season.seed)})
    arguments = llm.arguments()
    budget = _budget(folder, {cap: arguments.pop(cap) for cap in _CAPS if cap in arguments})

    def make(ally: Rival) -> LLMPlanner:
        _claim(folder, about, suite)
        planner = LLMPlanner(
            suite.scenario,
            endpoint,
            transcript=folder / transcript_name(ally.name),
            mode="record",
            **arguments | {"prompt": prompt, "control": control},
        )
        planner.budget = budget
        return planner

    return EvaluatedPlayer(name, None, _fingerprint(about), make)


def _replayed_entries(folder: Path, suite: Suite, taken: Collection[str]) -> list[EvaluatedPlayer]:
    """Return the language models whose transcripts are in the subfolders of a folder; no server is asked."""
    folders = sorted(path.parent for path in folder.glob(f"*/{ABOUT}"))
    if not folders:
        raise UserError(f"transcripts {folder}: hold no planner; name an evaluation's folder transcripts")
    for path in folders:
        if path.name in taken:
            raise UserError(f"transcripts {path}: another planner here has this name; rename the folder")
        if path.name in PLANNERS and path.name not in LLM_CONTROLS:
            raise UserError(f"transcripts {path}: a planner of the package has this name; rename the folder")
    return [_replayed_entry(path, suite) for path in folders]


def _replayed_entry(folder: Path, suite: Suite) -> EvaluatedPlayer:
    about, prompt = read_header(folder), load_prompt(str(folder / PROMPT))
    _check_suite(folder, about, suite)
    if prompt.hash != about.prompt_hash:
        raise UserError(f"transcripts {folder}: its {PROMPT} is not the prompt that was recorded")

    def make(ally: Rival) -> LLMPlanner:
        return replaying(suite.scenario, prompt, about, transcript_file(folder, ally.name))

    return EvaluatedPlayer(folder.name, None, _fingerprint(about), make)


def _current_season() -> Any:
    """Return the newest season's number and seed, where seasons are; otherwise None."""
    return load("language_model", "season")() if "season" in offered("language_model") else None


def nonce_of(about: RunHeader, season_seed: str) -> str:
    """Return a hash of a season's seed and of a run's description, which nobody knew before the season."""
    words = [season_seed, about.model, about.control, about.prompt_hash, about.suite_hash]
    return hashlib.sha256("/".join(words).encode()).hexdigest()


def _claim(folder: Path, about: RunHeader, suite: Suite) -> None:
    """Write the description and the prompt beside transcripts; refuse those of another planner."""
    if any(path.stat().st_size for path in folder.glob("*.jsonl")):
        known = read_header(folder)
        _check_suite(folder, known, suite)
        for key in _DECIDING:
            before, now = getattr(known, key), getattr(about, key)
            if key in known.model_fields_set and before != now:
                raise other_content(
                    f"transcripts {folder}", f"answers recorded with {key} {before}, not {now}"
                )
        return
    if (folder / ABOUT).exists():  # the run was begun with another ally, and nothing was answered yet
        known = read_header(folder)
        if all(getattr(known, key) == getattr(about, key) for key in (*_DECIDING, "suite_hash")):
            return
    write_whole(folder / PROMPT, prompt_file(about.prompt).read_bytes())
    write_json(folder / ABOUT, about.to_dict())


def _check_suite(folder: Path, about: RunHeader, suite: Suite) -> None:
    """Raise UserError if transcripts are not of the suite's matches."""
    if about.suite_hash != suite.hash:
        raise UserError(
            f"transcripts {folder}: hold matches of another suite, {about.suite!r} with "
            f"{about.matches} matches per ally; evaluate them with its --suite and --matches"
        )


def read_header(folder: Path) -> RunHeader:
    """Read the description of a run beside its transcripts; raises UserError for anything else."""
    file = folder / ABOUT
    return parse(RunHeader, read_json(file, "transcripts"), f"transcripts {file}")


def _fingerprint(about: RunHeader) -> str:
    given = about.to_dict()
    values = [given[key] for key in _DECIDING if key in given]
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()


def _budget(folder: Path, caps: Mapping[str, float]) -> CallBudget:
    """Return one budget for all allies, less what the recorded attempts have used."""
    budget = CallBudget(**caps)
    recorded = [Transcript(path, "replay") for path in sorted(folder.glob("*.jsonl"))]
    attempts = (attempt for transcript in recorded for attempt in transcript.attempts())
    budget.resume(attempts, f"transcripts {folder}")
    return budget


def transcript_name(ally: str) -> str:
    """Return the name of the transcript of the matches against an ally, whose own name may be a path."""
    return f"{ally.replace('/', '-').replace(':', '-')}.jsonl"


def transcript_file(folder: Path, ally: str) -> Path:
    """Return a folder's transcript of the matches against an ally; the packed one if there is no other."""
    plain = folder / transcript_name(ally)
    packed = plain.with_name(plain.name + PACKED)
    return packed if packed.exists() and not plain.exists() else plain


def replaying(scenario: Scenario, prompt: Prompt, header: Header, transcript: Path) -> LLMPlanner:
    """Return a language model's planner that takes its answers from a transcript; no server is asked.

    Args:
        scenario: what is played.
        prompt: the prompt that was recorded.
        header: that with which every attempt must have been made.
        transcript: the file.

    Raises:
        UserError: an attempt was made with another model, prompt or control.
    """
    planner = LLMPlanner(
        scenario, prompt=prompt, control=header.control, transcript=transcript, mode="replay"
    )
    planner.transcript.check_header(header)
    return planner
