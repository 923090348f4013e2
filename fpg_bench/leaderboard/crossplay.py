"""Cross-play: every ally of the board against every opponent, on the same chance, by both sides' returns."""

from __future__ import annotations

import contextlib
import json
import math
import random
import shutil
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.files import write_whole
from fpg_bench.common.parallel import Workers, folder_job, run_jobs
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.play import LOST_SCORE
from fpg_bench.evaluation.rounds import make_match as match_of
from fpg_bench.evaluation.rounds import play_round
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.leaderboard.cases import at_work, check_share, work_folder
from fpg_bench.leaderboard.pairs import (
    ROUNDS,
    BoardEntry,
    Pair,
    Pairs,
    crossplay_file,
    pair_key,
    pair_of,
    players_of_board,
    read_pairs,
)
from fpg_bench.leaderboard.playing import FAILED, Part, make_match
from fpg_bench.leaderboard.result import rounded
from fpg_bench.leaderboard.sandbox import PolicyFailed
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.player import Player
from fpg_bench.players.registry import as_player

_ALONE = Workers()
WITHIN = 0.005  # of a rate, and of the distance from 0 to 100, when it is played again


def play_missing(
    board: str | Path,
    *,
    rounds: int = ROUNDS,
    trusted: Collection[Row] | None = None,
    say: Callable[[str], None] = print,
    **workers: Any,
) -> list[str]:
    """Play the pairs of a board that have no figure yet; those of players that are gone are dropped.

    Args:
        board: the leaderboard's folder.
        rounds: of each pair, dealt out evenly to the training seeds of both.
        trusted: the rows that are believed; all others are played again and replaced. None: all are.
        say: told how it goes.
        **workers: how many allies play at once, and where; see :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        What could not be played, and which untrusted rows did not hold, one line each.
    """
    board = Path(board)
    pairs = read_pairs(board, players_of_board(board), rounds, say)
    believed = None if trusted is None else set(map(pair_of, trusted))
    known = {key: pair for key, pair in pairs.known.items() if believed is None or pair in believed}
    missing = [(a, o) for key, a, o in pairs.every() if key not in known]
    say(f"crossplay: {len(missing)} of {len(pairs.allies) * len(pairs.opponents)} pairs to play")
    with at_work(board):
        played, failed = _play(board, missing, rounds, Workers(**workers))
    known |= {pair.key: pair for pair in played}
    differing = _differing(played, pairs)
    failed += [f"{record}; replaced, commit this one" for record in differing]
    if missing or not pairs.whole:
        rows = [known[key].row() for key, _, _ in pairs.every() if key in known]
        records = [json.dumps(row, separators=(",", ":")) + "\n" for row in rows]
        write_whole(crossplay_file(board), "".join(records))
    return failed


def check_pairs(board: str | Path, share: float, seed: int) -> list[str]:
    """Play some pairs again, drawn at random; what differs, one line each.

    Args:
        board: the leaderboard's folder.
        share: of the pairs; at least one is played.
        seed: of the draw.

    Raises:
        UserError: a share out of range.
    """
    check_share(share)
    board = Path(board)
    pairs = read_pairs(board, players_of_board(board))
    there = [(a, o) for key, a, o in pairs.every() if key in pairs.known]
    drawn = random.Random(seed).sample(there, math.ceil(share * len(there)))
    with at_work(board):
        played, failed = _play(board, drawn, pairs.rounds)
    return failed + _differing(played, pairs)


def _differing(played: Sequence[Pair], pairs: Pairs) -> list[str]:
    """What differs of pairs that were played again, one line each; those that are new are passed over."""
    both = {key: players for key, *players in pairs.every()}
    return [
        f"{now.ally} - {now.opponent}: {what} {value:.4f}, the figure says {before:.4f}"
        for now in played
        if now.key in pairs.known
        for what, value, before, most in _compared(now, pairs.known[now.key], both[now.key])
        if abs(value - before) > most
    ]


def _compared(
    now: Pair, then: Pair, players: Sequence[BoardEntry]
) -> Iterator[tuple[str, float, float, float]]:
    """What is compared of a pair: its name, both values, and how far they may be apart."""
    yield "jammed", now.jamming_success_rate, then.jamming_success_rate, WITHIN
    for who in players:
        most = WITHIN * (who.scale.top - who.scale.zero)
        yield f"{who.side}'s return a step", now.reward(who.side), then.reward(who.side), most


def _play(
    board: Path, pairs: Sequence[tuple[BoardEntry, BoardEntry]], rounds: int, workers: Workers = _ALONE
) -> tuple[list[Pair], list[str]]:
    """Play pairs, an ally's after one another: their figures, and what failed."""
    work = work_folder(board) / "crossplay"
    jobs, folders = [], []
    for ally in {a.slug: a for a, _ in pairs}.values():
        others = [o for a, o in pairs if a is ally]
        folder, keys = work / ally.slug, {pair_key(ally, o, rounds) for o in others}
        fill, done = partial(_fill, ally, others, rounds), partial(_is_done, folder, keys)
        jobs.append(folder_job(ally.slug, folder, fill, done))
        folders.append((folder, keys))
    failed = run_jobs(jobs, workers.jobs, workers.backend, workers.address, say=None)
    rows = [row for folder, keys in folders for row in _rows(folder) if row["key"] in keys]
    shutil.rmtree(work, ignore_errors=True)
    lost = [f"{row['ally']} - {row['opponent']}: {row[FAILED]}" for row in rows if FAILED in row]
    played = [pair for pair in map(pair_of, rows) if pair is not None]
    return played, lost + [f"{name}: {why}" for name, why in failed.items()]


def _rows(folder: Path) -> list[Row]:
    return RowFile(folder / "pairs.jsonl").read()


def _is_done(folder: Path, keys: set[str]) -> bool:
    return keys <= {row["key"] for row in _rows(folder)}


def _fill(ally: BoardEntry, opponents: list[BoardEntry], rounds: int, folder: Path) -> None:
    """Play an ally against opponents into a folder, a line each as it ends."""
    there = {row["key"] for row in _rows(folder)}
    for opponent in opponents:
        key = pair_key(ally, opponent, rounds)
        if key in there:
            continue
        try:
            row = play_pair(ally, opponent, rounds).row()
        except PolicyFailed as error:
            row = {"ally": ally.slug, "opponent": opponent.slug, "key": key, FAILED: str(error)}
        RowFile(folder / "pairs.jsonl").append([row])


def play_pair(ally: BoardEntry, opponent: BoardEntry, rounds: int = ROUNDS) -> Pair:
    """Play one pair: all combinations of both sides' training seeds, equally often.

    A round that a side loses by an answer that is none counts as jammed throughout where it is the ally's,
    and as never jammed where it is the opponent's; its return is that of a lost round in its track.
    """
    games = np.arange(rounds)
    of_ally = games % len(ally.parts)
    of_opponent = games // len(ally.parts) % len(opponent.parts)
    duel = TwoPlayerBatch(opponent.scenario, rounds)
    with _team(ally, of_ally, duel) as one, _team(opponent, of_opponent, duel) as other:
        play_round(match_of(duel, one, other), seeds=np.array(evaluation_seeds(rounds, ally.season)))
        lost = one.invalid.copy(), other.invalid.copy()
    rates = duel.batch.tallies["jammed"] / duel.batch.tallies["steps"]
    rates[lost[0] & ~lost[1]], rates[lost[1] & ~lost[0]] = 1.0, 0.0
    return Pair(
        ally.slug,
        opponent.slug,
        pair_key(ally, opponent, rounds),
        rounds,
        _rewards(duel, ally, lost[0], of_ally),
        _rewards(duel, opponent, lost[1], of_opponent),
        _figure(rates.mean()),
        (int(lost[0].sum()), int(lost[1].sum())),
    )


def _rewards(
    duel: TwoPlayerBatch, who: BoardEntry, lost: np.ndarray, runners: np.ndarray
) -> tuple[float, ...]:
    """The return a step of each of a side's parts."""
    found = duel.batch.tallies[f"{who.side}_return"] / duel.batch.tallies["steps"]
    found[lost] = min([who.scale.reward(LOST_SCORE), *found[~lost]])
    return tuple(_figure(found[runners == k].mean()) for k in range(len(who.parts)))


def _figure(value: float) -> float:
    found = rounded(float(value))
    assert found is not None  # a mean of finite numbers
    return found


@contextlib.contextmanager
def _team(who: BoardEntry, runners: np.ndarray, duel: TwoPlayerBatch) -> Iterator[Team]:
    with contextlib.ExitStack() as stack:
        plays = [stack.enter_context(_player(part)) for part in who.parts]
        yield Team([as_player(player, who.side, duel.scenario) for player in plays], runners)


def _player(part: Part) -> contextlib.AbstractContextManager[Any]:
    """A part as a player; what the package ships needs no process of its own, which saves time."""
    if part.shipped and not isinstance(part.plays, str):
        return contextlib.nullcontext(OnnxPlayer(part.plays.model, part.plays.about))
    return make_match(part.plays)


class Team:
    """Plays each game of a batch with one of several players, whose states are kept apart.

    Args:
        players: the members.
        seats: ``(n,)`` which of them plays each game.
    """

    def __init__(self, players: Sequence[Player], runners: np.ndarray) -> None:
        self._members = [(player, np.flatnonzero(runners == k)) for k, player in enumerate(players)]
        self._members = [(player, games) for player, games in self._members if len(games)]

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Hand the masked games' seeds to the members that draw."""
        for player, games in self._members:
            if hasattr(player, "reset"):
                player.reset(mask[games], seeds[games])

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Play one step; see :class:`fpg_bench.players.player.Player`."""
        memories = [None] * len(self._members) if state is None else state
        actions, after = np.empty((len(observation), ACTION_SIZE), np.float32), []
        for (player, games), memory in zip(self._members, memories, strict=True):
            starts = None if episode_start is None else episode_start[games]
            actions[games], memory = player.predict(observation[games], memory, starts, deterministic)
            after.append(memory)
        return actions, after

    @property
    def invalid(self) -> np.ndarray:
        """``(n,)`` bool: the games whose present round a member has lost by an answer that is none."""
        found = np.zeros(sum(len(games) for _, games in self._members), bool)
        for player, games in self._members:
            found[games] = getattr(player, "invalid", False)
        return found
