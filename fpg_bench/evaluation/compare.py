"""A comparison: planners against a field of allies into a results folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import Entry, planner_entry
from fpg_bench.evaluation.evaluate import Progress, play_into, with_matches
from fpg_bench.evaluation.field import PLANNER
from fpg_bench.evaluation.field_file import load_field
from fpg_bench.evaluation.planner_llm import asked, replayed
from fpg_bench.evaluation.summary import Summary
from fpg_bench.matches.match_planner import asks_llm
from fpg_bench.planning import LLM_CONTROLS, PLANNERS

ALL = "all"
TRANSCRIPTS = "transcripts"  # of language models, in a results folder


def compare(
    planners: Sequence[Any] = (ALL,),
    field: str = "planner-v1",
    out: str | Path = "comparison",
    *,
    matches: int | None = None,
    transcripts: str | Path | None = None,
    llm: Mapping[str, Any] | None = None,
    progress: Progress = lambda entry, counterpart, rounds: None,
) -> list[Summary]:
    """Play planners against a field of allies; what is in the folder already is not played again.

    Args:
        planners: planners or their names; ``all``: all that ask no language model; ``llm``,
            ``llm-shuffled-rewards``, ``llm-no-history``: the model that the environment names, recorded in
            the folder's ``transcripts``.
        field: a field's name or YAML file.
        out: the results folder; ``lines.jsonl`` grows as allies are met.
        matches: per ally; None: the field's own.
        transcripts: a folder of transcripts; each planner in it is one more, replayed without a server.
        llm: options of :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`, whose caps hold for all
            allies together, and ``server``, the profile of its endpoint.
        progress: called before each meeting and after each of its rounds.

    Returns:
        The summaries of all planners in the folder, best first.

    Raises:
        UserError: something unknown, a folder that holds another field's lines, no language model where one
            is named, or one that is of no use, options for one where none is, or transcripts that do not
            hold these matches.
    """
    out = Path(out)
    played = with_matches(load_field(field, side=PLANNER), matches)
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
    return play_into(out, field, played, entries, progress)
