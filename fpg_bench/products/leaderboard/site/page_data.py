"""Data that the pages' scripts read, as JavaScript files, since nothing can be fetched from a disk.

Parts of the board for comparing entries, statistics and cross-play; rules and policies for playing.
"""

from __future__ import annotations

import base64
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ALLIES, OPPONENTS
from fpg_bench.common.rows import Row
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.players.agent import baselines_folder, read_card
from fpg_bench.players.onnx_file import MAX_NOISE, OPERATORS, OPSETS, plain_model, read_form
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.board import Board, BoardEntry, BoardSuite, BoardTrack, Figures
from fpg_bench.products.leaderboard.entries import Entries
from fpg_bench.products.leaderboard.site.dataset import dataset_files
from fpg_bench.products.leaderboard.site.views import (
    MEASURES,
    ROLES,
    crossplay_page,
    entry_page,
    format_rank,
    ordered_suites,
)
from fpg_bench.products.leaderboard.tracks import SCENARIOS, TRACKS
from fpg_bench.products.rendering.replay import scenario_data, script_json
from fpg_bench.products.sandbox.client import MOST_BYTES
from fpg_bench.products.sandbox.onnx_attributes import ATTRIBUTES, DEFAULTS, attributes_of

Policies = Mapping[tuple[str, str], Row]  # of submitted entries, by track and entry; see policy_data
Zoo = Mapping[str, tuple[Row, Row]]  # what is known of each agent, and its policy
_logger = logging.getLogger(__name__)


def data_files(board: Board, submitted: Policies) -> dict[str, str]:
    """Return the data files of the site.

    Args:
        board: the board.
        submitted: policies of submitted entries.
    """
    zoo = zoo_policies()
    crossplay = {
        f"data/{crossplay_page(scenario)}.js": _script(crossplay_data(board, scenario, submitted, zoo))
        for scenario in SCENARIOS
    }
    return {
        "board.json": board.to_json(),
        **dataset_files(board),
        **_compare_files(board),
        **crossplay,
        **_play_files(board, submitted, zoo),
    }


def _script(content: Row | None) -> str:
    return f"window.fpgData = {script_json(content)};\n"


def _compare_files(board: Board) -> dict[str, str]:
    """Return the data of the page that compares two entries: its own, a file per track, and one per entry."""
    shared: Row = {"measures": {name: asdict(measure) for name, measure in MEASURES.items()}}
    parts: dict[str, Row] = {}
    for track in board.tracks:
        parts[track.key] = _compared_track(track)
        for entry, figures in track.verified():
            parts[f"{track.key}/{entry.slug}"] = {
                suite.role: figures.units.get(suite.role) for suite in ordered_suites(track)
            }
    files = {
        f"data/compare/{name}.js": f"fpgCompared({script_json(name)}, {script_json(content)});\n"
        for name, content in parts.items()
    }
    return {"data/compare.js": _script(shared), **files}


def _compared_track(track: BoardTrack) -> Row:
    suites = ordered_suites(track)
    return {
        "ranked_by": track.ranked_by,
        "suites": [
            {"role": suite.role, **asdict(ROLES[suite.role]), "rivals": [*map(suite.label, suite.rivals)]}
            for suite in suites
        ],
        "rows": [_compared_entry(track, suites, entry, figures) for entry, figures in track.verified()],
        "student": track.student,
    }


def _compared_entry(
    track: BoardTrack, suites: Sequence[BoardSuite], entry: BoardEntry, figures: Figures
) -> Row:
    return {
        "slug": entry.slug,
        "name": entry.name,
        "page": entry_page(track, entry),
        "rank": format_rank(figures.rank),
        "kind": entry.kind,
        "algorithm": entry.about.algorithm,
        "authors": ", ".join(entry.about.authors),
        "score": _interval(figures.score),
        "gap": _rounded(figures.gap, 1),
        "scores": {suite.role: _interval(figures.scores.get(suite.role)) for suite in suites},
        "by_rival": {
            suite.role: [_interval(figures.by_rival.get(suite.role, {}).get(rival)) for rival in suite.rivals]
            for suite in suites
        },
        "measures": {name: _rounded(value, 4) for name, value in figures.measures.items()},
        "steps": None if entry.about.training is None else entry.about.training.steps,
    }


def _interval(score: Interval | None) -> list[float | None]:
    ends = (None,) * 3 if score is None else (score.value, score.low, score.high)
    return [_rounded(end, 1) for end in ends]


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or math.isnan(value) else round(value, digits)


def crossplay_data(board: Board, scenario: str, submitted: Policies, zoo: Zoo) -> Row | None:
    """Return the matrices of a scenario's cross-play and the players of a pair's round."""
    crossplay = board.crossplay.get(scenario)
    if crossplay is None:
        return None
    shown = {"ally": crossplay.allies, "opponent": crossplay.opponents}
    names = {side: board.names(side) for side in SIDES}
    matrices = {**crossplay.returns, "jamming_success_rate": crossplay.jamming_success_rate}
    return {
        "names": {side: {slug: names[side][slug] for slug in slugs} for side, slugs in shown.items()},
        "allies": crossplay.allies,
        "opponents": crossplay.opponents,
        "matrices": {name: _rounded_matrix(matrix) for name, matrix in matrices.items()},
        "half": {side: _rounded_matrix(matrix) for side, matrix in crossplay.half.items()},
        "rounds": crossplay.rounds,
        "nash": asdict(crossplay.nash),
        "game": scenario,
        "watch": _watched(board, scenario, submitted, zoo),
    }


def _rounded_matrix(matrix: Sequence[Sequence[float | None]]) -> list[list[float | None]]:
    return [[_rounded(value, 4) for value in row] for row in matrix]


def _watched(board: Board, scenario: str, submitted: Policies, zoo: Zoo) -> dict[str, dict[str, Row]]:
    """Return the player that represents an entry on the page, and its path, by side and entry."""
    watched: dict[str, dict[str, Row]] = {side: {} for side in SIDES}
    for track in board.tracks:
        is_played = track.side in SIDES and TRACKS[track.key].scenario == scenario
        for entry in track.entries if is_played else ():
            if player := _page_player(track, entry, submitted, zoo):
                path = "learned" if track.key.endswith("-learned") else "pursuit"
                watched[track.side][entry.slug] = {"player": player, "path": path}
    return watched


def _page_player(track: BoardTrack, entry: BoardEntry, submitted: Policies, zoo: Zoo) -> str | None:
    if (track.key, entry.slug) in submitted:
        return f"agent:{_submitted_file(track.key, entry.slug)}"
    if entry.kind == "script" and entry.plays in (*ALLIES, *OPPONENTS):
        return f"script:{entry.plays}"
    if entry.kind == "zoo" and entry.plays is not None and entry.plays in zoo:
        return f"agent:{agent_file(entry.plays)}"
    return None


def _play_files(board: Board, submitted: Policies, zoo: Zoo) -> dict[str, str]:
    """Return the data of the page on which a visitor plays, and a file per agent (its first seed)."""
    agents: list[tuple[Row, Row]] = []
    entries = {(track.key, entry.slug): (track, entry) for track in board.tracks for entry in track.entries}
    for (key, slug), policy in submitted.items():
        track, entry = entries[key, slug]
        game = TRACKS[key].scenario
        submission: Row = {"name": entry.name, "side": track.side, "flies": key.endswith("-learned")}
        submission |= {"game": game, "kind": "submitted", "file": _submitted_file(key, slug)}
        agents.append((submission, policy))
    for name, (about, policy) in zoo.items():
        agents.append(({"name": name, **about, "kind": "zoo", "file": agent_file(name)}, policy))
    games = {}
    for name in SCENARIOS:
        tracks = [t for t in board.tracks if t.side in SIDES and TRACKS[t.key].scenario == name]
        games[name] = {
            "rules": rules_data(preset(name)),
            "scenario": scenario_data(preset(name)),
            "leaders": _leaders(tracks, submitted, zoo),
            "scales": {TRACKS[track.key].path or track.side: asdict(track.scale) for track in tracks},
        }
    content = {"games": games, "agents": [about for about, _ in agents], "form": form_data()}
    files = {"data/play.js": _script(content)}
    for about, policy in agents:
        files[about["file"]] = f"fpgAgent({script_json(about['file'])}, {script_json(policy)});\n"
    return files


def _leaders(tracks: Sequence[BoardTrack], submitted: Policies, zoo: Zoo) -> dict[str, str]:
    """Return the best player of the first table of each side that the page can play."""
    first = {track.side: track for track in reversed(tracks)}
    return {
        side: player
        for side, track in first.items()
        for entry, _ in reversed(list(track.verified()))
        if (player := _page_player(track, entry, submitted, zoo))
    }


def agent_file(name: str) -> str:
    """Return the file of the site that holds the policy of an agent of the zoo."""
    return f"agents/{name.replace('/', '-')}.js"


def _submitted_file(key: str, slug: str) -> str:
    return f"agents/submitted/{key}/{slug}.js"


def zoo_policies() -> dict[str, tuple[Row, Row]]:
    """Return the zoo's agents that the page can play by name: what is known of each, and its policy."""
    folder = baselines_folder() / "agents"
    agents = {}
    for path in sorted(folder.glob("*/*/seed_0/policy.onnx")):
        name = path.parent.parent.relative_to(folder).as_posix()
        side, _, group = path.parts[-4].partition("-")
        if side in SIDES:  # the others are pairs of another scenario
            policy, game = policy_data(path.read_bytes()), "link" if group.startswith("link") else "standard"
            flies = side == "opponent" and read_card(path.parent).flies == "learned"
            agents[name] = {"side": side, "flies": flies, "game": game}, policy
    return agents


def rules_data(scenario: Scenario) -> Row:
    """Return the rules as the compiled game and the scripts read them; infinity (no cap) becomes None."""
    radio = radio_record(scenario)
    return _numbers(rules_record(scenario)) | {
        "radio": None if radio is None else _numbers(radio),
        "types": JAMMING_TYPES,
        "scripts": {
            name: getattr(scenario, f"script_{name}")
            for name in ("threat_db", "broadband_m", "comb_m", "sprint_m")
        },
    }


def _numbers(record: np.ndarray) -> Row:
    values = {name: record[0][name].tolist() for name in record.dtype.names or ()}
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }


def form_data() -> Row:
    """Return the form of a policy, as the page asks a visitor's file for it."""
    from fpg_bench.products.sandbox import onnx_checks

    return {
        "bytes": MOST_BYTES,
        "nodes": onnx_checks.MOST_NODES,
        "ends": onnx_checks.MOST_ENDS,
        "multiply_adds": onnx_checks.MOST_MULTIPLY_ADDS,
        "noise": MAX_NOISE,
        "opsets": [OPSETS[0], OPSETS[-1]],
        "operators": {name: ATTRIBUTES.get(name, "").split() for name in sorted(OPERATORS)},
        "defaults": DEFAULTS,
        "weights": onnx_checks.WEIGHTS,
        "lost": -100.0,  # the score of a lost round on a public suite
    }


def policy_data(model: bytes) -> Row:
    """Return a policy as a list of nodes and its weights.

    Args:
        model: the bytes of a ``policy.onnx``.

    Raises:
        UserError: not an ONNX file in the form of a policy.
    """
    from onnx import numpy_helper

    plain = plain_model(model)
    read_form(plain)
    sizes = {value.name: value.type.tensor_type.shape.dim[1].dim_value for value in plain.graph.input}
    return {
        "state": sizes.get("state", 0),
        "noise": sizes.get("noise", 0),
        "nodes": [_node(node) for node in plain.graph.node],
        "weights": {each.name: _weight(numpy_helper.to_array(each)) for each in plain.graph.initializer},
    }


def _node(node: Any) -> Row:
    from onnx import TensorProto, numpy_helper

    return {
        "op": node.op_type,
        "inputs": list(node.input),
        "outputs": list(node.output),
        "attributes": {
            name: _weight(numpy_helper.to_array(value)) if isinstance(value, TensorProto) else value
            for name, value in attributes_of(node).items()
        },
    }


def _weight(values: np.ndarray) -> Row:
    if values.dtype.kind in "ib":
        return {"shape": list(values.shape), "integers": values.astype(int).ravel().tolist()}
    floats = np.ascontiguousarray(values, "<f4").tobytes()
    return {"shape": list(values.shape), "floats": base64.b64encode(floats).decode()}


def submitted_policies(entries: Entries) -> dict[tuple[str, str], Row]:
    """Return the policies of verified, submitted entries that the page can play, by track and entry.

    The first training seed plays. One that the page cannot show is named in the log, and left out.
    """
    policies = {}
    for entry in entries.verified:
        if entry.submission.zoo is None and entry.submission.policies:
            try:
                policies[entry.key] = policy_data(entry.submission.policies[0].model)
            except UserError as error:
                _logger.warning(f"{'/'.join(entry.key)}: its policy is not on the page of games: {error}")
    return policies
