"""One match of a planner: played round by round into a file, and repeated from that file."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.errors import UserError
from fpg_bench.game.arena import check_seeds
from fpg_bench.game.measures import measures
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.state import TALLY
from fpg_bench.matches.match_file import ROUND, Match, MatchFile
from fpg_bench.matches.match_planner import planner_of, replayed_planner
from fpg_bench.matches.rounds import Table, begin, play_round, seated
from fpg_bench.pictures.recording import Recording
from fpg_bench.players.naming import as_player, player_name
from fpg_bench.players.player import SIDES, Player
from fpg_bench.rows import Row

ROUNDS = 10


@dataclass(frozen=True)
class Round:
    """A round that was played: its line of the file, and its steps."""

    row: Row
    recording: Recording

    @property
    def measures(self) -> dict[str, float | None]:
        """The standard measures, by the names of :func:`fpg_bench.game.measures.measures`."""
        return measures(self.row, np.array([self.row["ally_points"], self.row["jam_points"]]))

    @property
    def reward_per_step(self) -> float:
        """The opponent's mean reward."""
        return self.row["opponent_return"] / self.row["steps"]


Progress = Callable[[int, Round | None], Any]


def run_match(
    planner: Any = "interceptor",
    ally: Any = "expert",
    opponent: Any = "adaptive",
    *,
    seed: int = 0,
    out: str | Path | None = None,
    llm: Mapping[str, Any] | None = None,
    progress: Progress = lambda index, played: None,
    **game: Any,
) -> list[Round]:
    """Play one match of a planner; a match that was stopped goes on where it was.

    Args:
        planner: who decides where the opponent flies, by the grammar of
            :func:`fpg_bench.planning.as_planner`.
        ally, opponent: players, by the grammar of :func:`fpg_bench.players.naming.as_player`.
        seed: of the match; a whole number in [0, 2^63).
        out: the file that keeps it, JSON lines that are only ever added to; None: it is not kept.
        llm: options of the planner ``llm`` (see :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`),
            and ``server``, the profile of its endpoint.
        progress: called with a round's index and None before it is planned, and with the round after it.
        **game: ``scenario``, a :class:`Scenario`, a preset's name or a YAML file (None: ``standard``), and
            ``rounds``, how many the match has.

    Returns:
        The rounds. Those that were in the file are played again, which costs nothing beside the planning
        of a language model: its answers are taken from the file.

    Raises:
        UserError: an unknown planner, player or scenario, a file that holds another match, or rounds that
            came to something else when they were first played.
        OSError: the file cannot be written; what it holds is kept.
    """
    played = _played(**game)
    path = None if out is None else Path(out)
    sides = {"ally": ally, "opponent": opponent}
    players = {side: as_player(spec, side, played) for side, spec in sides.items()}
    seed = int(check_seeds(seed, 1)[0])
    pilot, told = planner_of(planner, played, path, llm or {})
    name = planner if isinstance(planner, str) and told is None else pilot.name
    names = {side: player_name(spec) for side, spec in sides.items()}
    match = Match(name, **names, scenario=played, seed=seed, llm=told)
    if path is None:
        return list(_rounds(match, pilot, players, None, [], progress))
    file = MatchFile(path)
    with file.locked(), contextlib.closing(pilot.transcript) if told else contextlib.nullcontext():
        return list(_rounds(match, pilot, players, file, file.begin(match), progress))


def _played(scenario: Scenario | str | None = None, rounds: int = ROUNDS) -> Scenario:
    return as_scenario(scenario, opponent_path="waypoints", rounds_per_match=rounds)


def replay_match(
    path: str | Path,
    progress: Progress = lambda index, played: None,
    *,
    allow: Collection[str] = (),
) -> tuple[Match, list[Round]]:
    """Repeat a match from its file alone, without network, and check it to the bit.

    Args:
        path: the file.
        progress: see :func:`run_match`.
        allow: the ``package.module:object`` that the file may name; code is never run on a file's word.

    Raises:
        UserError: no file of a match, one that names code which is not allowed, or a round or an attempt
            that is missing or was changed, by name.
    """
    file = MatchFile(Path(path))
    match, rows = file.read()
    for name in (match.planner, match.ally, match.opponent):
        if ":" in name and name not in allow:
            raise UserError(f"match {path}: would run {name}; if you trust that code, add --allow {name}")
    planner = replayed_planner(match.planner, match.llm, match.scenario, file.path)
    players = {side: as_player(getattr(match, side), side, match.scenario) for side in SIDES}
    return match, list(_rounds(match, planner, players, file, rows, progress))


def _rounds(
    match: Match,
    planner: Any,
    players: Mapping[str, Player],
    file: MatchFile | None,
    known: Sequence[Row],
    progress: Progress,
) -> Iterator[Round]:
    """Play the match; rounds that the file holds are checked, the others added."""
    table = seated(Duel(match.scenario, 1, planner), **players)
    for index in range(match.rounds):
        progress(index, None)
        row, recording = _play(table, match.seed if index == 0 else None)
        if file is not None and index < len(known):
            file.check(known[index], row)
            row = known[index]
        elif file is not None:
            file.add(row)
        played = Round(row, recording)
        progress(index, played)
        yield played


def _play(table: Table, seed: int | None) -> tuple[Row, Recording]:
    begin(table, seeds=seed)
    recording = Recording(table.duel.arena)
    play_round(table, on_step=recording.add, begun=True)
    return _row(table.duel, recording), recording


def _row(duel: Duel, recording: Recording) -> Row:
    """A round's line: the plan, what it came to, and a hash of every step."""
    plan = duel.plans[0]
    assert plan is not None
    row: Row = {"kind": ROUND, "seed": recording.seed, "match": recording.match, "round": recording.round}
    row |= {"source": plan.source, "status": plan.status, "tokens": plan.tokens, "seconds": plan.seconds}
    row["waypoints"] = duel.arena.waypoints[0].tolist()
    row |= dict(zip(TALLY.names or (), duel.arena.tallies[0].item(), strict=True))
    row["ally_points"], row["jam_points"] = duel.arena.histograms[0].tolist()
    row["steps_sha256"] = hashlib.sha256(recording.frames.tobytes()).hexdigest()
    return row
