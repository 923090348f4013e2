"""What the page on which a visitor plays needs: the rules as numbers, and whom it can play, as graphs."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.files import read_json
from fpg_bench.game.rules import rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import RULES
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.site.shown import Row, ShownEntry, ShownTrack, read_tracks
from fpg_bench.leaderboard.site.wording import finite
from fpg_bench.pictures.replay import scenario_data, script_json
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.onnx_file import plain_model
from fpg_bench.players.player import SIDES
from fpg_bench.players.scripts import ALLIES, OPPONENTS

# Of static/game_policy.js.
OPERATORS = {"Gemm", "Tanh", "Relu", "Sigmoid", "Clip", "Slice", "Concat"}
OPERATORS |= {"Reshape", "Transpose", "Gather", "Unsqueeze", "Squeeze", "LSTM"}
Policies = Mapping[tuple[str, str], dict[str, Any]]  # of submitted entries, by track and entry
Zoo = dict[str, tuple[dict[str, Any], dict[str, Any]]]
# Of the zoo; all play the standard game, whatever they were trained on.
_GROUPS = ("champion", "population", "scripted", "pursuit", "learned", "planner")


def play_files(tracks: Sequence[ShownTrack], submitted: Policies, zoo: Zoo) -> dict[str, str]:
    """The files of the page on which a visitor plays: its data, and one of each agent's first seed.

    Args:
        tracks: of a board, whose scales a visitor's score is told on.
        submitted: policies of submitted entries, by track and entry; they stand beside the zoo's.
        zoo: what :func:`zoo_policies` gives.
    """
    policies = _rivals(tracks, submitted, zoo)
    agents = [about for about, _ in policies]
    scales = {track.key.removeprefix("opponent-"): _scale(track) for track in tracks}
    scenario = Scenario()
    content = {"rules": rules_data(scenario), "scenario": scenario_data(scenario)}
    files = {
        "data/play.js": f"window.fpgData = {script_json(content | {'agents': agents, 'scales': scales})};\n"
    }
    for about, policy in policies:
        files[about["file"]] = f"fpgAgent({script_json(about['file'])}, {script_json(policy)});\n"
    return files


def _rivals(
    tracks: Sequence[ShownTrack], submitted: Policies, zoo: Zoo
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """What is told of each trained player, and its policy: submitted entries, then the zoo."""
    entries = {(track.key, entry.slug): (track, entry) for track in tracks for entry in track.entries}
    found = []
    for (key, slug), policy in submitted.items():
        track, entry = entries[key, slug]
        flies = key.endswith("-learned")
        about = {"name": entry.name, "side": track.side, "flies": flies, "kind": "submitted"}
        found.append((about | {"file": submitted_file(key, slug)}, policy))
    for name, (told, policy) in zoo.items():
        found.append(({"name": name, **told, "kind": "zoo", "file": agent_file(name)}, policy))
    return found


def agent_file(name: str) -> str:
    """The site's file of a zoo agent, as ``ally-scripted/ppo``."""
    return f"agents/{name.replace('/', '-')}.js"


def submitted_file(key: str, slug: str) -> str:
    """The site's file of a submitted entry's policy."""
    return f"agents/submitted/{key}/{slug}.js"


def _scale(track: ShownTrack) -> dict[str, float] | None:
    """What scores 0 and 100, in returns a step; None where a board does not say."""
    told = track.scale if isinstance(track.scale, dict) else {}
    zero, top = (finite(told.get(end)) for end in ("zero", "top"))
    return None if zero is None or top is None else {"zero": zero, "top": top}


def zoo_policies() -> Zoo:
    """The zoo's agents that the page can play, by name: what is known of each, and its policy."""
    folder, found = baselines_folder() / "agents", {}
    for path in sorted(folder.glob("*/*/seed_0/policy.onnx")):
        name = path.parent.parent.relative_to(folder).as_posix()
        side, _, group = path.parts[-4].partition("-")
        policy = policy_data(path.read_bytes()) if side in SIDES and group in _GROUPS else None
        if policy is not None:
            about = read_json(path.parent / "agent.json", "agent")
            flies = "learned" in json.dumps(about.get("scenario_fields") or {})
            found[name] = {"side": side, "flies": side == "opponent" and flies}, policy
    return found


def rules_data(scenario: Scenario) -> dict[str, Any]:
    """The rules as the kernel reads them, ready for JSON; what is infinite (no cap of the SNR) is None."""
    record = rules_record(scenario)[0]
    return {name: _plain(record[name]) for name in RULES.names or ()}


def _plain(value: Any) -> Any:
    number = value.tolist()
    return None if isinstance(number, float) and not math.isfinite(number) else number


def policy_data(model: bytes) -> dict[str, Any] | None:
    """A policy as a list of nodes and its weights, ready for JSON; None where the page can't play it.

    Args:
        model: the bytes of a ``policy.onnx``.

    Raises:
        UserError: it is no ONNX file that this program plays.
    """
    from onnx import numpy_helper

    graph = plain_model(model).graph
    inputs = {one.name: one for one in graph.input}
    if "noise" in inputs or not {node.op_type for node in graph.node} <= OPERATORS:
        return None
    shape = inputs["state"].type.tensor_type.shape.dim if "state" in inputs else None
    return {
        "state": 0 if shape is None else shape[1].dim_value,
        "nodes": [_node(node) for node in graph.node],
        "weights": {one.name: _weight(numpy_helper.to_array(one)) for one in graph.initializer},
    }


def _node(node: Any) -> dict[str, Any]:
    from onnx.helper import get_attribute_value

    told = {one.name: get_attribute_value(one) for one in node.attribute}
    return {
        "op": node.op_type,
        "inputs": list(node.input),
        "outputs": list(node.output),
        "attributes": {
            name: value.decode() if isinstance(value, bytes) else value for name, value in told.items()
        },
    }


def _weight(values: np.ndarray) -> dict[str, Any]:
    if values.dtype.kind in "iu":
        return {"shape": list(values.shape), "whole": values.ravel().tolist()}
    floats = np.ascontiguousarray(values, "<f4").tobytes()
    return {"shape": list(values.shape), "floats": base64.b64encode(floats).decode()}


def submitted_policies(board: Row, folder: str | Path) -> dict[tuple[str, str], dict[str, Any]]:
    """The first training seed's policy of each verified, submitted entry that the page can play.

    Args:
        board: what :func:`fpg_bench.leaderboard.board.make_board` gives.
        folder: the leaderboard's, which holds the submissions.

    Returns:
        By track and entry, what :func:`policy_data` gives.
    """
    found = {}
    for track in read_tracks(board):
        for entry in track.entries:
            if track.side in SIDES and entry.verified and entry.kind == "submitted":
                policy = _first_policy(Path(folder) / "submissions" / str(track.side) / entry.slug)
                if policy is not None:
                    found[track.key, entry.slug] = policy
    return found


def _first_policy(home: Path) -> dict[str, Any] | None:
    try:
        policies = load_submission(home, contract=False).policies
        return policy_data(min(policies, key=lambda one: one.seed).model) if policies else None
    except UserError:
        return None  # submit verify says what is wrong


def watched(tracks: Sequence[ShownTrack], policies: Policies, zoo: Zoo) -> dict[str, dict[str, Row]]:
    """By side and entry, the player that stands for it on the page, and the path that it flies.

    Entries are left out that the page can't play.
    """
    found = {side: dict[str, Row]() for side in SIDES}
    for track in tracks:
        for entry in track.entries:
            player = _player(track, entry, policies, zoo)
            if track.side in SIDES and player is not None:
                path = "learned" if track.key.endswith("-learned") else "pursuit"
                found[track.side][entry.slug] = {"player": player, "path": path}
    return found


def _player(track: ShownTrack, entry: ShownEntry, policies: Policies, zoo: Zoo) -> str | None:
    plays = entry.row.get("plays")
    if (track.key, entry.slug) in policies:
        return f"agent:{submitted_file(track.key, entry.slug)}"
    if entry.kind == "script" and plays in (*ALLIES, *OPPONENTS):
        return f"script:{plays}"
    return f"agent:{agent_file(plays)}" if entry.kind == "zoo" and plays in zoo else None
