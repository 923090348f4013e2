"""Rounds to watch: simulated when the site is built, kept as scripts that a page loads when asked."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench import __version__
from fpg_bench.envs.duel import Duel
from fpg_bench.envs.recording import Recording
from fpg_bench.envs.replay import FORMAT, replay_data, script_json
from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.leaderboard.planner_track import TRACK as PLANNERS
from fpg_bench.leaderboard.planner_track import panel_of
from fpg_bench.leaderboard.playing import parts_of, seated
from fpg_bench.leaderboard.sandbox import PolicyFailed
from fpg_bench.leaderboard.site.wording import written
from fpg_bench.leaderboard.submission import Submission, load_submission
from fpg_bench.plain_json import read_object
from fpg_bench.planning import as_planner
from fpg_bench.players.naming import as_player
from fpg_bench.players.player import SIDES
from fpg_bench.players.seat import Seat

Row = dict[str, Any]
STRONG = ("adaptive/pursuit", "expert/pursuit", "expert/learned", "expert")  # of any track's panel
_FORM = 2  # of labels and texts; another number has all rounds made anew
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
    which it scores least against, on the first evaluation seed. Rounds that the site holds already are kept.

    Args:
        board: what :func:`fpg_bench.leaderboard.board.make_board` gives.
        folder: the leaderboard's, which holds the submissions.
        out: the site's folder.
        progress: called with each entry's name.
        simulate: whether to play the rounds that are not there.
    """
    found = {}
    for track in board["tracks"]:
        for row in track["rows"]:
            progress(f"{track['key']}/{row['slug']}")
            replays = _entry_replays(track["key"], row, Path(folder), Path(out), simulate)
            if replays:
                found[track["key"], row["slug"]] = replays
    return found


def _entry_replays(key: str, row: Row, folder: Path, out: Path, simulate: bool) -> list[Replay]:
    """An entry's rounds; none where it is not verified or can't be played."""
    if row["status"] != "verified":
        return []
    try:
        home = folder / "submissions" / key.partition("-")[0] / row["slug"]
        submission = load_submission(home, contract=simulate)
        panel = panel_of(submission)
        entries = _chosen(panel, (row.get("worst") or {}).get("entry"))
        return list(_rounds(submission, panel, entries, key, out, simulate))
    except (PolicyFailed, UserError):
        return []  # submit verify says what is wrong


def _chosen(panel: Panel, worst: Any) -> list[Entry]:
    """Which counterparts are played: a strong one, and that of the lowest score."""
    by_name = {entry.name: entry for entry in panel.entries}
    strong = next((name for name in STRONG if name in by_name), panel.entries[0].name)
    names = dict.fromkeys([strong, worst if worst in by_name else strong])
    return [by_name[name] for name in names]


def _rounds(
    submission: Submission, panel: Panel, entries: list[Entry], key: str, out: Path, simulate: bool
) -> Iterator[Replay]:
    """The rounds; none is simulated where all are there already, or nothing is to be."""
    files = [_file(submission, panel, entry, key) for entry in entries]
    known = [_kept(out / file, file) for file in files]
    if None not in known or not simulate:
        yield from (replay for replay in known if replay is not None)
        return
    with _player(submission) as player:
        for entry, file in zip(entries, files, strict=True):
            yield simulated(submission, player, panel, entry, file)


def _file(submission: Submission, panel: Panel, entry: Entry, key: str) -> str:
    """Where a round lies; all that decides it decides its name."""
    content = [FORMAT, _FORM, __version__, submission.fingerprint, panel.hash, panel.season, entry.name]
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
    """Who plays: a policy in a process of its own, a script's name, or None for a planner."""
    if submission.track == PLANNERS:
        if submission.script is None:
            raise UserError("transcripts are not shown as rounds")
        yield None
        return
    with seated(parts_of(submission)[0].plays) as player:
        yield player


def simulated(submission: Submission, player: Any, panel: Panel, entry: Entry, file: str) -> Replay:
    """Play one round of a submission.

    Args:
        submission: whose.
        player: what plays its side: a player or its name; None for a planner.
        panel, entry: what it plays.
        file: where the round's script is to lie.
    """
    recording, measures = _play(submission, player, panel, entry)
    names = {panel.side: submission.name, "opponent" if panel.side == "ally" else "ally": entry.other}
    if submission.track == PLANNERS:
        names = {"ally": entry.other, "opponent": submission.name}
    label = f"against {entry.name}"
    title = f"{names['ally']} against {names['opponent']}"
    summary = _summary(measures)
    content = {"label": label, "summary": summary, "replay": replay_data([recording], title, **names)}
    return Replay(file, label, summary, _CALL + script_json(content) + _END)


def _play(
    submission: Submission, player: Any, panel: Panel, entry: Entry
) -> tuple[Recording, dict[str, float | None]]:
    """Play a match's rounds and keep the last: what a planner has learned shows at its end."""
    planners = submission.track == PLANNERS
    scenario = panel.entry_scenario(entry)
    sides: dict[str, Any] = {panel.side: player, "opponent" if panel.side == "ally" else "ally": entry.other}
    if planners:
        sides = {"ally": entry.other, "opponent": panel.planners.opponent}  # type: ignore[attr-defined]
    duel = Duel(scenario, 1, as_planner(submission.script, scenario) if planners else None)
    seats = [Seat(side, [as_player(sides[side], side, scenario)], duel.arena) for side in SIDES]
    seeds: Any = np.array(evaluation_seeds(1, panel.season))
    for _ in range(scenario.rounds_per_match if planners else 1):
        mask = duel.reset(seeds=seeds)
        for seat in seats:
            seat.begin(mask)
        recording, seeds = Recording(duel.arena), None
        while not duel.arena.games["truncated"].all():
            duel.arena.step(*(seat.act() for seat in seats))
            recording.add()
    return recording, duel.measures(0)


def _summary(measures: dict[str, float | None]) -> str:
    def share(name: str) -> str:
        return written(measures[name], "share")

    return (
        f"Jammed {share('jamming_success_rate')} of the time, link broken {share('outage')}; the ally pays "
        f"for a hop in {share('hop_rate')} of the steps and spreads in {share('spread_ratio')}; "
        f"mean SNR {written(measures['snr_db'], 'dB')}."
    )
