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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

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
_SUMS = {  # measure -> tally of a round
    "ally": "ally_return",
    "opponent": "opponent_return",
    "overlap": "overlap",
    "success": "jammed",
    "hops": "hops",
}
_LONGEST = max(REMEMBERED.values())
_PLANNED: Mapping[str, Any] = {"planner": "interceptor"}


@dataclass(frozen=True)
class Part:
    """A part of a claim under an interpretation.

    Attributes:
        claim: of :data:`fpg_bench.paper.claims.ASPECTS`.
        statement: the quantity claimed to be positive.
        mean, low, high: the difference and its 95 % interval (Welch).
        p: two-sided.
    """

    claim: str
    statement: str
    mean: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class Played:
    """Results of a pair of players, round by round.

    Attributes:
        ally, opponent: ``(rounds, games)`` rewards a step.
        overlap, success, hops: ``(rounds, games)`` shares of the steps.
        histograms: ``(rounds, 2, points)`` steps per frequency point, and ``(rounds, 2, 30)`` per finer bin.
    """

    ally: np.ndarray
    opponent: np.ndarray
    overlap: np.ndarray
    success: np.ndarray
    hops: np.ndarray
    histograms: tuple[np.ndarray, np.ndarray]

    def matches(self, name: str) -> np.ndarray:
        """Return the mean of a measure over each match, ``(games,)``."""
        return getattr(self, name).mean(axis=0)

    def first(self, rounds: int) -> Played:
        """Return the first rounds of each match."""
        cut = {name: getattr(self, name)[:rounds] for name in _SUMS}
        coarse, fine = (each[:rounds] for each in self.histograms)
        return replace(self, **cut, histograms=(coarse, fine))


def play_pair(
    interpretation: Interpretation, ally: str, opponent: str, games: int, rounds: int = 1, **options: Any
) -> Played:
    """Play the first rounds of some matches between two scripts, on the same seeds for every pair.

    Scripts do not observe the hop cost, and the first rounds of a match do not depend on later ones. So
    interpretations that differ in these points only share the games.

    Args:
        interpretation: the rules.
        ally, opponent: names of the scripts.
        games, rounds: number of matches, and of rounds in each.
        **options: those of :func:`fpg_bench.envs.two_player.make_duel`.
    """
    played = _play_free(_free(interpretation), ally, opponent, games, rounds, tuple(options.items()))
    return replace(played, ally=played.ally - interpretation.scenario().hop_cost * played.hops)


def _free(interpretation: Interpretation) -> Interpretation:
    """Return the interpretation whose games this one shares, with free hops and the longest memory."""
    return interpretation.replace(hop_cost="0", memory="for-ever")


@lru_cache(maxsize=128)
def _play_free(
    interpretation: Interpretation,
    ally: str,
    opponent: str,
    games: int,
    rounds: int,
    options: tuple[tuple[str, Any], ...],
) -> Played:
    scenario = interpretation.scenario()
    core = JointGame(games, scenario=scenario, **dict(options))
    players: list[Any] = [as_player(ally, "ally", scenario), as_player(opponent, "opponent", scenario)]
    core.reset(seeds=np.array(evaluation_seeds(games)))
    tallies, coarse, fine = [], [], []
    for number in range(rounds):
        if number:
            core.reset(np.ones(games, bool))
        fine.append(_play_round(core, players, games))
        tallies.append(core.duel.batch.tallies.copy())
        coarse.append(core.duel.batch.histograms.sum(axis=0))
    sums = np.stack(tallies)
    shares: dict[str, Any] = {name: sums[tally] / sums["steps"] for name, tally in _SUMS.items()}
    return Played(**shares, histograms=(np.stack(coarse), np.stack(fine)))


def _play_round(core: JointGame, players: Sequence[Any], games: int) -> np.ndarray:
    """Play a round, and return the finer histogram of both centre frequencies, ``(2, 30)``."""
    scenario, state = core.scenario, core.duel.batch.games
    memories: list[Any] = [None, None]
    starts, counts = np.ones(games, bool), np.zeros((2, FINE))
    for _ in range(scenario.steps_per_round):
        actions: list[Any] = [None, None]
        for side, observations in enumerate(np.split(core.observations, 2, axis=1)):
            actions[side], memories[side] = players[side].predict(
                np.ascontiguousarray(observations), memories[side], starts
            )
        core.step(np.concatenate(actions, axis=1))
        starts = np.zeros(games, bool)
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
    pair = partial(play_pair, interpretation, games=games)
    best = {kind: _best(pair, kind, (*ASKING, *NOT_ASKING)) for kind in JAMMING_TYPES}
    most = max(2, games // 3)
    planned = play_pair(interpretation, "expert", "adaptive", most, _LONGEST, **_PLANNED).first(
        interpretation.rounds
    )
    early = pair("random", "random", path="circle")
    parts = [
        *_paths(pair, planned),
        *_over_training(early, planned),
        *_types(best),
        _difference(
            "D4 knowledge",
            "ally's reward: best script with - without knowledge base",
            _best(pair, "adaptive", ASKING).matches("ally"),
            _best(pair, "adaptive", NOT_ASKING, knowledge="none").matches("ally"),
        ),
    ]
    return {
        "interpretation": interpretation.name,
        "games": games,
        "parts": [asdict(part) for part in parts],
        "overlap": [round(float(each.overlap.mean()), 5) for each in (early, planned)],
        "spectrum overlap": [
            [round(spectrum_overlap(each.sum(axis=0)) or 0.0, 5) for each in played.histograms]
            for played in (early, planned)
        ],
    }


def _best(pair: Any, opponent: str, allies: Iterable[str], **options: Any) -> Played:
    """Return the games of the ally's best script, by its own reward, against an opponent on the circle."""
    results: list[Played] = [pair(ally, opponent, path="circle", **options) for ally in allies]
    return max(results, key=lambda played: float(played.ally.mean()))


def _paths(pair: Any, planned: Played) -> Iterator[Part]:
    for path in FIXED_PATHS:
        yield _earned("D1", f"planned - {path}", planned, pair("expert", "adaptive", path=path))
    yield _earned("D4 planner", "planned - learned path", planned, pair("expert", "adaptive", path="learned"))


def _over_training(early: Played, late: Played) -> Iterator[Part]:
    overlap, success = ((early.matches(name), late.matches(name)) for name in ("overlap", "success"))
    yield _difference("D2", "overlap ratio: early - late", *overlap)
    yield _difference("D2", "jamming success rate: late - early", *reversed(success))


def _types(best: Mapping[str, Played]) -> Iterator[Part]:
    for kind, played in best.items():
        statement = f"{kind} alone: ally's - opponent's reward"
        yield _difference("D3 level", statement, played.matches("ally"), played.matches("opponent"))
    for strong, weak in STRONGER:
        yield _earned("D3 order", f"{strong} - {weak}", best[strong], best[weak])


def _earned(claim: str, names: str, high: Played, low: Played) -> Part:
    """Compare the opponent's rewards."""
    return _difference(
        claim, f"opponent's reward: {names}", high.matches("opponent"), low.matches("opponent")
    )


def _difference(claim: str, statement: str, high: np.ndarray, low: np.ndarray) -> Part:
    """Test a difference by Welch's t-test."""
    mean = float(high.mean() - low.mean())
    if high.std() == low.std() == 0:  # nothing varies
        return Part(claim, statement, mean, mean, mean, 0.0 if mean else 1.0)
    test = ttest_ind(high, low, equal_var=False)
    numbers = (mean, *test.confidence_interval(), test.pvalue)
    return Part(claim, statement, *(float(f"{number:.5g}") for number in numbers))


def screen_all(
    interpretations: Iterable[Interpretation], file: Path, games: int = 96, n_jobs: int = 2
) -> list[Row]:
    """Screen interpretations, and return their rows in the same order.

    Args:
        interpretations: the interpretations.
        file: file of the rows; existing rows are kept, and new ones appended as they finish.
        games: see :func:`screen`.
        n_jobs: number of processes.

    Raises:
        UserError: malformed rows, or failed jobs (the other rows are kept).
    """
    rows = RowFile(file, {"interpretation": str, "games": int, "parts": list})
    interpretations = list(interpretations)
    with rows.locked():
        done = {row["interpretation"] for row in rows.read() if row["games"] == games}
        groups: dict[Interpretation, list[Interpretation]] = {}  # by the games that they share
        for interpretation in interpretations:
            if interpretation.name not in done:
                groups.setdefault(_free(interpretation), []).append(interpretation)
        jobs = [
            Job(
                f"{group[0].name} and {len(group) - 1} more",
                partial(_screen_group, group, games),
                rows.append,
            )
            for group in groups.values()
        ]
        check_all_done(run_jobs(jobs, n_jobs))
        by_name = {row["interpretation"]: row for row in rows.read() if row["games"] == games}
    return [by_name[interpretation.name] for interpretation in interpretations]


def _screen_group(interpretations: Iterable[Interpretation], games: int) -> list[Row]:
    return [screen(interpretation, games) for interpretation in interpretations]


HELD, OPPOSITE, OPEN = "#0b5fa5", "#d95f02", "#777777"


@dataclass(frozen=True)
class Effect:
    """A claim under an interpretation: its weakest part decides (intersection-union test).

    Attributes:
        interpretation: the interpretation.
        weakest: the part, as in a row of the screen.
        n_reversed: number of parts whose interval lies below zero.
    """

    interpretation: Interpretation
    weakest: Mapping[str, Any]
    n_reversed: int

    @property
    def size(self) -> float:
        """Mean of the weakest part in half widths of its interval, which makes claims comparable."""
        part = self.weakest
        return part["mean"] / max((part["high"] - part["low"]) / 2, 1e-9)

    @property
    def holds(self) -> bool:
        """True if all parts hold: the weakest is positive with a one-sided p below 0.025."""
        return _not_positive(self.weakest) < LEVEL / 2


def claims_of(rows: Sequence[Row]) -> list[str]:
    """Return the claims that occur in rows, sorted."""
    return sorted({part["claim"] for row in rows for part in row["parts"]})


def effects(rows: Sequence[Row], claim: str) -> list[Effect]:
    """Return a claim's effects under all interpretations, the weakest first."""
    unsorted = (_effect(row, claim) for row in rows)
    return sorted(unsorted, key=lambda effect: (effect.size, effect.interpretation.name))


def _effect(row: Row, claim: str) -> Effect:
    parts = [part for part in row["parts"] if part["claim"] == claim]
    weakest = max(parts, key=_not_positive)
    return Effect(
        parse_interpretation(row["interpretation"]), weakest, sum(part["high"] < 0 for part in parts)
    )


def _not_positive(part: Mapping[str, Any]) -> float:
    """Return the one-sided p of a part."""
    half = part["p"] / 2
    return half if part["mean"] > 0 else 1 - half


def shares(claim_effects: Sequence[Effect]) -> dict[tuple[str, str], float]:
    """Return by point and setting the share of interpretations under which the claim holds."""
    held: dict[tuple[str, str], list[bool]] = {}
    for effect in claim_effects:
        for setting in effect.interpretation.items:
            held.setdefault(setting, []).append(effect.holds)
    return {key: sum(values) / len(values) for key, values in held.items()}


def draw_curve(rows: Sequence[Row]) -> Any:
    """Draw the specification curve: a column per claim, with its weakest part and the settings below."""
    settings = [(point, setting) for point, known in POINTS.items() for setting in known]
    claims = claims_of(rows)
    figure = blank_figure(2.6 * len(claims) + 1.4, 8)
    above, below = figure.subplots(2, len(claims), sharex="col", sharey="row", height_ratios=(2, 3))
    for column, claim in enumerate(claims):
        claim_effects = effects(rows, claim)
        _draw_effects(above[column], claim_effects, claim)
        _draw_settings(below[column], claim_effects, settings)
    above[0].set_ylabel("weakest part, in its 95 % half widths")
    below[0].set_yticks(
        range(len(settings)), [f"{point}: {setting}" for point, setting in settings], fontsize=8
    )
    below[0].invert_yaxis()
    return figure


def _colour(effect: Effect) -> str:
    if effect.holds:
        return HELD
    return OPPOSITE if effect.n_reversed else OPEN


def _draw_effects(axes: Any, claim_effects: Sequence[Effect], claim: str) -> None:
    places, held = range(len(claim_effects)), sum(effect.holds for effect in claim_effects)
    sizes, colours = [effect.size for effect in claim_effects], [_colour(each) for each in claim_effects]
    axes.scatter(places, sizes, s=4, c=colours, linewidths=0, rasterized=True)
    axes.axhline(0, color="black", lw=0.8)
    axes.axhspan(-1, 1, color="#000000", alpha=0.08, lw=0)
    axes.set_yscale("symlog", linthresh=1)
    axes.set_title(f"{claim}:\nholds under {held} of {len(places)}", fontsize=9)


def _draw_settings(axes: Any, claim_effects: Sequence[Effect], settings: list[tuple[str, str]]) -> None:
    dots = [
        (place, settings.index(setting), _colour(effect))
        for place, effect in enumerate(claim_effects)
        for setting in effect.interpretation.items
    ]
    across, down, colours = zip(*dots, strict=True)
    axes.scatter(across, down, s=28, c=colours, marker="|", linewidths=0.25, rasterized=True)
    axes.set_xlabel("interpretations, sorted")
    axes.grid(axis="y", alpha=0.2)


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


def make_screen(out: Path, games: int = 96, points: Iterable[str] = POINTS, n_jobs: int = 2) -> list[Path]:
    """Screen interpretations; return the written files: rows, ``screen.md`` and the specification curve.

    Args:
        out: folder; rows in its ``screen.jsonl`` are kept. ``screen.jsonl.gz`` holds all of them at the end.
        games: matches of each pair of scripts.
        points: points in which the interpretations differ.
        n_jobs: number of processes.

    Raises:
        UserError: an unknown point, malformed rows, or failed jobs (the other rows are kept).
    """
    rows = screen_all(all_interpretations(points), out / "screen.jsonl", games, n_jobs)
    text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)
    write_whole(out / ROWS, gzip.compress(text.encode(), mtime=0))
    return [out / ROWS, *write_screen(rows, out)]


def read_screen(folder: Path) -> list[Row]:
    """Read the rows of a complete screen, ``screen.jsonl.gz``; raises UserError if it is unreadable."""
    return [read_object(line) for line in read_bounded(folder / ROWS, "rows", _MAX_BYTES).splitlines()]


def write_screen(rows: Sequence[Row], out: Path) -> list[Path]:
    """Write ``screen.md`` and the specification curve, and return the files."""
    written = save_figure(draw_curve(rows), out / "figures" / "screen")
    write_whole(out / "screen.md", _HEAD.format(count=len(rows)) + _tables(rows))
    return [*written, out / "screen.md"]


def _tables(rows: Sequence[Row]) -> str:
    by_claim = {claim: effects(rows, claim) for claim in claims_of(rows)}
    games = rows[0]["games"]
    sections = {
        "How often each claim holds": _held(by_claim),
        "Part by part": _parts(rows),
        "Effect of each point": by_setting(rows),
        "Interpretations under which most claims hold": _best_table(by_claim),
        "How far the spectra overlap (Fig. 4)": _bins(rows) + "\n\n" + _BINS_NOTE,
        "How it was made": f"```bash\npython -m scripts.interpretations screen --games {games}\n```\n\n"
        f"{games} matches of each pair of scripts, on evaluation seeds, one round of each; of planned paths "
        f"{max(2, games // 3)} matches, with all rounds that the planner remembers.",
    }
    return "\n\n".join(f"## {title}\n\n{text}" for title, text in sections.items()) + "\n"


def _held(by_claim: dict[str, list[Effect]]) -> str:
    lines = [["claim", "the paper", "holds", "a part is reversed", "weakest part most often"]]
    for claim, each in by_claim.items():
        held, against = sum(effect.holds for effect in each), sum(effect.n_reversed > 0 for effect in each)
        weakest = Counter(effect.weakest["statement"] for effect in each if not effect.holds)
        most_often = max(weakest, key=lambda text: (weakest[text], text), default="-")
        lines.append([claim, ASPECTS[claim], f"{held} of {len(each)}", str(against), most_often])
    return markdown_table(lines)


def _parts(rows: Sequence[Row]) -> str:
    """Tabulate for each part how many interpretations show it, and its opposite."""
    lines = [["claim", "claimed to be positive", "shown", "reversed", "not shown"]]
    for number, part in enumerate(rows[0]["parts"]):
        same = [row["parts"][number] for row in rows]
        shown = [each for each in same if each["p"] < LEVEL]
        above = sum(each["mean"] > 0 for each in shown)
        counts = (above, len(shown) - above, len(same) - len(shown))
        lines.append([part["claim"], part["statement"], *map(str, counts)])
    return markdown_table([lines[0], *sorted(lines[1:])])


def _bins(rows: Sequence[Row]) -> str:
    """Tabulate the spectrum overlap on 15 points and 30 bins, early and late, by hopping mode."""
    lines = [["hops", "stage", "overlap ratio %", "15 points %", "30 bins %"]]
    for hops in POINTS["hops"]:
        some = [row for row in rows if parse_interpretation(row["interpretation"]).setting("hops") == hops]
        for stage, stage_name in enumerate(("early", "late") if some else ()):
            by_bins = [[row["spectrum overlap"][stage][kind] for row in some] for kind in (0, 1)]
            ranges = [[row["overlap"][stage] for row in some], *by_bins]
            ranges_pct = [f"{100 * min(each):.0f} to {100 * max(each):.0f}" for each in ranges]
            lines.append([hops, stage_name, *ranges_pct])
    return markdown_table(lines)


def by_setting(rows: Sequence[Row]) -> str:
    """Tabulate the share of interpretations with each setting under which each claim holds."""
    by_claim = {claim: shares(effects(rows, claim)) for claim in claims_of(rows)}
    lines = [["point", "setting", "meaning", *(f"{claim} holds %" for claim in by_claim)]]
    for point, known in POINTS.items():
        for name, setting in known.items():
            held = [each.get((point, name)) for each in by_claim.values()]
            if None not in held:
                variants = [f"{100 * share:.0f}" for share in held if share is not None]
                lines.append([point, f"`{name}`", setting.about, *variants])
    return markdown_table(lines)


def _best_table(by_claim: dict[str, list[Effect]], most: int = 10) -> str:
    held: dict[str, list[str]] = {}
    for claim, claim_effects in by_claim.items():
        for effect in claim_effects:
            held.setdefault(effect.interpretation.name, []).extend([claim] if effect.holds else [])
    order = sorted(held, key=lambda name: (-len(held[name]), name.count("="), name))
    lines = [["interpretation", "claims that hold"]]
    return markdown_table(lines + [[f"`{name}`", ", ".join(held[name]) or "none"] for name in order[:most]])
