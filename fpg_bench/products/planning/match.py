"""A match of one planner: played round by round into a file, and replayed from it."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fpg_bench.common.differences import first_difference
from fpg_bench.common.errors import UserError, shown
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.products import load
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.envs.two_player import PlannerSpec, TwoPlayerBatch
from fpg_bench.evaluation.record import LATER_TALLIES
from fpg_bench.evaluation.rounds import begin_round, finish_round, make_match
from fpg_bench.game.batch import check_seeds
from fpg_bench.game.metrics import measures
from fpg_bench.game.recording import Recording
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.state import TALLY
from fpg_bench.players.planner import Planner, as_planner, asks_language_model
from fpg_bench.players.player import SIDES, Player, PlayerSpec
from fpg_bench.players.registry import as_player, player_name
from fpg_bench.players.remote import pinned
from fpg_bench.version import versions

ROUNDS = 10


@dataclass(frozen=True)
class Round:
    """Round of a match: its row of the file, its steps, and the exchange with a language model.

    Attributes:
        row: its row of the file.
        recording: its steps.
        talk: the attempts of a language model at its plan, each a
            :class:`fpg_bench.products.language_models.transcript.Attempt`; empty for other planners.
        problem: the reason that a language model gave no valid path for it; None if it did.
    """

    row: Row
    recording: Recording
    talk: tuple[Any, ...]
    problem: str | None

    @property
    def measures(self) -> dict[str, float | None]:
        """The standard measures, by the names of :func:`fpg_bench.game.metrics.measures`."""
        return measures(self.row, np.array([self.row["ally_points"], self.row["jam_points"]]))

    @property
    def reward_per_step(self) -> float:
        """The opponent's mean reward."""
        return float(self.row["opponent_return"] / self.row["steps"])


Progress = Callable[[int, Round | None], Any]


def run_match(
    planner: PlannerSpec = "interceptor",
    ally: PlayerSpec = "expert",
    opponent: PlayerSpec = "adaptive",
    *,
    seed: int = 0,
    out: str | Path | None = None,
    llm: Mapping[str, Any] = MappingProxyType({}),
    progress: Progress = lambda index, played: None,
    scenario: Scenario | str | None = None,
    rounds: int = ROUNDS,
) -> list[Round]:
    """Play one match of a planner, or resume one that was stopped.

    Args:
        planner: the opponent's planner, by the grammar of :func:`fpg_bench.players.planner.as_planner`.
        ally, opponent: players, by the grammar of :func:`fpg_bench.players.registry.as_player`.
        seed: seed of the match, a whole number in [0, 2^63).
        out: file of the match, JSON lines; None: it is not kept.
        llm: options of the planner ``llm``, by name.
        progress: called with a round's index and None before it is planned, and with the round after it.
        scenario: a :class:`Scenario`, a preset's name or a YAML file; None: ``standard``.
        rounds: number of rounds of the match.

    Returns:
        The rounds. Those in the file are simulated again and compared with it; no language model is asked
        for them, since its answers are read from the file.

    Raises:
        UserError: an unknown planner, player or scenario, a file that holds another match, or rounds whose
            results differ from the file's.
        OSError: the file cannot be written; what it holds is kept.
    """
    played = as_scenario(scenario, opponent_path="waypoints", rounds_per_match=rounds)
    path = None if out is None else Path(out)
    ally, opponent = pinned(ally), pinned(opponent)
    sides = {"ally": ally, "opponent": opponent}
    players = {side: as_player(spec, side, played) for side, spec in sides.items()}
    seed = int(check_seeds(seed, 1)[0])
    flier, description = _planner(planner, played, path, llm)
    name = planner if isinstance(planner, str) and description is None else flier.name
    match = Match(name, player_name(ally), player_name(opponent), played, seed, description)
    if path is None:
        return list(_rounds(match, flier, players, None, [], progress))
    file = MatchFile(path)
    with file.locked(), contextlib.ExitStack() as stack:
        if (transcript := _transcript(flier)) is not None:
            stack.callback(transcript.close)
        return list(_rounds(match, flier, players, file, file.begin(match), progress))


def replay_match(path: str | Path, *, allow: Collection[str] = ()) -> tuple[Match, list[Round]]:
    """Replay a match from its file and check that every step is the same; no language model is asked.

    Args:
        path: the file.
        allow: the ``package.module:object`` and agents of the Hub that the file may name; neither is run on a
            file's word.

    Raises:
        UserError: not the file of a match, one that names a player which is not allowed, or a round or an
            attempt that is missing or was changed; the message names it.
    """
    file = MatchFile(Path(path))
    match, rows = file.read()
    check_allowed((match.planner, match.ally, match.opponent), allow, f"match {path}")
    if asks_language_model(match.planner):
        planner = load("language model", "of a match's file")(match, file.path)
    else:
        planner = as_planner(match.planner, match.scenario)
    players = {side: as_player(getattr(match, side), side, match.scenario) for side in SIDES}
    return match, list(_rounds(match, planner, players, file, rows))


def _rounds(
    match: Match,
    planner: Planner,
    players: Mapping[str, Player],
    file: MatchFile | None,
    known: Sequence[Row],
    progress: Progress = lambda index, played: None,
) -> Iterator[Round]:
    """Play the match; rounds that the file holds are checked, the others added."""
    batch = make_match(TwoPlayerBatch(match.scenario, 1, planner), players["ally"], players["opponent"])
    for index in range(match.rounds):
        progress(index, None)
        begin_round(batch, seeds=match.seed if index == 0 else None)
        recording = Recording(batch.duel.batch)
        finish_round(batch, on_step=recording.add)
        row = _row(batch.duel, recording)
        if file is not None and index < len(known):
            file.check(known[index], row)
            row = known[index]
        elif file is not None:
            file.add(row)
        plan = batch.duel.plans[0]
        problem = None if plan is None else plan.problem
        played = Round(row, recording, _talk(planner, row), problem)
        progress(index, played)
        yield played


def _talk(planner: Planner, row: Row) -> tuple[Any, ...]:
    """Return the exchange with a language model for a round; empty for other planners."""
    if (transcript := _transcript(planner)) is None:
        return ()
    place = (row["seed"], row["match"], row["round"])
    return tuple(attempt for attempt in transcript.attempts() if attempt.where[:3] == place)


def _transcript(planner: Planner) -> Any:
    """Return the transcript of a planner that asks a language model; None for other planners."""
    return getattr(planner, "transcript", None) if asks_language_model(planner) else None


def _row(duel: TwoPlayerBatch, recording: Recording) -> Row:
    """Return a round's row: the plan, its results, and a hash of every step."""
    plan = duel.plans[0]
    assert plan is not None
    row: Row = {"kind": ROUND, "seed": recording.seed, "match": recording.match, "round": recording.round}
    row |= {"source": plan.source, "status": plan.status, "tokens": plan.tokens, "seconds": plan.seconds}
    row["waypoints"] = duel.batch.waypoints[0].tolist()
    row |= dict(zip(TALLY.names or (), duel.batch.tallies[0].item(), strict=True))
    row["ally_points"], row["jam_points"] = duel.batch.histograms[0].tolist()
    row["steps_sha256"] = hashlib.sha256(recording.frames.tobytes()).hexdigest()
    return row


RUN, ROUND = "run", "round"
_HEADER = {"planner": str, "ally": str, "opponent": str, "seed": int, "scenario": dict, "scenario_hash": str}
_UNTIMED = "seconds"  # key of the planning time, which a replay does not repeat


@dataclass(frozen=True)
class Match:
    """Everything that decides the course of a match.

    Attributes:
        planner, ally, opponent: names of planner and players.
        scenario: what is played; it has the number of rounds.
        seed: of the match.
        llm: model, server, prompt and control of a planner that asks a language model, else None.
    """

    planner: str
    ally: str
    opponent: str
    scenario: Scenario
    seed: int
    llm: JsonObject | None

    @property
    def rounds(self) -> int:
        """Number of rounds of the match."""
        return self.scenario.rounds_per_match

    def row(self) -> Row:
        """Return the file's first row."""
        scenario = dataclasses.asdict(self.scenario)
        row: Row = {"kind": RUN, "planner": self.planner, "ally": self.ally, "opponent": self.opponent}
        row |= {"seed": self.seed, "rounds": self.rounds, "llm": self.llm, "versions": versions()}
        row |= {"scenario": scenario, "scenario_hash": self.scenario.hash}
        return _as_written(row)


class MatchFile:
    """The file of one match: its header, its rounds, and the rows that a planner adds.

    Args:
        path: the file; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = RowFile(path)
        self.locked = self._file.locked
        self._versions = ""  # the first version that differs from the file's

    def begin(self, match: Match) -> list[Row]:
        """Write the header, or check that it is that of the match; return the rounds in the file.

        A file without rounds is begun anew, whatever its header.

        Raises:
            UserError: the file holds something else; the first difference is named.
        """
        rows = self._file.read()
        if not rows:
            self._file.append([match.row()])
            return []
        known = self._header(rows)
        if len(rows) == 1:  # nothing was played: a language model that could not be asked, for one
            self.path.write_bytes(b"")
            self._file.append([match.row()])
            return []
        difference = _difference(known, match.row(), but="versions")
        if difference:
            raise UserError(f"match {self.path}: is another match, {difference}; name another file or folder")
        return self._rounds(rows)

    def read(self) -> tuple[Match, list[Row]]:
        """Return the match and all its rounds.

        Raises:
            UserError: not the file of a match, or a round is missing; the message names it.
        """
        if self.path.is_dir():
            raise UserError(f"match {self.path}: is a folder; name its match.jsonl")
        if not self.path.is_file():
            raise UserError(f"match {self.path}: no such file; plan run writes one")
        rows = self._file.read()
        match, rounds = self._match(self._header(rows)), self._rounds(rows)
        if len(rounds) < match.rounds:
            raise UserError(
                f"match {self.path}: round {len(rounds)} is missing, or its line was cut off; the same "
                "plan run again resumes it"
            )
        return match, rounds

    def add(self, row: Row) -> None:
        """Append a round."""
        self._file.append([row])

    def check(self, known: Row, played: Row) -> None:
        """Raise UserError, with the first difference, if a round was not played as the file has it."""
        played = {key: played[key] for key in played if key in known or key not in LATER_TALLIES}
        difference = _difference(known, _as_written(played), but=_UNTIMED)
        if not isinstance(known.get(_UNTIMED), int | float):
            difference = difference or f"{_UNTIMED} is {known.get(_UNTIMED)!r}"
        if lacking := played.keys() - known.keys():
            difference = difference or f"{min(lacking)} is missing"
        if difference:
            raise UserError(
                f"match {self.path}: round {played['round']} differs: {difference}{self._versions}"
            )

    def _header(self, rows: list[Row]) -> Row:
        head = rows[0] if rows else {}
        if head.get("kind") != RUN or any(
            not isinstance(head.get(key), kind) for key, kind in _HEADER.items()
        ):
            raise UserError(f"match {self.path}: holds no match; name a file that plan run has written")
        other = _difference(head.get("versions"), versions(), "versions")
        self._versions = f"; {other}" if other else ""
        return head

    def _match(self, head: Row) -> Match:
        try:
            scenario = Scenario(**head["scenario"])
        except (TypeError, UserError) as error:
            raise UserError(f"match {self.path}: its scenario cannot be played: {error}") from error
        if (scenario.hash, scenario.rounds_per_match) != (head["scenario_hash"], head.get("rounds")):
            raise UserError(f"match {self.path}: its scenario is not the one it was played in")
        named = {key: head[key] for key in ("planner", "ally", "opponent", "seed")}
        return Match(scenario=scenario, llm=head.get("llm"), **named)

    def _rounds(self, rows: list[Row]) -> list[Row]:
        """Return the rows of the rounds, in order from round 0."""
        rounds = [row for row in rows if row.get("kind") == ROUND]
        for index, row in enumerate(rounds):
            if (number := row.get("round")) != index:
                raise UserError(
                    f"match {self.path}: round {index} is missing; round {number} is in its place"
                )
        return rounds


def _as_written(row: Row) -> Row:
    """Return a row as a file gives it back, with lists for tuples."""
    return dict(json.loads(json.dumps(row)))


def _difference(known: object, now: object, where: str = "", but: str = "") -> str:
    """Describe the first value of the file that differs from the present one; empty if none does."""
    found = first_difference(now, known, where, (but,))
    return "" if found is None else f"{found[0]} is {shown(found[2])} in the file, {shown(found[1])} now"


def _planner(
    spec: PlannerSpec, scenario: Scenario, path: Path | None, llm: Mapping[str, Any]
) -> tuple[Planner, JsonObject | None]:
    """Return a match's planner, and the description of its language model for the file, if it asks one.

    ``path``, the match's file, is the language model's transcript, too.
    """
    if isinstance(spec, str) and asks_language_model(spec):
        flier, described = load("language model", "of a match")(spec, scenario, path, llm)
        return flier, described
    if given := next(iter(llm), None):
        raise UserError(f"{given}: is for the planner 'llm', not for {spec!r}")
    planner = as_planner(spec, scenario)
    if path is not None and asks_language_model(planner.name):
        raise UserError("planner: name it 'llm' and pass its options with it, so that the file describes it")
    return planner, None
