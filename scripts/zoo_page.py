"""The zoo's index, and each group's table and learning curves."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fpg_bench.common.canvas import image_of
from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text, number
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.run_description import EVALUATIONS
from fpg_bench.evaluation.statistics import (
    TRAINING_SEEDS,
    Interval,
    mean_interval,
)
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import Summary, summarise
from fpg_bench.evaluation.table import bounds, markdown_table
from fpg_bench.products.rendering.curves import draw_curves
from fpg_bench.products.zoo.zoo import SCORES, Zoo, ZooAgent, ZooGroup

PAGE, TABLE, CURVES = "README.md", "table.csv", "curves.jsonl"
PICTURE = "curves.svg"
TEMPLATE = Path(__file__).with_name("zoo.md")
_MEASURES = (
    ("overlap ratio %", "overlap_ratio"),
    ("jamming success rate %", "jamming_success_rate"),
    ("hops %", "hop_rate"),
)
_INDEX = ("group", "trained on", "suite", "best agent", "score", "best script", "score", "all agents")


# Learning curves


def keep_curve(zoo: Zoo, agent: ZooAgent, run: Path) -> None:
    """Keep the scores of a run's evaluations, in place of those of an earlier run of the agent."""
    file, head = curve_file(zoo, agent.group), {"algorithm": agent.algorithm, "training_seed": agent.seed}
    rows = [row for row in file.read() if not head.items() <= row.items()]
    for row in RowFile(run / EVALUATIONS).read():
        if row["side"] == agent.group.side:
            score = round(row["score"], 2)
            rows.append({**head, "steps": row["steps"], "seconds": row["seconds"], "score": score})
    write_whole(file.path, "".join(json.dumps(row) + "\n" for row in rows))


def curve_file(zoo: Zoo, group: ZooGroup) -> RowFile:
    """Return the file of a group's learning curves."""
    return RowFile(zoo.scores(group) / CURVES)


# The page


def write_page(zoo: Zoo) -> Path:
    """Write the zoo's ``README.md``, with a table and picture of each group; returns the page's path."""
    for group in zoo.groups:
        public, *others = _summaries(zoo, group)
        if any(summary.trained for summary in public):
            write_whole(zoo.scores(group) / TABLE, csv_text(table(zoo, group, public, others)))
            draw_picture(zoo, group)
    write_whole(zoo.folder / PAGE, page(zoo))
    write_scores(zoo)
    return zoo.folder / PAGE


def write_scores(zoo: Zoo) -> None:
    """Write what ``fpg-bench zoo`` prints, the scores of all shipped agents on the first suite of a group.

    Beside them stands the best script on each suite, by the suite's hash, for the levels of learning curves.
    """
    rows = [row for group in zoo.groups for row in _scores(zoo, group)]
    best: dict[str, dict[str, float]] = {}
    for suite in map(load_suite, dict.fromkeys(name for group in zoo.groups for name in group.suites)):
        found = summarise(zoo.read_script_records(suite), suite)[:1]
        best[suite.hash[:16]] = {each.entry: each.score.value for each in found}
    write_whole(zoo.folder / SCORES, json.dumps({"agents": rows, "best_scripts": best}, indent=1) + "\n")


def _scores(zoo: Zoo, group: ZooGroup) -> Iterator[Row]:
    suite = load_suite(group.suites[0])
    summaries = {each.entry: each for each in summarise(zoo.read_records(group, suite), suite)}
    for algorithm in group.steps:
        agents = [agent for agent in zoo.members(f"{group.name}/{algorithm}") if agent.shipped]
        summary = summaries.get(algorithm)
        scores = {} if summary is None else summary.seed_scores()
        score = None if summary is None else _trained_again(summary)
        if agents:
            yield {
                "agent": f"{group.name}/{algorithm}",
                "suite": suite.name,
                "steps": agents[0].card().played_steps,
                "score": None if score is None else score.value,
                "low": None if score is None else score.low,
                "high": None if score is None else score.high,
                "seeds": {
                    f"seed_{agent.seed}": {
                        "steps": agent.card().played_steps,
                        "score": scores.get(agent.seed),
                        "policy": agent.card().policy_sha256,
                    }
                    for agent in agents
                },
            }


def page(zoo: Zoo) -> str:
    """Return the text of the page, from the records and agents of the zoo's folder."""
    index = markdown_table([_INDEX, *(_row(zoo, group) for group in zoo.groups)])
    return TEMPLATE.read_text(encoding="utf-8").replace("INDEX\n", f"{index}\n")


def _summaries(zoo: Zoo, group: ZooGroup) -> list[list[Summary]]:
    """Return the summaries of each of a group's suites, best first."""
    return [summarise(zoo.read_records(group, suite), suite) for suite in map(load_suite, group.suites)]


def _row(zoo: Zoo, group: ZooGroup) -> list[str]:
    """Return the row of a group in the index: its best algorithm beside the best script."""
    *_, last = _summaries(zoo, group)
    best: list[str] = []
    for is_trained in (True, False):
        first = next((summary for summary in last if summary.trained is is_trained), None)
        best += [first.entry, _written(first)] if first else ["-", "-"]
    folder = zoo.scores(group).relative_to(zoo.folder).as_posix()
    files = [TABLE, *[PICTURE] * bool(curve_file(zoo, group).read())]  # some have no curves on today's scale
    links = [f"[{Path(name).stem}](../{zoo.folder.name}/{folder}/{name})" for name in files]
    shown = ", ".join(links) if best[0] != "-" else "not trained yet"
    return [f"`{group.name}`", f"`{group.id}`", f"`{group.suites[-1]}`", *best, shown]


def table(zoo: Zoo, group: ZooGroup, public: list[Summary], others: list[list[Summary]]) -> list[list[str]]:
    """Return the table of a group: every algorithm and script on each of its suites."""
    names = [
        *("player", "seeds", "steps"),
        *(f"score on {name}" for name in group.suites),
        *("worst return per step", "against"),
        *(heading for heading, _ in _MEASURES),
        "time (min)",
    ]
    return [names, *(_cells(zoo, group, summary, others) for summary in public)]


def _cells(zoo: Zoo, group: ZooGroup, summary: Summary, others: list[list[Summary]]) -> list[str]:
    steps, minutes = _training(zoo, group, summary.entry) if summary.trained else ("-", "-")
    elsewhere = [next((s for s in suite if s.entry == summary.entry), None) for suite in others]
    lows = {f"{s.suite.name}, {s.worst}": s.by_rival[s.worst].value for s in (summary, *elsewhere) if s}
    worst = min(lows, key=lambda name: lows[name])
    scores = [_written(s) if s else "-" for s in (summary, *elsewhere)]
    return [
        summary.label,
        str(summary.training_seeds or "-"),
        steps,
        *scores,
        number(lows[worst]),
        worst,
        *(number(summary.measures[name], 100) for _, name in _MEASURES),
        minutes,
    ]


def _trained_again(summary: Summary) -> Interval:
    """Return the score with its interval over training seeds; that of a script is over matches."""
    if summary.trained:
        return mean_interval(summary.samples.mean(axis=1), TRAINING_SEEDS)
    return summary.score


def _written(summary: Summary) -> str:
    score = _trained_again(summary)
    return f"{number(score.value)} {bounds(score)}"


def _training(zoo: Zoo, group: ZooGroup, algorithm: str) -> tuple[str, str]:
    """Return an algorithm's training steps, and the minutes of its fastest training."""
    cards = [agent.card() for agent in zoo.members(f"{group.name}/{algorithm}") if agent.shipped]
    seconds = [card.seconds for card in cards if card.seconds is not None]
    steps = f"{np.mean([card.training_steps for card in cards]) / 1e6:.3g}M"
    return steps, number(min(seconds) / 60 if seconds else None)


def draw_picture(zoo: Zoo, group: ZooGroup) -> None:
    """Draw a group's learning curves beside its records, with the level of the best script."""
    if rows := curve_file(zoo, group).read():
        suite = load_suite(group.training_suite)
        scripts = [of for of in summarise(zoo.read_script_records(suite), suite) if not of.is_oracle]
        levels = {of.entry: of.score.value for of in scripts[:1]}
        path = zoo.scores(group) / PICTURE
        figure = draw_curves(rows, levels=levels, band="range")
        write_whole(path, image_of(figure, "svg", f"{path.parent.name}-{path.stem}"))
