"""Who plans a match: any planner by name, and the language model with what its file must tell of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning.llm.llm_planner import LLMPlanner
from fpg_bench.planning.llm.prompts import Prompt
from fpg_bench.planning.llm.servers import endpoint_from_environment
from fpg_bench.planning.naming import LLM_CONTROLS, as_planner


def planner_of(
    spec: Any, scenario: Scenario, path: Path | None, options: Mapping[str, Any]
) -> tuple[Any, dict[str, Any] | None]:
    """A match's planner, and what its file tells of the language model that it asks, if it asks one.

    Args:
        spec: a planner, by the grammar of :func:`fpg_bench.planning.as_planner`.
        scenario: what is played.
        path: the match's file, which is the language model's transcript too; None: none is kept.
        options: of the language model's planner, and ``server``, the profile of its endpoint.

    Raises:
        UserError: an unknown planner or option, options for one that asks no language model, or no endpoint.
    """
    if asks_llm(spec):
        return _llm_planner(spec, scenario, path, dict(options))
    if options:
        raise UserError(f"{next(iter(options))}: is for the planner 'llm', not for {spec!r}")
    planner = as_planner(spec, scenario)
    if path is not None and asks_llm(getattr(planner, "name", "")):
        raise UserError(
            "planner: name it 'llm' and give its options beside it; its file tells all of it then"
        )
    return planner, None


def replayed_planner(name: str, told: dict[str, Any] | None, scenario: Scenario, path: Path) -> Any:
    """The planner of a match that is repeated from its file, which calls nobody.

    Raises:
        UserError: an unknown planner, or a language model of which the file does not tell enough.
    """
    if not asks_llm(name):
        return as_planner(name, scenario)
    try:
        prompt, control = Prompt(**told["prompt"]), str(told["control"])  # type: ignore[index]
        unchanged = prompt.hash == told["prompt_hash"]  # type: ignore[index]
    except (TypeError, KeyError) as error:
        raise UserError(f"match {path}: does not tell the prompt and control of its planner") from error
    if not unchanged:
        raise UserError(f"match {path}: its prompt is not the one that was recorded")
    return replaying(scenario, prompt, {**(told or {}), "control": control}, path)


def replaying(
    scenario: Scenario, prompt: Prompt, told: Mapping[str, Any], transcript: Path, chain: str | None = None
) -> LLMPlanner:
    """A language model's planner that takes its answers from a transcript; nobody is asked.

    Args:
        scenario: what is played.
        prompt: that it was recorded with.
        told: ``model``, ``prompt_hash`` and ``control``, with which every attempt must have been made.
        transcript: the file.
        chain: where the chain of hashes through it begins; None: it has none.

    Raises:
        UserError: an attempt was made otherwise.
    """
    recorded: dict[str, Any] = {"transcript": transcript, "mode": "replay", "chain": chain}
    planner = LLMPlanner(scenario, prompt=prompt, control=told["control"], **recorded)
    planner.transcript.check_told(told)
    return planner


def asks_llm(spec: Any) -> bool:
    """Whether a planner's name is that of one which asks a language model."""
    return isinstance(spec, str) and spec in LLM_CONTROLS


def _llm_planner(
    name: str, scenario: Scenario, path: Path | None, options: dict[str, Any]
) -> tuple[Any, dict[str, Any]]:
    options = {"control": LLM_CONTROLS[name], **options}
    endpoint = endpoint_from_environment(options.pop("server", None))
    planner = LLMPlanner(scenario, endpoint, transcript=path, **options)
    sampled: dict[str, Any] = {
        name: options[name] for name in ("temperature", "sampling_seed") if name in options
    }
    told: dict[str, Any] = {
        "model": endpoint.model,
        "server": endpoint.server.name,
        "control": planner.control,
    }
    return planner, {**told, **sampled, "prompt": asdict(planner.prompt), "prompt_hash": planner.prompt.hash}
