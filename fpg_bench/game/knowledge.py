"""The expert knowledge base, read from YAML: one entry per jamming type (paper, Section 4.2)."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.checks import check_keys, is_integer, of_kind
from fpg_bench.common.errors import UserError, shown
from fpg_bench.common.files import read_yaml
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.names import JAMMING_TYPES

EXPERT_FILE = Path(__file__).with_name("knowledge.yml")
_KEYS = ("spectrum", "guard_mhz", "strategy", "candidates", "spread", "advice")
_MOST = 1_000_000  # MHz, and candidates
_LONGEST = 500  # characters of a text
_SPECTRUM = ("half_width_mhz", "spacing_mhz")


@dataclass(frozen=True)
class KnowledgeEntry:
    """Entry of one jamming type: its spectrum, and the counter-strategy.

    ``candidates`` is 0 where the strategy draws from all free points, else how many of the free
    points farthest from the sensed centre it draws from. ``spacing_mhz`` is 0 for a spectrum in
    one piece.
    """

    half_width_mhz: float
    spacing_mhz: float
    guard_mhz: float
    candidates: int
    spread: bool
    advice: str


def load_knowledge(name: str) -> tuple[KnowledgeEntry, ...] | None:
    """Load the knowledge base ``expert`` of the package or a YAML file; None for ``none``.

    Returns:
        Entries in the order of the jamming types: tone, narrowband, broadband, comb.

    Raises:
        UserError: the file cannot be read, or an entry or key is missing, unknown or bad.
    """
    if name == "none":
        return None
    return _expert() if name == "expert" else _load(Path(name))


@functools.cache
def _expert() -> tuple[KnowledgeEntry, ...]:
    return _load(EXPERT_FILE)


def _load(path: Path) -> tuple[KnowledgeEntry, ...]:
    content = read_yaml(path, "knowledge (expert, none or a YAML file)")
    check_keys(content, JAMMING_TYPES, f"knowledge {path}", needed=JAMMING_TYPES)
    return tuple(_entry(f"knowledge {path}: {name}", content[name]) for name in JAMMING_TYPES)


def _entry(where: str, content: JsonObject) -> KnowledgeEntry:
    check_keys(content, _KEYS, where, needed=_KEYS)
    spectrum, candidates = content["spectrum"], content["candidates"]
    check_keys(spectrum, _SPECTRUM, f"{where}: spectrum", needed=_SPECTRUM)
    if candidates != "all" and not (is_integer(candidates) and candidates <= _MOST):
        raise UserError(
            f"{where}: candidates: expected 'all' or a whole number above 0, got {shown(candidates)}"
        )
    for name in ("strategy", "advice"):
        text = content[name]
        if not isinstance(text, str) or not text.isprintable() or len(text) > _LONGEST:
            raise UserError(f"{where}: {name}: expected a line of text, got {shown(text)}")
    spacing = spectrum["spacing_mhz"]
    return KnowledgeEntry(
        half_width_mhz=_positive(f"{where}: half_width_mhz", spectrum["half_width_mhz"]),
        spacing_mhz=0.0 if spacing is None else _positive(f"{where}: spacing_mhz", spacing),
        guard_mhz=_positive(f"{where}: guard_mhz", content["guard_mhz"]),
        candidates=0 if candidates == "all" else candidates,
        spread=of_kind(content["spread"], f"{where}: spread", "true or false", bool),
        advice=content["advice"],
    )


def _positive(where: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= _MOST:
        raise UserError(f"{where}: expected a number of at least 0, got {shown(value)}")
    return float(value)
