"""The track of planners: those of the package, or a language model's transcripts, played and scored."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel, load_panel
from fpg_bench.evaluation.planner_llm import transcript_file
from fpg_bench.evaluation.planner_references import PlannerTable
from fpg_bench.evaluation.planner_runner import pairing_rounds
from fpg_bench.evaluation.runner import round_row
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.evaluation.zoo_scores import sum_up
from fpg_bench.leaderboard.transcripts import FOLDER, entered_table, local, told
from fpg_bench.planning import as_planner
from fpg_bench.rows import Row

if TYPE_CHECKING:
    from fpg_bench.leaderboard.submission import Submission

TRACK = "planner"
STATUSES, TOKENS = "statuses", "tokens"  # what a planner's line says beside what any line does
_FALLBACK = "fallback-"
_TOLD = ("model", "server", "control", "prompt_hash")


def panel_of(submission: Submission) -> Panel:
    """What a submission of any track plays.

    Raises:
        UserError: no such panel.
    """
    if submission.track == TRACK:
        return entered_table(submission.panel, asks=submission.script is None)
    return load_panel(submission.panel)


def planner_facts(submission: Submission, table: PlannerTable) -> Row:
    """What a result's fingerprint tells of a planner: its tier, its matches, and the language model.

    Raises:
        UserError: there is no such planner, or its transcripts do not tell.
    """
    matches = {"matches": table.planners.matches}
    if submission.script is not None:
        return {"tier": as_planner(submission.script, table.scenario).tier, **matches}
    about, _ = told(submission.folder, table.planners)
    prompt = Path(about["prompt"]).stem
    return {"tier": "history", **matches, "prompt": prompt, **{key: about[key] for key in _TOLD}}


def planner_lines(submission: Submission, table: PlannerTable) -> list[Row]:
    """Play a planner against all allies of its panel; raises as :func:`planner_line` does."""
    plays = submission.folder if submission.script is None else submission.script
    return [planner_line(plays, table, entry) for entry in table.entries]


def planner_line(plays: str | Path, table: PlannerTable, entry: Entry) -> Row:
    """Play all matches of a planner and an ally; no language model is asked.

    Args:
        plays: a planner's name, or the folder of a submission that holds transcripts.
        table: the panel.
        entry: the ally.

    Returns:
        What :func:`fpg_bench.evaluation.zoo_scores.sum_up` says, the steps per frequency point of both
        sides, and for a language model ``statuses``, how many plans had which, and ``tokens`` a plan.

    Raises:
        UserError: a transcript is not that of these matches: its prompts are others, or something of it is
            missing or was changed; with the ally.
    """
    try:
        planner = _planner(plays, table, entry.other)
        rows = [
            _row(duel, game)
            for duel in pairing_rounds(planner, entry.other, table.planners)
            for game in range(table.planners.matches)
        ]
    except UserError as error:
        if isinstance(plays, str):
            raise
        raise UserError(f"against {entry.name}: {local(error, plays)}") from error
    points = {
        key: np.sum([row[key] for row in rows], axis=0).tolist() for key in ("ally_points", "jam_points")
    }
    line = {"training_seed": None, "entry": entry.name} | sum_up(rows, table) | {"lost": 0} | points
    return line | _asked(rows, isinstance(plays, Path))


def is_planner_line(line: Row, table: PlannerTable) -> bool:
    """Whether a line says of a language model's plans what it should."""
    statuses, tokens = line.get(STATUSES), line.get(TOKENS)
    if statuses is None:
        return tokens is None
    counts = list(statuses.values()) if isinstance(statuses, dict) else []
    whole = all(isinstance(count, int) and count >= 0 for count in counts)
    return whole and sum(counts) == table.rounds and (tokens is None or isinstance(tokens, int | float))


def planner_summary(lines: Iterable[Row], table: PlannerTable) -> Row:
    """What the lines of a planner come to, unrounded.

    Returns:
        ``score`` over the last rounds and ``score_all`` over all, as ``plan compare`` prints them, the
        ``curve`` by round, ``entries``, ``measures``, and for a language model the share of ``valid`` plans
        (its own, and no fallback), ``statuses`` and ``tokens`` a plan; None for others.
    """
    found = {line["entry"]: line for line in lines}
    mine = [found[entry.name] for entry in table.entries]
    returns, scale, count = returns_of(mine, table), table.scale(), table.planners.rounds
    last = slice(count - table.planners.last_rounds, None)
    each = scale.ally_scores(returns, last)
    by_round = [scale.score(returns, slice(k, k + 1)) for k in range(count)]
    score = scale.score(returns, last)
    return {
        "score": _interval(score) | {"over": score.over},
        "mean": score.value,
        "score_all": _interval(scale.score(returns, slice(None))),
        "curve": [_interval(of) for of in by_round],
        "entries": {entry.name: _interval(of) for entry, of in zip(table.entries, each, strict=True)},
        "training_seeds": 0,
        "rounds": sum(line["n"] for line in mine),
        "lost": 0,
        "measures": {key: _mean([line["mean"][key] for line in mine]) for key in mine[0]["mean"]},
        **_valid(mine),
    }


def returns_of(lines: Iterable[Row], table: PlannerTable) -> np.ndarray:
    """``(allies, matches, rounds)`` returns of a planner, in the order of the panel's allies."""
    found = {line["entry"]: line["returns"] for line in lines}
    return np.array([found[entry.name] for entry in table.entries]).reshape(
        len(found), -1, table.planners.rounds
    )


def _planner(plays: str | Path, table: PlannerTable, ally: str) -> Any:
    if isinstance(plays, str):
        return as_planner(plays, table.scenario)
    from fpg_bench.planning.llm.llm_planner import LLMPlanner

    about, prompt = told(plays, table.planners)
    recorded = transcript_file(plays / FOLDER, ally)
    planner = LLMPlanner(
        table.scenario, prompt=prompt, control=about["control"], transcript=recorded, mode="replay"
    )
    planner.transcript.check_told(about)
    return planner


def _row(duel: Any, game: int) -> Row:
    """One round; how long planning took is left out, since that is never twice the same."""
    plan = duel.plans[game]
    return round_row(duel, game) | {"status": plan.status, "source": plan.source, "tokens": plan.tokens}


def _asked(rows: list[Row], asks: bool) -> Row:
    if not asks:
        return {STATUSES: None, TOKENS: None}
    tokens = [row["tokens"] for row in rows if row["tokens"] is not None]
    statuses = Counter(sorted(row["status"] for row in rows))
    return {STATUSES: dict(statuses), TOKENS: sum(tokens) / len(rows) if tokens else None}


def _valid(lines: list[Row]) -> Row:
    if lines[0][STATUSES] is None:
        return {"valid": None, STATUSES: None, TOKENS: None}
    statuses = sum((Counter(line[STATUSES]) for line in lines), Counter[str]())
    fallen = sum(count for status, count in statuses.items() if status.startswith(_FALLBACK))
    tokens = _mean([line[TOKENS] for line in lines])
    return {"valid": 1 - fallen / statuses.total(), STATUSES: dict(sorted(statuses.items())), TOKENS: tokens}


def _interval(of: Interval) -> Row:
    return {"value": of.value, "low": of.low, "high": of.high}


def _mean(values: list[float | None]) -> float | None:
    """The mean of the values that exist."""
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None
