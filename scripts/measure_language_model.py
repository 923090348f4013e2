"""Ask a language model for the plans of a field in several parts, and put it beside other planners.

    python scripts/measure_language_model.py
    python scripts/measure_language_model.py --table

The first command records one part after the other: the model, its controls, another prompt, temperatures
and sampling seeds. It may be stopped, killed and run again: what was answered is not asked again. Two of it
beside each other share the parts. The second packs the transcripts of whole parts and writes the table,
without a server; anybody can do that again.
"""

from __future__ import annotations

import argparse
import gzip
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.compare import TRANSCRIPTS, compare
from fpg_bench.evaluation.evaluate import LINES
from fpg_bench.evaluation.field_file import load_field
from fpg_bench.evaluation.table import write_table
from fpg_bench.files import PACKED, write_whole
from fpg_bench.rows import RowFile

FIELD = Path(__file__).with_name("planner-expert.yml")
BESIDE = ("random", "circle", "hill-climb", "interceptor")  # planners that are no language models


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
                str(FIELD),
                out / part.name,
                matches=matches,
                llm={**part.options, **({} if server is None else {"server": server})},
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
        found = compare(BESIDE, str(FIELD), folder, matches=matches, transcripts=into / TRANSCRIPTS)
    write_table(found, found[0].field, into)
    print((into / "table.md").read_text())


def is_whole(part: Part, out: Path) -> bool:
    """Whether a part has met everybody."""
    allies = load_field(str(FIELD)).counterparts
    return len(RowFile(out / part.name / LINES).read()) == len(allies)


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
