"""Try generated hostile inputs: ``python scripts/attack.py --class onnx --count 10000``.

Reports for each class how many got in, crashed or leaked a key, and the most time and memory that one took.
The generators are those of the tests in ``tests/attacks``.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import sys
import tempfile
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from fpg_bench.common.strict_json import read_object
from fpg_bench.evaluation.suite import Suite
from fpg_bench.leaderboard.folders import result_file
from fpg_bench.leaderboard.playing import smoke_test
from fpg_bench.leaderboard.policy_client import check_policies
from fpg_bench.leaderboard.submission import examine, load_submission, plain, problems, read_about
from fpg_bench.leaderboard.tracks import TRACKS, TrackSuites
from fpg_bench.leaderboard.verification import case_of
from fpg_bench.planning.llm.client import ERRORS, MOST_TOKENS, read_reply
from fpg_bench.players.agent import OnnxPlayer
from tests.attacks.json_texts import hostile_texts
from tests.attacks.kills import VERBS, Killed
from tests.attacks.names import lookalikes
from tests.attacks.onnx_files import hostile_files
from tests.attacks.pull_requests import spoil
from tests.attacks.replaying import Recorded
from tests.attacks.servers import Hostile, hostile_answers
from tests.attacks.transcripts import spoil_transcripts
from tests.leaderboard.making import FIELDS, as_policy

BOARD = Path(__file__).parents[1] / "leaderboard"
HONEST = BOARD / "submissions/ally/plain-torch"
KEY = "sk-0123456789abcdef"
IN, OUT, CRASH, LEAK = "got in", "kept out", "crashed", "leaked"
Attacks = Iterator[tuple[str, Callable[[], str]]]  # the kind, and a call that returns the outcome


def onnx(count: int, seed: int) -> Attacks:
    """Policies: the contract, and a smoke test if that lets one pass."""
    suite, files = TrackSuites().public(TRACKS["ally"]), hostile_files(count, seed)
    while batch := list(islice(files, 25)):
        found = check_policies([data for _, data, _ in batch])
        for (kind, data, must), lines in zip(batch, found, strict=True):
            yield kind, partial(_try_policy, kind, data, must, lines, suite)


def _try_policy(kind: str, data: bytes, must: bool, lines: list[str], suite: Suite) -> str:
    if lines or not must or (kind == "reader" and not OnnxPlayer(data, {}).row_wise):
        return OUT  # a reader that is asked one game at a time has no others to read
    lines = smoke_test(as_policy(data), suite)
    return CRASH if any("a bug" in line for line in lines) else OUT if lines else IN


def pulls(count: int, seed: int) -> Attacks:
    """Folders, texts and results of an honest entry, each spoilt in one way."""
    result = result_file(BOARD, "ally", HONEST.name)
    for number in range(count):
        with tempfile.TemporaryDirectory() as scratch:
            board = Path(scratch)
            folder = shutil.copytree(HONEST, board / "submissions/ally" / HONEST.name)
            copied = result_file(board, "ally", HONEST.name)
            copied.parent.mkdir(parents=True)
            shutil.copyfile(result, copied)
            yield spoil(folder, copied, seed + number), partial(_enter, board, folder)


def _enter(board: Path, folder: Path) -> str:
    lines = problems(folder)
    "".join(lines).encode()
    submission, _ = examine(folder)
    if submission is None or lines:
        return OUT
    try:
        case = case_of(board, submission)
    except ValueError:
        return OUT
    is_same = case.path.read_bytes() == result_file(BOARD, "ally", HONEST.name).read_bytes()
    return OUT if is_same and submission.fingerprint == load_submission(HONEST).fingerprint else IN


def texts(count: int, seed: int) -> Attacks:
    """JSON."""
    for kind, text in hostile_texts(count, seed):
        yield kind, partial(_read, text)


def _read(text: bytes) -> str:
    try:
        read_object(text, most=1_000_000)
    except ValueError:
        return OUT
    return IN


def servers(count: int, seed: int) -> Attacks:
    """Answers of servers of language models."""
    for kind, answer in hostile_answers(count, KEY, seed):
        yield kind, partial(_reply, answer)


def _reply(answer: Hostile) -> str:
    reply = read_reply(answer.status, answer.body, KEY, ())
    kept = json.dumps(reply.raw, allow_nan=False) + (reply.text or "") + reply.detail + (reply.model or "")
    if KEY in kept or KEY in kept.replace('", "', "").replace('"}, {"type": "text", "text": "', ""):
        return LEAK
    counts = [count for count in (reply.tokens_in, reply.tokens_out) if count is not None]
    is_sound = reply.error in (None, *ERRORS) and all(0 <= count <= MOST_TOKENS for count in counts)
    return OUT if is_sound else IN


def names(count: int, seed: int) -> Attacks:
    """Names that look like those of scripts."""
    for number, name in enumerate(("expert-spread", "My agent", "Population PPO", "reactive")):
        for other in lookalikes(name, count // 4, seed + number):
            yield name, partial(_name, name, other)


def _name(name: str, other: str) -> str:
    is_refused = bool(read_about(FIELDS | {"name": other})[1])
    return OUT if is_refused or plain(other) == plain(name) else IN


def transcripts(count: int, seed: int) -> Attacks:
    """Transcripts of a language model, each spoilt in one way."""
    with tempfile.TemporaryDirectory() as scratch:
        recorded = Recorded(Path(scratch))
        for number in range(count):
            folder = shutil.copytree(recorded.entry, Path(scratch) / "spoilt")
            kind = spoil_transcripts(folder / "transcripts", seed + number)
            yield kind, partial(_replay, recorded, folder)
            shutil.rmtree(folder)


def _replay(recorded: Recorded, folder: Path) -> str:
    return OUT if recorded.flown(folder) in (None, recorded.honest) else IN


def kills(count: int, seed: int) -> Attacks:
    """Verbs that are killed at random moments and resumed; another result counts as got in."""
    with tempfile.TemporaryDirectory() as scratch:
        verbs = {verb: Killed(verb, Path(scratch)) for verb in VERBS}
        for number in range(count):
            verb = list(VERBS)[number % len(VERBS)]
            yield verb, partial(_resume, verbs[verb], Path(scratch) / str(number), seed + number)


def _resume(verb: Killed, folder: Path, seed: int) -> str:
    return OUT if verb.same(folder, seed) else IN


CLASSES: dict[str, Callable[[int, int], Attacks]] = {
    "onnx": onnx,
    "pulls": pulls,
    "json": texts,
    "servers": servers,
    "names": names,
    "transcripts": transcripts,
    "kills": kills,
}


def attack(name: str, count: int, seed: int) -> int:
    """Attack by one class; return how many attacks were not kept out."""
    tracemalloc.start()
    outcomes: Counter[str] = Counter()
    slowest, start = (0.0, ""), time.perf_counter()
    for kind, call in CLASSES[name](count, seed):
        began = time.perf_counter()
        try:
            outcome = call()
        except Exception as error:
            print(f"{type(error).__name__}: {error!s:.200}", file=sys.stderr)
            outcome = CRASH
        outcomes[outcome] += 1
        slowest = max(slowest, (time.perf_counter() - began, kind))
        if outcome != OUT:
            print(f"{name}: {kind}: {outcome}", flush=True)
    here = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    print(
        f"{name}: {outcomes.total()} inputs, seed {seed}: {outcomes[IN]} got in, {outcomes[CRASH]} crashed, "
        f"{outcomes[LEAK]} leaked; slowest {slowest[0]:.2f} s ({slowest[1]}); {here:.0f} MB here, "
        f"{children:.0f} MB in a process for them; {time.perf_counter() - start:.0f} s in all",
        flush=True,
    )
    return outcomes.total() - outcomes[OUT]


def main() -> int:
    """Attack by one class, or by all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--class", dest="kind", choices=[*CLASSES, "all"], default="all")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    kinds = list(CLASSES) if options.kind == "all" else [options.kind]
    return 1 if sum(attack(kind, options.count, options.seed) for kind in kinds) else 0


if __name__ == "__main__":
    sys.exit(main())
