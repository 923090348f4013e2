"""The track of planners: those of the package, or a language model's transcripts, replayed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fpg_bench.evaluation.field import Counterpart, Field
from fpg_bench.evaluation.planner_llm import transcript_file
from fpg_bench.leaderboard.transcripts import FOLDER, told
from fpg_bench.planning import as_planner
from fpg_bench.rows import Row

if TYPE_CHECKING:
    from fpg_bench.leaderboard.submission import Submission

TRACK = "planner"
_TOLD = ("model", "server", "control", "prompt_hash")


def planner_facts(submission: Submission, field: Field) -> Row:
    """What a result's fingerprint tells of a planner: its tier, its matches, and the language model.

    Raises:
        UserError: there is no such planner, or its transcripts do not tell.
    """
    matches = {"matches": field.matches}
    if submission.script is not None:
        return {"tier": as_planner(submission.script, field.scenario).tier, **matches}
    about, _ = told(submission.folder, field)
    prompt = Path(about["prompt"]).stem
    runs = {"runs": submission.runs, "season": about["season"]}
    return {"tier": "history", **matches, **runs, "prompt": prompt, **{key: about[key] for key in _TOLD}}


def replaying(folder: Path, field: Field) -> Callable[[Counterpart], Any]:
    """What gives the planner of a submission's transcripts against an ally; no language model is asked.

    Raises:
        UserError: when called: a transcript is not that of these matches: its prompts are others, or
            something of it is missing or was changed.
    """
    from fpg_bench.planning.llm.llm_planner import LLMPlanner

    def make(ally: Counterpart) -> Any:
        about, prompt = told(folder, field)
        recorded = transcript_file(folder / FOLDER, ally.name)
        planner = LLMPlanner(
            field.scenario, prompt=prompt, control=about["control"], transcript=recorded, mode="replay"
        )
        planner.transcript.check_told(about)
        return planner

    return make
