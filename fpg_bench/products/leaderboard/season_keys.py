"""Keys of seasons: what decides their results, by the files of closed seasons."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml
from fpg_bench.players.agent import suites_folder

_PAST = {  # seeds of seasons whose suites are gone, from which the nonces of recorded matches follow
    1: "dec07a8603b0f1a5c4cdbe0ff9a45ff2ebfc89facafc1072e5b50fd933ed745b",
    2: "c3ec4b3c9fb8a62dc69683bd3247e895ed5637fd3295859610968618d90546fd",
    3: "b8a2973e4daea255631e47ac47fe2dc0684e5ce4cec21bcbf4a4937acc90d27f",
}


@dataclass(frozen=True)
class SeasonKey:
    """The parts of a season that decide results.

    Attributes:
        number: the season's number.
        seed: its seed, unknown to everybody before it was closed.
        entries: the hashes of each entry's policies when it was closed, by ``track/name``. The seed follows
            from them, so another entry would have changed it.
        scenario: the preset that it is played in; each has a closing of its own.
        checks: whether each check on its members held at the closing, by side and name; earlier seasons
            have none.
    """

    number: int
    seed: str
    entries: Mapping[str, Sequence[str]] = field(default_factory=dict)
    scenario: str = "standard"
    checks: Mapping[str, bool] = field(default_factory=dict)

    def met(self, name: str, policies: Sequence[str]) -> bool:
        """Return True if the entry had just these policies when the season was closed."""
        return list(self.entries.get(name, ())) == list(policies)

    def suite_name(self, public: str) -> str:
        """Return the name of a track's season suite: ``ally-v2`` becomes ``ally-season-4``."""
        return f"{public.rpartition('-v')[0]}-season-{self.number}"


def season_label(number: int, scenario: str) -> int | str:
    """Return the label of a season in its seed and its folder's name: 2, or ``2-link``."""
    return number if scenario == "standard" else f"{number}-{scenario}"


def seed_from(protocol: str, number: int | str, hashes: Iterable[str]) -> str:
    """Return a season's seed: SHA-256 of the protocol, its number (or name) and the entries' sorted hashes.

    Nobody can know or choose it before the last entry is submitted.
    """
    words = ("fpg-bench", protocol, "season", number, *sorted(hashes))
    return hashlib.sha256("/".join(map(str, words)).encode()).hexdigest()


def current_seasons() -> dict[str, SeasonKey]:
    """Return the newest closed season of each scenario that has one.

    Raises:
        UserError: a file cannot be read, or a seed does not follow from the entries.
    """
    closed = [_key(file.parent.name) for file in suites_folder().glob("season-*/season.yml")]
    return {key.scenario: key for key in sorted(closed, key=lambda key: key.number)}


def current_season() -> SeasonKey | None:
    """Return the newest closed season of ``standard``; None before the first. Raises as above."""
    return current_seasons().get("standard")


def season_seed(number: int) -> str:
    """Return the seed of a closed season of ``standard`` by its number, also of one whose suites are gone.

    Raises:
        UserError: no such season; also as :func:`current_season`.
    """
    return _PAST.get(number) or _key(f"season-{number}").seed


def _key(name: str) -> SeasonKey:
    content = read_yaml(suites_folder() / name / "season.yml", "season")
    sound = type(content.get("number")) is int and isinstance(content.get("entries"), dict)
    if not sound or not isinstance(content.get("seed"), str):
        raise UserError(f"season {name}: season.yml lacks its number, seed or entries")
    try:
        checks = {str(check["name"]): check["holds"] is True for check in content.get("checks", ())}
    except (TypeError, KeyError):
        raise UserError(f"season {name}: season.yml: expected checks with name and holds") from None
    number, seed, entries = (content[key] for key in ("number", "seed", "entries"))
    scenario = str(content.get("scenario", "standard"))
    try:
        hashes = [of for listed in entries.values() for of in listed]
        follows = seed_from(content.get("protocol", ""), season_label(number, scenario), hashes) == seed
    except TypeError:  # no lists
        follows = False
    if not follows:
        raise UserError(f"season {name}: its seed does not follow from the entries that season.yml lists")
    return SeasonKey(number, seed, entries, scenario, checks)
