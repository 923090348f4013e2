"""Comparison of planners against a suite of allies, language models recorded and replayed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.imports import code_fingerprint, is_code
from fpg_bench.common.products import load
from fpg_bench.envs.two_player import PlannerSpec
from fpg_bench.evaluation.entry import EvaluatedPlayer, FixedPlayer
from fpg_bench.evaluation.evaluate import play_into, with_matches
from fpg_bench.evaluation.store import Progress
from fpg_bench.evaluation.suite import PLANNER, Suite, load_suite
from fpg_bench.evaluation.table import Results
from fpg_bench.players.planner import PLANNERS, as_planner, asks_language_model

ALL = "all"
TRANSCRIPTS = "transcripts"  # of language models, in a results folder


def compare(
    planners: Sequence[PlannerSpec] = (ALL,),
    suite: str = "planner-v1",
    out: str | Path = "comparison",
    *,
    matches: int | None = None,
    transcripts: str | Path | None = None,
    llm: Mapping[str, Any] = MappingProxyType({}),
    progress: Progress = lambda entry, rival, rounds, done, total: None,
    allow: Collection[str] = (),
    reuse: bool = False,
) -> Results:
    """Play planners against a suite of allies; records that the folder has already are not played again.

    Args:
        planners: planners or their names; ``all``: all that ask no language model; ``llm``,
            ``llm-shuffled-rewards``, ``llm-no-history``: the model that the environment names, recorded in
            the folder's ``transcripts``.
        suite: a suite's name or YAML file.
        out: the results folder; ``records.jsonl`` grows as allies are met.
        matches: per ally; None: the suite's own.
        transcripts: a folder of transcripts; each planner in it is one more, replayed without a server.
        llm: options of the language models by name, whose caps hold for all allies together.
        progress: called before each matchup and after each of its rounds; see
            :func:`fpg_bench.evaluation.evaluate.evaluate`.
        allow: the code and agents of the Hub that the suite's file may name; see
            :func:`fpg_bench.evaluation.suite.load_suite`.
        reuse: keep the folder's records of planners of code, and of suites with code; see
            :func:`fpg_bench.evaluation.evaluate.evaluate`.

    Returns:
        The summaries of all planners in the folder, best first.

    Raises:
        UserError: something unknown, a folder that holds other files or another suite's records, a language
            model without an endpoint, with an unusable one or without a valid plan against an ally, options
            for a language model where none is named, or transcripts that do not hold these matches.
    """
    out = Path(out)
    played = with_matches(load_suite(suite, side=PLANNER, allow=allow), matches)
    silent = [name for name in PLANNERS if not asks_language_model(name)]
    specs: list[PlannerSpec] = []
    for named in planners:
        for spec in silent if named == ALL else [named]:
            if spec not in specs:
                specs.append(spec)
    entries = []
    for spec in specs:
        if isinstance(spec, str) and asks_language_model(spec):
            recorded = load("language_model", "of a comparison")
            entries.append(recorded(spec, played, out / TRANSCRIPTS / spec, llm))
        else:
            entries.append(planner_entry(spec, played))
    given = next(iter(llm), None)
    if given and not any(isinstance(spec, str) and asks_language_model(spec) for spec in specs):
        models = ", ".join(name for name in PLANNERS if name not in silent)
        raise UserError(f"{given}: is for the planners {models}; name one of them")
    if transcripts is not None:
        replayed = load("language_model", "of transcripts")
        entries += replayed(Path(transcripts), played, [entry.name for entry in entries])
    return play_into(out, suite, played, entries, progress, reuse=reuse)


def planner_entry(spec: PlannerSpec, suite: Suite) -> EvaluatedPlayer:
    """Return the entry of a planner, given by its name or as an object.

    Raises:
        UserError: no such planner, one without a valid name or tier, or one by the name of another.
    """
    as_planner(spec, suite.scenario)  # refuses an invalid planner before anything is played
    name = spec if isinstance(spec, str) else str(getattr(spec, "name", type(spec).__name__))
    code = spec if isinstance(spec, str) else f"{type(spec).__module__}:{name}"
    if not isinstance(spec, str) and name in PLANNERS:
        raise UserError(f"planner {spec!r}: calls itself {name}, as one of the package does; rename it")
    return EvaluatedPlayer(name, None, code_fingerprint(code), FixedPlayer(spec), is_code=is_code(code))
