"""Comparison of planners against a suite of allies, language models recorded and replayed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import PACKED, read_json, write_json, write_whole
from fpg_bench.evaluation.entry import Entry, planner_entry
from fpg_bench.evaluation.evaluate import Progress, play_into, with_matches
from fpg_bench.evaluation.match import asks_llm, replaying
from fpg_bench.evaluation.seeds import SeasonKey, current_season
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite, load_suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.planning import LLM_CONTROLS, PLANNERS
from fpg_bench.planning.llm.budget import Budget
from fpg_bench.planning.llm.llm_planner import LLMPlanner
from fpg_bench.planning.llm.prompts import load_prompt, prompt_file
from fpg_bench.planning.llm.servers import endpoint_from_environment
from fpg_bench.planning.llm.transcript import Transcript, chain_start

ALL = "all"
TRANSCRIPTS = "transcripts"  # of language models, in a results folder


def compare(
    planners: Sequence[Any] = (ALL,),
    suite: str = "planner-v1",
    out: str | Path = "comparison",
    *,
    matches: int | None = None,
    transcripts: str | Path | None = None,
    llm: Mapping[str, Any] | None = None,
    progress: Progress = lambda entry, rival, rounds: None,
) -> list[Summary]:
    """Play planners against a suite of allies; what is in the folder already is not played again.

    Args:
        planners: planners or their names; ``all``: all that ask no language model; ``llm``,
            ``llm-shuffled-rewards``, ``llm-no-history``: the model that the environment names, recorded in
            the folder's ``transcripts``.
        suite: a suite's name or YAML file.
        out: the results folder; ``records.jsonl`` grows as allies are met.
        matches: per ally; None: the suite's own.
        transcripts: a folder of transcripts; each planner in it is one more, replayed without a server.
        llm: options of :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`, whose caps hold for all
            allies together, and ``server``, the profile of its endpoint.
        progress: called before each meeting and after each of its rounds.

    Returns:
        The summaries of all planners in the folder, best first.

    Raises:
        UserError: something unknown, a folder that holds another suite's lines, no language model where one
            is named, or one that is of no use, options for one where none is, or transcripts that do not
            hold these matches.
    """
    out = Path(out)
    played = with_matches(load_suite(suite, side=PLANNER), matches)
    ordinary = [name for name in PLANNERS if not asks_llm(name)]
    named = [spec for named in planners for spec in (ordinary if named == ALL else [named])]
    named = [spec for k, spec in enumerate(named) if spec not in named[:k]]
    if llm and not any(map(asks_llm, named)):
        raise UserError(f"{next(iter(llm))}: is for the planners {', '.join(LLM_CONTROLS)}; name one of them")
    entries: list[Entry] = [
        asked(spec, played, out / TRANSCRIPTS / spec, llm or {})
        if asks_llm(spec)
        else planner_entry(spec, played)
        for spec in named
    ]
    if transcripts is not None:
        entries += replayed(Path(transcripts), played, [entry.name for entry in entries])
    return play_into(out, suite, played, entries, progress)


ABOUT, PROMPT = "planner.json", "prompt.yml"  # lie beside a planner's transcripts, one for each ally
_DECIDING = ("model", "control", "prompt_hash")
_SAMPLING = ("temperature", "sampling_seed")
_CAPS = ("calls", "tokens", "seconds")


def asked(name: str, suite: Suite, folder: Path, options: Mapping[str, Any]) -> Entry:
    """A language model that is asked and recorded; what its transcripts hold is not asked again.

    Args:
        name: one of ``LLM_CONTROLS``.
        suite: what it will play.
        folder: where its transcripts grow.
        options: those of :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`, whose caps hold for all
            allies together, and ``server``, the profile of its endpoint.

    Raises:
        UserError: no endpoint, no such prompt, or a folder with transcripts of another model or prompt.
    """
    control, rest = LLM_CONTROLS[name], dict(options)
    endpoint = endpoint_from_environment(rest.pop("server", None))
    prompt = rest.pop("prompt", endpoint.server.prompt)
    about: dict[str, Any] = {"model": endpoint.model, "server": endpoint.server.name, "control": control}
    about |= {"prompt": prompt, "prompt_hash": load_prompt(prompt).hash}
    about |= {"temperature": rest.get("temperature", endpoint.server.temperature)}
    about |= {"sampling_seed": rest.get("sampling_seed", 0)}
    about |= {"suite": suite.name, "suite_hash": suite.hash, "matches": suite.matches}
    about |= begun(about)
    budget = _budget(folder, {cap: rest.pop(cap) for cap in _CAPS if cap in rest})

    def make(ally: Rival) -> LLMPlanner:
        header = _claimed(folder, about, suite)
        path = folder / transcript_name(ally.name)
        planner = LLMPlanner(
            suite.scenario,
            endpoint,
            prompt=prompt,
            control=control,
            transcript=path,
            mode="record",
            chain=chain_of(header, ally.name),
            **rest,
        )
        planner.budget = budget
        return planner

    return Entry(name, None, _fingerprint(about), make, LLMPlanner.tier)


def replayed(folder: Path, suite: Suite, taken: Collection[str] = ()) -> list[Entry]:
    """The language models whose transcripts lie in a folder, as they were recorded; no server is asked.

    Args:
        folder: holds a folder for each planner, whose name is what rows call it.
        suite: what they played.
        taken: the names of the other planners under comparison.

    Raises:
        UserError: no transcripts there, those of another suite, or a planner by the name of another.
    """
    found = sorted(path.parent for path in folder.glob(f"*/{ABOUT}"))
    if not found:
        raise UserError(f"transcripts {folder}: hold no planner; name the folder transcripts of a comparison")
    for path in found:
        if path.name in taken:
            raise UserError(f"transcripts {path}: another planner here has this name; rename the folder")
        if path.name in PLANNERS and path.name not in LLM_CONTROLS:
            raise UserError(f"transcripts {path}: a planner of the package has this name; rename the folder")
    return [_replayed(path, suite) for path in found]


def _replayed(folder: Path, suite: Suite) -> Entry:
    about, prompt = _about(folder), load_prompt(str(folder / PROMPT))
    _check_suite(folder, about, suite)
    if prompt.hash != about["prompt_hash"]:
        raise UserError(f"transcripts {folder}: its {PROMPT} is not the prompt that was recorded")

    def make(ally: Rival) -> LLMPlanner:
        recorded, chain = transcript_file(folder, ally.name), chain_of(about, ally.name)
        return replaying(suite.scenario, prompt, about, recorded, chain)

    return Entry(folder.name, None, _fingerprint(about), make, LLMPlanner.tier)


def begun(about: Mapping[str, Any]) -> dict[str, Any]:
    """When a run begins, and what nobody could write before the present season's seed was known.

    Args:
        about: what the run is told of.
    """
    season = current_season()
    header = {"begun": datetime.now(UTC).isoformat(timespec="seconds")}
    return {**header, "season": None, "nonce": None} if season is None else header | nonce_of(about, season)


def nonce_of(about: Mapping[str, Any], season: SeasonKey) -> dict[str, Any]:
    """The season's number, and a hash of its seed and of what is asked whom."""
    words = [season.seed, *(about[key] for key in (*_DECIDING, "suite_hash"))]
    return {"season": season.number, "nonce": hashlib.sha256("/".join(words).encode()).hexdigest()}


def chain_of(about: Mapping[str, Any], ally: str) -> str | None:
    """Return the first hash of the transcript's chain; None for recordings without a chain."""
    return chain_start(about, transcript_name(ally)) if "nonce" in about else None


def _claimed(folder: Path, about: dict[str, Any], suite: Suite) -> dict[str, Any]:
    """Say beside transcripts whose they are, and keep the prompt; refuse those of another.

    Returns:
        What stands there, from when the run was begun.
    """
    if any(path.stat().st_size for path in folder.glob("*.jsonl")):
        known = _about(folder)
        _check_suite(folder, known, suite)
        for key in (*_DECIDING, *_SAMPLING):
            if known.get(key, about[key]) != about[key]:
                raise UserError(
                    f"transcripts {folder}: recorded with {key} {known[key]}, not {about[key]}; choose "
                    "another folder"
                )
        return known
    if (folder / ABOUT).exists():  # another ally's matches began the run, and nothing was answered yet
        known = _about(folder)
        if all(known.get(key) == about[key] for key in (*_DECIDING, *_SAMPLING, "suite_hash")):
            return known
    write_whole(folder / PROMPT, prompt_file(about["prompt"]).read_bytes())
    write_json(folder / ABOUT, about)
    return about


def _check_suite(folder: Path, about: Mapping[str, Any], suite: Suite) -> None:
    """Check that transcripts are of the suite's matches, with what to write to compare them."""
    if about.get("suite_hash") != suite.hash:
        raise UserError(
            f"transcripts {folder}: hold matches of another suite, {about.get('suite')!r} with "
            f"{about.get('matches')} matches per ally; compare them with its --suite and --matches"
        )


def _about(folder: Path) -> dict[str, Any]:
    about = read_json(folder / ABOUT, "transcripts")
    if not all(isinstance(about.get(key), str) for key in _DECIDING):
        raise UserError(f"transcripts {folder / ABOUT}: expected the keys {', '.join(_DECIDING)}")
    return about


def _fingerprint(about: Mapping[str, Any]) -> str:
    told = [about[key] for key in _DECIDING] + [about[key] for key in _SAMPLING if key in about]
    return hashlib.sha256(json.dumps(told).encode()).hexdigest()


def _budget(folder: Path, caps: Mapping[str, float]) -> Budget:
    """One budget for all allies, from which everything that is recorded already is taken."""
    budget = Budget(**caps)
    recorded = [Transcript(path, "replay") for path in sorted(folder.glob("*.jsonl"))]
    attempts = (attempt for transcript in recorded for attempt in transcript.attempts())
    budget.resume(attempts, f"transcripts {folder}")
    return budget


def transcript_name(ally: str) -> str:
    """The name of the transcript of the matches against an ally, whose own name may be a path."""
    return f"{ally.replace('/', '-').replace(':', '-')}.jsonl"


def transcript_file(folder: Path, ally: str) -> Path:
    """The transcript in a folder of the matches against an ally, packed where only that is there."""
    plain = folder / transcript_name(ally)
    packed = plain.with_name(plain.name + PACKED)
    return packed if packed.exists() and not plain.exists() else plain
