"""Map what the radio link is worth over hop time, reaction and power, with players that adapt at each point.

python scripts/map_regimes.py docs/results/regimes.csv [--page docs/results/regimes.md]

A point is the preset ``link`` with another hop time, interval of checks and jamming power. There scripts over
a grid of constants, the Bayes jammer, the range rule and shipped agents meet, and copies of those that matter
that lack an ability; rules are searched against each equilibrium and join. The matrix is solved as a zero-sum
game of the ally's reward. Its interval has what a last search gains against either mixture, or a member of a
season, which no pool has. A lever is what the side loses whose players all lack one ability; its range is
over several pools. Rows are written as they finish; a row that is there is not played again. The page gets a
table and the figures beside it.
"""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle, product
from pathlib import Path

import numpy as np
from command import run
from lineage import fill
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from measure_payoffs import Frozen, Values, levers

from fpg_bench.common.canvas import OPPONENT, PAGE, blank_figure, styled, write_figure
from fpg_bench.common.files import write_whole
from fpg_bench.common.ids import other_side
from fpg_bench.common.output import csv_text, number
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.statistics import nash, student_half
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.game.actions import KNOWLEDGE_GATE, SPEED
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.players.agent import expand_suites
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.registry import as_player
from fpg_bench.products.league.candidates import Candidates
from fpg_bench.products.league.categorical import Play
from fpg_bench.products.league.rule_search import RuleSearch, rule_of
from fpg_bench.products.league.rules import NUMBERS, OFF, Option, rule_graph, rule_values

HOPS = (0.02, 0.1, 0.3, 0.5)  # hop time over dwell: the share of a step that a hop loses
REACTIONS = ((3, 5), (1, 1), (1, 3), (12, 18))  # dwells from one check to the next; first that of link
POWERS_DBM = (39.0, 33.0, 45.0)  # of the jammer, first that of link
BASE_DBM = preset("link").base_power_dbm
MATCHES, SCREENED = 256, 32  # matches of a pair, and of those that only may matter
FRESH = 1_000_000  # the first seed of matches on which nothing was chosen
SEARCHES, GENERATIONS = 2, 16  # of rules that join each side; one more search says what is left
USUAL = 4  # of a side's players, of which there are copies at each point
TOLERANCE = 0.01  # of the ally's reward per step, in which a pool's equilibrium is one
AGENTS = "ppo-stack8/seed_0"
KNOWING = "always-hop by knowledge"  # always-hop, with the point that the knowledge base picks
Names = Mapping[str, Sequence[str]]  # by side
PLAYERS: Names = {  # the usual ones first
    "ally": [
        *("range", "range(js_db=5)"),
        *(f"ally-link{kind}/{AGENTS}" for kind in ("-champion", "-population", "")),
        *("always-hop", KNOWING, "by-type", "clock", "expert", "range(js_db=0)", "evidence"),
        "by-type(hop_below_db=60)",
        *(
            f"evidence(tone=80, narrowband=90, broadband={wide}, comb=70, least={least}, most={least + 6}, "
            "spread_beyond_m=5000)"
            for wide, least in product((3, 30), (4, 12))
        ),
    ],
    "opponent": [
        *("alternate", "hunter(type=0, hold_s=1)"),
        *(f"opponent-link{kind}/{AGENTS}" for kind in ("", "-population")),
        *("tone", "narrowband", "broadband", "bayes", "adaptive"),
        *("alternate(type=2, hold_s=3)", "alternate(type=1, centres=5)"),
        *(f"hunter(type=0, hold_s={hold})" for hold in (2, 3, 5)),
        *(f"hunter(type=1, hold_s={hold})" for hold in (1, 2, 3, 6)),
        *(f"split(type={kind}, hold_s={hold})" for kind, hold in ((0, 1), (0, 3), (1, 1))),
    ],
}
AND, ONLY, RULE = ": ", " only", "rule"  # in names of copies, of those of one type, and of what is found
_CONSTANTS = {lever.name: lever.constants for lever in levers(preset("link"))}
COPIES: Mapping[str, Mapping[str, Mapping[str, Values]]] = {  # of a lever's several the best one counts
    "ally": {
        "hop": {"no hops": _CONSTANTS["hopping"]["never"]},
        "spread": {"no spreading": _CONSTANTS["spreading"]["never"]},
        "speed": {"10 m/s": {SPEED: -0.2}, "17.5 m/s": {SPEED: 0.4}},
        "knowledge": {"own point": _CONSTANTS["knowledge base"]["never"]},
        "own point": {"point by knowledge": {KNOWLEDGE_GATE: 1.0}},
    },
    "opponent": {
        "type": {name + ONLY: values for name, values in _CONSTANTS["type"].items()},
        "tuning": {"known point": _CONSTANTS["tuning"]["known frequency"]},
    },
}
# Hop time and reaction of a follower of 1 ms, over the dwell; docs/results/regimes.md has the sources.
RADIOS = {  # and the mark's side
    "B": ("Bluetooth", 0.41, 1.6, "left"),
    "E": ("ExpressLRS", 0.06, 0.13, "left"),
    "C": ("CABELL V3", 0.04, 0.3, "right"),
    "L": ("Link 16", 0.51, 77, "center"),
}
LEVERS = tuple(name for side in SIDES for name in COPIES[side])
LEFT = " may gain"  # what a last search gains for a side
MIXTURES = ("allies", "opponents")  # columns
SEASON, MEMBERS = "suite:season-5-link", " of season 5 may gain"  # trained players of three kinds
ENDS = (("opponent", -1), ("ally", 1))  # of an interval: who may move it, and whither
LEAST, MOST = " least", " most"  # of a lever over the pools
COLUMNS = (
    *("hop_dwell", "reaction_dwell", "power_dbm", "free", "idle", "value", "half"),
    *(side + LEFT for side in SIDES),
    *(name + end for name in LEVERS for end in ("", LEAST, MOST)),
    *(*MIXTURES, "rules", "seconds"),
    *(side + MEMBERS for side in SIDES),
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


@dataclass(frozen=True)
class Solution:
    """An equilibrium.

    Attributes:
        earned: ``(matches,)``, the ally's reward per step in each match.
        joined: the players of each side that joined the double oracle.
        shares: of those that play.
    """

    earned: np.ndarray
    joined: Names
    shares: Mapping[str, Mapping[str, float]]

    @property
    def value(self) -> float:
        """The ally's mean reward per step."""
        return float(self.earned.mean())


@dataclass
class Meetings:
    """Rewards per step of allies against opponents in a scenario; a pair is played when it matters.

    Attributes:
        scenario: what is played.
        rules: players that a search found, and their numbers, by their names.
        matches, first_seed: of a pair.
    """

    scenario: Scenario
    rules: dict[str, tuple[Player, dict[str, Option]]] = field(default_factory=dict)
    matches: int = MATCHES
    first_seed: int = 0
    _known: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    _players: dict[str, Player] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._few = self if self.matches <= SCREENED else replace(self, matches=SCREENED, _known={})

    def player(self, name: str, side: str) -> Player:
        """Return a player of the pools, or its copy that lacks an ability."""
        if name not in self._players:
            plain, _, copy = name.partition(AND)
            values = {key: of for each in COPIES[side].values() for key, of in each.items()}.get(copy, {})
            if plain == KNOWING:
                plain, values = "always-hop", {KNOWLEDGE_GATE: 1.0, **values}
            types = [kind for kind in JAMMING_TYPES if copy == kind + ONLY] or JAMMING_TYPES
            known = replace(self.scenario, jamming_types=tuple(types))
            player = self.rules[plain][0] if plain in self.rules else as_player(plain, side, known)
            self._players[name] = Frozen(player, values) if values else player
        return self._players[name]

    def rewards(self, ally: str, opponent: str) -> np.ndarray:
        """Return ``(matches,)``, what the ally earns per step."""
        if (ally, opponent) not in self._known:
            players = self.player(ally, "ally"), self.player(opponent, "opponent")
            match = make_match(TwoPlayerBatch(self.scenario, self.matches, threads=1), *players)
            play_round(match, seeds=np.arange(self.first_seed, self.first_seed + self.matches))
            tallies = match.duel.batch.tallies
            self._known[ally, opponent] = tallies["ally_return"] / tallies["steps"]
        return self._known[ally, opponent]

    def answer(self, side: str, met: Solution, name: str | None = None) -> float:
        """Return what a player, or the mixture, of a side gets per step against an equilibrium's other one.

        An ally gets the reward; an opponent, what the ally lacks to zero.
        """
        mixtures = met.shares if name is None else {**met.shares, side: {name: 1.0}}
        allies, opponents = (mixtures[each] for each in SIDES)
        pairs = product(allies.items(), opponents.items())
        earned = sum(a * b * self.rewards(ally, rival).mean() for (ally, a), (rival, b) in pairs)
        return float(earned if side == "ally" else -earned)

    def solve(self, pools: Names, met: Solution | None = None) -> Solution:
        """Return the equilibrium of these players, by a double oracle: the best answers to it join.

        It goes on from an equilibrium of some of them.
        """
        joined = {side: list(met.joined[side] if met else pools[side][:1]) for side in SIDES}
        while True:
            samples = np.array([[self.rewards(a, o) for o in joined["opponent"]] for a in joined["ally"]])
            found = nash(-samples.mean(axis=2))
            shares = {
                side: {
                    name: share for name, share in zip(joined[side], of.tolist(), strict=True) if share > 1e-6
                }
                for side, of in zip(SIDES, found[:2], strict=True)
            }
            met = Solution(np.einsum("a,abm,b->m", found.rows, samples, found.columns), joined, shares)
            better = {side: self._better(side, pools[side], met) for side in SIDES}
            if not any(better.values()):
                return met
            joined = {side: joined[side] + better[side] for side in SIDES}

    def _better(self, side: str, pool: Sequence[str], met: Solution) -> list[str]:
        """Return the player of a pool that answers an equilibrium best, if it gains by it."""
        others = [name for name in pool if name not in met.joined[side]]
        first = sorted(others, key=lambda name: -self._few.answer(side, met, name))[:2]
        answers = {name: self.answer(side, met, name) for name in first}
        least = (met.value if side == "ally" else -met.value) + TOLERANCE
        return sorted((name for name in first if answers[name] > least), key=lambda name: -answers[name])[:1]

    def search(self, side: str, met: Solution, seed: int) -> str:
        """Search a rule that answers an equilibrium; return its name."""
        rivals, shares = other_side(side), met.shares[other_side(side)]
        players = [self.player(name, rivals) for name in shares]
        reward = "own" if side == "ally" else "zero_sum"
        search = RuleSearch(side, players, self.scenario, seed=seed, reward=reward)
        search.play, search.rivals = of_mixture(search.play, [*shares.values()]), 1
        for _ in range(GENERATIONS):
            search.run()
        name, model = f"{RULE} {len(self.rules)}", rule_graph(side, self.scenario)
        player = Candidates(model, rule_values(side, search.best[None], self.scenario))
        self.rules[name] = player, {key: of for key, of in rule_of(side, search.best).items() if of != OFF}
        return name


def of_mixture(play: Play, shares: Sequence[float]) -> Play:
    """Return the play of a search against rivals that divide each generation's matches by their shares."""

    def mixed(options: np.ndarray, _: int, first_seed: int, matches: int) -> np.ndarray:
        places = (np.random.default_rng(first_seed).random() + np.arange(matches)) / matches
        drawn = np.minimum(np.searchsorted(np.cumsum(shares), places), len(shares) - 1)
        counts = enumerate(np.bincount(drawn).tolist())
        return np.concatenate([play(options, k, first_seed, count) for k, count in counts if count], axis=1)

    return mixed


def with_copies(pools: Names, met: Solution) -> Names:
    """Return pools with copies that lack an ability, of the usual players and of those of an equilibrium."""
    wide = {}
    for side in SIDES:
        matter = dict.fromkeys(name.partition(AND)[0] for name in [*pools[side][:USUAL], *met.shares[side]])
        copies = [key for each in COPIES[side].values() for key in each]
        wide[side] = list(dict.fromkeys([*pools[side], *map(AND.join, product(matter, copies))]))
    return wide


def worth(game: Meetings, pools: Names, whole: Solution) -> dict[str, float]:
    """Return what a side loses at an equilibrium whose players all lack one ability, by the lever.

    They meet the rivals that joined, and the first of the others.
    """
    met = {side: list(dict.fromkeys([*whole.joined[side], *pools[side][: 2 * USUAL]])) for side in SIDES}
    lost = {}
    for side, sign in zip(SIDES, (1, -1), strict=True):
        for lever, copies in COPIES[side].items():
            lacking = [[name for name in pools[side] if name.endswith(AND + copy)] for copy in copies]
            lost[lever] = min(sign * (whole.value - game.solve({**met, side: own}).value) for own in lacking)
    return lost


def measure(point: Point, seed: int) -> Line:
    """Return the row of a point."""
    began, game, pools = time.process_time(), Meetings(point.scenario), PLAYERS
    whole, levers = game.solve(pools), []
    for turn in range(SEARCHES + 1):
        pools = with_copies(pools, whole)
        whole = game.solve(pools, whole)
        if turn in (0, SEARCHES):
            levers.insert(0, worth(game, pools, whole))
        found = {side: game.search(side, whole, seed * (SEARCHES + 1) + turn) for side in SIDES}
        if turn < SEARCHES:
            pools = {side: [*pools[side], found[side]] for side in SIDES}
            whole = game.solve(pools, whole)
    fresh = replace(game, first_seed=FRESH, _known={})
    free = Meetings(replace(point.scenario, opponent_power_dbm=-100.0)).rewards("range", "tone").mean()
    idle = game.solve({**pools, "ally": ["idle"]}).value
    left = (fresh.answer(side, whole, found[side]) - fresh.answer(side, whole) for side in SIDES)
    gains = [max(0.0, gain) for gain in left]
    worths = [of(each[name] for each in levers) for name in LEVERS for of in (next, min, max)]
    figures = [free, idle, whole.value, student_half(whole.earned), *gains, *worths]
    mixtures = [_mixture(whole.shares[side]) for side in SIDES]
    rules = json.dumps({name: numbers for name, (_, numbers) in game.rules.items()})
    cells = [*point.key, *(f"{figure:.3f}" for figure in figures), *mixtures, rules]
    columns = COLUMNS[: -len(SIDES)]  # what members of a season gain is measured apart
    return dict(zip(columns, [*cells, f"{time.process_time() - began:.0f}"], strict=True))


def attacked(point: Point, row: Line) -> Line:
    """Return what members of a season gain against the mixtures as a row states them, by column."""
    game = Meetings(point.scenario)
    for (name, numbers), side in zip(json.loads(row["rules"]).items(), cycle(SIDES), strict=False):
        options = [grid.index(numbers.get(key, OFF)) for key, grid in NUMBERS[side].items()]
        values = rule_values(side, np.array([options]), point.scenario)
        game.rules[name] = Candidates(rule_graph(side, point.scenario), values), numbers
    shares = {side: stated(row[column]) for side, column in zip(SIDES, MIXTURES, strict=True)}
    fresh, met, gains = replace(game, first_seed=FRESH, _known={}), Solution(np.zeros(0), {}, shares), {}
    for side in SIDES:
        members = {str(each): each for each in expand_suites([SEASON], side)}
        game._players |= {name: as_player(each, side, point.scenario) for name, each in members.items()}
        best = sorted(members, key=lambda name: -game._few.answer(side, met, name))[:2]
        gain = max(fresh.answer(side, met, name) for name in best) - fresh.answer(side, met)
        gains[side + MEMBERS] = f"{max(0.0, gain):.3f}"
    return gains


def stated(mixture: str) -> dict[str, float]:
    """Return the shares of an equilibrium that a row states."""
    shares = {}
    for part in mixture.split("; "):
        name, _, share = part.rpartition(" ")
        plain, found, copy = name.partition(AND)
        is_agent = plain.startswith(tuple(f"{side}-link" for side in SIDES))
        shares[plain + f"/{AGENTS}" * is_agent + found + copy] = float(share)
    return {name: share / sum(shares.values()) for name, share in shares.items()}


def _mixture(shares: Mapping[str, float]) -> str:
    """Return the shares of an equilibrium, greatest first."""
    kept = sorted(((share, name) for name, share in shares.items() if share > 0.02), reverse=True)
    return "; ".join(f"{name.replace('/' + AGENTS, '')} {share:.2f}" for share, name in kept)


def read_rows(path: Path) -> dict[tuple[str, ...], Line]:
    """Return the rows of a map by their points, each of which stands once: two runs may meet at one."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {tuple(row[name] for name in COLUMNS[:3]): row for row in csv.DictReader(file)}


def add_row(path: Path, row: Line) -> None:
    """Add a row to a map, and print it."""
    with path.open("a", encoding="utf-8") as rows:
        rows.write(csv_text([map(row.get, COLUMNS)]))
    print(*row.values(), sep=", ", flush=True)


def write_rows(path: Path, rows: Mapping[tuple[str, ...], Line]) -> None:
    """Write a map; of rows that were added for a point, the last."""
    write_whole(path, csv_text([COLUMNS, *(map(row.get, COLUMNS) for row in rows.values())]))


def table(rows: Mapping[tuple[str, ...], Line]) -> str:
    """Return the map as Markdown: values, levers in percent of the value, and the equilibria."""
    ratios = ("hop / dwell", "reaction / dwell", "jammer / base, dB")
    left = ("left to allies", "left to jammers", "idle / free")
    lines = [[*ratios, "value", *left, *(f"{name} %" for name in LEVERS), "allies", "opponents"]]
    for key in sorted(rows, key=lambda key: [*map(float, reversed(key))]):
        row = rows[key]
        of = {name: float(row[name]) for name in COLUMNS if name not in (*MIXTURES, "rules")}
        most_left = {side: max(of[side + LEFT], of[side + MEMBERS]) for side in SIDES}
        low, high = (of["value"] + sign * (of["half"] + most_left[side]) for side, sign in ENDS)
        cells = [row["hop_dwell"], row["reaction_dwell"], f"{of['power_dbm'] - BASE_DBM:+g}"]
        cells += [f"{of['value']:.2f} [{low:.2f}, {high:.2f}]", *(f"{most_left[side]:.2f}" for side in SIDES)]
        cells.append(f"{of['idle'] / of['free']:.0%}")
        for name in LEVERS:
            least, own, most = (number(of[name + end] / of["value"], 100, 0) for end in (LEAST, "", MOST))
            cells.append(own if least == most else f"{own} ({least} to {most})")
        lines.append([*cells, row["allies"], row["opponents"]])
    return markdown_table(lines)


@styled
def draw(rows: Mapping[tuple[str, ...], Line]) -> Figure:
    """Draw value and levers over hop time and reaction, and over hop time and power."""
    reactions, powers = sorted(REACTIONS), sorted(POWERS_DBM)
    over_base = [f"{power - BASE_DBM:+g}".replace("-", "\u2212") for power in powers]
    planes = {
        "reaction / dwell": ([f"{sum(of) / 2:g}" for of in reactions], product(reactions, POWERS_DBM[:1])),
        "jammer / base (dB)": (over_base, product(REACTIONS[:1], powers)),
    }
    panels = {
        "value": ["value"],
        "hop %": ["hop"],
        "spread %": ["spread"],
        "type or tuning %": ["type", "tuning"],
    }
    figure = blank_figure(PAGE, 3.9)
    for axes_row, (label, (names, points)) in zip(figure.subplots(2, 4), planes.items(), strict=True):
        others = list(points)
        has_radios = others[0][1] == others[-1][1]
        for axes, (title, shares) in zip(axes_row, panels.items(), strict=True):
            shown = np.full((len(others), len(HOPS)), np.nan)
            for (y, (checks, power)), (x, hop) in product(enumerate(others), enumerate(HOPS)):
                if row := rows.get(Point(hop, checks, power).key):
                    most = max(float(row[name]) for name in shares)  # the greater one
                    shown[y, x] = most if title == "value" else 100 * most / float(row["value"])
                    ink = "white" if shown[y, x] > (7 if title == "value" else 15) else "black"
                    text = number(shown[y, x], digits=1 if title == "value" else 0).replace("-", "\u2212")
                    axes.text(x, y, text, ha="center", va="center", color=ink)
            scale = Normalize(4, 9) if title == "value" else Normalize(0, 30)
            axes.imshow(shown, cmap="Greys", norm=scale, origin="lower", aspect="auto")
            axes.set_xticks(range(len(HOPS)), [f"{hop:g}" for hop in HOPS])
            axes.set_yticks(range(len(names)), names if title == "value" else [])
            axes.set_title(title)
            link = 1.5, others.index((REACTIONS[0], POWERS_DBM[0])) - 0.5
            axes.add_patch(Rectangle(link, 1, 1, fill=False, lw=1.5))
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
    write_rows(file, read_rows(file))
    for seed, point in enumerate(points):
        row = read_rows(file).get(point.key)
        if row is None:
            add_row(file, row := measure(point, seed))
        if not row.get(SIDES[0] + MEMBERS):
            add_row(file, row | attacked(point, row))
    write_rows(file, read_rows(file))
    if page:
        measured = read_rows(file)
        write_figure(draw(measured), page.with_suffix(".svg"))
        fill(page, {"map": table(measured)})


if __name__ == "__main__":
    run(main)
