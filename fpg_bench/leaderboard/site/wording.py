"""How the page says a number: digits and units; a dash for whatever a board holds instead of one."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple, Protocol

from fpg_bench.errors import UserError

NONE = "–"
_SLUG = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
_LINK = re.compile(r"https://[A-Za-z0-9.-]+(:\d+)?(/[^\s\"'<>\\]*)?")


class Bounded(Protocol):
    """What has a lower and an upper end, each a number or None."""

    @property
    def low(self) -> float | None:
        """The lower one."""

    @property
    def high(self) -> float | None:
        """The upper one."""


class Measure(NamedTuple):
    """What the page says about a measure: its name, how it is written, and what it means."""

    label: str
    style: str
    about: str


# In the order in which an entry's page lists them.
MEASURES = {
    "return": Measure("Return a step", "step", "mean of its own rewards in the rounds that its score counts"),
    "ally_return": Measure("Ally's return", "whole", "sum of the ally's rewards in a round"),
    "opponent_return": Measure("Opponent's return", "whole", "sum of the opponent's rewards in a round"),
    "jamming_success_rate": Measure(
        "Jammed", "share", "time in which jamming covers the ally and breaks its link"
    ),
    "overlap_ratio": Measure("Overlap", "share", "time in which jamming covers the ally's frequency"),
    "spectrum_overlap": Measure(
        "Spectrum overlap", "share", "how alike the frequencies of both sides are spread"
    ),
    "outage": Measure("Outage", "share", "time in which the link is broken, jammed or not"),
    "capacity_mbit_s": Measure("Capacity", "Mbit/s", "mean rate of the link"),
    "snr_db": Measure("SNR", "dB", "mean quality of the link"),
    "hop_rate": Measure("Hops", "share", "time steps in which the ally pays for a hop"),
    "frequency_changes": Measure(
        "Frequency changes", "share", "steps in which the ally's frequency really changes"
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
HIDDEN = ("recoveries_cut",)  # of use to those who compute the others
COLUMNS = ("jamming_success_rate", "return")  # beside the scores in a track's table


class Role(NamedTuple):
    """What the page calls a field by what it says of an entry, and whom one meets there."""

    label: str
    about: str


# In the order in which pages list them.
ROLES = {
    "known": Role("Known", "the public field, which everybody can train on"),
    "unseen": Role("Unseen", "players that were trained after entries were closed"),
    "shifted": Role("Shifted", "the public field under changed rules"),
    "responses": Role("Best responses", "players that were trained to beat one entry"),
    "public": Role("Public seeds", "the known field on seeds that everybody knew"),
}
_TOPS = {"ally": "a link that is never jammed"}  # what scores 100


def finite(value: Any) -> float | None:
    """A number, or None where there is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def written(value: Any, style: str = "score") -> str:
    """A number in words: ``score`` (one digit), ``step`` (two), ``whole``, ``share`` or a unit."""
    number = finite(value)
    if number is None:
        return NONE
    if style == "share":
        return f"{100 * number:.1f} %"
    if style == "whole":
        return f"{number:,.0f}".replace("-", "−")
    text = f"{number:.{2 if style == 'step' else 1}f}".replace("-", "−")
    return text if style in ("score", "step") else f"{text} {style}"


def measure_of(name: str) -> Measure:
    """What the page says about a measure; one that it does not know is called by its own name."""
    if name in MEASURES:
        return MEASURES[name]
    label = name.replace("_", " ").capitalize()
    return Measure(label, "share" if name.endswith(("_ratio", "_rate")) else "score", "")


def interval_text(interval: Bounded | None) -> str:
    """``low to high`` of an interval; empty where it has none."""
    if interval is None or interval.low is None or interval.high is None:
        return ""
    return f"{written(interval.low)} to {written(interval.high)}"


def signed(value: Any) -> str:
    """A difference of scores with its sign; a dash where there is none."""
    number = finite(value)
    return f"+{written(number)}" if number is not None and number >= 0 else written(number)


def role_of(name: str) -> Role:
    """What the page says about a field's role; one that it does not know is called by its own name."""
    return ROLES.get(name, Role(name.capitalize(), ""))


def scale_text(scale: Any, side: Any) -> str:
    """What scores 0 and 100, in returns a step; empty where a board does not say."""
    ends = [finite(scale.get(end)) for end in ("zero", "top")] if isinstance(scale, dict) else [None]
    if None in ends:
        return ""
    zero, top = (written(end, "step") for end in ends)
    best = _TOPS.get(str(side), "the best that is known to be possible")
    return f"a score of 0 is what playing at random earns ({zero} a step), 100 is {best} ({top} a step)"


def rank_text(rank: Any) -> str:
    """``2``, or ``2–4`` where it can't be told apart from others; a dash where it has no rank."""
    ends = [finite(end) for end in rank] if isinstance(rank, list | tuple) and len(rank) == 2 else [None]
    if None in ends:
        return NONE
    low, high = (f"{end:.0f}" for end in ends)
    return low if low == high else f"{low}–{high}"


def lost_text(lost: Any, rounds: Any) -> str:
    """How many rounds were lost by rule; empty where none was."""
    return (
        f"{written(lost, 'whole')} of {written(rounds, 'whole')} rounds lost by rule" if finite(lost) else ""
    )


def safe_link(text: Any) -> str | None:
    """An https link, or None for whatever else a submission has written there."""
    return text if isinstance(text, str) and len(text) < 500 and _LINK.fullmatch(text) else None


def safe_slug(text: Any, what: str) -> str:
    """A word that may stand in a file's name.

    Raises:
        UserError: it is no such word.
    """
    if not isinstance(text, str) or not _SLUG.fullmatch(text):
        raise UserError(
            f"board: {what} {text!r}: expected at most 40 of a-z, 0-9 and -, a letter or digit first"
        )
    return text
