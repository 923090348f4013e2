"""View models of the pages: names and formats of numbers, axes of small charts, and the tables' rows."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from fpg_bench.evaluation.statistics import Interval
from fpg_bench.products.leaderboard.board import CROSSPLAY, Board, BoardEntry, BoardSuite, BoardTrack, Figures
from fpg_bench.products.leaderboard.exploited import RESPONSE, Effort
from fpg_bench.products.leaderboard.tracks import PUBLIC, RESPONSES, SCENARIOS, SHIFTED, TRACKS, UNSEEN

NONE = "–"
FEW_SEEDS = "fewer than five training seeds of an algorithm: no rank"
_LINK = re.compile(r"https://[A-Za-z0-9.-]+(:\d+)?(/[^\s\"'<>\\]*)?")


@dataclass(frozen=True)
class Measure:
    """Presentation of a measure: its label, its format (see :func:`format_number`), and its meaning."""

    label: str
    style: str
    about: str


# In the order in which an entry's page lists them. recoveries_cut is left out: others are computed from it.
MEASURES = {
    "return": Measure("Return per step", "step", "mean of its own rewards in the rounds of its score"),
    "ally_return": Measure("Ally's return", "whole", "sum of the ally's rewards per round"),
    "opponent_return": Measure("Opponent's return", "whole", "sum of the opponent's rewards per round"),
    "overlap_ratio": Measure("Overlap ratio", "share", "time in which jamming covers the ally's frequency"),
    "jamming_success_rate": Measure(
        "Jamming success rate", "share", "time in which jamming covers the ally and breaks its link"
    ),
    "spectrum_overlap": Measure("Spectrum overlap", "share", "similarity of both sides' use of frequencies"),
    "outage": Measure("Outage", "share", "time in which the link is broken, jammed or not"),
    "capacity_mbit_s": Measure("Capacity", "Mbit/s", "mean rate of the link"),
    "delivered_share": Measure(
        "Delivered share",
        "share",
        "what was delivered of the rate of a link without jamming, spreading and hops",
    ),
    "survived_share": Measure(
        "Survived share", "share", "what jamming left of the rate of the same waveform, on a radio link"
    ),
    "snr_db": Measure("SNR", "dB", "mean quality of the link"),
    "hop_rate": Measure("Hops", "share", "time steps in which the ally pays for a hop"),
    "frequency_changes": Measure(
        "Frequency changes", "share", "steps in which the ally's frequency really changes"
    ),
    "hop_entropy_bits": Measure(
        "Hop entropy", "bits", "entropy of a hop's destination, given the point it leaves"
    ),
    "spread_ratio": Measure("Spreading", "share", "time in which the ally spreads its signal to hide"),
    "detection_rate": Measure("Heard", "share", "checks in which the opponent hears the ally"),
    "near_ratio": Measure("Near", "share", "time in which the opponent is within 30 m"),
    "success_given_overlap": Measure(
        "Broken where covered", "share", "covered time in which the link is broken"
    ),
    "outage_mean_s": Measure("Mean outage", "s", "mean length of an outage"),
    "outage_longest_s": Measure("Longest outage", "s", "longest outage of all rounds"),
    "time_to_recover_s": Measure("Time to recover", "s", "from being heard and jammed to a working link"),
    "share_tone": Measure("Single tone", "share", "time in which the opponent jams a single tone"),
    "share_narrowband": Measure("Narrowband", "share", "time in which it jams a narrow band"),
    "share_broadband": Measure("Broadband", "share", "time in which it jams a broad band"),
    "share_comb": Measure("Comb", "share", "time in which it jams a comb of tones"),
}
MISSION = ("overlap_ratio", "jamming_success_rate")  # the two measures of the mission, right after each score


@dataclass(frozen=True)
class Role:
    """Presentation of a suite's role: its label, and the rivals in it."""

    label: str
    about: str


# In the order in which pages list them.
ROLES = {
    PUBLIC: Role("Public", "the public suite, which everybody can train on"),
    UNSEEN: Role("Held-out", "rivals that were trained after entries were closed"),
    SHIFTED: Role("Shifted", "trained rivals under changed rules"),
    RESPONSES: Role("Best responses", "rivals that were trained to beat one entry"),
}


def format_number(value: float | None, style: str = "score") -> str:
    """Format a number as ``score`` (one digit), ``step`` (two), ``whole``, ``share`` or with a unit."""
    if value is None or not math.isfinite(value):
        return NONE
    if style == "share":
        return f"{100 * value:.1f} %"
    if style == "whole":
        return f"{value:,.0f}".replace("-", "−")
    text = f"{value:.{2 if style == 'step' else 1}f}".replace("-", "−")
    return text if style in ("score", "step") else f"{text} {style}"


def sort_key(value: float | None) -> str:
    """Return a number as the key by which tables are sorted, to six digits; empty for None."""
    return "" if value is None else f"{value:.6g}"


def format_interval(score: Interval | None) -> str:
    """Format an interval as ``low to high``; empty where there is none."""
    if score is None or not math.isfinite(score.half):
        return ""
    return f"{format_number(score.low)} to {format_number(score.high)}"


def format_signed(value: float) -> str:
    """Format a difference of scores with its sign."""
    return f"+{format_number(value)}" if value >= 0 else format_number(value)


def format_rank(rank: tuple[int, int] | None) -> str:
    """Format a rank as ``2``, or as ``2–4`` where it is shared; a dash without one."""
    if rank is None:
        return NONE
    best, worst = rank
    return str(best) if best == worst else f"{best}–{worst}"


# What scores 100: a bound for allies alone; see scripts/measure_scales.py.
_TOPS = {
    "ally": "a link that is never jammed",
    "opponent": "that of the best script or oracle against each public rival",
    "planner": "that of the planner optimised over the public suite",
}


def scale_text(track: BoardTrack) -> str:
    """Describe the returns per step that score 0 and 100."""
    zero, top = (format_number(end, "step") for end in (track.scale.zero, track.scale.top))
    text = f"a score of 0 is the return of random play in the same suite ({zero} per step in the public one)"
    text += f", 100 is {_TOPS[track.side]} ({top} per step)"
    return text if track.side == "ally" else f"{text}; it can be exceeded"


def safe_link(text: str | None) -> str | None:
    """Return an https link; None for anything else that a submission has as its reference."""
    return text if text is not None and len(text) < 500 and _LINK.fullmatch(text) else None


def ordered_suites(track: BoardTrack, without: Sequence[str] = ()) -> list[BoardSuite]:
    """Return a track's suites in the order in which pages list them."""
    return sorted(
        (suite for suite in track.suites if suite.role not in without),
        key=lambda suite: list(ROLES).index(suite.role),
    )


def entry_page(track: BoardTrack, entry: BoardEntry) -> str:
    """Return the address of an entry's page from the site's root."""
    return f"entries/{track.key}/{entry.slug}.html"


@dataclass(frozen=True)
class Axis:
    """Horizontal axis of small charts of intervals, in pixels."""

    low: float
    high: float
    width: float = 130
    margin: float = 5

    @classmethod
    def of_scores(cls, scores: Iterable[Interval], lowest: float = -math.inf) -> Axis:
        """Return the axis that spans scores with their intervals as far as ``lowest``, and 0 to 100."""
        ends = [end for score in scores for end in (score.value, score.low, score.high)]
        ends = [0.0, 100.0, *filter(math.isfinite, ends)]
        return cls(max(min(ends), lowest), max(ends))

    def place(self, value: float) -> float:
        """Return the position of a value, or of the axis's lower end if it is lower."""
        share = max(0.0, (value - self.low) / (self.high - self.low))
        return round(self.margin + share * (self.width - 2 * self.margin), 1)

    def ends(self, score: Interval) -> tuple[float, float]:
        """Return the positions of an interval's ends; both are its value's if it has none."""
        if not math.isfinite(score.half):
            return (self.place(score.value),) * 2
        return self.place(score.low), self.place(score.high)


def _place(where: str) -> str:
    return where if where == CROSSPLAY else ROLES[where].label.lower()


def _rival(board: Board, track: BoardTrack, rival: str, where: str) -> str:
    """Return the name of a rival of a suite, or of an entry of the other side."""
    if where == CROSSPLAY:
        return board.names(track.other_side)[rival]
    return next(suite.label(rival) for suite in track.suites if suite.role == where)


def exploited_view(board: Board, track: BoardTrack, figures: Figures | None) -> dict[str, Any] | None:
    """Return the lowest known return of an entry in words; None for planners, and where it is not verified.

    ``found_by`` says who found it and for how many CPU seconds, ``attacked`` how many training seeds somebody
    attacked, and ``efforts`` with how much.
    """
    if figures is None or figures.exploited is None:
        return None
    lowest = figures.exploited.lowest
    reward = lowest.return_per_step
    ends = (format_number(end, "step") for end in (reward.low, reward.high))
    if lowest.where == RESPONSE:
        lost = f", {lowest.invalid:,} rounds lost by invalid answers" if lowest.invalid else ""
        found_by = f"{lowest.name} ({', '.join(lowest.authors)}), {lowest.seconds or 0:,.0f} CPU s{lost}"
    else:
        found_by = f"{_rival(board, track, lowest.rival, lowest.where)}, {_place(lowest.where)}"
    attacked, efforts = _attacked(figures.exploited.efforts)
    return {
        "value": reward.value,
        "at_most": f"at most {format_number(reward.value, 'step')}",
        "interval": " to ".join(ends) if math.isfinite(reward.half) else "",
        "found_by": found_by if lowest.training_seed is None else f"{found_by}, seed {lowest.training_seed}",
        "n_responses": len(figures.exploited.attacks),
        "attacked": attacked,
        "efforts": efforts,
    }


def _attacked(efforts: Sequence[Effort]) -> tuple[str, str]:
    """Return in short how many training seeds somebody attacked, and at length with how much."""
    made = [each for each in efforts if each.responses]
    left = [str(each.training_seed) for each in efforts if not each.responses]
    words = [
        f"{'the script' if each.training_seed is None else f'seed {each.training_seed}'}: "
        f"{_several(each.responses, 'response')} of {format_number(each.steps, 'whole')} steps and "
        f"{format_number(each.seconds, 'whole')} CPU s"
        for each in made
    ]
    if not made:
        return "nobody yet", "nobody yet"
    if left:
        words.append(f"seed{'s' if len(left) > 1 else ''} {', '.join(left)}: nobody yet")
    count = f"{len(made)} of {_several(len(efforts), 'seed')} attacked"
    return "attacked" if efforts[0].training_seed is None else count, "; ".join(words)


def _several(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def warnings(figures: Figures | None) -> list[str]:
    """Return the remarks shown below an entry's name in tables."""
    if figures is None:
        return []
    texts = [
        "reference: it sees the ally's path" if figures.is_reference else "",
        "late entry" if figures.is_late else "",
        FEW_SEEDS if figures.has_few_seeds else "",
        lost_text(figures),
        same_policies_text(figures),
    ]
    return [text for text in texts if text]


def same_policies_text(figures: Figures) -> str:
    """Name the other entries that have one of an entry's policies; empty where there is none."""
    return f"plays the same as {', '.join(figures.same_policies)}" if figures.same_policies else ""


def lost_text(figures: Figures) -> str:
    """Describe the rounds that were lost by rule; empty where there is none."""
    lost, rounds = (format_number(number, "whole") for number in (figures.lost, figures.rounds))
    return f"{lost} of {rounds} rounds lost by rule" if figures.lost else ""


def attackers_of(track: BoardTrack) -> list[dict[str, Any]]:
    """Return the attackers of a track, from that which broke most.

    Each has a name, authors, the entries that its responses answer, and those that nobody else brought lower.
    """
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for entry, figures in track.verified():
        for attack in figures.exploited.attacks if figures.exploited else ():
            name, authors = key = attack.name, ", ".join(attack.authors)
            of = found.setdefault(key, {"name": name, "authors": authors, "answered": [], "broken": []})
            if entry.name not in of["answered"]:
                of["answered"].append(entry.name)
            if figures.exploited and attack == figures.exploited.lowest:
                of["broken"].append(entry.name)
    return sorted(found.values(), key=lambda of: (-len(of["broken"]), -len(of["answered"]), of["name"]))


def track_view(board: Board, track: BoardTrack) -> dict[str, Any]:
    """Return what pages show of a track beside its entries.

    ``mission`` has the two measures of the mission, as far as they were measured; ``leaders`` the names of
    the entries that may be best; ``exploited`` the lowest known returns by slug; ``unbroken`` the entries
    that have responses, by their lowest known return; and ``notes`` what a reader may stumble over.
    """
    verified = list(track.verified())
    measured = {name for _, figures in verified for name in figures.measures}
    exploited = {entry.slug: exploited_view(board, track, entry.figures) for entry in track.entries}
    kept = {slug: of["value"] for slug, of in exploited.items() if of is not None and of["n_responses"]}
    return {
        "track": track,
        "ranking": next(suite for suite in track.suites if suite.role == track.ranked_by),
        "scale": scale_text(track),
        "axis": Axis.of_scores(
            [of.scores[track.ranked_by] for _, of in verified if track.ranked_by in of.scores]
            + [Interval(seed) for _, figures in verified for seed in figures.by_seed.values()],
            lowest=-20,
        ),
        "has_tiers": any(figures.planner is not None for _, figures in verified),
        "has_shifted": any(SHIFTED in figures.scores for _, figures in verified),
        "has_improvement": any(figures.improvement is not None for _, figures in verified),
        "mission": {name: MEASURES[name] for name in MISSION if name in measured},
        "leaders": [entry.name for entry, figures in verified if figures.may_be_best],
        "exploited": exploited,
        "unbroken": sorted(
            (entry for entry in track.entries if entry.slug in kept), key=lambda entry: -kept[entry.slug]
        ),
        "attackers": attackers_of(track),
        "notes": [*_track_notes(board, track)],
    }


def _track_notes(board: Board, track: BoardTrack) -> Iterator[str]:
    """Yield what a reader of a track's table may stumble over."""
    if failed := [name for name, holds in track.checks.items() if not holds]:
        yield (
            f"{len(failed)} of {len(track.checks)} checks on these rivals failed when the season was closed "
            f"({'; '.join(failed)}), so differences of a few points among the best say little."
        )
    ranked = [entry for entry, figures in track.verified() if figures.rank is not None]
    rules = [place for place, entry in enumerate(ranked) if (entry.about.zoo or "").endswith("/rule")]
    for place in rules[:1]:
        trained = [entry.about.training is not None for entry in ranked]
        yield (
            f"{sum(trained[place + 1 :])} of {sum(trained) - len(rules)} trained entries score less than "
            f"{ranked[place].name}, a few numbers that a search found."
        )
    agents = {entry.plays: entry.name for entry in track.entries if entry.kind == "zoo" and entry.plays}
    for other in board.tracks:
        shared = [agents[entry.plays] for entry in other.entries if entry.plays in agents]
        if shared and other is not track:
            names = ", ".join(shared)
            yield f"{names}: also in the table “{other.title}”, by its rules of flight and on its own scale."
    if TRACKS[track.key].scenario == "link":
        yield (
            "On a radio link jamming may cover the ally and leave its link whole, "
            "so a leader's overlap ratio can be high: the jamming success rate tells."
        )


def crossplay_page(scenario: str) -> str:
    """Return the name of the page of a scenario's cross-play, and of its data, without the ending."""
    return "crossplay" if scenario == SCENARIOS[0] else f"crossplay-{scenario}"
