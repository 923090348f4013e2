"""Language models as planners of the games of a training, and of rounds that are played to be seen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.language_models.llm_planner import LLM_CONTROLS, LLMPlanner, check_asked
from fpg_bench.products.language_models.options import PlayOptions, TrainingOptions
from fpg_bench.products.language_models.servers import endpoint_from_environment
from fpg_bench.training.run_folder import TRANSCRIPT


def training_planner(spec: object, out: Path, options: Mapping[str, Any] = MappingProxyType({})) -> Any:
    """Return the planner of a run's games, which plans in parallel with them.

    Args:
        spec: the planner, by name or as an object.
        out: the run's folder, where the transcript of a language model is written.
        options: options of the planner, the attributes of :class:`TrainingOptions`.

    Returns:
        For a language model a function of the scenario that makes its planner; any other planner as it is.

    Raises:
        UserError: options for a planner that asks no language model.
    """
    from fpg_bench.products.language_models.background import BackgroundPlanner

    if not _asks(spec, options):
        return spec
    llm = TrainingOptions.of(options)
    return lambda scenario: BackgroundPlanner(_planner(spec, scenario, llm, out / TRANSCRIPT))


def playing_planner(spec: object, options: Mapping[str, Any]) -> Any:
    """Return the planner of rounds that are played to be seen; see :func:`training_planner`.

    Args:
        spec: the planner, by name or as an object.
        options: the attributes of :class:`PlayOptions`.

    Raises:
        UserError: options for a planner that asks no language model, or both ``record`` and ``transcript``.
    """
    if not _asks(spec, options):
        return spec
    llm = PlayOptions.of(options)
    if llm.record is not None and llm.transcript is not None:
        raise UserError("record: a transcript is played again and nothing is asked; leave out one of the two")
    return lambda scenario: _planner(spec, scenario, llm, llm.record)


def _asks(spec: object, options: Mapping[str, Any]) -> bool:
    """Return whether a planner is a language model by its name; raise UserError where others have options."""
    asks = isinstance(spec, str) and spec in LLM_CONTROLS
    check_asked(asks, options)
    return asks


def _planner(spec: Any, scenario: Scenario, llm: TrainingOptions, kept: str | Path | None) -> LLMPlanner:
    arguments = {"control": LLM_CONTROLS[spec]} | llm.arguments()
    if llm.transcript is not None:
        return LLMPlanner(scenario, transcript=llm.transcript, mode="replay", **arguments)
    return LLMPlanner(scenario, endpoint_from_environment(llm.server), transcript=kept, **arguments)
