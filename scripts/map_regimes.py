"""Map what the radio link is worth over hop time, reaction and power, with players that adapt at each point.

python scripts/map_regimes.py docs/results/regimes.csv [--page docs/results/regimes.md]

A point is the preset ``link`` with another hop time, interval of checks and jamming power. There scripts, the
Bayes jammer, the range rule and shipped agents meet; both sides then look for better answers among scripts
with other constants, and the matrix is solved as a zero-sum game of the ally's reward. A lever is what the
side loses without one ability, when the players that matter choose anew without it. Rows are written as they
finish; a row that is there is not played again. The page gets a table and the figures beside it.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np
from command import run
from lineage import fill
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from measure_payoffs import Frozen, Values

from fpg_bench.common.canvas import OPPONENT, PAGE, blank_figure, styled, write_figure
from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text, number
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.statistics import nash, student_half
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.game.actions import HOP_GATE, IN_BAND_GATE, KNOWLEDGE_GATE, SPEED, SPREAD_GATE, TUNING
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.players.registry import as_player
from fpg_bench.players.tactics import draw_variants

HOPS = (0.02, 0.1, 0.3, 0.5)  # hop time over dwell: the share of a step that a hop loses
REACTIONS = ((3, 5), (1, 1), (1, 3), (12, 18))  # dwells from one check to the next; first that of link
POWERS_DBM = (39.0, 33.0, 45.0)  # of the jammer, first that of link
BASE_DBM = preset("link").base_power_dbm
MATCHES, CHOSEN_ON = 256, 1_000_000  # matches of a pair, and the first seed of those that choose variants
SEARCHES, VARIANTS = 1, 8  # of variants of each side
MOST = 3  # players of a side that a lever is measured with
AGENTS = "ppo-stack8/seed_0"
KNOWING = "always-hop by knowledge"  # always-hop, with the point that the knowledge base picks
ALLIES = (
    *("idle", "expert", "by-type", "always-hop", KNOWING, "clock"),
    *("range", "range(js_db=0)", "range(js_db=5)"),
    *(f"ally-link{kind}/{AGENTS}" for kind in ("", "-population", "-champion")),
)
OPPONENTS = (
    *("tone", "narrowband", "broadband", "adaptive", "alternate", "hunter(type=0, hold_s=1)", "bayes"),
    *(f"opponent-link{kind}/{AGENTS}" for kind in ("", "-population")),
)
SEARCHED = {"ally": ("range", "clock", "evidence", "by-type"), "opponent": ("hunter", "alternate", "herd")}
ALLY_LEVERS: Mapping[str, Sequence[Values]] = {  # of several constants the best one counts
    "hop": [{HOP_GATE: -1.0}],
    "spread": [{SPREAD_GATE: -1.0}],
    "speed": [{SPEED: -0.2}, {SPEED: 0.4}],  # 10 and 17.5 m/s
    "knowledge": [{KNOWLEDGE_GATE: -1.0}],
    "own point": [{KNOWLEDGE_GATE: 1.0}],
}
TUNED: Values = {TUNING: 0.0, IN_BAND_GATE: -1.0}
# Hop time and reaction of a follower of 1 ms, over the dwell; docs/results/regimes.md has the sources.
RADIOS = {  # and the mark's side
    "B": ("Bluetooth", 0.41, 1.6, "left"),
    "E": ("ExpressLRS", 0.06, 0.13, "left"),
    "C": ("CABELL V3", 0.04, 0.3, "right"),
    "L": ("Link 16", 0.51, 77, "center"),
}
LEVERS = (*ALLY_LEVERS, "type", "tuning")
HALF = " half"  # of the 95 % interval over matches
MEASURED = ("value", *LEVERS)
COLUMNS = (
    *("hop_dwell", "reaction_dwell", "power_dbm", "free", "idle"),
    *(name + end for name in MEASURED for end in ("", HALF)),
    *("allies", "opponents", "seconds"),
)
Line = dict[str, str]


@dataclass(frozen=True)
class Point:
    """A point of the map."""

    hop_s: float
    checks: tuple[int, int]
    power_dbm: float

    @property
    def key(self) -> tuple[str, ...]:
        """The first columns of its row."""
        return f"{self.hop_s:g}", f"{sum(self.checks) / 2:g}", f"{self.power_dbm:g}"

    @property
    def scenario(self) -> Scenario:
        """The scenario ``link`` at this point."""
        return replace(
            preset("link"),
            hop_airtime_s=self.hop_s,
            opponent_power_dbm=self.power_dbm,
            first_check_s=(1, self.checks[1]),
            check_interval_s=self.checks,
            check_scale_s=float(self.checks[1]),
        )


@dataclass
class Meetings:
    """Rewards per step of allies against opponents in a scenario, each pair played once.

    Attributes:
        scenario: what is played.
        ally, opponent: values that replace those of the actions of a side.
        matches, first_seed: of a pair.
    """

    scenario: Scenario
    ally: Values = field(default_factory=dict)
    opponent: Values = field(default_factory=dict)
    matches: int = MATCHES
    first_seed: int = 0
    _known: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)

    def rewards(self, ally: str, opponent: str) -> np.ndarray:
        """Return ``(matches,)``, what the ally earns per step."""
        if (ally, opponent) not in self._known:
            frozen = {"ally": dict(self.ally), "opponent": dict(self.opponent)}
            names = {"ally": ally, "opponent": opponent}
            if ally == KNOWING:
                names["ally"], frozen["ally"] = "always-hop", {KNOWLEDGE_GATE: 1.0, **self.ally}
            players = [
                Frozen(as_player(names[side], side, self.scenario), values) if values else names[side]
                for side, values in frozen.items()
            ]
            match = make_match(TwoPlayerBatch(self.scenario, self.matches, threads=1), *players)
            play_round(match, seeds=np.arange(self.first_seed, self.first_seed + self.matches))
            tallies = match.duel.batch.tallies
            self._known[ally, opponent] = tallies["ally_return"] / tallies["steps"]
        return self._known[ally, opponent]

    def matrix(self, allies: Sequence[str], opponents: Sequence[str]) -> np.ndarray:
        """Return ``(allies, opponents, matches)``."""
        return np.array([[self.rewards(ally, opponent) for opponent in opponents] for ally in allies])

    def solve(self, allies: Sequence[str], opponents: Sequence[str]) -> Solution:
        """Return the equilibrium of these players."""
        samples = self.matrix(allies, opponents)
        found = nash(-samples.mean(axis=2))
        earned = np.einsum("a,abm,b->m", found.rows, samples, found.columns)
        return Solution(
            earned,
            dict(zip(allies, found.rows.tolist(), strict=True)),
            dict(zip(opponents, found.columns.tolist(), strict=True)),
        )


@dataclass(frozen=True)
class Solution:
    """The ally's reward per step in each match at the equilibrium, ``(matches,)``, and both sides' shares."""

    earned: np.ndarray
    allies: Mapping[str, float]
    opponents: Mapping[str, float]


def adapt(game: Meetings, seed: int) -> tuple[list[str], list[str]]:
    """Return the players of a point: the usual ones, and variants that answer their equilibrium better."""
    allies, opponents = list(ALLIES), list(OPPONENTS)
    chosen = replace(game, first_seed=CHOSEN_ON, _known={})
    for search in range(SEARCHES):
        solution = game.solve(allies, opponents)
        for side, pool, rivals in (
            ("ally", allies, solution.opponents),
            ("opponent", opponents, solution.allies),
        ):
            met = {name: share for name, share in rivals.items() if share > 0.02}
            shares, number = list(met.values()), seed * SEARCHES + search
            drawn = draw_variants(side, VARIANTS, game.scenario, number, SEARCHED[side])
            pairs = [product([name], met) if side == "ally" else product(met, [name]) for name in drawn]
            earned = [
                np.average([chosen.rewards(*pair).mean() for pair in own], weights=shares) for own in pairs
            ]
            pool.append(drawn[int(np.argmax(earned) if side == "ally" else np.argmin(earned))])
    return allies, opponents


def shortlist(names: Sequence[str], shares: Mapping[str, float], worst: np.ndarray) -> list[str]:
    """Return the players that a lever is measured with: of the equilibrium, then those of the best worst."""
    order = sorted(range(len(names)), key=lambda k: (-round(shares[names[k]], 2), -worst[k]))
    return [names[k] for k in order[:MOST]]


def measure(point: Point, seed: int) -> Line:
    """Return the row of a point."""
    began, scenario = time.process_time(), point.scenario
    game = Meetings(scenario)
    allies, opponents = adapt(game, seed)
    whole, values = game.solve(allies, opponents), game.matrix(allies, opponents).mean(axis=2)
    own = shortlist(allies, whole.allies, values.min(axis=1))
    others = shortlist(opponents, whole.opponents, -values.max(axis=0))
    own += [name for name in ("range",) if name not in own]
    others += [name for name in ("bayes",) if name not in others]
    kept = game.solve(own, others).earned
    lost = {
        name: kept
        - max((Meetings(scenario, ally=one).solve(own, others).earned for one in constants), key=np.mean)
        for name, constants in ALLY_LEVERS.items()
    }
    of_type = []
    for kind, name in enumerate(JAMMING_TYPES):
        pool = [*dict.fromkeys([*others, name, f"alternate(type={kind})"])]
        of_type.append(Meetings(replace(scenario, jamming_types=(name,))).solve(own, pool).earned)
    lost["type"] = min(of_type, key=np.mean) - kept
    lost["tuning"] = Meetings(scenario, opponent=TUNED).solve(own, others).earned - kept
    measured = {"value": whole.earned, **lost}
    silent = Meetings(replace(scenario, opponent_power_dbm=-100.0))
    figures = {
        "free": float(silent.rewards("range", "tone").mean()),
        "idle": float(values[allies.index("idle")].min()),
        **{name: float(earned.mean()) for name, earned in measured.items()},
        **{name + HALF: student_half(earned) for name, earned in measured.items()},
    }
    return {
        **dict(zip(COLUMNS[:3], point.key, strict=True)),
        **{name: f"{number:.3f}" for name, number in figures.items()},
        "allies": _mixture(whole.allies),
        "opponents": _mixture(whole.opponents),
        "seconds": f"{time.process_time() - began:.0f}",
    }


def _mixture(shares: Mapping[str, float]) -> str:
    """Return the shares of an equilibrium, greatest first."""
    kept = sorted(((share, name) for name, share in shares.items() if share > 0.02), reverse=True)
    return "; ".join(f"{name.removesuffix('/' + AGENTS)} {share:.2f}" for share, name in kept)


def read_rows(path: Path) -> list[Line]:
    """Return the rows of a map that have been measured, each point once: two runs may meet at one."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list({tuple(row[name] for name in COLUMNS[:3]): row for row in csv.DictReader(file)}.values())


def table(rows: Sequence[Line]) -> str:
    """Return the map as Markdown: values, levers in percent of the value, and the equilibria."""
    lines = [
        [
            "hop / dwell",
            "reaction / dwell",
            "jammer / base, dB",
            "value",
            "idle / free",
            *(f"{name} %" for name in LEVERS),
            "allies",
            "opponents",
        ]
    ]
    for row in sorted(rows, key=lambda row: [float(row[name]) for name in reversed(COLUMNS[:3])]):
        value = float(row["value"])
        shares = [number(float(row[name]) / value, 100, 0) for name in LEVERS]
        idle = f"{float(row['idle']) / float(row['free']):.0%}"
        key = [row["hop_dwell"], row["reaction_dwell"], f"{float(row['power_dbm']) - BASE_DBM:+g}"]
        lines.append(
            [
                *key,
                f"{value:.2f} ± {float(row['value' + HALF]):.2f}",
                idle,
                *shares,
                row["allies"],
                row["opponents"],
            ]
        )
    return markdown_table(lines)


@styled
def draw(rows: Sequence[Line]) -> Figure:
    """Draw value and levers over hop time and reaction, and over hop time and power."""
    known = {tuple(row[name] for name in COLUMNS[:3]): row for row in rows}
    reactions = sorted(REACTIONS)
    planes = (
        (
            "reaction / dwell",
            [f"{sum(of) / 2:g}" for of in reactions],
            [(of, POWERS_DBM[0]) for of in reactions],
        ),
        (
            "jammer / base (dB)",
            [f"{of - BASE_DBM:+g}".replace("-", "\u2212") for of in sorted(POWERS_DBM)],
            [(REACTIONS[0], of) for of in sorted(POWERS_DBM)],
        ),
    )
    panels = {
        "value": ("value",),
        "hop %": ("hop",),
        "spread %": ("spread",),
        "type or tuning %": ("type", "tuning"),  # the greater one
    }
    figure = blank_figure(PAGE, 3.9)
    for axes_row, (label, names, others) in zip(figure.subplots(2, 4), planes, strict=True):
        for axes, (title, levers) in zip(axes_row, panels.items(), strict=True):
            shown = np.full((len(others), len(HOPS)), np.nan)
            for (y, (checks, power)), (x, hop) in product(enumerate(others), enumerate(HOPS)):
                if row := known.get(Point(hop, checks, power).key):
                    most = max(float(row[name]) for name in levers)
                    shown[y, x] = most if title == "value" else 100 * most / float(row["value"])
                    ink = "white" if shown[y, x] > (7 if title == "value" else 15) else "black"
                    text = number(shown[y, x], digits=1 if title == "value" else 0).replace("-", "\u2212")
                    axes.text(x, y, text, ha="center", va="center", color=ink)
            scale = Normalize(4, 9) if title == "value" else Normalize(0, 30)
            axes.imshow(shown, cmap="Greys", norm=scale, origin="lower", aspect="auto")
            axes.set_xticks(range(len(HOPS)), [f"{hop:g}" for hop in HOPS])
            axes.set_yticks(range(len(names)), names if levers == ("value",) else [])
            axes.set_title(title)
            link = 1.5, others.index((REACTIONS[0], POWERS_DBM[0])) - 0.5
            axes.add_patch(Rectangle(link, 1, 1, fill=False, lw=1.5))
            has_radios = others[0][1] == others[-1][1]
            room = 0.6 * has_radios  # for radios off the map
            axes.set(xlim=(-0.5, len(HOPS) - 0.5 + room), ylim=(-0.5 - room, len(names) - 0.5 + room))
            if has_radios:
                _mark_radios(axes)
        axes_row[0].set_ylabel(label)
    radios = ", ".join(f"{mark} {name}" for mark, (name, *_) in RADIOS.items())
    figure.supxlabel(f"hop time / dwell; square: link; under a follower of 1 ms {radios}")
    return figure


def _mark_radios(axes: Axes) -> None:
    """Mark radios under a follower of 1 ms; those off the map lie beside it."""
    rows = [sum(checks) / 2 for checks in sorted(REACTIONS)]
    for mark, (_, hop, reaction, side) in RADIOS.items():
        x, y = np.interp(hop, HOPS, range(len(HOPS))), np.interp(reaction, rows, range(len(rows)))
        x += 0.8 * (hop > HOPS[-1])
        y += 0.8 * ((reaction > rows[-1]) - (reaction < rows[0]))
        text = axes.text(x, y, mark, weight="bold", color=OPPONENT, ha=side, va="center")
        text.set_path_effects([withStroke(linewidth=2, foreground="white")])


def main(file: Path, page: Path | None = None) -> None:
    """Measure the points that are missing in a file, and write the page."""
    points = [Point(hop, checks, POWERS_DBM[0]) for checks, hop in product(REACTIONS, HOPS)]
    points += [Point(hop, REACTIONS[0], power) for power, hop in product(POWERS_DBM[1:], HOPS)]
    if not file.exists():
        write_whole(file, csv_text([COLUMNS]))
    for seed, point in enumerate(points):
        if point.key not in {tuple(row[name] for name in COLUMNS[:3]) for row in read_rows(file)}:
            row = measure(point, seed)
            with file.open("a", encoding="utf-8") as rows:
                rows.write(csv_text([[row[name] for name in COLUMNS]]))
            print(*row.values(), sep=", ", flush=True)
    if page:
        measured = read_rows(file)
        write_figure(draw(measured), page.with_suffix(".svg"))
        fill(page, {"map": table(measured)})


if __name__ == "__main__":
    run(main)
