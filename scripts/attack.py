"""Throw generated hostile inputs at the door: ``python scripts/attack.py --class onnx --count 10000``.

Says for each class how many got in, crashed or leaked a key, and the most time and memory that one took. The
generators are those of the tests in ``tests/attacks``.
"""

from __future__ import annotations

import argparse
import collections
import json
import resource
import shutil
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from fpg_bench.common.strict_json import read_object
from fpg_bench.leaderboard.cases import case_of, result_file
from fpg_bench.leaderboard.check import examine, load_submission, problems
from fpg_bench.leaderboard.onnx_contract import check_policies
from fpg_bench.leaderboard.smoke_test import trial
from fpg_bench.leaderboard.submission_file import plain, read_fields
from fpg_bench.leaderboard.tracks import TRACKS
from fpg_bench.planning.llm.client import ERRORS, MOST_TOKENS, read_reply
from fpg_bench.players.agent import OnnxPlayer
from tests.attacks.json_texts import hostile_texts
from tests.attacks.kills import VERBS, Killed
from tests.attacks.names import lookalikes
from tests.attacks.onnx_files import hostile_files
from tests.attacks.pull_requests import spoil
from tests.attacks.replaying import Recorded
from tests.attacks.servers import hostile_answers
from tests.attacks.transcripts import spoil_transcripts
from tests.leaderboard.making import FIELDS, as_policy

BOARD = Path(__file__).parents[1] / "leaderboard"
KEY = "sk-0123456789abcdef"
IN, OUT, CRASH, LEAK = "got in", "kept out", "crashed", "leaked"
_AT_ONCE = 25
Found = Iterator[tuple[str, str, float]]  # kind, what became of it, seconds


def onnx(count: int, seed: int) -> Found:
    """Policies: the contract, and a trial where that lets one pass."""
    suite, waiting = TRACKS["ally"].suite, []
    for item in hostile_files(count, seed):
        waiting.append(item)
        if len(waiting) == _AT_ONCE:
            yield from _checked(waiting, suite)
            waiting = []
    yield from _checked(waiting, suite)


def _checked(items: list, suite) -> Found:
    start = time.perf_counter()
    found = check_policies([data for _, data, _ in items])
    each = (time.perf_counter() - start) / max(len(items), 1)
    for (kind, data, must), records in zip(items, found, strict=True):
        start = time.perf_counter()
        if not records and must:
            alone = kind == "reader" and not OnnxPlayer(data, {}).row_wise  # it has no others to read
            records = ["is asked one game at a time"] if alone else trial(as_policy(data), suite)
        what = OUT if records or not must else IN
        yield (
            kind,
            CRASH if any("a bug" in record for record in records) else what,
            each + time.perf_counter() - start,
        )


def pulls(count: int, seed: int) -> Found:
    """Folders, texts and results of an honest entry, each spoilt in one way."""
    with tempfile.TemporaryDirectory() as scratch:
        board = Path(scratch) / "board"
        honest, result = BOARD / "submissions/ally/plain-torch", result_file(BOARD, "ally", "plain-torch")
        for number in range(count):
            folder = shutil.copytree(honest, board / "submissions/ally/plain-torch")
            kept = result_file(board, "ally", "plain-torch")
            kept.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(result, kept)
            kind = spoil(folder, kept, seed + number)
            yield kind, *_timed(partial(_entered, board, folder))
            shutil.rmtree(board)


def _entered(board: Path, folder: Path) -> str:
    records = problems(folder)
    "".join(records).encode()
    submission, _ = examine(folder)
    if submission is None or records:
        return OUT
    try:
        case = case_of(board, submission)
    except ValueError:
        return OUT
    honest = load_submission(BOARD / "submissions/ally/plain-torch")
    same = case.path.read_bytes() == result_file(BOARD, "ally", "plain-torch").read_bytes()
    return OUT if same and submission.fingerprint == honest.fingerprint else IN  # what was added says nothing


def texts(count: int, seed: int) -> Found:
    """JSON."""
    for kind, text in hostile_texts(count, seed):
        yield kind, *_timed(partial(_read, text))


def _read(text: bytes) -> str:
    try:
        read_object(text, most=1_000_000)
    except ValueError:
        return OUT
    return IN


def servers(count: int, seed: int) -> Found:
    """Answers of servers of language models."""
    for kind, answer in hostile_answers(count, KEY, seed):
        yield kind, *_timed(partial(_answered, answer))


def _answered(answer) -> str:
    reply = read_reply(answer.status, answer.body, KEY, ())
    kept = json.dumps(reply.raw, allow_nan=False) + (reply.text or "") + reply.detail + (reply.model or "")
    joined = kept.replace('", "', "").replace('"}, {"type": "text", "text": "', "")
    if KEY in kept or KEY in joined:
        return LEAK
    counts = [count for count in (reply.tokens_in, reply.tokens_out) if count is not None]
    sound = reply.error in (None, *ERRORS) and all(0 <= count <= MOST_TOKENS for count in counts)
    return OUT if sound else IN


def names(count: int, seed: int) -> Found:
    """Names that look like those of scripts."""
    for number, name in enumerate(("expert-spread", "My agent", "Population PPO", "reactive")):
        for other in lookalikes(name, count // 4, seed + number):
            yield name, *_timed(partial(_named, name, other))


def _named(name: str, other: str) -> str:
    refused = bool(read_fields(FIELDS | {"name": other})[1])
    return OUT if refused or plain(other) == plain(name) else IN


def transcripts(count: int, seed: int) -> Found:
    """Transcripts of a language model, each spoilt in one way."""
    with tempfile.TemporaryDirectory() as scratch:
        recorded = Recorded(Path(scratch))
        for number in range(count):
            folder = shutil.copytree(recorded.entry, Path(scratch) / "spoilt")
            kind = spoil_transcripts(folder / "transcripts", seed + number)
            yield kind, *_timed(partial(_replayed, recorded, folder))
            shutil.rmtree(folder)


def _replayed(recorded: Recorded, folder: Path) -> str:
    return OUT if recorded.flown(folder) in (None, recorded.honest) else IN


def kills(count: int, seed: int) -> Found:
    """Verbs that are killed at random moments, and go on; what is let in is another result."""
    with tempfile.TemporaryDirectory() as scratch:
        verbs = {verb: Killed(verb, Path(scratch)) for verb in VERBS}
        for number in range(count):
            verb = list(VERBS)[number % len(VERBS)]
            folder = Path(scratch) / str(number)
            yield verb, *_timed(partial(_went_on, verbs[verb], folder, seed + number))
        killed = sum(verb.kills for verb in verbs.values())
        print(f"kills: {killed} times killed", file=sys.stderr, flush=True)


def _went_on(verb: Killed, folder: Path, seed: int) -> str:
    return OUT if verb.same(folder, seed) else IN


def _timed(call: Callable[[], str]) -> tuple[str, float]:
    start = time.perf_counter()
    try:
        what = call()
    except Exception as error:
        print(f"{type(error).__name__}: {error!s:.200}", file=sys.stderr)
        what = CRASH
    return what, time.perf_counter() - start


CLASSES = {
    "onnx": onnx,
    "pulls": pulls,
    "json": texts,
    "servers": servers,
    "names": names,
    "transcripts": transcripts,
    "kills": kills,
}


def main() -> None:
    """Attack by one class, or by all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--class", dest="kind", choices=[*CLASSES, "all"], default="all")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    bad = 0
    for name in CLASSES if words.kind == "all" else [words.kind]:
        tracemalloc.start()
        found: collections.Counter[str] = collections.Counter()
        slowest, start = (0.0, ""), time.perf_counter()
        for kind, what, seconds in CLASSES[name](words.count, words.seed):
            found[what] += 1
            slowest = max(slowest, (seconds, kind))
            if what != OUT:
                print(f"{name}: {kind}: {what}", flush=True)
            if found.total() % 500 == 0:
                print(f"{name}: {found.total()} of {words.count}, {dict(found)}", file=sys.stderr, flush=True)
        peak = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        inside = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
        print(
            f"{name}: {sum(found.values())} inputs, seed {words.seed}: {found[IN]} got in, "
            f"{found[CRASH]} crashed, {found[LEAK]} leaked; slowest {slowest[0]:.2f} s ({slowest[1]}); "
            f"{peak:.0f} MB here, {inside:.0f} MB in a process for them; "
            f"{time.perf_counter() - start:.0f} s in all",
            flush=True,
        )
        bad += found[IN] + found[CRASH] + found[LEAK]
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
