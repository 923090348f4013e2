"""Ranges of seeds for training, tuning, evaluation and data sets, which never meet, and the keys of seasons.

A training run of seed k takes [k * 10^6, (k + 1) * 10^6); tuning seeds begin at 2^40, evaluation seeds at
2^41, and those of data sets at 2^42, where data set k has 2^32 of them. The further
games of a batch that has one seed lie above all of these, from 3 * 2^61 on. Evaluation seeds follow from the
protocol version and a season key by a public hash, so they can be changed each season.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml
from fpg_bench.players.agent import suites_folder

PROTOCOL = "1"
SEASON = "0"
TRAINING_STRIDE = 10**6
TUNING_START = 2**40
EVALUATION_START = 2**41
DATASET_START = 2**42
_BLOCK = 2**20
_DATASET_BLOCK = 2**32
_MOST_DATASETS = 2**30
_PAST = {  # seeds of seasons whose suites are gone, from which the nonces of recorded matches follow
    1: "dec07a8603b0f1a5c4cdbe0ff9a45ff2ebfc89facafc1072e5b50fd933ed745b",
    2: "c3ec4b3c9fb8a62dc69683bd3247e895ed5637fd3295859610968618d90546fd",
}


def training_seed(k: int) -> int:
    """Return the first environment seed of training seed k.

    Raises:
        UserError: k is negative or so large that it would reach the tuning seeds.
    """
    seed = k * TRAINING_STRIDE
    if k < 0 or seed + TRAINING_STRIDE > TUNING_START:
        raise UserError(f"training seed: expected 0 to {TUNING_START // TRAINING_STRIDE - 1}, got {k}")
    return seed


def evaluation_seeds(count: int, season: str = SEASON) -> list[int]:
    """Return the first ``count`` evaluation seeds of a season of this protocol.

    Raises:
        UserError: more than a season has.
    """
    if not 0 <= count <= _BLOCK:
        raise UserError(f"evaluation seeds: a season has {_BLOCK}, asked for {count}")
    digest = hashlib.sha256(f"fpg-bench/{PROTOCOL}/{season}".encode()).digest()
    first = EVALUATION_START + int.from_bytes(digest[:8], "big") % _BLOCK * _BLOCK
    return list(range(first, first + count))


def tuning_seeds(count: int) -> list[int]:
    """Return the first ``count`` tuning seeds, on which a policy is scored while it is trained or tuned.

    Raises:
        UserError: more than there are.
    """
    if not 0 <= count <= EVALUATION_START - TUNING_START:
        raise UserError(f"tuning seeds: there are {EVALUATION_START - TUNING_START}, asked for {count}")
    return list(range(TUNING_START, TUNING_START + count))


def dataset_seed(k: int) -> int:
    """Return the first of the 2^32 environment seeds of data set k.

    Raises:
        UserError: k is negative, or 2^30 or more.
    """
    if not 0 <= k < _MOST_DATASETS:
        raise UserError(f"seed of a data set: expected 0 to {_MOST_DATASETS - 1}, got {k}")
    return DATASET_START + k * _DATASET_BLOCK


@dataclass(frozen=True)
class SeasonKey:
    """The parts of a season that decide results.

    Attributes:
        number: the season's number.
        seed: its seed, unknown to everybody before it was closed.
        entries: the hashes of each entry's policies when it was closed, by ``track/name``. The seed follows
            from them, so another entry would have changed it.
        scenario: the preset that it is played in; each has a closing of its own.
    """

    number: int
    seed: str
    entries: Mapping[str, Sequence[str]] = field(default_factory=dict)
    scenario: str = "standard"

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
    number, seed, entries = (content[key] for key in ("number", "seed", "entries"))
    scenario = str(content.get("scenario", "standard"))
    try:
        hashes = [of for listed in entries.values() for of in listed]
        follows = seed_from(content.get("protocol", ""), season_label(number, scenario), hashes) == seed
    except TypeError:  # no lists
        follows = False
    if not follows:
        raise UserError(f"season {name}: its seed does not follow from the entries that season.yml lists")
    return SeasonKey(number, seed, entries, scenario)
