"""Play submissions: every policy in a process of its own, one record per rival."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.envs.two_player import PlannerSpec
from fpg_bench.evaluation.entry import EvaluatedPlayer, FixedPlayer, player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.store import RECORDS, EncounterStore, Pairing, R, Store
from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.player import PlayerSpec
from fpg_bench.products.language_models.comparison import replaying, transcript_file
from fpg_bench.products.leaderboard.folders import at_work, work_folder
from fpg_bench.products.leaderboard.submission import Submission
from fpg_bench.products.leaderboard.tracks import TrackSuites
from fpg_bench.products.leaderboard.transcripts import FOLDER, local, read_recording
from fpg_bench.products.sandbox import client
from fpg_bench.products.sandbox.client import Policy
from fpg_bench.products.sandbox.process import PolicyFailed, missing_here

NOTES = "notes.jsonl"  # in a part's folder, beside a folder for each suite
FAILED = "failed"  # key of a row that says why a part could not be finished
OPEN = "open"  # key of a row that names what the policy could not be kept from
_ROUNDS = 6  # against each rival of a smoke test

Matchup = tuple[Suite, Rival]
Key = tuple[str, str, str]  # of a matchup: the suite's name, its hash's first digits, the rival's name


@dataclass(frozen=True)
class Part:
    """Part of a submission that is played by itself.

    Attributes:
        slug: the submission's name.
        seed: the training seed; None for a script or transcripts.
        plays: a script's name, or a policy.
        shipped: true for a policy that the package ships.
        recorded: the submission's folder, if a language model's transcripts are replayed.
    """

    slug: str
    seed: int | None
    plays: str | Policy
    shipped: bool = False
    recorded: Path | None = None

    @property
    def name(self) -> str:
        """Name of the part in folders and messages."""
        return "script" if self.seed is None else f"seed_{self.seed}"

    @property
    def fingerprint(self) -> str:
        """Hash of the policy, or the script's name."""
        return self.plays if isinstance(self.plays, str) else self.plays.sha256

    def entry(self, player: PlayerSpec, suite: Suite) -> EvaluatedPlayer:
        """Return the part as an entry of a suite, played by a player."""
        if self.recorded is not None:
            return EvaluatedPlayer(self.slug, None, self.fingerprint, partial(_replay, self.recorded, suite))
        return EvaluatedPlayer(self.slug, self.seed, self.fingerprint, FixedPlayer(player))


def _replay(folder: Path, suite: Suite, ally: Rival) -> PlannerSpec:
    """Return the planner that replays a submission's transcript of the matches against an ally."""
    about, prompt = read_recording(folder, suite)
    return replaying(suite.scenario, prompt, about, transcript_file(folder / FOLDER, ally.name))


def parts_of(submission: Submission) -> list[Part]:
    """Return the parts of a submission, by training seed."""
    slug = submission.slug
    if submission.script is not None:
        return [Part(slug, None, submission.script)]
    if submission.is_recorded:
        return [Part(slug, None, "transcripts", recorded=submission.folder)]
    return [Part(slug, policy.seed, policy, submission.zoo is not None) for policy in submission.policies]


def suites_of(submission: Submission, suites: TrackSuites) -> Mapping[str, Suite]:
    """Return the suites that a submission plays, by role."""
    return suites.of(submission.board_track, transcripts=bool(submission.transcripts))


def key_of(suite: Suite, rival: Rival) -> Key:
    """Return the key of a matchup."""
    return suite.name, suite.hash[:16], rival.name


def matchups_of(suites: Iterable[Suite]) -> list[Matchup]:
    """Return all matchups of several suites."""
    return [(suite, rival) for suite in suites for rival in suite.rivals]


def part_records(part: Part, matchups: Iterable[Matchup], folder: Path | None = None) -> list[Record]:
    """Play a part's matchups in this process, and return their records.

    Args:
        part: the part.
        matchups: what it plays, suite by suite.
        folder: has a store of each suite, whose records are not played again; None: nothing is kept.

    Raises:
        PolicyFailed: a policy's process died or exceeded its limits.
        UserError: a transcript is not that of these matches.
    """
    with running_player(part) as player:
        records: list[Record] = []
        for name, of_suite in groupby(matchups, key=lambda matchup: matchup[0].name):
            wanted = [Pairing(part.entry(player, suite), suite, rival) for suite, rival in of_suite]
            store = Store(None if folder is None else folder / name / RECORDS)
            records += store.fill(wanted, partial(_play, part))
        return records


def _play(part: Part, entry: EvaluatedPlayer, suite: Suite, rival: Rival, **more: Any) -> Record:
    try:
        record = play(entry, suite, rival, **more)
    except UserError as error:
        if part.recorded is None:
            raise
        raise UserError(f"against {rival.name}: {local(error, part.recorded)}") from error
    # The time that planning took differs each time, so it is left out.
    plans = record.plans and dataclasses.replace(record.plans, seconds=0.0)
    return dataclasses.replace(record, plans=plans)


@contextlib.contextmanager
def running_player(part: Part, shipped_in_process: bool = False) -> Iterator[PlayerSpec]:
    """Load a part for playing; everything that plays an entry of the board loads it here.

    Args:
        part: the part.
        shipped_in_process: play the package's own agents in this process, which saves the start of another.

    Yields:
        The name of a script, or a policy as a player, which runs in a sandbox.
    """
    if isinstance(part.plays, str):
        yield part.plays
    elif part.shipped and shipped_in_process:
        yield OnnxPlayer(part.plays.model, part.plays.card)
    else:
        with client.PolicyClient(part.plays) as player:
            yield player


@contextlib.contextmanager
def work_store(board: Path, name: str, kind: type[R]) -> Iterator[EncounterStore[Any, R]]:
    """Lock a board, and yield a store of unfinished work, which is removed once all is on the board.

    Args:
        board: the leaderboard's folder.
        name: of the work.
        kind: a model of the store's rows.
    """
    folder = work_folder(board) / name
    with at_work(board):
        yield EncounterStore(kind, folder / RECORDS)
        shutil.rmtree(folder, ignore_errors=True)


def fill(part: Part, matchups: Sequence[Matchup], folder: Path) -> None:
    """Play a part's matchups that have no record in a folder; if the policy fails, the reason is noted."""
    notes = RowFile(folder / NOTES)
    try:
        part_records(part, matchups, folder)
    except PolicyFailed as error:
        notes.append([{FAILED: f"{part.name}: {error}"}])
    if isinstance(part.plays, Policy) and (lacking := missing_here()):
        notes.append([{OPEN: lacking}])


@dataclass
class PlayedPart:
    """Contents of a part's folder.

    Attributes:
        records: by their matchups.
        failure: why the part could not be finished; None if it could.
        unprotected: what its policy could not be kept from.
    """

    records: dict[Key, Record] = field(default_factory=dict)
    failure: str | None = None
    unprotected: list[str] = field(default_factory=list)

    def is_done(self, matchups: Iterable[Matchup]) -> bool:
        """Return True if nothing of these matchups is left to play."""
        return self.failure is not None or all(key_of(*matchup) in self.records for matchup in matchups)


def read_part(folder: Path) -> PlayedPart:
    """Read the records of a part from its folder; empty if there is no such folder."""
    records = [record for path in folder.glob(f"*/{RECORDS}") for record in Store(path).records()]
    played = PlayedPart({(record.suite, record.suite_hash, record.rival): record for record in records})
    for row in RowFile(folder / NOTES).read():
        if FAILED in row:
            played.failure = played.failure or str(row[FAILED])
        elif OPEN in row:
            played.unprotected = list(row[OPEN])
    return played


def smoke_test(policy: Policy, suite: Suite) -> list[str]:
    """Play a few rounds against the first and last rival of a suite, and return what goes wrong."""
    few = dataclasses.replace(suite, matches=-(-_ROUNDS // suite.rounds_per_match))
    rivals = dict.fromkeys([suite.rivals[0], suite.rivals[-1]])
    try:
        with client.PolicyClient(policy) as player:
            lost = sum(play(player_entry(player), few, rival).lost for rival in rivals)
    except PolicyFailed as error:
        return [str(error)]
    return ["loses rounds: an answer is not finite, not in [-1, 1], or of another shape"] if lost else []
