"""Ask a language model for the plans of a suite in several parts, and put it beside other planners.

    python scripts/measure_language_model.py
    python scripts/measure_language_model.py --table

The first command records one part after the other: the model, its controls, another prompt, temperatures
and sampling seeds. It may be stopped, killed and run again: what was answered is not asked again. Two of it
beside each other share the parts. The second packs the transcripts of whole parts and writes tables: the
planners side by side, how much more the model scores than each, and what a plan took. It asks nobody, and
anybody can do it again.
"""

from __future__ import annotations

import argparse
import gzip
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import PACKED, write_whole
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.compare import TRANSCRIPTS, compare
from fpg_bench.evaluation.evaluate import RECORDS
from fpg_bench.evaluation.statistics import MATCHES, mean_interval
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import as_markdown, bounds, write_table
from fpg_bench.planning.llm.packed import packed_rows

SUITE = Path(__file__).with_name("planner-expert.yml")
BESIDE = ("random", "circle", "hill-climb", "interceptor")  # planners that are no language models

_TIMINGS = ("cache_n", "prompt_n", "predicted_n", "prompt_ms", "predicted_ms")  # as llama.cpp says them


@dataclass(frozen=True)
class Part:
    """One way to ask: the planner, and options of it that are not the usual ones."""

    name: str
    planner: str = "llm"
    options: dict[str, Any] = field(default_factory=dict)


PARTS = (  # what matters most comes first
    Part("llm"),
    Part("llm-shuffled-rewards", "llm-shuffled-rewards"),
    Part("llm-no-history", "llm-no-history"),
    Part("llm-brief", options={"prompt": "brief"}),
    Part("llm-temperature-0", options={"temperature": 0.0}),
    Part("llm-seed-1", options={"sampling_seed": 1}),
    Part("llm-seed-2", options={"sampling_seed": 2}),
    Part("llm-paper", options={"prompt": "paper"}),
)


def record(parts: Iterable[Part], out: Path, matches: int, server: str | None) -> None:
    """Record the parts that are not whole, but those that another process records."""
    for part in parts:
        began = time.monotonic()
        try:
            known = compare(
                [part.planner],
                str(SUITE),
                out / part.name,
                matches=matches,
                llm={"prompt": "standard", **part.options, **({} if server is None else {"server": server})},
                progress=lambda entry, ally, rounds, part=part: say(f"{part.name}: {rounds} rounds"),
            )
        except UserError as error:
            say(f"{part.name}: {error}")
            continue
        say(f"{part.name}: score {known[0].score.value:.1f}, {time.monotonic() - began:.0f} s")


def table(parts: Iterable[Part], out: Path, into: Path, matches: int) -> None:
    """Pack the transcripts of whole parts, play them again, and write the table of all."""
    for part in parts:
        if is_whole(part, out):
            pack(out / part.name / TRANSCRIPTS / part.planner, into / TRANSCRIPTS / part.name)
    with tempfile.TemporaryDirectory() as folder:
        found = compare(BESIDE, str(SUITE), folder, matches=matches, transcripts=into / TRANSCRIPTS)
    write_table(found, found[0].suite, into)
    write_whole(into / "differences.md", differences(found))
    write_whole(into / "speed.md", speeds(into / TRANSCRIPTS))
    for name in ("table.md", "differences.md", "speed.md"):
        print((into / name).read_text())


def differences(found: Sequence[Summary]) -> str:
    """How much more the model scores than each other planner, match by match, as a table."""
    by_name = {summary.entry: summary for summary in found}
    model, lines = by_name.pop(PARTS[0].name), []
    for name, other in by_name.items():
        each = [mean_interval(mine - theirs, MATCHES) for mine, theirs in _paired(model, other)]
        lines.append([name, *(f"{one.value:+.1f} {bounds(one)}" for one in each)])
    heads = ["llm less", f"score, last {model.suite.last_rounds} rounds", "score, all rounds"]
    return as_markdown(
        heads, lines, "With 95 % intervals over the same matches; not corrected for their number."
    )


def _paired(model: Summary, other: Summary) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Both planners' scores of each match: of the rounds that count, and of all."""
    yield model.samples, other.samples
    yield _over_all(model), _over_all(other)


def _over_all(summary: Summary) -> np.ndarray:
    returns = np.array([line.returns for line in summary.records])
    by_match = returns.reshape(len(summary.records), summary.suite.matches, -1).mean(axis=(0, 2))
    found: np.ndarray = summary.suite.scale.score(by_match / summary.suite.scenario.steps_per_round)
    return found


def speeds(transcripts: Path) -> str:
    """What an attempt took, as far as the server's replies say it, as a table: means."""
    lines = []
    for folder in sorted(path for path in transcripts.iterdir() if path.is_dir()):
        rows = [row for file in sorted(folder.glob(f"*.jsonl{PACKED}")) for row in packed_rows(file)]
        told = [
            row["raw"]["timings"] for row in rows if isinstance(row["raw"], dict) and "timings" in row["raw"]
        ]
        if told:
            means = {name: np.mean([one[name] for one in told]) for name in _TIMINGS}
            seconds = f"{np.mean([row['seconds'] for row in rows]):.1f}"
            saved = means["cache_n"] * means["prompt_ms"] / max(means["prompt_n"], 1)
            counts = [f"{means[name]:.0f}" for name in ("cache_n", "prompt_n", "predicted_n")]
            parts = [f"{ms / 1000:.1f}" for ms in (means["prompt_ms"], means["predicted_ms"], saved)]
            lines.append([folder.name, str(len(rows)), seconds, *counts, *parts])
    heads = [
        "planner",
        "attempts",
        "s",
        "tokens kept",
        "read",
        "written",
        "s reading",
        "s writing",
        "s saved",
    ]
    below = "Kept: of the prompt before, in the server's cache; saved: what reading them would have taken."
    return as_markdown(heads, lines, below)


def is_whole(part: Part, out: Path) -> bool:
    """Whether a part has met everybody."""
    allies = load_suite(str(SUITE)).rivals
    return len(RowFile(out / part.name / RECORDS).read()) == len(allies)


def pack(recorded: Path, folder: Path) -> None:
    """Copy a planner's transcripts, packed."""
    for path in sorted(recorded.iterdir()):
        if path.suffix == ".jsonl":
            packed = gzip.compress(path.read_bytes(), 9, mtime=0)
            write_whole(folder / f"{path.name}{PACKED}", packed)
        else:
            write_whole(folder / path.name, path.read_bytes())


def say(line: str) -> None:
    """Print a line with the time."""
    print(time.strftime("%H:%M:%S"), line, flush=True)


def main() -> None:
    """Record, or write the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    asked.add_argument("--out", type=Path, default=Path("runs/language-model"), help="what is recorded")
    asked.add_argument("--into", type=Path, default=Path("results/language-model"), help="for --table")
    asked.add_argument("--matches", type=int, default=4, help="against each ally; ten rounds each")
    asked.add_argument("--parts", nargs="*", choices=[part.name for part in PARTS], help="default: all")
    asked.add_argument("--server", help="the profile of the server; default: as the environment says")
    asked.add_argument("--table", action="store_true", help="write the table of what is recorded")
    said = asked.parse_args()
    parts = [part for part in PARTS if not said.parts or part.name in said.parts]
    if said.table:
        table(parts, said.out, said.into, said.matches)
    else:
        record(parts, said.out, said.matches, said.server)


if __name__ == "__main__":
    main()
