"""Verification: results are played again, every field of them is compared, and a verdict is given.

A table of :class:`Tolerances` names each field of a kind of results, and how far a stored value may be from
that which was just played. The game and scripts have the same bits on every machine, and agents on one. On
another processor the last bits of an agent's action may differ and, where these lie on a threshold, so may
the rest of the round. Tolerances are for this alone, and a field without one is refused.
"""

from __future__ import annotations

import dataclasses
import logging
import math
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from fpg_bench.common.checks import first_difference
from fpg_bench.common.errors import UserError, printable, shown
from fpg_bench.common.ids import NAMED
from fpg_bench.evaluation.record import HOP_BITS, Plans, Record
from fpg_bench.evaluation.suite import Suite
from fpg_bench.game.metrics import CLEAN, GREATEST

_logger = logging.getLogger(__name__)

T = TypeVar("T")

# Of agents on another machine: a share of the distance from 0 to 100 for returns, of a sum for levels, and of
# all steps for counts. With other last bits in all that agents see, 193 of 194 means of 100 rounds stayed the
# same to the bit, and one moved by 4e-5.
WITHIN = 1e-3
SHARE_OF_ROUNDS = 0.99  # that return the same
# Of the same rounds: sums and means are rounded once more when they are added up.
_SUMMED, _AVERAGED = 1e-6, 1e-5
_LEVELS = ("snr_db", "capacity_mbit_s", CLEAN, HOP_BITS)
_RETURNS = ("ally_return", "opponent_return")


# Verdicts


@dataclass(frozen=True)
class Verdict:
    """The verdict on one result, and the line that explains it."""

    name: str
    is_good: bool
    line: str


class Verdicts:
    """Verdicts on results, one for each name.

    Args:
        level: logging level of the line for each that is given.
    """

    def __init__(self, level: int = logging.INFO) -> None:
        self._level = level
        self._given: dict[str, Verdict] = {}

    def give(self, name: str, good: bool, line: str) -> None:
        """Give a verdict."""
        self._given[name] = Verdict(name, good, printable(line))
        _logger.log(self._level, printable(f"{name}: {line}"))

    def __contains__(self, name: str) -> bool:
        return name in self._given

    def all(self) -> list[Verdict]:
        """Return the verdicts by name."""
        return [self._given[name] for name in sorted(self._given)]

    def bad(self) -> list[Verdict]:
        """Return those of results that are not good, in their order."""
        return [verdict for verdict in self._given.values() if not verdict.is_good]


def judge(
    differing: Sequence[str] | None, text: str, is_trusted: bool = True, update: bool = False
) -> tuple[bool, str]:
    """Return whether a result that was played again is good, and the line of its verdict.

    Args:
        differing: what differs from the stored result; None: there was none.
        text: what was just played.
        is_trusted: the stored result stays, if it does not hold; others are replaced.
        update: replace it without ado.
    """
    if not differing or update:
        return True, f"{'holds' if is_trusted and differing == [] else 'verified'}: {text}"
    others = f" (and {len(differing) - 1} more)" if len(differing) > 1 else ""
    if is_trusted:
        return False, f"the result does not hold: {differing[0]}{others}"
    wrong = f"the result that came along does not hold: {differing[0]}{others}"
    return False, f"replaced: {wrong}; commit this one: {text}"


# Samples


def check_share(share: float) -> None:
    """Raise UserError for a share that is not above 0 and at most 1."""
    if not 0 < share <= 1:
        raise UserError(f"sample: expected a share above 0 and at most 100 %, got {100 * share:g} %")


def draw(items: Sequence[T], share: float, rng: random.Random) -> list[T]:
    """Draw a share of items at random, rounded up."""
    return rng.sample(items, math.ceil(share * len(items)))


# Fields and their tolerances


@dataclass(frozen=True)
class Replayed(Generic[T]):
    """A stored result beside that of the same rounds, which were just played.

    Attributes:
        now, then: the result that was just played, and the stored one.
        units: sizes that tolerances are shares of, by name.
        is_scripted: scripts alone play, so that the rounds have the same bits on every machine.
        is_same: the rounds are the same; only sums over them may be rounded otherwise.
        where: begins messages.
    """

    now: T
    then: T
    units: Mapping[str, float]
    is_scripted: bool
    is_same: bool
    where: str = ""

    def line(self, name: str, now: object, then: object) -> str:
        """Return the line on a value that differs."""
        texts = [f"{value:.6g}" if isinstance(value, float) else shown(value) for value in (now, then)]
        if texts[0] == texts[1]:
            texts = [shown(now), shown(then)]
        return f"{self.where}{name} {texts[0]}, the result says {texts[1]}"


class Tolerance:
    """Distance that a field's stored value may have from the one that was just played; here: not at all."""

    def differences(self, name: str, replays: Sequence[Replayed[Any]]) -> Iterator[str]:
        """Yield a line for each stored value of a field that does not hold."""
        for each in replays:
            found = first_difference(getattr(each.now, name), getattr(each.then, name), name)
            if found is not None:
                yield each.line(*found)

    def is_same(self, now: Any, then: Any) -> bool:
        """Return True if two values are the same to the bit."""
        return bool(now == then)


EXACT = Tolerance()


@dataclass(frozen=True)
class NotCompared(Tolerance):
    """A field that is not compared, and the reason."""

    because: str

    def differences(self, name: str, replays: Sequence[Replayed[Any]]) -> Iterator[str]:
        """Yield nothing."""
        return iter(())

    def is_same(self, now: Any, then: Any) -> bool:
        """Return True."""
        return True


@dataclass(frozen=True)
class Within(Tolerance):
    """A number, or one for each training seed, within a share of a unit.

    Attributes:
        share: the greatest difference, in units.
        unit: the unit's name.
        dealt: rounds are dealt out to the numbers, so that one moves a number as far as all of them the mean.
        of: what each number is of, in messages.
    """

    share: float
    unit: str
    dealt: bool = False
    of: str = " of training seed"

    def differences(self, name: str, replays: Sequence[Replayed[Any]]) -> Iterator[str]:
        """Yield a line for each result in which the mean or one of the numbers does not hold."""
        for each in replays:
            now, then = (np.atleast_1d(np.array(getattr(of, name))) for of in (each.now, each.then))
            if now.shape != then.shape:
                yield each.line(name, now.tolist(), then.tolist())
                continue
            rounded = _AVERAGED * np.abs(now) if now.dtype.kind == "f" else 0 * now  # counts are exact
            most = rounded if each.is_same else self.share * each.units[self.unit] + 0 * now
            worst = int(np.argmax(np.abs(now - then) - most))
            if self.dealt and abs(now.mean() - then.mean()) > most.mean():
                yield each.line(name, now.mean().item(), then.mean().item())
            elif abs(now[worst] - then[worst]) > most[worst] * (len(now) if self.dealt else 1):
                which = f"{self.of} {worst + 1}" if len(now) > 1 else ""
                yield each.line(f"{name}{which}", now[worst].item(), then[worst].item())


class _Rounds(Tolerance):
    """Returns of rounds: 99 % of all must be the same, and the mean over the training seeds must agree."""

    def differences(self, name: str, replays: Sequence[Replayed[Record]]) -> Iterator[str]:
        near = [
            np.abs(np.subtract(each.now.returns, each.then.returns)) <= WITHIN * each.units[_RETURN]
            for each in replays
        ]
        share = float(np.concatenate(near).mean())
        if share < SHARE_OF_ROUNDS:
            yield f"{100 * (1 - share):.1f} % of {sum(map(len, near))} rounds return something else"
        for each in replays:
            if each.is_scripted or each.now.rounds_sha256 == each.then.rounds_sha256:
                yield from EXACT.differences(name, [each])
        by_rival: dict[tuple[str, str], list[Replayed[Record]]] = {}
        for each in replays:
            by_rival.setdefault((each.now.suite_hash, each.now.rival), []).append(each)
        for seeds in by_rival.values():
            now = np.mean([each.now.returns for each in seeds])
            then = np.mean([each.then.returns for each in seeds])
            if abs(now - then) > WITHIN * seeds[0].units[_RETURN]:
                where = f"{seeds[0].now.suite}, {seeds[0].now.rival}"
                yield f"{where}: mean return {now:.1f}, the result says {then:.1f}"


class _Bits(Tolerance):
    """A hash of all rounds, which is the same on every machine if scripts alone play."""

    def differences(self, name: str, replays: Sequence[Replayed[Record]]) -> Iterator[str]:
        for each in replays:
            if each.is_scripted and each.now.rounds_sha256 != each.then.rounds_sha256:
                yield f"{each.where}other rounds, though scripts play the same to the bit on every machine"


class _Sums(Tolerance):
    """Sums by their names, each by what it counts."""

    def differences(self, name: str, replays: Sequence[Replayed[Record]]) -> Iterator[str]:
        for each in replays:
            now, then = each.now.tally, each.then.tally
            for key in now | then:
                is_there = key in now and key in then
                if not is_there or abs(now[key] - then[key]) > self._most(key, each):
                    yield each.line(key, now.get(key), then.get(key))

    def _most(self, key: str, replay: Replayed[Record]) -> float:
        tally, rounds = replay.now.tally, len(replay.now.returns)
        if replay.is_same:
            return _SUMMED * abs(tally[key])
        if key == "steps":
            return 0.0
        if key == GREATEST:  # a single round decides it, and it may last for all of that round
            return tally["steps"] / rounds
        if key in _RETURNS:
            return WITHIN * replay.units[_RETURN] * rounds
        return WITHIN * (abs(tally[key]) if key in _LEVELS else tally["steps"])


class Tolerances(Tolerance, Generic[T]):
    """The tolerances of all fields of a kind of results; also of a field that holds such a result, or None.

    >>> Tolerances(Plans, statuses=EXACT, tokens=EXACT, seconds=NotCompared("of the machine"))
    Traceback (most recent call last):
    ...
    TypeError: Plans: say how far these fields may differ when they are played again: useless

    Args:
        kind: a model or a dataclass.
        **of: the tolerance of each of its fields.

    Raises:
        TypeError: a field without a tolerance, or a tolerance without a field.
    """

    def __init__(self, kind: type[T], **of: Tolerance) -> None:
        if undeclared := sorted(fields_of(kind) ^ of.keys()):
            raise TypeError(
                f"{kind.__name__}: say how far these fields may differ when they are played again: "
                f"{', '.join(undeclared)}"
            )
        self._of = of

    def of(self, replays: Sequence[Replayed[T]]) -> list[str]:
        """Return what does not hold of results that were played again, one line each."""
        return [line for name, each in self._of.items() for line in each.differences(name, replays)]

    def differences(self, name: str, replays: Sequence[Replayed[Any]]) -> Iterator[str]:
        """Yield what does not hold in results that are a field of others."""
        for each in replays:
            now, then = getattr(each.now, name), getattr(each.then, name)
            if now is None or then is None:
                yield from EXACT.differences(name, [each])
            else:
                yield from self.of([dataclasses.replace(each, now=now, then=then)])

    def is_same(self, now: T | None, then: T | None) -> bool:
        """Return True if all fields that are compared are the same to the bit."""
        return now is then if now is None or then is None else not self.changed(now, then)

    def changed(self, now: T, then: T) -> list[str]:
        """Return the names of fields that are compared and not the same to the bit."""
        fields = self._of.items()
        return [name for name, each in fields if not each.is_same(getattr(now, name), getattr(then, name))]


def fields_of(kind: Any) -> set[str]:
    """Return the names of the fields of a model or a dataclass."""
    return set(getattr(kind, "model_fields", None) or (field.name for field in dataclasses.fields(kind)))


# Records


# Units: a round's distance from 0 to 100, and the numbers of rounds and of steps.
_RETURN, _ROUNDS, _STEPS = "return", "rounds", "steps"

PLANS = Tolerances(
    Plans, statuses=EXACT, tokens=EXACT, useless=EXACT, seconds=NotCompared("the time on a machine")
)
RECORD = Tolerances(
    Record,
    returns=_Rounds(),
    rounds_sha256=_Bits(),
    suite=EXACT,
    suite_hash=EXACT,
    entry=EXACT,
    training_seed=EXACT,
    fingerprint=EXACT,
    rival=EXACT,
    lost=Within(1 - SHARE_OF_ROUNDS, _ROUNDS),
    plans=PLANS,
    tally=_Sums(),
    ally_points=Within(WITHIN, _STEPS, of=" of point"),
    jam_points=Within(WITHIN, _STEPS, of=" of point"),
)


def replays_of(
    played: Iterable[Record], kept: Iterable[Record], suites: Iterable[Suite]
) -> list[Replayed[Record]]:
    """Return records that were played again beside those of a result.

    Args:
        played: records just played, perhaps against some rivals only.
        kept: the records of the result.
        suites: the suites that they were played on.
    """
    by_hash = {suite.hash[:16]: suite for suite in suites}
    before = {_matchup(record): record for record in kept}
    replays = []
    for now in played:
        then, suite = before[_matchup(now)], by_hash[now.suite_hash]
        is_scripted, span = _is_scripted(now, suite), (suite.scale.top - suite.scale.zero)
        seed = "" if now.training_seed is None else f"seed {now.training_seed}, "
        where = f"{seed}{now.suite}, {now.rival}: "
        units = {_RETURN: span * suite.scenario.steps_per_round, _ROUNDS: len(now.returns)} | {
            _STEPS: now.tally["steps"]
        }
        is_same = now.returns == then.returns or now.rounds_sha256 == then.rounds_sha256
        replays.append(Replayed(now, then, units, is_scripted, is_same, where))
    return replays


def _matchup(record: Record) -> tuple[int | None, str, str, str]:
    return record.training_seed, record.suite, record.suite_hash, record.rival


def _is_scripted(record: Record, suite: Suite) -> bool:
    """Return True if scripts alone play; planners may call libraries that choose code by processor."""
    if suite.side not in NAMED or record.fingerprint not in {name[:16] for name in NAMED[suite.side]}:
        return False
    rival = suite.named(record.rival)
    return rival.planner is None and set(rival.players) <= set(NAMED[suite.other_side])
