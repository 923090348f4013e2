"""Write the figures that pages quote: ``python scripts/quote_figures.py``.

A figure or a table stands in a page between ``<!-- NAME -->`` and ``<!-- end -->``, also in
the midst of a sentence. All are read from committed data; the oracle, which is in no suite, is played.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache, partial

import numpy as np
from command import run
from lineage import ROOT, fill

from fpg_bench.common.output import number
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.statistics import (
    ENOUGH_SEEDS,
    MATCHES,
    Interval,
    correlation_interval,
    differences,
    pair_error,
)
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import Summary, summary_of
from fpg_bench.evaluation.table import bounds, markdown_table
from fpg_bench.products.leaderboard.board import Board, BoardEntry, Figures, make_board
from fpg_bench.products.leaderboard.entries import Entries, load_entries
from fpg_bench.products.leaderboard.exploited import Attack
from fpg_bench.products.leaderboard.season.checks import spearman
from fpg_bench.products.leaderboard.tracks import PUBLIC, SHIFTED, TRACKS, UNSEEN

FIRST_OPPONENTS = 5
FIRST = 8  # allies of the finding on hunter
PLANNER_SCORES = "docs/guides/planner-v1.csv"
MISSION = ("overlap ratio", "jamming success rate")  # of the public suite, as the field's papers give them
HEADLINE = ("player", "", "public score", "held-out score", "lowest known return", *MISSION)
ENTRIES = ("entry", "seeds", "held-out score", "rank", "public", "shifted", "lowest known return")
FOUND = ("found by", "CPU s")  # the lowest return, of allies
RANKED = ("track", "ranked entries", "may be best", "pairs told apart", "reversed")
ON_LINK = ("ally-link-waterfall-dqn", "ally-link-dqn", "ally-link-dueling-ddqn", "expert-link")
PerEntry = tuple[BoardEntry, Figures]
per_step = partial(number, digits=2)


@cache
def read_entries() -> Entries:
    """Return the entries of the board."""
    return load_entries(ROOT / "leaderboard")


@cache
def board() -> tuple[Board, Mapping[str, Summary]]:
    """Return the board, and the oracle's summaries as an ally by role of the suite."""
    entries, oracle = read_entries(), player_entry("oracle")
    suites, summaries = entries.suites.of(TRACKS["ally"]), {}
    for suite in (suites[role] for role in (PUBLIC, UNSEEN)):
        summaries[suite.name] = summary_of([play(oracle, suite, rival) for rival in suite.rivals], suite)
    return make_board(entries), summaries


def verified(key: str) -> list[PerEntry]:
    """Return the verified entries of a track, best first."""
    (track,) = (track for track in board()[0].tracks if track.key == key)
    return list(track.verified())


def lowest(figures: Figures) -> Attack:
    """Return the lowest known return per step of a player, and who found it."""
    assert figures.exploited is not None
    return figures.exploited.lowest


def kept(figures: Figures) -> str:
    """Return the lowest known return per step of a player."""
    return per_step(lowest(figures).return_per_step.value)


def attacked(key: str) -> list[PerEntry]:
    """Return the allies with responses, by what they keep: the first is the champion."""
    entries = [each for each in verified(key) if each[1].exploited and each[1].exploited.attacks]
    return sorted(entries, key=lambda each: -lowest(each[1]).return_per_step.value)


def score(interval: Interval) -> str:
    """Return a score with its interval."""
    return f"{number(interval.value)} {bounds(interval)}"


def player(entry: BoardEntry) -> str:
    """Return what commands call an entry."""
    return f"`{entry.plays or entry.slug}`"


def mission(measures: Mapping[str, float | None]) -> list[str]:
    """Return the overlap ratio and the jamming success rate, in percent."""
    return [f"{number(100 * (measures[name.replace(' ', '_')] or 0))} %" for name in MISSION]


def headline() -> str:
    """Return the table of the front page: who leads by what, between an oracle and random play."""
    entries, oracle = verified("ally"), list(board()[1].values())
    of_slug = {each[0].slug: each for each in entries}
    learner = next(each for each in entries if each[1].training_seeds >= ENOUGH_SEEDS)
    first = entries[0][0].about.algorithm
    rows = {
        f"{first[0].lower()}{first[1:]}, first by held-out score": entries[0],
        f"{learner[0].about.algorithm}, the best learner by held-out score": learner,
        "the champion, first by lowest known return": attacked("ally")[0],
        "the best script by held-out score": next(each for each in entries if each[0].kind == "script"),
        "stays on its frequency": of_slug["idle"],
        "": of_slug["random"],
    }
    reward = min(summary.by_rival[summary.worst].value for summary in oracle)
    lines = [["`oracle`", "sees the full state", *(score(of.score) for of in oracle), per_step(reward)]]
    lines[0] += mission(oracle[0].measures)
    for what, (entry, figures) in rows.items():
        scores = [score(figures.scores[role]) for role in (PUBLIC, UNSEEN)]
        lines.append([player(entry), what, *scores, kept(figures), *mission(figures.measures)])
    return markdown_table([HEADLINE, *lines])


def track_table(key: str) -> str:
    """Return the table of the entries of a track with responses; of opponents, the first ones."""
    lines, broken = [], attacked(key)
    for entry, figures in broken or verified(key)[:FIRST_OPPONENTS]:
        scores = [number(figures.scores[role].value) for role in (PUBLIC, SHIFTED)]
        rank = "-".join(map(str, dict.fromkeys(figures.rank or ()))) or "-"
        seeds = str(figures.training_seeds or "-")
        lines.append([player(entry), seeds, score(figures.scores[UNSEEN]), rank, *scores, kept(figures)])
        if broken:
            attack = lowest(figures)
            ends = (per_step(end) for end in (attack.return_per_step.low, attack.return_per_step.high))
            lines[-1][-1] += f" [{', '.join(ends)}]"
            cost = "-" if attack.seconds is None else number(attack.seconds, digits=0)
            lines[-1] += [attack.name or attack.rival, cost]
    return markdown_table([ENTRIES + FOUND * bool(broken), *lines])


def learners_in_link() -> str:
    """Return the table of published learners in link, beside a script and the first by held-out score."""
    of_slug = {each[0].slug: each for each in verified("ally-link")}
    lines = [["player", "steps", "public score", "held-out score", "hops"]]
    for slug in (*ON_LINK, next(iter(of_slug))):
        entry, figures = of_slug[slug]
        steps = f"{training.steps:,}" if (training := entry.about.training) else "-"
        hops = f"{100 * (figures.measures['hop_rate'] or 0):.0f} %"
        scores = [score(figures.scores[role]) for role in (PUBLIC, UNSEEN)]
        lines.append([player(entry), steps, *scores, hops])
    return markdown_table(lines)


def lowest_of(slug: str) -> str:
    """Return the lowest known return per step of an ally."""
    return next(kept(figures) for entry, figures in verified("ally") if entry.slug == slug)


def with_lowest(role: str) -> str:
    """Return the correlation of the attacked allies' scores with their lowest known returns."""
    entries = [figures for _, figures in attacked("ally")]
    values = [[lowest(of).return_per_step.value, of.scores[role].value] for of in entries]
    found = correlation_interval(spearman(*np.array(values).T), len(values))
    return f"{per_step(found.value)} [{per_step(found.low)}, {per_step(found.high)}]"


def most_against(opponent: str) -> str:
    """Return the most that any of the best allies of the cross-play earns per step from an opponent."""
    played = board()[0].crossplay["standard"]
    returns = np.array(played.returns["ally"])
    best = np.argsort(-returns.mean(1))[:FIRST]
    return per_step(returns[best, played.opponents.index(opponent)].max())


def ranked() -> str:
    """Return the table of how many entries of each track may be best, and how many pairs are told apart."""
    lines = []
    for track in board()[0].tracks:
        places = {entry.slug: of for entry, of in track.verified() if of.rank is not None}
        of_track = [of for of in read_entries().verified if of.track.key == track.key and of.slug in places]
        samples = [of.summaries[track.ranked_by].samples for of in of_track]
        halves = [[of[:, k::2] for of in samples] for k in (0, 1)]
        (one, at_one), (other, at_other) = (differences(half, pair_error(len(half))) for half in halves)
        count, told = len(places), sum(of.rank[0] - 1 for of in places.values() if of.rank)
        best = sum(of.may_be_best for of in places.values())
        turned = int(((one > at_one) & (other < -at_other)).sum())
        pairs = f"{told} of {count * (count - 1) // 2}"
        lines.append([track.title, str(count), str(best), pairs, str(turned)])
    return markdown_table([RANKED, *lines])


def top(suite: str) -> str:
    """Return the reward per step that scores 100 in a suite."""
    return f"{load_suite(suite).scale.top:g}"


def planner_scores() -> str:
    """Return the table of the scores of planners, best first."""
    with (ROOT / PLANNER_SCORES).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    keys = ("score", "score_low", "score_high")
    scores = {row["entry"]: Interval(*(float(row[key]) for key in keys), MATCHES) for row in rows}
    ranked = sorted(scores, key=lambda name: -scores[name].value)
    return markdown_table([("planner", "score"), *([f"`{name}`", score(scores[name])] for name in ranked)])


def quotes() -> Mapping[str, Mapping[str, str]]:
    """Return the figures by page and mark."""
    (leader, of_leader), *_ = verified("ally")
    return {
        "README.md": {"headline": headline()},
        "docs/index.md": {"leader": f"{player(leader)}, {score(of_leader.scores[UNSEEN])}"},
        "docs/benchmark/protocol.md": {
            "top": top("ally-v2"),
            "top in link": top("ally-link-v1"),
            "ranked": ranked(),
        },
        "docs/guides/planners.md": {"scores": planner_scores()},
        "docs/results/champions.md": {
            "allies": track_table("ally"),
            "allies in link": track_table("ally-link"),
            "opponents that fly themselves": track_table("opponent-learned"),
            "opponents in pursuit": track_table("opponent-pursuit"),
            "with held-out": with_lowest(UNSEEN),
            "with public": with_lowest(PUBLIC),
            "lowest of belief": lowest_of("belief"),
        },
        "docs/results/findings.md": {
            "most against hunter": most_against("hunter"),
            "lowest of the first": lowest_of(leader.slug),
            "lowest of a double oracle": lowest_of("ally-champion-2"),
            "lowest of self-play": lowest_of("ally-champion-3"),
        },
        "docs/results/papers.md": {"learners in link": learners_in_link()},
    }


def main() -> None:
    """Write all figures."""
    for page, figures in quotes().items():
        fill(ROOT / page, figures)


if __name__ == "__main__":
    run(main)
