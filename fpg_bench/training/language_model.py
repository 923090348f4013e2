"""Training against a language model: it plans beside the game; a transcript keeps what was flown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning import LLM_CONTROLS

TRANSCRIPT = "transcript.jsonl"


def training_planner(spec: Any, out: Path, replayed: str | Path | None) -> Any:
    """What a run hands over as its planner.

    Args:
        spec: the planner asked for.
        out: the run's folder, where the transcript of a language model grows.
        replayed: the transcript of another run, whose plans are flown again without a server.

    Returns:
        What makes a language model's planner beside the game; any other planner as it is.

    Raises:
        UserError: a transcript, and a planner that asks no language model.
    """
    if not (isinstance(spec, str) and spec in LLM_CONTROLS):
        if replayed is not None:
            raise UserError(f"transcript: nothing to replay where the planner is {spec!r}")
        return spec

    def make(scenario: Scenario) -> Any:
        from fpg_bench.planning.llm.background import Beside
        from fpg_bench.planning.llm.llm_planner import LLMPlanner

        path, mode = (out / TRANSCRIPT, "record") if replayed is None else (replayed, "replay")
        return Beside(LLMPlanner(scenario, control=LLM_CONTROLS[spec], transcript=path, mode=mode))

    return make
