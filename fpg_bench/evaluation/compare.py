"""Comparison of planners against a suite of allies, language models recorded and replayed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import PACKED, read_json, write_json, write_whole
from fpg_bench.envs.two_player import PlannerSpec
from fpg_bench.evaluation.entry import EvaluatedPlayer, planner_entry
from fpg_bench.evaluation.evaluate import play_into, with_matches
from fpg_bench.evaluation.match import replaying
from fpg_bench.evaluation.seeds import SeasonKey, current_season
from fpg_bench.evaluation.store import Progress
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite, load_suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.planning import LLM_CONTROLS, PLANNERS
from fpg_bench.planning.llm.answers import PARSER
from fpg_bench.planning.llm.budget import Budget
from fpg_bench.planning.llm.llm_planner import LLMPlanner
from fpg_bench.planning.llm.prompts import load_prompt, prompt_file
from fpg_bench.planning.llm.servers import endpoint_from_environment
from fpg_bench.planning.llm.transcript import Transcript, chain_start

ALL = "all"
TRANSCRIPTS = "transcripts"  # of language models, in a results folder


def compare(
    planners: Sequence[PlannerSpec] = (ALL,),
    suite: str = "planner-v1",
    out: str | Path = "comparison",
    *,
    matches: int | None = None,
    transcripts: str | Path | None = None,
    llm: Mapping[str, Any] | None = None,
    progress: Progress = lambda entry, rival, rounds: None,
    allow: Collection[str] = (),
) -> list[Summary]:
    """Play planners against a suite of allies; records that the folder has already are not played again.

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
        progress: called before each matchup and after each of its rounds.
        allow: the code and agents of the Hub that the suite's file may name; see
            :func:`fpg_bench.evaluation.suite.load_suite`.

    Returns:
        The summaries of all planners in the folder, best first.

    Raises:
        UserError: something unknown, a folder that holds other files or another suite's records, a language
            model without an endpoint, with an unusable one or without a valid plan against an ally, options
            for a language model where none is named, or transcripts that do not hold these matches.
    """
    out = Path(out)
    played = with_matches(load_suite(suite, side=PLANNER, allow=allow), matches)
    specs: list[PlannerSpec] = []
    for named in planners:
        for spec in [name for name in PLANNERS if name not in LLM_CONTROLS] if named == ALL else [named]:
            if spec not in specs:
                specs.append(spec)
    entries = []
    for spec in specs:
        if isinstance(spec, str) and spec in LLM_CONTROLS:
            entries.append(_recorded_entry(spec, played, out / TRANSCRIPTS / spec, llm or {}))
        else:
            entries.append(planner_entry(spec, played))
    if llm and not any(isinstance(spec, str) and spec in LLM_CONTROLS for spec in specs):
        raise UserError(f"{next(iter(llm))}: is for the planners {', '.join(LLM_CONTROLS)}; name one of them")
    if transcripts is not None:
        entries += _replayed_entries(Path(transcripts), played, [entry.name for entry in entries])
    return play_into(out, suite, played, entries, progress)


ABOUT, PROMPT = "planner.json", "prompt.yml"  # beside a planner's transcripts, one per ally
_DECIDING = ("model", "control", "prompt_hash")
_SAMPLING = ("temperature", "sampling_seed")
_CAPS = ("calls", "tokens", "seconds")


def _recorded_entry(name: str, suite: Suite, folder: Path, options: Mapping[str, Any]) -> EvaluatedPlayer:
    """Return a language model whose answers are recorded in a folder; recorded answers are not asked again.

    Raises:
        UserError: no endpoint, no such prompt, or a folder with transcripts of another model or prompt.
    """
    control, rest = LLM_CONTROLS[name], dict(options)
    endpoint = endpoint_from_environment(rest.pop("server", None))
    prompt = rest.pop("prompt", endpoint.server.prompt)
    about: dict[str, Any] = {
        "model": endpoint.model,
        "server": endpoint.server.name,
        "control": control,
        "prompt": prompt,
        "prompt_hash": load_prompt(prompt).hash,
        "temperature": rest.get("temperature", endpoint.server.temperature),
        "sampling_seed": rest.get("sampling_seed", 0),
        "parser": PARSER,
        "suite": suite.name,
        "suite_hash": suite.hash,
        "matches": suite.matches,
    }
    about |= begun(about)
    budget = _budget(folder, {cap: rest.pop(cap) for cap in _CAPS if cap in rest})

    def make(ally: Rival) -> LLMPlanner:
        header = _claim(folder, about, suite)
        planner = LLMPlanner(
            suite.scenario,
            endpoint,
            prompt=prompt,
            control=control,
            transcript=folder / transcript_name(ally.name),
            mode="record",
            chain=chain_start(header, transcript_name(ally.name)),
            parser=header.get("parser", 1),
            **rest,
        )
        planner.budget = budget
        return planner

    return EvaluatedPlayer(name, None, _fingerprint(about), make)


def _replayed_entries(folder: Path, suite: Suite, taken: Collection[str]) -> list[EvaluatedPlayer]:
    """Return the language models whose transcripts are in the subfolders of a folder; no server is asked.

    Raises:
        UserError: no transcripts there, those of another suite, or a planner by the name of another one,
            which is in ``taken`` or in the package.
    """
    folders = sorted(path.parent for path in folder.glob(f"*/{ABOUT}"))
    if not folders:
        raise UserError(f"transcripts {folder}: hold no planner; name the folder transcripts of a comparison")
    for path in folders:
        if path.name in taken:
            raise UserError(f"transcripts {path}: another planner here has this name; rename the folder")
        if path.name in PLANNERS and path.name not in LLM_CONTROLS:
            raise UserError(f"transcripts {path}: a planner of the package has this name; rename the folder")
    return [_replayed_entry(path, suite) for path in folders]


def _replayed_entry(folder: Path, suite: Suite) -> EvaluatedPlayer:
    about, prompt = _about(folder), load_prompt(str(folder / PROMPT))
    _check_suite(folder, about, suite)
    if prompt.hash != about["prompt_hash"]:
        raise UserError(f"transcripts {folder}: its {PROMPT} is not the prompt that was recorded")

    def make(ally: Rival) -> LLMPlanner:
        chain = chain_start(about, transcript_name(ally.name))
        return replaying(suite.scenario, prompt, about, transcript_file(folder, ally.name), chain)

    return EvaluatedPlayer(folder.name, None, _fingerprint(about), make)


def begun(about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the time at which a run begins, and a nonce that could not be known before the present season.

    Args:
        about: the run's description.
    """
    season = current_season()
    header = {"begun": datetime.now(UTC).isoformat(timespec="seconds")}
    return {**header, "season": None, "nonce": None} if season is None else header | nonce_of(about, season)


def nonce_of(about: Mapping[str, Any], season: SeasonKey) -> dict[str, Any]:
    """Return the season's number, and a hash of its seed and of the run's description."""
    words = [season.seed, *(about[key] for key in (*_DECIDING, "suite_hash"))]
    return {"season": season.number, "nonce": hashlib.sha256("/".join(words).encode()).hexdigest()}


def _claim(folder: Path, about: dict[str, Any], suite: Suite) -> dict[str, Any]:
    """Write the description and the prompt beside transcripts; refuse those of another planner.

    Returns:
        The description in the folder, written when the run was begun.
    """
    if any(path.stat().st_size for path in folder.glob("*.jsonl")):
        known = _about(folder)
        _check_suite(folder, known, suite)
        for key in (*_DECIDING, *_SAMPLING):
            if known.get(key, about[key]) != about[key]:
                raise other_content(
                    f"transcripts {folder}", f"answers recorded with {key} {known[key]}, not {about[key]}"
                )
        return known
    if (folder / ABOUT).exists():  # the run was begun with another ally, and nothing was answered yet
        known = _about(folder)
        if all(known.get(key) == about[key] for key in (*_DECIDING, *_SAMPLING, "parser", "suite_hash")):
            return known
    write_whole(folder / PROMPT, prompt_file(about["prompt"]).read_bytes())
    write_json(folder / ABOUT, about)
    return about


def _check_suite(folder: Path, about: Mapping[str, Any], suite: Suite) -> None:
    """Raise UserError if transcripts are not of the suite's matches."""
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
    values = [about[key] for key in (*_DECIDING, *_SAMPLING, "parser") if key in about]
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()


def _budget(folder: Path, caps: Mapping[str, float]) -> Budget:
    """Return one budget for all allies, less what the recorded attempts have used."""
    budget = Budget(**caps)
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
