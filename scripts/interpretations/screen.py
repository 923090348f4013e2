"""Scripted screen: test the paper's claims between players that do not learn, under each interpretation.

Scripts take seconds where MADDPG takes hours, so that all combinations of settings are tested. Scripts stand
for the learned policies in a claim:

* D1, D4: the opponent ``adaptive`` on paths planned by the ``interceptor``, on fixed ones, and flying itself.
* D2: random players stand for the start of training, ``expert`` and ``adaptive`` for its end.
* D3, D4: the ally plays the script that earns most against each jamming type. With the knowledge base it is
  chosen among the scripts that use it, without it among the others, in a game that has none.

The specification curve follows Simonsohn, Simmons and Nelson, "Specification curve analysis" (Nature Human
Behaviour, 2020).
"""

from __future__ import annotations

import gzip
import json
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import lru_cache, partial
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import ttest_ind

from fpg_bench.common.files import read_bounded, write_whole
from fpg_bench.common.parallel import Job, check_all_done, run_jobs
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.strict_json import read_object
from fpg_bench.envs.core import JointGame
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.metrics import spectrum_overlap
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.paper.claims import ASPECTS, LEVEL, STRONGER
from fpg_bench.paper.conditions import FIXED_PATHS
from fpg_bench.paper.figures import save_figure
from fpg_bench.paper.report import markdown_table
from fpg_bench.players.registry import as_player
from fpg_bench.rendering.canvas import blank_figure
from scripts.interpretations.interpretations import (
    POINTS,
    REMEMBERED,
    Interpretation,
    all_interpretations,
    parse_interpretation,
)

ASKING = ("expert", "expert-spread")  # allies that use the knowledge base
NOT_ASKING = ("idle", "reactive", "always-hop")
FINE = 30  # bins of a finer histogram, for the continuous jamming frequency
_TALLIES = {  # measure -> tally of a round
    "ally": "ally_return",
    "opponent": "opponent_return",
    "overlap": "overlap",
    "success": "jammed",
    "hops": "hops",
}
# Per measure (rounds, games): rewards per step and shares of steps. ``points`` (rounds, 2, points) and
# ``bins`` (rounds, 2, 30): steps of both sides per frequency point and per finer bin.
Played = dict[str, np.ndarray]


def play_pair(
    interpretation: Interpretation, ally: str, opponent: str, games: int, rounds: int = 1, **options: str
) -> Played:
    """Play the first rounds of some matches between two scripts, on the same seeds for every pair.

    Args:
        interpretation: the rules.
        ally, opponent: names of the scripts.
        games, rounds: number of matches, and of rounds in each.
        **options: those of :func:`fpg_bench.envs.two_player.make_duel`.
    """
    played = _play_free(_free(interpretation), ally, opponent, games, rounds, **options)
    return played | {"ally": played["ally"] - interpretation.scenario().hop_cost * played["hops"]}


def _free(interpretation: Interpretation) -> Interpretation:
    """Return the interpretation whose games this one shares, with free hops and the longest memory.

    Scripts do not observe the hop cost, and the first rounds of a match do not depend on later ones.
    """
    return interpretation.replace({"hop-cost": "0", "memory": "for-ever"})


@lru_cache(maxsize=128)
def _play_free(
    interpretation: Interpretation, ally: str, opponent: str, games: int, rounds: int, **options: str
) -> Played:
    scenario = interpretation.scenario()
    core = JointGame(games, scenario=scenario, **options)
    players = [as_player(ally, "ally", scenario), as_player(opponent, "opponent", scenario)]
    core.reset(seeds=np.array(evaluation_seeds(games)))
    tallies, points, bins = [], [], []
    for number in range(rounds):
        if number:
            core.reset(np.ones(games, bool))
        bins.append(play_round(core, players))
        tallies.append(core.duel.batch.tallies.copy())
        points.append(core.duel.batch.histograms.sum(axis=0))
    sums = np.stack(tallies)
    played = {name: sums[tally] / sums["steps"] for name, tally in _TALLIES.items()}
    return played | {"points": np.stack(points), "bins": np.stack(bins)}


def play_round(core: JointGame, players: Sequence[Any]) -> np.ndarray:
    """Play a round, and return the finer histogram of both centre frequencies, ``(2, 30)``."""
    scenario, state = core.scenario, core.duel.batch.games
    memories: list[Any] = [None, None]
    starts, counts = np.ones(core.count, bool), np.zeros((2, FINE))
    for _ in range(scenario.steps_per_round):
        actions: list[Any] = [None, None]
        for side, observations in enumerate(np.split(core.observations, 2, axis=1)):
            actions[side], memories[side] = players[side].predict(
                np.ascontiguousarray(observations), memories[side], starts
            )
        core.step(np.concatenate(actions, axis=1))
        starts = np.zeros(core.count, bool)
        for side, name in enumerate(("frequency_mhz", "jamming_mhz")):
            share = (state[name] - scenario.band_low_mhz) / (scenario.band_high_mhz - scenario.band_low_mhz)
            counts[side] += np.bincount((share * FINE).astype(int).clip(0, FINE - 1), minlength=FINE)
    return counts


def screen(interpretation: Interpretation, games: int) -> Row:
    """Test each claim under an interpretation, and return a row.

    Args:
        interpretation: the rules.
        games: matches of each pair; planned paths have a third of them, with all rounds.
    """
    pair = partial(play_pair, interpretation)

    def best(opponent: str, allies: Iterable[str], **options: str) -> Played:
        """Return the games of the ally's best script, by its reward, against an opponent on the circle."""
        played = [pair(ally, opponent, games, path="circle", **options) for ally in allies]
        return max(played, key=lambda each: float(each["ally"].mean()))

    matches, longest = max(2, games // 3), max(REMEMBERED.values())
    long = pair("expert", "adaptive", matches, longest, planner="interceptor")
    planned = {name: values[: interpretation.rounds] for name, values in long.items()}
    early = pair("random", "random", games, path="circle")
    flown = {path: pair("expert", "adaptive", games, path=path) for path in (*FIXED_PATHS, "learned")}
    jammed = {kind: best(kind, (*ASKING, *NOT_ASKING)) for kind in JAMMING_TYPES}
    with_knowledge, without = best("adaptive", ASKING), best("adaptive", NOT_ASKING, knowledge="none")
    parts = [
        *(_part("D1", f"opponent's reward: planned - {path}", planned, flown[path]) for path in FIXED_PATHS),
        _part("D4 planner", "opponent's reward: planned - learned path", planned, flown["learned"]),
        _part("D2", "overlap ratio: early - late", early, planned, "overlap"),
        _part("D2", "jamming success rate: late - early", planned, early, "success"),
        *(
            _part("D3 level", f"{kind} alone: ally's - opponent's reward", played, played, "ally", "opponent")
            for kind, played in jammed.items()
        ),
        *(
            _part("D3 order", f"opponent's reward: {strong} - {weak}", jammed[strong], jammed[weak])
            for strong, weak in STRONGER
        ),
        _part(
            "D4 knowledge",
            "ally's reward: best script with - without knowledge base",
            with_knowledge,
            without,
            "ally",
        ),
    ]
    return {
        "interpretation": interpretation.name,
        "games": games,
        "parts": parts,
        "overlap": [round(float(played["overlap"].mean()), 5) for played in (early, planned)],
        "spectrum overlap": [
            [round(spectrum_overlap(played[name].sum(axis=0)) or 0.0, 5) for name in ("points", "bins")]
            for played in (early, planned)
        ],
    }


def _part(
    claim: str, statement: str, more: Played, less: Played, name: str = "opponent", other: str | None = None
) -> Row:
    """Test a difference, which the claim says is positive, between means of matches by Welch's t-test.

    Args:
        claim: of :data:`fpg_bench.paper.claims.ASPECTS`.
        statement: description of the difference.
        more, less: games whose difference it is.
        name, other: measures of ``more`` and ``less``; ``other`` defaults to ``name``.
    """
    above, below = more[name].mean(axis=0), less[other or name].mean(axis=0)
    mean = float(above.mean() - below.mean())
    if above.std() == below.std() == 0:  # nothing varies
        low, high, p = mean, mean, 0.0 if mean else 1.0
    else:
        test = ttest_ind(above, below, equal_var=False)
        mean, low, high, p = (
            float(f"{number:.5g}") for number in (mean, *test.confidence_interval(), test.pvalue)
        )
    return {"claim": claim, "statement": statement, "mean": mean, "low": low, "high": high, "p": p}


HOLDS, REVERSED, OPEN = "#0b5fa5", "#d95f02", "#777777"


class Effect(NamedTuple):
    """A claim under an interpretation: its weakest part decides (intersection-union test).

    Attributes:
        interpretation: the interpretation.
        size: mean of the weakest part in half widths of its interval, which makes claims comparable.
        statement: of the weakest part.
        holds: true if all parts hold: the weakest is positive with a one-sided p below 0.025.
        is_reversed: true if the interval of any part is below zero.
    """

    interpretation: Interpretation
    size: float
    statement: str
    holds: bool
    is_reversed: bool

    @property
    def colour(self) -> str:
        """Colour in figures."""
        return HOLDS if self.holds else REVERSED if self.is_reversed else OPEN


def effects(rows: Iterable[Row]) -> dict[str, list[Effect]]:
    """Return the effects of each claim under all interpretations, the weakest first; claims are sorted."""
    by_claim: dict[str, list[Effect]] = {claim: [] for claim in sorted(ASPECTS)}
    for row in rows:
        for claim, unsorted in by_claim.items():
            parts = [part for part in row["parts"] if part["claim"] == claim]
            weakest = max(parts, key=_one_sided_p)
            unsorted.append(
                Effect(
                    parse_interpretation(row["interpretation"]),
                    weakest["mean"] / max((weakest["high"] - weakest["low"]) / 2, 1e-9),
                    weakest["statement"],
                    holds=_one_sided_p(weakest) < LEVEL / 2,
                    is_reversed=any(part["high"] < 0 for part in parts),
                )
            )
    key = attrgetter("size", "interpretation.name")
    return {claim: sorted(unsorted, key=key) for claim, unsorted in by_claim.items()}


def _one_sided_p(part: Row) -> float:
    half = part["p"] / 2
    return float(half if part["mean"] > 0 else 1 - half)


def draw_curve(by_claim: Mapping[str, list[Effect]]) -> Any:
    """Draw the specification curve: a column per claim, with its weakest part and the settings below."""
    settings = [(point, setting) for point, known in POINTS.items() for setting in known]
    figure = blank_figure(2.6 * len(ASPECTS) + 1.4, 8)
    above, below = figure.subplots(2, len(ASPECTS), sharex="col", sharey="row", height_ratios=(2, 3))
    for curve, strokes, (claim, each) in zip(above, below, by_claim.items(), strict=True):
        colours, sizes = [effect.colour for effect in each], [effect.size for effect in each]
        curve.scatter(range(len(each)), sizes, s=4, c=colours, linewidths=0, rasterized=True)
        curve.axhline(0, color="black", lw=0.8)
        curve.axhspan(-1, 1, color="#000000", alpha=0.08, lw=0)
        curve.set_yscale("symlog", linthresh=1)
        held = sum(effect.holds for effect in each)
        curve.set_title(f"{claim}:\nholds under {held} of {len(each)}", fontsize=9)
        across, colours = (np.repeat(values, len(POINTS)) for values in (range(len(each)), colours))
        down = [settings.index(item) for effect in each for item in effect.interpretation.items]
        strokes.scatter(across, down, s=28, c=colours, marker="|", linewidths=0.25, rasterized=True)
        strokes.set_xlabel("interpretations, sorted")
        strokes.grid(axis="y", alpha=0.2)
    above[0].set_ylabel("weakest part, in its 95 % half widths")
    labels = [f"{point}: {setting}" for point, setting in settings]
    below[0].set_yticks(range(len(settings)), labels, fontsize=8)
    below[0].invert_yaxis()
    return figure


ROWS = "screen.jsonl.gz"
_MAX_BYTES = 2**26  # of all rows; those of 768 interpretations are two million
_HEAD = """\
# The paper's claims under every interpretation: scripted players

{count} interpretations of the paper were played: every combination of the settings below. Nobody learns here;
scripts stand for both sides (`scripts/interpretations/screen.py` lists them). This page therefore shows what
the *game* rewards under an interpretation, and where training is worth its hours. A claim holds under an
interpretation if all its parts do, each with p below 0.05 (two-sided, Welch; parts of one claim need no
correction, since all have to hold). There is no correction for the number of interpretations: by chance
alone, a claim of one part with no true effect would hold under one in forty.

![Each claim under each interpretation: blue holds, orange has a part that is reversed](figures/screen.png)

Blue: the claim holds. Orange: one of its parts is reversed. Grey: neither is shown. Above, each dot is an
interpretation by its weakest part; grey background: the interval of that part contains zero. Below, a stroke
marks the settings of the interpretation above it.

"""
_BINS_NOTE = """\
Lowest to highest over the interpretations. The paper's overlap stays near 54 % (54.46, 54.39, 53.69). An ally
on fifteen points fills half of thirty bins, while a jammer with a continuous centre frequency fills all of
them. So finer bins alone bring the overlap of two even spectra near one half, whoever plays. The paper does
not state the width of its bins."""


def make_screen(
    out: Path, games: int = 96, points: Collection[str] = tuple(POINTS), n_jobs: int = 2
) -> list[Path]:
    """Screen interpretations; return the written files: rows, ``screen.md`` and the specification curve.

    Args:
        out: folder; rows in its ``screen.jsonl`` are kept. ``screen.jsonl.gz`` holds all of them at the end.
        games: matches of each pair of scripts.
        points: points in which the interpretations differ.
        n_jobs: number of processes.

    Raises:
        UserError: malformed rows, or failed jobs (the other rows are kept).
    """
    file = RowFile(out / "screen.jsonl", {"interpretation": str, "games": int, "parts": list})
    interpretations = list(all_interpretations(points))
    with file.locked():
        done = {row["interpretation"] for row in file.read() if row["games"] == games}
        groups: dict[Interpretation, list[Interpretation]] = {}  # by the games that they share
        for interpretation in interpretations:
            if interpretation.name not in done:
                groups.setdefault(_free(interpretation), []).append(interpretation)
        jobs = [
            Job(free.name, partial(_screen_all, group, games), file.append) for free, group in groups.items()
        ]
        check_all_done(run_jobs(jobs, n_jobs))
        by_name = {row["interpretation"]: row for row in file.read() if row["games"] == games}
    rows = [by_name[interpretation.name] for interpretation in interpretations]
    text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)
    write_whole(out / ROWS, gzip.compress(text.encode(), mtime=0))
    return [out / ROWS, *write_screen(rows, out)]


def _screen_all(interpretations: Iterable[Interpretation], games: int) -> list[Row]:
    return [screen(interpretation, games) for interpretation in interpretations]


def read_screen(folder: Path) -> list[Row]:
    """Read the rows of a complete screen, ``screen.jsonl.gz``; raises UserError if it is unreadable."""
    return [read_object(line) for line in read_bounded(folder / ROWS, "rows", _MAX_BYTES).splitlines()]


def write_screen(rows: Sequence[Row], out: Path) -> list[Path]:
    """Write ``screen.md`` and the specification curve, and return the files."""
    by_claim, games = effects(rows), rows[0]["games"]
    written = save_figure(draw_curve(by_claim), out / "figures" / "screen")
    sections = {
        "How often each claim holds": _held(by_claim),
        "Part by part": _parts(rows),
        "Effect of each point": by_setting(by_claim),
        "Interpretations under which most claims hold": _most(by_claim),
        "How far the spectra overlap (Fig. 4)": _bins(rows) + "\n\n" + _BINS_NOTE,
        "How it was made": f"```bash\npython -m scripts.interpretations --games {games}\n```\n\n"
        f"{games} matches of each pair of scripts, on evaluation seeds, one round of each; of planned paths "
        f"{max(2, games // 3)} matches, with all rounds that the planner remembers.",
    }
    text = "\n\n".join(f"## {title}\n\n{text}" for title, text in sections.items()) + "\n"
    write_whole(out / "screen.md", _HEAD.format(count=len(rows)) + text)
    return [*written, out / "screen.md"]


def _held(by_claim: Mapping[str, list[Effect]]) -> str:
    lines = [["claim", "the paper", "holds", "a part is reversed", "weakest part most often"]]
    for claim, each in by_claim.items():
        weakest = Counter(effect.statement for effect in each if not effect.holds)
        most_often = max(weakest, key=lambda text: (weakest[text], text), default="-")
        held, reverse = sum(effect.holds for effect in each), sum(effect.is_reversed for effect in each)
        lines.append([claim, ASPECTS[claim], f"{held} of {len(each)}", str(reverse), most_often])
    return markdown_table(lines)


def _parts(rows: Sequence[Row]) -> str:
    """Tabulate for each part how many interpretations show it, and its opposite."""
    heading, lines = ["claim", "claimed to be positive", "shown", "reversed", "not shown"], []
    for same in zip(*(row["parts"] for row in rows), strict=True):
        shown = [part["mean"] > 0 for part in same if part["p"] < LEVEL]
        counts = (shown.count(True), shown.count(False), len(same) - len(shown))
        lines.append([same[0]["claim"], same[0]["statement"], *map(str, counts)])
    return markdown_table([heading, *sorted(lines)])


def by_setting(by_claim: Mapping[str, list[Effect]]) -> str:
    """Tabulate the share of interpretations with each setting under which each claim holds."""
    lines = [["point", "setting", "meaning", *(f"{claim} holds %" for claim in by_claim)]]
    for point, known in POINTS.items():
        for name, setting in known.items():
            held = [
                [effect.holds for effect in each if effect.interpretation.setting(point) == name]
                for each in by_claim.values()
            ]
            if all(held):
                lines.append(
                    [point, f"`{name}`", setting.about, *(f"{100 * np.mean(each):.0f}" for each in held)]
                )
    return markdown_table(lines)


def _most(by_claim: Mapping[str, list[Effect]], most: int = 10) -> str:
    """Tabulate the interpretations under which most claims hold."""
    claims: dict[str, list[str]] = {}
    for claim, each in by_claim.items():
        for effect in each:
            claims.setdefault(effect.interpretation.name, []).extend([claim] if effect.holds else [])
    order = sorted(claims, key=lambda name: (-len(claims[name]), name.count("="), name))
    lines = [["interpretation", "claims that hold"]]
    return markdown_table(lines + [[f"`{name}`", ", ".join(claims[name]) or "none"] for name in order[:most]])


def _bins(rows: Sequence[Row]) -> str:
    """Tabulate the spectrum overlap on 15 points and 30 bins, early and late, by hopping mode."""
    lines = [["hops", "stage", "overlap ratio %", "15 points %", "30 bins %"]]
    for hops in POINTS["hops"]:
        some = [row for row in rows if parse_interpretation(row["interpretation"]).setting("hops") == hops]
        for stage, name in enumerate(("early", "late") if some else ()):
            overlaps = np.array([[row["overlap"][stage], *row["spectrum overlap"][stage]] for row in some])
            lowest, highest = 100 * overlaps.min(axis=0), 100 * overlaps.max(axis=0)
            ranges = [f"{low:.0f} to {high:.0f}" for low, high in zip(lowest, highest, strict=True)]
            lines.append([hops, name, *ranges])
    return markdown_table(lines)
