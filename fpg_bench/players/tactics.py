"""Scripts with adjustable constants, so that a search can find the worst rival of a family.

Most of them remember earlier steps of the round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import ALL_TACTICS, TACTICS
from fpg_bench.game import rng as draws
from fpg_bench.game.actions import HOP_GATE, KNOWLEDGE_GATE, PREFERENCE, SPEED, SPREAD_GATE
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import log
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    JAM_CENTRE,
    JAM_TYPE,
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    OWN_POSITION,
    SENSED_COVERS,
    SENSED_TYPE,
    SNR,
    SPREADING_TIME,
)
from fpg_bench.game.state import ACTION_SIZE, TYPES, Record
from fpg_bench.players.player import Memory, Prediction
from fpg_bench.players.scripted import (
    BROADBAND,
    COMB,
    NARROWBAND,
    TONE,
    WATCHFUL,
    ally_speed,
    away_m,
    draw,
    fitting_type,
    fly_at_ally,
    jam,
    js_db,
    scenario_scales,
    separation_m,
)
from fpg_bench.players.seeded import SeededPolicy, fresh_memory

SULK, BY_TYPE, EVIDENCE, CLOCK, RANGE = range(len(ALL_TACTICS["ally"]))
SCAN, ALTERNATE, GUARD, HERD, HUNTER, SPLIT = range(len(ALL_TACTICS["opponent"]))
SPRINT_M, CRUISE_M_S = 250.0, 10.0  # of an ally that keeps its range

ALLY_MEMORY = np.dtype(
    [
        ("step", "i8"),
        ("hops", "i8"),  # in a row that ended no outage
        ("until", "i8"),  # the step until which it stays
        ("evidence", "f8"),  # that the opponent knows its point: minus the log of the chance of blind hits
        ("level", "f8"),  # of evidence at which it hops; 0 where none has been drawn
        ("hits", "i8"),  # in a row
        ("since", "i8"),  # steps since the first of the last hits in a row
        ("place", "f8", (3,)),  # its position as it is seen
    ]
)
OPPONENT_MEMORY = np.dtype(
    [
        ("step", "i8"),
        ("moves", "i8"),  # how often a check found the ally elsewhere than it was jammed
        ("since", "i8"),  # steps since a check last found the ally
        ("known", "f8"),  # where it was found, as it is seen
        ("is_elsewhere", "?"),  # whether that was elsewhere than the time before
    ]
)


@dataclass(frozen=True)
class Constant:
    """A constant of a script, with the least and the greatest value that it may take."""

    default: float
    low: float
    high: float
    is_whole: bool = False


def constants(name: str, scenario: Scenario) -> dict[str, Constant]:
    """Return the constants of a script, in the order in which its rule reads them."""
    threat = Constant(scenario.script_threat_db, -10, 60)
    centres, hold = Constant(2, 1, 15, True), Constant(1, 1, 10, True)
    # One in so many blind hits by each type is on the ally's point: of 15 points a tone covers 1, narrowband
    # 3, broadband half of them, and a comb 4.
    evidence = {
        "tone": Constant(15, 1, 100),
        "narrowband": Constant(5, 1, 100),
        "broadband": Constant(2, 1, 100),
        "comb": Constant(3.75, 1, 100),
        "least": Constant(1, 0, 20),
        "most": Constant(5, 0, 20),
        "spread_beyond_m": Constant(110, 0, 5000),
        "spread_s": Constant(5, 0, 60, True),
    }
    known = {
        "sulk": {
            "below_db": Constant(scenario.snr_threshold_db, -10, 60),
            "patience_hops": Constant(3, 1, 20, True),
            "rest_s": Constant(30, 1, 300, True),
        },
        "by-type": {"spread_below_db": threat, "hop_below_db": threat},
        "scan": {
            "type": Constant(NARROWBAND, 0, TYPES - 1, True),
            "centres": replace(centres, default=5),
            "hold_s": hold,
        },
        "alternate": {"type": Constant(BROADBAND, 0, TYPES - 1, True), "centres": centres, "hold_s": hold},
        "guard": {
            "comb_m": Constant(89, 0, 1000),
            "beside_mhz": Constant(14, -50, 50),
            "points": Constant(3, 1, 15, True),
        },
        "evidence": evidence,
        "clock": evidence
        | {
            "most": Constant(2, 0, 20),
            "spread_s": Constant(3, 0, 60, True),
            "spread_from_s": Constant(3, 1, 60, True),
            "spread_to_s": Constant(6, 0, 60, True),
        },
        "range": {
            "js_db": Constant(-7, -60, 60),
            "sprint_m": Constant(SPRINT_M, 0, 5000),
            "cruise_m_s": Constant(CRUISE_M_S, 0, 30),
        },
        "hunter": {
            "type": Constant(NARROWBAND, 0, TYPES - 1, True),
            "hold_s": replace(hold, default=2),
            "blind_type": Constant(BROADBAND, 0, TYPES - 1, True),
            "centres": centres,
        },
    }
    known["herd"] = known["alternate"] | {"moves": Constant(2, 1, 20, True)}
    known["split"] = known["hunter"] | {"hold_s": hold}
    return known[name]


def draw_variants(
    side: str, count: int, scenario: Scenario, seed: int = 0, names: Sequence[str] | None = None
) -> list[str]:
    """Return the names of ``count`` scripts of a side with random constants, each script in turn.

    By default they are those of ``all-scripted``, so that a seed draws the same as ever.
    """
    rng, names = np.random.default_rng(seed), TACTICS[side] if names is None else names
    variants = []
    for name in (names[i % len(names)] for i in range(count)):
        values = {
            key: rng.integers(int(each.low), int(each.high) + 1)
            if each.is_whole
            else rng.uniform(each.low, each.high)
            for key, each in constants(name, scenario).items()
        }
        variants.append(f"{name}({', '.join(f'{key}={value:.4g}' for key, value in values.items())})")
    return variants


@compiled
def play_ally(
    kind: int,
    observations: np.ndarray,
    actions: np.ndarray,
    memory: np.ndarray,
    keys: np.ndarray,
    scales_array: np.ndarray,
    constant: np.ndarray,
) -> None:
    """Fill the actions of an ally.

    Sulk and by-type hop by the knowledge base, the others to a random point. ``memory`` (n,) is of dtype
    ``ALLY_MEMORY``.
    """
    scales = scales_array[0]
    for i in range(observations.shape[0]):
        seen, action = observations[i], actions[i]
        of = memory[i]
        step = of.step
        snr = seen[SNR] * scales.snr_db
        hop, spread, is_random = False, False, kind in (EVIDENCE, CLOCK)
        if is_random:
            hop = _is_known(of, seen, constant, draw(keys, i, step, 0))
            spread = seen[SPREADING_TIME] * scales.spreading_s < constant[7] - 0.5
            if kind == CLOCK and of.since <= constant[9]:
                spread = of.since >= constant[8]
            spread = spread and separation_m(seen, scales) > constant[6]
        elif kind == RANGE:
            spread = js_db(seen, scales) >= constant[0]
        elif kind == SULK:
            if snr >= constant[0]:
                of.hops = 0
            elif step >= of.until and of.hops >= constant[1]:
                of.hops, of.until = 0, step + int(constant[2])
            elif step >= of.until:
                hop = True
                of.hops += 1
        elif seen[SENSED_COVERS] > 0.0:
            tone = seen[SENSED_TYPE + TONE] > 0.0
            spread = tone and (snr < constant[0] or seen[SPREADING_TIME] > 0.0)
            hop = snr < constant[1] and not tone
        action[:] = 0.0
        action[HOP_GATE] = 1.0 if hop else -1.0
        action[SPREAD_GATE] = 1.0 if spread else -1.0
        action[SPEED] = ally_speed(seen, scales)
        if kind == RANGE:
            action[SPEED] = range_speed(of, seen, constant[1], constant[2], scales)
        action[KNOWLEDGE_GATE] = -1.0 if is_random else action[HOP_GATE]
        if is_random:
            action[PREFERENCE] = draw(keys, i, step, 3)
        of.step += 1


@compiled
def range_speed(of: Record, seen: np.ndarray, sprint_m: float, cruise_m_s: float, scales: Record) -> float:
    """Return the speed of an ally that sprints while it is near the opponent and flies away from it."""
    along = 0.0
    for axis in range(3):
        place = seen[OWN_POSITION + axis] * scales.box_m[axis]
        along += (place - of.place[axis]) * away_m(seen, scales, axis)
        of.place[axis] = place
    if (of.step == 0 or along < 0.0) and separation_m(seen, scales) < sprint_m:
        return 1.0
    low, high = scales.speeds_m_s[0], scales.speeds_m_s[1]
    speed: float = 2.0 * (cruise_m_s - low) / (high - low) - 1.0
    return speed


@compiled
def _is_known(of: Record, seen: np.ndarray, constant: np.ndarray, drawn: float) -> bool:
    """Count the evidence that the opponent knows the ally's point; returns True once it is at its level.

    A hit is a step in which the sensed jamming covers the ally. The level is then drawn anew by ``drawn``, a
    uniform number in [-1, 1].
    """
    if of.step == 0:
        of.level = constant[4] + (constant[5] - constant[4]) * (drawn + 1.0) / 2.0
    of.since += 1
    if seen[SENSED_COVERS] <= 0.0:
        of.hits, of.evidence = 0, 0.0
        return False
    of.hits += 1
    if of.hits == 1:
        of.since = 0
    for kind in range(TYPES):
        if seen[SENSED_TYPE + kind] > 0.0:
            of.evidence += log(constant[kind])
    if of.evidence < of.level:
        return False
    of.hits, of.evidence = 0, 0.0
    of.level = constant[4] + (constant[5] - constant[4]) * (drawn + 1.0) / 2.0
    return True


@compiled
def play_opponent(
    kind: int,
    observations: np.ndarray,
    actions: np.ndarray,
    memory: np.ndarray,
    keys: np.ndarray,
    scales_array: np.ndarray,
    constant: np.ndarray,
) -> None:
    """Fill the actions of an opponent, which flies at the ally.

    ``memory`` (n,) is of dtype ``OPPONENT_MEMORY``.
    """
    scales = scales_array[0]
    for i in range(observations.shape[0]):
        seen, action = observations[i], actions[i]
        of = memory[i]
        step = of.step
        distance = fly_at_ally(seen, action, scales)
        checked = seen[KNOWN_AGE] <= 0.0
        if checked and seen[JAM_TYPE : JAM_TYPE + TYPES].any() and seen[JAM_CENTRE] != seen[KNOWN_FREQUENCY]:
            of.moves += 1
        of.since = 0 if checked else of.since + 1
        if checked:
            of.is_elsewhere = step > 0 and seen[KNOWN_FREQUENCY] != of.known
            of.known = seen[KNOWN_FREQUENCY]
        tuning, in_band = 0.0, False
        if kind == GUARD and distance < constant[0]:
            turn = step % int(constant[2]) - (constant[2] - 1.0) / 2.0
            jamming_type, tuning = COMB, turn * scales.point_spacing_mhz / scales.tuning_span_mhz
        elif kind == GUARD:
            jamming_type, tuning = NARROWBAND, constant[1] / scales.tuning_span_mhz
        elif kind == HERD and of.moves < constant[3]:
            jamming_type = fitting_type(WATCHFUL, seen, distance, scales)
        elif kind >= HUNTER and (of.since < constant[1] or (kind == SPLIT and not of.is_elsewhere)):
            jamming_type = int(constant[0])
        elif kind >= HUNTER:
            turn = draws.integer(keys[i], step, draws.PLAYER_DRAW, int(constant[3]))
            jamming_type, in_band = int(constant[2]), True
            tuning = (2.0 * turn + 1.0) / constant[3] - 1.0
        else:
            turn = step // int(constant[2]) % int(constant[1])
            jamming_type, in_band = int(constant[0]), True
            tuning = (2.0 * turn + 1.0) / constant[1] - 1.0
        jam(action, jamming_type, tuning, in_band)
        of.step += 1


class Tactic(SeededPolicy):
    """A script with adjustable constants, compiled over a batch.

    Args:
        side: ``ally`` or ``opponent``.
        name: one of ``fpg_bench.common.ids.ALL_TACTICS[side]``.
        scenario: the rules, with the scales of observations.
        changes: constants in place of the default ones of :func:`constants`.

    Raises:
        UserError: the script has no such constant, or it may not take this value.
    """

    def __init__(self, side: str, name: str, scenario: Scenario, **changes: float) -> None:
        self.side, self.name = side, name
        self._kind = ALL_TACTICS[side].index(name)
        known = constants(name, scenario)
        for key, value in changes.items():
            if key not in known:
                raise UserError(f"{name}: no constant {key!r}{nearest(key, known)}")
            of = known[key]
            if not of.low <= value <= of.high or (of.is_whole and value % 1):
                kind = "a whole number" if of.is_whole else "a number"
                raise UserError(
                    f"{name}: {key}: expected {kind} from {of.low:g} to {of.high:g}, got {value:g}"
                )
        self._constants = np.array([changes.get(key, each.default) for key, each in known.items()], float)
        self._scales = scenario_scales(scenario)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        count, kind = len(seen), ALLY_MEMORY if self.side == "ally" else OPPONENT_MEMORY
        memory = fresh_memory(kind, count, state, starts)
        actions = np.empty((count, ACTION_SIZE), np.float32)
        seen = np.require(seen, np.float32, ("C", "A", "W"))
        if self.side == "ally":
            play_ally(self._kind, seen, actions, memory, self.keys(count), self._scales, self._constants)
        else:
            play_opponent(self._kind, seen, actions, memory, self.keys(count), self._scales, self._constants)
        return actions, memory

    def __repr__(self) -> str:
        return f"Tactic({self.side!r}, {self.name!r})"
