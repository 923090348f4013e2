"""Rounds to watch: simulated when the site is built, kept as scripts that a page loads when asked."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.field import PLANNER, Counterpart, Field
from fpg_bench.evaluation.play import table_of
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.playing import Meeting, parts_of, seated
from fpg_bench.leaderboard.sandbox import PolicyFailed
from fpg_bench.leaderboard.site.shown import Row, ShownEntry, read_tracks, value_of
from fpg_bench.leaderboard.site.wording import role_of, written
from fpg_bench.leaderboard.submission import Submission
from fpg_bench.leaderboard.tracks import KNOWN, RESPONSES, UNSEEN
from fpg_bench.matches.rounds import begin, play_round
from fpg_bench.pictures.recording import Recording
from fpg_bench.pictures.replay import FORMAT, replay_data, script_json
from fpg_bench.plain_json import read_object
from fpg_bench.players.player import SIDES
from fpg_bench.version import __version__

STRONG = ("adaptive/pursuit", "expert/pursuit", "expert/learned", "expert")  # of any track's known field
_FORM = 4  # of labels and texts; another number has all rounds made anew
_ROLES = (KNOWN, UNSEEN, RESPONSES)  # of fields that are played under the game's own rules
_CALL, _END = "fpgRound(", ");\n"


@dataclass(frozen=True)
class Replay:
    """One round of an entry.

    Attributes:
        file: the script's place in the site.
        label: what is played, in a few words.
        summary: what happened in it, in a sentence.
        script: the script's text.
    """

    file: str
    label: str
    summary: str
    script: str


def make_replays(
    board: Row,
    folder: str | Path,
    out: str | Path,
    progress: Callable[[str], None] = lambda name: None,
    simulate: bool = True,
) -> dict[tuple[str, str], list[Replay]]:
    """Rounds of all entries of a board that can be played, by track and entry.

    The policy of the first training seed plays one round against a strong counterpart and one against that
    which it scores least against of all fields under its own rules, on the first evaluation seed. Rounds that
    the site holds already are kept.

    Args:
        board: what :func:`fpg_bench.leaderboard.board.make_board` gives.
        folder: the leaderboard's, which holds the submissions.
        out: the site's folder.
        progress: called with each entry's name.
        simulate: whether to play the rounds that are not there.
    """
    found = {}
    for track in read_tracks(board):
        for entry in track.entries:
            progress(f"{track.key}/{entry.slug}")
            replays = _entry_replays(track.key, entry, Path(folder), Path(out), simulate)
            if replays:
                found[track.key, entry.slug] = replays
    return found


def _entry_replays(key: str, entry: ShownEntry, folder: Path, out: Path, simulate: bool) -> list[Replay]:
    """An entry's rounds; none where it is not verified or can't be played."""
    if not entry.verified:
        return []
    try:
        home = folder / "submissions" / key.partition("-")[0] / entry.slug
        submission = load_submission(home, contract=simulate)
        return list(_rounds(submission, _chosen(submission.fields, entry), key, out, simulate))
    except (PolicyFailed, UserError):
        return []  # submit verify says what is wrong


def _chosen(fields: Mapping[str, Field], entry: ShownEntry) -> dict[str, Meeting]:
    """What is played, by what it is called: a strong counterpart, and that of the lowest score."""
    meetings = [(role, one) for role in _ROLES if role in fields for one in fields[role].counterparts]
    strong = next((m for m in meetings if m[1].name in STRONG), meetings[0])
    scores = [value_of(entry.met.get(role, {}).get(one.name)) for role, one in meetings]
    known = [(score, m) for score, m in zip(scores, meetings, strict=True) if score is not None]
    lowest = min(known, key=lambda item: item[0])[1] if known else strong
    return {_label(role, one): (fields[role], one) for role, one in (strong, lowest)}


def _label(role: str, counterpart: Counterpart) -> str:
    told = "" if role == KNOWN else f" ({role_of(role).label.lower()})"
    return f"against {counterpart.name}{told}"


def _rounds(
    submission: Submission, meetings: Mapping[str, Meeting], key: str, out: Path, simulate: bool
) -> Iterator[Replay]:
    """The rounds; none is simulated where all are there already, or nothing is to be."""
    files = [_file(submission, label, meeting, key) for label, meeting in meetings.items()]
    known = [_kept(out / file, file) for file in files]
    if None not in known or not simulate:
        yield from (replay for replay in known if replay is not None)
        return
    with _player(submission) as player:
        for (label, meeting), file in zip(meetings.items(), files, strict=True):
            yield simulated(submission, player, meeting, label, file)


def _file(submission: Submission, label: str, meeting: Meeting, key: str) -> str:
    """Where a round lies; all that decides it decides its name."""
    content = [FORMAT, _FORM, __version__, submission.fingerprint, meeting[0].hash, label]
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]
    return f"replays/{key}/{submission.slug}/{digest}.js"


def _kept(path: Path, file: str) -> Replay | None:
    """A round that an earlier build has written; None where there is none that can be read."""
    try:
        text = path.read_text(encoding="utf-8")
        content = read_object(text.removeprefix(_CALL).removesuffix(_END))
        return Replay(file, str(content["label"]), str(content["summary"]), text)
    except (OSError, ValueError, KeyError, TypeError):
        return None


@contextlib.contextmanager
def _player(submission: Submission) -> Iterator[Any]:
    """Who plays: a policy in a process of its own, or the name of a script or planner."""
    if submission.track == PLANNER and submission.script is None:
        raise UserError("transcripts are not shown as rounds")
    with seated(parts_of(submission)[0].plays) as player:
        yield player


def simulated(submission: Submission, player: Any, meeting: Meeting, label: str, file: str) -> Replay:
    """Play one round of a submission.

    Args:
        submission: whose.
        player: what plays its side: a player or its name, or a planner's name.
        meeting: what it plays: a field, and whom of it.
        label: what the page calls the round.
        file: where the round's script is to lie.
    """
    (field, counterpart), other = meeting, " or ".join(meeting[1].players)
    recordings, measures = _play(player, field, counterpart)
    pair = (submission.name, other) if field.side == "ally" else (other, submission.name)
    names = dict(zip(SIDES, pair, strict=True))
    summary = _summary(measures)
    title = f"{names['ally']} against {names['opponent']}"
    content = {
        "label": label,
        "summary": summary,
        "replay": replay_data(recordings, title, names["ally"], names["opponent"]),
    }
    return Replay(file, label, summary, _CALL + script_json(content) + _END)


def _play(
    player: Any, field: Field, counterpart: Counterpart
) -> tuple[list[Recording], dict[str, float | None]]:
    """Play a match and keep all rounds of a planner's, so that learning is seen; measures are the last's."""
    table = table_of(player, field, counterpart, matches=1)
    seeds: Any = np.array(evaluation_seeds(1, field.season))
    recordings = []
    for _ in range(field.rounds_per_match if field.side == PLANNER else 1):
        begin(table, seeds=seeds)
        recording, seeds = Recording(table.duel.arena), None
        play_round(table, on_step=recording.add, begun=True)
        recordings.append(recording)
    return recordings, table.duel.measures(0)


def _summary(measures: dict[str, float | None]) -> str:
    def share(name: str) -> str:
        return written(measures[name], "share")

    return (
        f"Jammed {share('jamming_success_rate')} of the time, link broken {share('outage')}; the ally pays "
        f"for a hop in {share('hop_rate')} of the steps and spreads in {share('spread_ratio')}; "
        f"mean SNR {written(measures['snr_db'], 'dB')}."
    )
