"""Rounds to watch: simulated when the site is built, and kept as scripts that a page loads on demand."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.strict_json import read_object
from fpg_bench.evaluation.play import match_of
from fpg_bench.evaluation.rounds import begin_round, finish_round
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import PLANNER, Rival, Suite
from fpg_bench.players.player import PlayerSpec
from fpg_bench.products.leaderboard.about import board_name
from fpg_bench.products.leaderboard.cases import Case
from fpg_bench.products.leaderboard.entries import Entries
from fpg_bench.products.leaderboard.playing import Matchup, parts_of, running_player
from fpg_bench.products.leaderboard.result import round_finite
from fpg_bench.products.leaderboard.site.views import ROLES, format_number
from fpg_bench.products.leaderboard.submission import Submission
from fpg_bench.products.leaderboard.tracks import PUBLIC, RESPONSES, UNSEEN
from fpg_bench.products.rendering.recording import Recording
from fpg_bench.products.rendering.replay import FORMAT, replay_data, script_json
from fpg_bench.products.sandbox.client import Policy, check_policy
from fpg_bench.products.sandbox.process import PolicyFailed
from fpg_bench.version import __version__

_logger = logging.getLogger(__name__)

STRONG = ("adaptive/pursuit", "expert/pursuit", "expert/learned", "expert")  # rivals of the public suites
_FORM = 7  # version of labels and texts; after a change all rounds are played again
_ROLES = (PUBLIC, UNSEEN, RESPONSES)  # suites under the game's own rules
_CALL, _END = "fpgRound(", ");\n"


@dataclass(frozen=True)
class Replay:
    """A round of an entry.

    Attributes:
        file: the script's file in the site.
        label: a short name of the round.
        summary: a sentence about the round.
        script: the script's text.
    """

    file: str
    label: str
    summary: str
    script: str


Replays = Mapping[tuple[str, str], Sequence[Replay]]  # by track and entry


def make_replays(entries: Entries, out: str | Path, simulate: bool = True) -> Replays:
    """Return the rounds of all verified entries that can be played.

    The first training seed's policy plays one round against a strong rival and one against the rival with
    the entry's lowest score under its own rules, on the first evaluation seed. Rounds that the site has
    already are kept.

    Args:
        entries: the entries of a board.
        out: the site's folder.
        simulate: play the rounds that are missing.
    """
    replays = {}
    for entry in entries.verified:
        with contextlib.suppress(PolicyFailed, UserError):  # leaderboard verify names the problem
            if rounds := list(_rounds(entry, Path(out), simulate)):
                replays[entry.key] = rounds
    return replays


def _choose(entry: Case) -> dict[str, Matchup]:
    """Choose a strong rival and that of the lowest score, by the labels of their rounds."""
    suites = entry.suites
    pairs = [(role, rival) for role in _ROLES if role in suites for rival in suites[role].rivals]
    strong = next((pair for pair in pairs if pair[1].name in STRONG), pairs[0])

    def score(pair: tuple[str, Rival]) -> float:
        role, rival = pair
        return round_finite(suites[role].scale.score(entry.summaries[role].by_rival[rival.name].value))

    chosen = strong, min(pairs, key=score)
    return {label_of(role, rival.name): (suites[role], rival) for role, rival in chosen}


def label_of(role: str, rival: str) -> str:
    """Return the name of a round against a rival of a suite."""
    return f"against {rival}" + ("" if role == PUBLIC else f" ({ROLES[role].label.lower()})")


def _rounds(entry: Case, out: Path, simulate: bool) -> Iterator[Replay]:
    submission, matchups = entry.submission, _choose(entry)
    files = [_file(entry, label, suite) for label, (suite, _) in matchups.items()]
    kept = [_read_replay(out / file, file) for file in files]
    if None not in kept or not simulate:
        yield from (replay for replay in kept if replay is not None)
        return
    if submission.is_recorded:
        return
    (part, *_) = parts_of(submission)
    if isinstance(part.plays, Policy) and not part.shipped and check_policy(part.plays.model):
        return
    _logger.info(f"{'/'.join(entry.key)}: playing rounds to watch")
    with running_player(part, shipped_in_process=True) as player:
        for (label, (suite, rival)), file in zip(matchups.items(), files, strict=True):
            yield simulate_round(submission, player, suite, rival, label, file)


def _file(entry: Case, label: str, suite: Suite) -> str:
    """Return a round's file, whose name follows from everything that decides its content."""
    content = [FORMAT, _FORM, __version__, entry.fingerprint.submission, suite.hash, label]
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]
    return f"replays/{'/'.join(entry.key)}/{digest}.js"


def _read_replay(path: Path, file: str) -> Replay | None:
    """Read a round of an earlier build; None where there is none that can be read."""
    try:
        text = path.read_text(encoding="utf-8")
        content = read_object(text.removeprefix(_CALL).removesuffix(_END))
        return Replay(file, str(content["label"]), str(content["summary"]), text)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def simulate_round(
    submission: Submission, player: PlayerSpec, suite: Suite, rival: Rival, label: str, file: str
) -> Replay:
    """Play a round of a submission.

    Args:
        submission: the submission.
        player: its player, or the name of its script or planner.
        suite, rival: the matchup.
        label: the round's name on the page.
        file: the script's file in the site.
    """
    recordings, measures = _play(player, suite, rival)
    names = [board_name(submission, submission.slug), " or ".join(rival.players)]
    ally, opponent = names if suite.side == "ally" else reversed(names)
    summary = _summary(measures)
    content = {
        "label": label,
        "summary": summary,
        "replay": replay_data(recordings, f"{ally} against {opponent}", ally, opponent),
    }
    return Replay(file, label, summary, _CALL + script_json(content) + _END)


def _play(player: PlayerSpec, suite: Suite, rival: Rival) -> tuple[list[Recording], dict[str, float | None]]:
    """Play a round, or all rounds of a planner's match; returns recordings, and the last round's measures."""
    match = match_of(player, suite, rival, matches=1)
    seeds: np.ndarray | None = np.array(evaluation_seeds(1, suite.season))
    recordings = []
    for _ in range(suite.rounds_per_match if suite.side == PLANNER else 1):
        begin_round(match, seeds=seeds)
        recording, seeds = Recording(match.duel.batch), None
        finish_round(match, on_step=recording.add)
        recordings.append(recording)
    return recordings, match.duel.measures(0)


def _summary(measures: Mapping[str, float | None]) -> str:
    def share(name: str) -> str:
        return format_number(measures[name], "share")

    return (
        f"Overlap ratio {share('overlap_ratio')}, jamming success rate {share('jamming_success_rate')}, "
        f"link broken {share('outage')} of the time; the ally "
        f"hops in {share('hop_rate')} of the steps and spreads in {share('spread_ratio')}; "
        f"mean SNR {format_number(measures['snr_db'], 'dB')}."
    )
