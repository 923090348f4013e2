"""A comparison: planners against a panel into a results folder."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.evaluate import ABOUT, ROWS, claim
from fpg_bench.evaluation.planner_llm import asked, replayed
from fpg_bench.evaluation.planner_panel import PlannerPanel, load_planner_panel
from fpg_bench.evaluation.planner_runner import Contender, contender, play_planner
from fpg_bench.evaluation.planner_summary import PlannerSummary, summarise_planners
from fpg_bench.files import read_json
from fpg_bench.planning import LLM_CONTROLS, PLANNERS
from fpg_bench.players.naming import as_player
from fpg_bench.rows import RowFile

ALL = "all"
TRANSCRIPTS = "transcripts"  # of language models, in a results folder


def compare(
    planners: Sequence[Any] = (ALL,),
    panel: str = "planner-v1",
    out: str | Path = "comparison",
    *,
    matches: int | None = None,
    transcripts: str | Path | None = None,
    llm: Mapping[str, Any] | None = None,
    progress: Callable[[Contender, str, int], None] = lambda who, ally, rounds: None,
) -> list[PlannerSummary]:
    """Play planners against a panel; matches that are in the folder already are not played again.

    Args:
        planners: planners or their names; ``all``: all that ask no language model; ``llm``,
            ``llm-shuffled-rewards``, ``llm-no-history``: the model that the environment names, recorded in
            the folder's ``transcripts``. The planners of the scores 0 and 100 are played in any case.
        panel: a panel's name or YAML file.
        out: the results folder; ``rows.jsonl`` grows as rounds end.
        matches: matches per ally; None: the panel's own.
        transcripts: a folder of transcripts; each planner in it is one more, replayed without a server.
        llm: options of :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`, whose caps hold for all
            allies together, and ``server``, the profile of its endpoint.
        progress: called with the planner, the ally and how many rounds are played.

    Returns:
        The summaries of all planners in the folder, best first.

    Raises:
        UserError: something unknown, a folder that holds another panel's rows, no language model where one is
            named, or one that is of no use, options for one where none is, or transcripts that do not hold
            these matches.
    """
    out = Path(out)
    played = _with_matches(load_planner_panel(panel), matches)
    _check_players(played)
    named = _named(planners, played)
    if llm and not any(map(_is_llm, named)):
        raise UserError(f"{next(iter(llm))}: is for the planners {', '.join(LLM_CONTROLS)}; name one of them")
    contenders = [
        asked(spec, played, out / TRANSCRIPTS / spec, llm or {}) if _is_llm(spec) else contender(spec, played)
        for spec in named
    ]
    if transcripts is not None:
        contenders += replayed(Path(transcripts), played, [who.name for who in contenders])
    claim(out, panel, played.hash, matches=played.matches)
    file = RowFile(out / ROWS)
    with file.locked():
        for who in contenders:
            play_planner(who, played, file, functools.partial(progress, who))
    return summarise_planners(file.read(), played)


def read_comparison(folder: str | Path) -> tuple[list[PlannerSummary], PlannerPanel]:
    """The summaries of a comparison's folder, and its panel.

    Raises:
        UserError: no such folder, or one of a panel that is not this version's.
    """
    folder = Path(folder)
    about = read_json(folder / ABOUT, "results")
    panel = _with_matches(load_planner_panel(about["panel"]), about.get("matches"))
    if panel.hash != about["panel_hash"]:
        raise UserError(f"results {folder}: played under another version of {about['panel']}; compare again")
    return summarise_planners(RowFile(folder / ROWS).read(), panel), panel


def _with_matches(panel: PlannerPanel, matches: int | None) -> PlannerPanel:
    if matches is not None and matches < 1:
        raise UserError(f"matches: expected a whole number above 0, got {matches}")
    return panel if matches is None else dataclasses.replace(panel, matches=matches)


def _check_players(panel: PlannerPanel) -> None:
    """Raise UserError where a panel names a player that does not exist, before anything is played."""
    as_player(panel.opponent, "opponent", panel.scenario)
    for ally in panel.allies:
        as_player(ally, "ally", panel.scenario)


def _named(planners: Sequence[Any], panel: PlannerPanel) -> list[Any]:
    """The planners to play, each once: those that scores need first, then those that are asked for."""
    named: list[Any] = [panel.zero, panel.bound]
    for spec in planners:
        named += [name for name in PLANNERS if not _is_llm(name)] if spec == ALL else [spec]
    return [spec for k, spec in enumerate(named) if spec not in named[:k]]


def _is_llm(spec: Any) -> bool:
    return isinstance(spec, str) and spec in LLM_CONTROLS
