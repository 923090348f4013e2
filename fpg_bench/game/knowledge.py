"""The expert knowledge base, read from YAML: one entry per jamming type (paper, Section 4.2)."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.checks import is_whole
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml

EXPERT_FILE = Path(__file__).with_name("knowledge.yml")
_KEYS = ("spectrum", "guard_mhz", "strategy", "candidates", "spread", "advice")


class KnowledgeError(UserError):
    """An invalid knowledge base; the message names the file, the entry and the key."""


@dataclass(frozen=True)
class Entry:
    """Entry of one jamming type: its spectrum, and the counter-strategy.

    ``candidates`` is 0 where the strategy draws from all free points, else how many of the free
    points farthest from the sensed centre it draws from. ``spacing_mhz`` is 0 for a spectrum in
    one piece.
    """

    half_width_mhz: float
    spacing_mhz: float
    guard_mhz: float
    candidates: int
    strategy: str
    spread: bool
    advice: str


@dataclass(frozen=True)
class KnowledgeBase:
    """Entries in the order of the jamming types: tone, narrowband, broadband, comb."""

    entries: tuple[Entry, ...]

    def canonical(self) -> list[dict[str, Any]]:
        """Return what the game reads, for the scenario's hash; the advice is not part of it."""
        return [{k: v for k, v in vars(e).items() if k not in ("strategy", "advice")} for e in self.entries]


def load_knowledge(name: str, jamming_types: tuple[str, ...]) -> KnowledgeBase | None:
    """Load the knowledge base ``expert`` of the package or a YAML file; None for ``none``.

    Raises:
        UserError: the file cannot be read, or an entry or key is missing, unknown or bad.
    """
    if name == "none":
        return None
    return _expert(jamming_types) if name == "expert" else _load(Path(name), jamming_types)


@functools.cache
def _expert(jamming_types: tuple[str, ...]) -> KnowledgeBase:
    return _load(EXPERT_FILE, jamming_types)


def _load(path: Path, jamming_types: tuple[str, ...]) -> KnowledgeBase:
    content = read_yaml(path, "knowledge (expert, none or a YAML file)")
    if set(content) != set(jamming_types):
        found = ", ".join(map(str, content))
        raise KnowledgeError(
            f"knowledge {path}: expected the entries {', '.join(jamming_types)}, got {found}"
        )
    return KnowledgeBase(tuple(_entry(f"knowledge {path}: {name}", content[name]) for name in jamming_types))


def _entry(where: str, content: Any) -> Entry:
    if not isinstance(content, dict) or set(content) != set(_KEYS):
        found = ", ".join(map(str, content)) if isinstance(content, dict) else repr(content)
        raise KnowledgeError(f"{where}: expected the keys {', '.join(_KEYS)}, got {found}")
    spectrum = content["spectrum"]
    if not isinstance(spectrum, dict) or set(spectrum) != {"half_width_mhz", "spacing_mhz"}:
        raise KnowledgeError(f"{where}: spectrum: expected half_width_mhz and spacing_mhz, got {spectrum!r}")
    candidates = content["candidates"]
    if candidates != "all" and not is_whole(candidates):
        raise KnowledgeError(
            f"{where}: candidates: expected 'all' or a whole number above 0, got {candidates!r}"
        )
    if not isinstance(content["spread"], bool):
        raise KnowledgeError(f"{where}: spread: expected true or false, got {content['spread']!r}")
    spacing = spectrum["spacing_mhz"]
    return Entry(
        half_width_mhz=_positive(f"{where}: half_width_mhz", spectrum["half_width_mhz"]),
        spacing_mhz=0.0 if spacing is None else _positive(f"{where}: spacing_mhz", spacing),
        guard_mhz=_positive(f"{where}: guard_mhz", content["guard_mhz"]),
        candidates=0 if candidates == "all" else candidates,
        strategy=str(content["strategy"]),
        spread=content["spread"],
        advice=str(content["advice"]),
    )


def _positive(where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0:
        raise KnowledgeError(f"{where}: expected a number of at least 0, got {value!r}")
    return float(value)
