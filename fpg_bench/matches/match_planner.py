"""Who plans a match: any planner by name, and the language model with what its file must tell of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.game.scenario import Scenario
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
    if _asks_llm(spec):
        return _llm_planner(spec, scenario, path, dict(options))
    if options:
        raise UserError(f"{next(iter(options))}: is for the planner 'llm', not for {spec!r}")
    planner = as_planner(spec, scenario)
    if path is not None and _asks_llm(getattr(planner, "name", "")):
        raise UserError(
            "planner: name it 'llm' and give its options beside it; its file tells all of it then"
        )
    return planner, None


def replayed_planner(name: str, told: dict[str, Any] | None, scenario: Scenario, path: Path) -> Any:
    """The planner of a match that is repeated from its file, which calls nobody.

    Raises:
        UserError: an unknown planner, or a language model of which the file does not tell enough.
    """
    if not _asks_llm(name):
        return as_planner(name, scenario)
    from fpg_bench.planning.llm.llm_planner import LLMPlanner
    from fpg_bench.planning.llm.prompts import Prompt

    try:
        prompt, control = Prompt(**told["prompt"]), str(told["control"])  # type: ignore[index]
        unchanged = prompt.hash == told["prompt_hash"]  # type: ignore[index]
    except (TypeError, KeyError) as error:
        raise UserError(f"match {path}: does not tell the prompt and control of its planner") from error
    if not unchanged:
        raise UserError(f"match {path}: its prompt is not the one that was recorded")
    planner = LLMPlanner(scenario, prompt=prompt, control=control, transcript=path, mode="replay")
    planner.transcript.check_told(told or {})
    return planner


def _asks_llm(spec: Any) -> bool:
    return isinstance(spec, str) and spec in LLM_CONTROLS


def _llm_planner(
    name: str, scenario: Scenario, path: Path | None, options: dict[str, Any]
) -> tuple[Any, dict[str, Any]]:
    from fpg_bench.planning.llm.llm_planner import LLMPlanner
    from fpg_bench.planning.llm.servers import endpoint_from_environment

    options = {"control": LLM_CONTROLS[name], **options}
    endpoint = endpoint_from_environment(options.pop("server", None))
    planner = LLMPlanner(scenario, endpoint, transcript=path, **options)
    told = {"model": endpoint.model, "server": endpoint.server.name, "control": planner.control}
    return planner, {**told, "prompt": asdict(planner.prompt), "prompt_hash": planner.prompt.hash}
