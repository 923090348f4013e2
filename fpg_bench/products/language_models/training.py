"""Training with a language model that plans in parallel with the game; a transcript keeps the plans."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.language_models.llm_planner import LLM_CONTROLS
from fpg_bench.products.language_models.options import TrainingOptions
from fpg_bench.training.run_folder import TRANSCRIPT


def training_planner(spec: object, out: Path, options: Mapping[str, Any] = MappingProxyType({})) -> Any:
    """Return the planner of a run's games.

    Args:
        spec: the planner, by name or as an object.
        out: the run's folder, where the transcript of a language model is written.
        options: options of the planner, the attributes of :class:`TrainingOptions`.

    Returns:
        For a language model a function of the scenario that makes its planner; any other planner as it is.

    Raises:
        UserError: a transcript or options for a planner that asks no language model.
    """
    if not (isinstance(spec, str) and spec in LLM_CONTROLS):
        if "transcript" in options:
            raise UserError(f"transcript: nothing to replay with the planner {spec!r}")
        if given := next(iter(options), None):
            raise UserError(f"{given}: is for a language model, not for the planner {spec!r}")
        return spec
    llm = TrainingOptions.of(options)
    arguments = {"control": LLM_CONTROLS[spec]} | llm.arguments()

    def make(scenario: Scenario) -> Any:
        from fpg_bench.products.language_models.background import BackgroundPlanner
        from fpg_bench.products.language_models.llm_planner import LLMPlanner
        from fpg_bench.products.language_models.servers import endpoint_from_environment

        if llm.transcript is not None:
            return BackgroundPlanner(
                LLMPlanner(scenario, transcript=llm.transcript, mode="replay", **arguments)
            )
        endpoint = endpoint_from_environment(llm.server)
        return BackgroundPlanner(LLMPlanner(scenario, endpoint, transcript=out / TRANSCRIPT, **arguments))

    return make
