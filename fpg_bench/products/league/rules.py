"""Short rules: numbers on grids that say when to hop, spread and sprint, or what to jam where.

A rule is searched without a network (:mod:`fpg_bench.products.league.rule_search`), reads in a line, and
is exported as an ordinary agent. The first option of each number is ``off``, or what a script does.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import NormalDist
from types import MappingProxyType

import numpy as np

from fpg_bench.game.actions import (
    HOP_GATE,
    IN_BAND_GATE,
    KNOWLEDGE_GATE,
    PREFERENCE,
    SPEED,
    SPREAD_GATE,
    TUNING,
    TYPE_SCORES,
    VELOCITY,
)
from fpg_bench.game.choices import PURSUIT_M, Choices
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    LAST_CHECK,
    OWN_POSITION,
    SENSED_COVERS,
    SENSED_TYPE,
    SNR,
    SPREADING_TIME,
)
from fpg_bench.game.state import TYPES
from fpg_bench.products.league.candidates import PolicyGraph, away_m

OFF = "off"
_NEVER, _EVIDENCE = 1e9, 12.0  # what nothing reaches; what the hits of a type add up to that make a hop
_SCALES = {"spread_s": "spreading_scale_s", "hold_s": "age_scale_s", "moved_hold_s": "age_scale_s"}
# Numbers that nothing reaches where they are off; what else has a unit is always passed there.
_OFF_BEYOND = ("below_db", "spread_beyond_m", "spread_s", "spread_until_s", "hop_every_s", *_SCALES)
_TYPES = tuple(range(TYPES))
_CENTRES = (2, 1, 3, 5, 15)

Option = float | str

_HITS = (OFF, 1, 2, 3, 4, 6)
ALLY: Mapping[str, tuple[Option, ...]] = MappingProxyType(
    {
        **{f"{name}_hits": _HITS for name in JAMMING_TYPES},  # after which it hops
        "drawn": (OFF, 1),  # hops to a random point, not by the knowledge base
        "forget_s": (OFF, 2, 4, 8),  # seconds without a hit after which hits no longer count
        "pause_s": (OFF, 2, 3, 5, 8, 15),  # between hops, at least
        "below_db": (OFF, 0, 5, 10, 15, 20, 30),  # of the SNR above its threshold, where hits count
        "hop_every_s": (OFF, 2, 3, 5, 8, 12, 20),  # at the latest
        "spread_beyond_m": (OFF, 0, 30, 60, 110, 200),
        "spread_s": (OFF, 1, 2, 3, 4, 6),  # in a row, before a pause of one second
        "spread_after_s": (OFF, 1, 2, 3, 5),  # since the last hit
        "spread_until_s": (OFF, 1, 3, 6, 12),
        "spread_above_db": (OFF, 5, 10, 20),  # of the SNR above its threshold
        "sprint_m": (OFF, 60, 120, 200, 250, 350, 600),  # distance within which it flies at full speed
        "fleeing": (OFF, 1),  # full speed only while it flies away
        "cruise": (OFF, -1, -0.5, 0.5, 1),  # the action at other times; off is the mean speed
    }
)
OPPONENT: Mapping[str, tuple[Option, ...]] = MappingProxyType(
    {
        "known_type": _TYPES,  # on the known point
        "hold_s": (OFF, 1, 2, 3, 4, 5),  # after a check that found the ally; off: until the next one
        "moved_hold_s": (OFF, 1, 2, 3, 5),  # the same of an ally that was found elsewhere
        "finds": (1, 2, 3),  # checks in a row that find such an ally where it was, until it counts as staying
        "distrust": (OFF, 1),  # treat an ally as found elsewhere from the start
        "misses": (OFF, 1),  # jam blindly after a check that heard nothing
        "blind_type": (2, 1, 3, 0),
        "centres": _CENTRES,  # of blind jamming, evenly over the band
        "centre_s": (1, 2, 3, 5),
        "random": (OFF, 1),  # centres are drawn, not taken in turn
        "near_m": (OFF, 30, 60, 90, 130, 200),  # distance within which it jams with the near type
        "near_type": _TYPES,
    }
)
NUMBERS = MappingProxyType({"ally": ALLY, "opponent": OPPONENT})
_MEMORY = {"ally": 7, "opponent": 5}


def rule_values(side: str, indices: np.ndarray, scenario: Scenario) -> np.ndarray:
    """Return the thresholds of rules in the units of observations.

    Args:
        side: ``ally`` or ``opponent``.
        indices: ``(n, numbers)``, the option of each number.
        scenario: gives the scales.

    Returns:
        ``(n, numbers)`` float32.
    """
    columns = []
    for (name, options), chosen in zip(NUMBERS[side].items(), indices.T, strict=True):
        grid = [_threshold(name, option, scenario) for option in options]
        columns.append(np.array(grid, np.float32)[chosen])
    return np.stack(columns, axis=1)


def _threshold(name: str, option: Option, scenario: Scenario) -> float:
    """Return what an option of a number is in the graph, by the unit that ends its name."""
    unit = name.rpartition("_")[2]
    if option == OFF:
        return _NEVER if name in _OFF_BEYOND else -_NEVER if unit in ("db", "m", "s") else 0.0
    value = float(option)
    if unit == "hits":
        return _EVIDENCE / value
    if unit == "db":
        return (scenario.snr_threshold_db + value) / scenario.snr_scale_db
    if unit == "m":
        return value * value
    if unit == "s":  # whole seconds, half a second below
        return (value - 0.5) / (getattr(scenario, _SCALES[name]) if name in _SCALES else 1)
    return value


def rule_graph(side: str, scenario: Scenario, numbers: np.ndarray | None = None) -> bytes:
    """Return the family of a side as ONNX, or one rule of it.

    Args:
        side: ``ally`` or ``opponent``.
        scenario: gives the scales.
        numbers: ``(numbers,)`` float32, of :func:`rule_values`; None: they are an input.
    """
    graph = PolicyGraph(tuple(NUMBERS[side]), numbers, _MEMORY[side])
    return (_write_ally if side == "ally" else _write_opponent)(graph, scenario)


def _write_ally(graph: PolicyGraph, scenario: Scenario) -> bytes:
    seen, memory, given = graph.seen, graph.memory, graph.given
    evidence, quiet_s, since_hop_s = (memory.column(k) for k in range(3))
    place_before, has_begun = memory.column(3, 3), memory.column(6) > 0.5
    hit = seen.column(SENSED_COVERS) > 0
    snr = seen.column(SNR)
    weights = seen.column(SENSED_TYPE, TYPES) * given(f"{JAMMING_TYPES[0]}_hits", TYPES)
    weight = weights.column(0) + weights.column(1) + weights.column(2) + weights.column(3)
    quiet_s = hit.where(0, quiet_s + 1)
    evidence = hit.where(evidence + weight, (given("forget_s") < quiet_s).where(0, evidence))
    is_due = (evidence > _EVIDENCE - 0.5) & (snr < given("below_db"))
    since_hop_s = since_hop_s + 1
    hop = (is_due | (given("hop_every_s") < since_hop_s)) & (given("pause_s") < since_hop_s)
    evidence, since_hop_s = hop.where(0, evidence), hop.where(0, since_hop_s)

    away = away_m(seen, scenario)
    squares = away.dot(away)
    spread = (given("spread_beyond_m") < squares) & (seen.column(SPREADING_TIME) < given("spread_s"))
    spread = spread & (given("spread_after_s") < quiet_s) & (quiet_s < given("spread_until_s"))
    spread = spread & (given("spread_above_db") < snr)

    place = seen.column(OWN_POSITION, 3)
    moved = (place - place_before) * graph.constant(*scenario.box_m)
    flees = (moved.dot(away) < 0) | ~has_begun | (given("fleeing") < 0.5)
    speed = ((squares < given("sprint_m")) & flees).where(1, given("cruise"))
    choices = Choices("ally", "uniform-hop", scenario)
    point = graph.count_at_most(graph.constant(*choices.quantiles), graph.noise)
    step = choices.preferences[1] - choices.preferences[0]
    preference = point * float(step) - 1.0
    return graph.finish(
        [
            (HOP_GATE, 1, hop.where(1, -1)),
            (SPREAD_GATE, 1, spread.where(1, -1)),
            (SPEED, 1, speed),
            (PREFERENCE, 1, preference),
            (KNOWLEDGE_GATE, 1, (given("drawn") < 0.5).where(1, -1)),
        ],
        [evidence, quiet_s, since_hop_s, place, hit.where(1, 1)],
    )


def _write_opponent(graph: PolicyGraph, scenario: Scenario) -> bytes:
    seen, memory, given = graph.seen, graph.memory, graph.given
    known_before, left, phase_s, turn = (memory.column(k) for k in range(4))
    has_begun = memory.column(4) > 0.5
    known, age = seen.column(KNOWN_FREQUENCY), seen.column(KNOWN_AGE)
    # Checks still to find the ally where it was before it counts as staying.
    found = (age < 0.5 / scenario.age_scale_s) & has_begun
    left = has_begun.where(left, given("distrust") * given("finds"))
    is_same = known.equals(known_before)
    left = (found & is_same).where((left - 1).of("Relu"), (found & ~is_same).where(given("finds"), left))
    unheard = (seen.column(LAST_CHECK) < -0.5) & (given("misses") > 0.5)
    hold = (left > 0.5).where(given("moved_hold_s"), given("hold_s"))
    is_known = (age < hold) & ~unheard

    # Centres of blind jamming, in turn or drawn.
    phase_s = phase_s + 1
    is_next = (given("centre_s") < phase_s) | ~has_begun
    phase_s = is_next.where(0, phase_s)
    drawn = turn * 0.0
    for count in sorted(_CENTRES)[1:]:
        edges = graph.constant(*(NormalDist().inv_cdf(k / count) for k in range(1, count)))
        of = given("centres").equals(graph.constant(count))
        drawn = of.where(graph.count_at_most(edges, graph.noise), drawn)
    following = (turn + 1 > given("centres") - 0.5).where(0, turn + 1)
    turn = is_next.where((given("random") > 0.5).where(drawn, has_begun.where(following, turn)), turn)
    blind = (turn * 2.0 + 1.0) / given("centres") - 1.0

    away = away_m(seen, scenario)
    squares = away.dot(away)
    kind = is_known.where(given("known_type"), given("blind_type"))
    kind = (squares < given("near_m")).where(given("near_type"), kind)
    reach = squares.of("Sqrt").at_least(PURSUIT_M)
    return graph.finish(
        [
            (TYPE_SCORES, TYPES, kind.equals(graph.constant(*_TYPES)).where(1, -1)),
            (TUNING, 1, is_known.where(0, blind)),
            (IN_BAND_GATE, 1, is_known.where(-1, 1)),
            (VELOCITY, 3, away / reach),
        ],
        [known, left, phase_s, turn, found.where(1, 1)],
    )


def describe_rule(side: str, rule: Mapping[str, Option]) -> str:
    """Return a rule in words."""
    return _describe_ally(rule) if side == "ally" else _describe_opponent(rule)


def _describe_ally(rule: Mapping[str, Option]) -> str:
    words = []
    hits = {name: rule[f"{name}_hits"] for name in JAMMING_TYPES if rule[f"{name}_hits"] != OFF}
    where = "by the knowledge base" if rule["drawn"] == OFF else "to a random point"
    if hits:
        counts = " or ".join(f"{count} of {name}" for name, count in hits.items())
        gap = "" if rule["forget_s"] == OFF else f" with gaps of up to {rule['forget_s']} s"
        level = _unless_off(rule, "below_db", " while the SNR is less than {} dB above its threshold")
        words.append(f"hop {where} after hits in a row{gap}, {counts},{level}".rstrip(","))
    words.append(_unless_off(rule, "hop_every_s", f"hop {where} {{}} s after the last hop"))
    words.append(_unless_off(rule, "pause_s", "hop at most every {} s"))
    if rule["spread_beyond_m"] != OFF:
        blink = _unless_off(rule, "spread_s", " for {} s, then pause for 1 s,")
        since = _unless_off(rule, "spread_after_s", " from {} s after a hit")
        since += _unless_off(rule, "spread_until_s", " until {} s after a hit")
        level = _unless_off(rule, "spread_above_db", " while the SNR is {} dB above its threshold")
        words.append(f"spread{blink} beyond {rule['spread_beyond_m']} m{since}{level}")
    flees = "" if rule["fleeing"] == OFF else " while flying away"
    words.append(_unless_off(rule, "sprint_m", f"full speed within {{}} m{flees}"))
    words.append(_unless_off(rule, "cruise", "else speed {} between -1, the slowest, and 1"))
    return "; ".join(filter(None, words))


def _describe_opponent(rule: Mapping[str, Option]) -> str:
    known, blind, near = (
        JAMMING_TYPES[int(rule[name])] for name in ("known_type", "blind_type", "near_type")
    )
    order = "in turn at each of" if rule["random"] == OFF else "at one, drawn anew, of"
    blindly = f"{blind} {order} {rule['centres']} centres, {rule['centre_s']} s each"
    words = [f"{known} on the known point"]
    if rule["hold_s"] != OFF:
        words.append(f"{rule['hold_s']} s after a find, {blindly}")
    if rule["moved_hold_s"] != OFF:
        start = "" if rule["distrust"] == OFF else "from the start, and "
        last = "a check finds" if rule["finds"] == 1 else f"{rule['finds']} checks in a row find"
        words.append(
            f"{start}once a check has found the ally elsewhere, {blindly} from {rule['moved_hold_s']} s "
            f"after a find, until {last} it where it was"
        )
    words.append(_unless_off(rule, "misses", f"after a check that hears nothing, {blindly}"))
    words.append(_unless_off(rule, "near_m", f"{near} within {{}} m"))
    return "; ".join(filter(None, words))


def _unless_off(rule: Mapping[str, Option], name: str, words: str) -> str:
    return "" if rule[name] == OFF else words.format(rule[name])
