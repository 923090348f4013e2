"""Which season is on: its number and seed, from which evaluation seeds and unseen fields follow."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from fpg_bench.errors import UserError
from fpg_bench.files import read_yaml
from fpg_bench.players.agent import fields_folder


@dataclass(frozen=True)
class SeasonKey:
    """What of a season decides results.

    Attributes:
        number: the season's.
        seed: that nobody knew before it was closed.
        entries: over whom it was closed: the hashes of each entry's policies, by ``track/name``; the seed
            follows from them, so who adds one has another seed.
    """

    number: int
    seed: str
    entries: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def met(self, name: str, policies: Sequence[str]) -> bool:
        """Whether an entry of policies was closed over as it is; any other may have trained on the season."""
        return list(self.entries.get(name, ())) == list(policies)

    def field_name(self, public: str) -> str:
        """The season's field of a track: ``ally-v1`` becomes ``ally-season-1``."""
        return f"{public.removesuffix('-v1')}-season-{self.number}"


def seed_from(protocol: str, number: int | str, hashes: Iterable[str]) -> str:
    """The season's seed: SHA-256 of the protocol, its number (or name) and the entries' sorted hashes.

    Nobody knows it, or can choose it, before the last entry is in.
    """
    words = ("fpg-bench", protocol, "season", number, *sorted(hashes))
    return hashlib.sha256("/".join(map(str, words)).encode()).hexdigest()


def current_season() -> SeasonKey | None:
    """The newest season that is closed; None before the first.

    Raises:
        UserError: its file cannot be read, or its seed does not follow from its entries.
    """
    found = [_key(file.parent.name) for file in fields_folder().glob("season-*/season.yml")]
    return max(found, key=lambda key: key.number, default=None)


def _key(name: str) -> SeasonKey:
    content = read_yaml(fields_folder() / name / "season.yml", "season")
    sound = type(content.get("number")) is int and isinstance(content.get("entries"), dict)
    if not sound or not isinstance(content.get("seed"), str):
        raise UserError(f"season {name}: season.yml lacks its number, seed or entries")
    number, seed, entries = (content[key] for key in ("number", "seed", "entries"))
    try:
        hashes = [of for listed in entries.values() for of in listed]
        follows = seed_from(content.get("protocol", ""), number, hashes) == seed
    except TypeError:  # no lists
        follows = False
    if not follows:
        raise UserError(f"season {name}: its seed does not follow from the entries that season.yml lists")
    return SeasonKey(number, seed, entries)
