"""Self-contained HTML pages that replay rounds, with data and player in one file."""

from __future__ import annotations

import html
import importlib.resources
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.files import write_whole
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.rendering.recording import Recording

FORMAT = "fpg-replay/1"
_CODE = ("events", "pen", "arena", "times", "hands", "player")  # each uses those before it


def replay_data(
    recordings: Sequence[Recording], title: str, ally: str = "ally", opponent: str = "opponent"
) -> JsonObject:
    """Return the page's data, ready for JSON; lengths in m, frequencies in MHz, times in s, levels in dB.

    - ``format``: ``fpg-replay/1``; ``title``, ``ally``, ``opponent``: plain text.
    - ``scenario``: of :func:`scenario_data`.
    - ``rounds``: per round ``seed`` (text: it may exceed what JavaScript counts exactly), ``match``,
      ``round``, ``path``, ``control_points`` [4][3] of the ally's Bezier curve, ``waypoints`` [n][3] or
      null, and ``steps``: one list per field, entry k after k steps (entry 0 is the round's start):
      ``ally`` and ``opponent`` [3], ``frequency``, ``known``, ``age``, ``type`` (index into ``jamming``,
      -1: none), ``centre``, ``distance``, ``snr``, ``clean_snr``, ``spreading`` (seconds without a break),
      ``hopped`` and ``covered`` (0 or 1), ``check`` (1 heard, -1 not heard, 0 no check in this step),
      ``ally_reward``, ``opponent_reward``.
    """
    return {
        "format": FORMAT,
        "title": title,
        "ally": ally,
        "opponent": opponent,
        "scenario": scenario_data(recordings[0].scenario),
        "rounds": [_round_data(recording) for recording in recordings],
    }


def scenario_data(scenario: Scenario) -> JsonObject:
    """Return a scenario as pages draw it; ``spacing_mhz`` is that of a comb's teeth, 0: in one piece."""
    s = scenario
    comb = s.comb_spacing_points * s.point_spacing_mhz
    kinds = zip(JAMMING_TYPES, s.footprint_half_widths_mhz, s.jamming_coefficients, strict=True)
    return {
        "box_m": s.box_m,
        "base_station_m": s.base_station_m,
        "band_mhz": (s.band_low_mhz, s.band_high_mhz),
        "threshold_db": s.snr_threshold_db,
        "distance_reward_m": s.distance_reward_m,
        "jamming": [
            {
                "name": name,
                "half_width_mhz": half,
                "spacing_mhz": round(comb, 4) if name == "comb" else 0,
                "power_dbm": round(k * s.opponent_power_dbm, 3),
            }
            for name, half, k in kinds
        ],
    }


def _round_data(recording: Recording) -> JsonObject:
    waypoints = recording.waypoints
    return {
        "seed": str(recording.seed),
        "match": recording.match,
        "round": recording.round,
        "path": recording.path,
        "control_points": _rounded(recording.control_points, 1),
        "waypoints": None if waypoints is None else _rounded(waypoints, 1),
        "steps": _steps_data(recording.frames),
    }


def _steps_data(frames: np.ndarray) -> dict[str, list[Any]]:
    check = np.where(frames["checked"], frames["last_check"], 0)
    return {
        "ally": _rounded(frames["ally_position"], 1),
        "opponent": _rounded(frames["opponent_position"], 1),
        "frequency": _rounded(frames["frequency_mhz"], 2),
        "known": _rounded(frames["known_mhz"], 2),
        "age": frames["age_s"].tolist(),
        "type": frames["jamming_type"].tolist(),
        "centre": _rounded(frames["jamming_mhz"], 2),
        "distance": _rounded(frames["distance_m"], 1),
        "snr": _rounded(frames["snr_db"], 2),
        "clean_snr": _rounded(frames["clean_snr_db"], 2),
        "spreading": frames["spreading_s"].tolist(),
        "hopped": frames["hopped"].astype(int).tolist(),
        "covered": frames["covered"].astype(int).tolist(),
        "check": check.tolist(),
        "ally_reward": _rounded(frames["ally_reward"], 2),
        "opponent_reward": _rounded(frames["opponent_reward"], 2),
    }


def _rounded(values: np.ndarray, digits: int) -> list[Any]:
    return list(np.round(values, digits).tolist())


def replay_page(data: JsonObject) -> str:
    """Return the HTML page of :func:`replay_data`'s result; its texts cannot become markup or code."""
    parts = {"title": html.escape(data["title"]), "data": script_json(data)}
    parts |= {"css": replay_part("css"), "js": replay_part("js"), "player": replay_markup("h1")}
    template = _resource("replay.html")
    return re.sub("{{(title|data|css|js|player)}}", lambda mark: parts[mark[1]], template)


def script_json(content: object) -> str:
    """Return compact JSON in which no string can end a script element."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def replay_part(suffix: str) -> str:
    """Return the player's styles (``css``) or code (``js``), to be embedded in a page."""
    parts = _CODE if suffix == "js" else ("player",)
    return "".join(_resource(f"replay_{part}.{suffix}") for part in parts)


def replay_code(part: str) -> str:
    """Return one part of the player's code, for a page that needs only this part: ``events`` or ``pen``."""
    return _resource(f"replay_{part}.js")


def replay_markup(heading: str) -> str:
    """Return the player's markup; ``heading`` is the element of its title, such as ``h1``."""
    return _resource("replay_player.html").replace("{{heading}}", heading)


def _resource(name: str) -> str:
    return importlib.resources.files("fpg_bench.products.rendering").joinpath(name).read_text("utf-8")


def write_replay(
    recordings: Sequence[Recording],
    path: str | Path,
    title: str,
    ally: str = "ally",
    opponent: str = "opponent",
) -> None:
    """Write the replay of rounds of one scenario as one HTML file, atomically.

    Args:
        recordings: the rounds, at least one.
        path: the file; it is replaced.
        title: the page's heading.
        ally, opponent: names of the players.
    """
    write_whole(Path(path), replay_page(replay_data(recordings, title, ally, opponent)))
