"""Tables 1 to 3: what the paper gives, what is in use in both scenarios, and what it leaves to us."""

from __future__ import annotations

import inspect
from typing import Any

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import PAPER, STANDARD, Scenario
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.paper.experiment import ALGORITHM, BUDGETS, Budget, hyperparameters
from fpg_bench.training.algorithms import find_algorithm

Table = tuple[str, list[list[str]]]  # title, and lines of which the first holds the headings
_RULES = "docs/rules.md"


def tables(budget: Budget = BUDGETS["full"]) -> list[Table]:
    """The three tables, their lines made from the scenarios and hyper-parameters in use."""
    return [_jamming(), _environment(), _algorithm(budget)]


def _jamming() -> Table:
    lines = [["jamming type", "k in the paper", "k in use (both)", "half width (MHz), ours", "why"]]
    given = ("1.5", "1.2", "0.4", "0.8")
    reasons = (
        "Eq. 7 is a line; half an ally's bandwidth makes it hit one frequency point",
        "Eq. 8 leaves B open; three points",
        "Eq. 9 leaves the band open; half of it",
        "Eq. 10 leaves the spacing open; every fourth point, each tooth as wide as a tone",
    )
    for index, kind in enumerate(JAMMING_TYPES):
        width = PAPER.footprint_half_widths_mhz[index]
        lines.append(
            [kind, given[index], f"{PAPER.jamming_coefficients[index]:g}", f"{width:g}", reasons[index]]
        )
    return "Table 1: jamming types", lines


def _environment() -> Table:
    lines = [
        ["parameter", "the paper", "paper scenario", "standard scenario", "what was open, and our choice"]
    ]

    def line(name: str, given: str, field: str, why: str = "") -> None:
        lines.append([name, given, *(_shown(scenario, field) for scenario in (PAPER, STANDARD)), why])

    line("bandwidth (MHz)", "5", "bandwidth_mhz")
    line(
        "bandwidth while spreading (MHz)",
        "2400",
        "spread_bandwidth_mhz",
        "far wider than the band of 100; enters the noise alone",
    )
    line(
        "noise density (dBm/Hz)",
        "-170 dBm",
        "noise_density_dbm_hz",
        "read as a density: times the bandwidth in use",
    )
    line("checks every (s)", "5", "check_interval_s", "standard hides when the next one comes")
    line("opponent's speed (m/s)", "10", "opponent_speed_m_s")
    line("ally's speed (m/s)", "10", "ally_speed_m_s", "the ally controls its velocity, so a range")
    line("P_base (dBm)", "45", "base_power_dbm")
    line("P_opponent (dBm)", "20", "opponent_power_dbm", "k multiplies the dBm value, as printed")
    line("M (dB)", "8", "snr_threshold_db")
    line("SNR", "Eq. 2 and 3", "snr_model", "the paper counts interference twice; standard once")
    line("detection", "SNR of the ally at least M", "detection", "standard: by the opponent's own receiver")
    line("H", "not given", "hop_cost", "hopping pays against a jammer in reach, not always")
    line("E", "not given", "distance_reward")
    line("alpha", "not given", "snr_drop_weight")
    line("fading (dB)", "Gaussian noise", "fading_sd_db", "how much is not given")
    line("SNR that rewards count (dB)", "all", "snr_cap_db", "standard: a link gains nothing above it")
    line("steps of a round", "not given", "steps_per_round", "10^7 steps over the 10^5 of the figures")
    line(
        "ally's path",
        "a Bezier curve",
        "ally_path_m",
        "the paper's control points are not given; standard draws them",
    )
    return "Table 2: the environment", lines


def _algorithm(budget: Budget) -> Table:
    defaults = inspect.signature(find_algorithm(ALGORITHM).kind).parameters
    used = {name: spec.default for name, spec in defaults.items()} | hyperparameters(budget).algorithm
    network = " x ".join(map(str, used["policy_kwargs"]["net_arch"]))
    penalty = f"{used['logit_penalty']} beyond {used['logit_limit']}"
    every = f"{budget.train_freq * budget.games} steps"
    lines = [
        ["parameter", "the paper", "in use", "what was open, and our choice"],
        ["discount factor", "0.99", str(used["gamma"]), ""],
        ["steps", "10^7", f"{budget.steps:,}", f"a tenth at most; {budget.updates():,} updates"],
        ["batch size", "32", str(used["batch_size"]), ""],
        ["learning rate", "0.001", str(used["learning_rate"]), ""],
        ["buffer capacity", "10^6", f"{used['buffer_size']:,}", ""],
        ["state dimension", "15", str(OBSERVATION_SIZE), f"which numbers is not given; {_RULES}, section 8"],
        ["action dimension", "9", str(ACTION_SIZE), f"which numbers is not given; {_RULES}, section 7"],
        ["max action value", "5", "1", "actions are in [-1, 1]; a scale of 5 has no meaning in the rules"],
        ["loss function", "MSE", "MSE", ""],
        ["networks", "not given", network, "both sides', actors and critics"],
        ["tau", "not given", str(used["tau"]), ""],
        ["exploration noise", "normal, sigma not given", str(used["noise_sd"]), "on actions in [-1, 1]"],
        ["reward scale", "not given", str(used["reward_scale"]), "rewards reach 70 a step"],
        ["logit penalty", "not given", penalty, "against actions stuck at their bounds"],
        ["random steps first", "not given", f"{used['learning_starts']:,}", ""],
        ["games at once", "1", str(budget.games), f"{budget.gradient_steps} updates every {every}"],
    ]
    return "Table 3: MADDPG", lines


def _shown(scenario: Scenario, field: str) -> str:
    value: Any = getattr(scenario, field)
    if field == "ally_path_m":
        return "drawn per match" if value is None else "one, fixed"
    if isinstance(value, tuple):
        return " to ".join(f"{each:g}" for each in dict.fromkeys(value))
    return "all" if value is None else f"{value:g}" if isinstance(value, int | float) else str(value)
