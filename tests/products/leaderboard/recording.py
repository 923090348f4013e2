"""A small suite of planners, and a language model's submission that was recorded on it."""

from __future__ import annotations

import gzip
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.products.language_models.transcript import Attempt
from tests.products.language_models.fault_server import FaultServer, answer

PLANNER_SUITE = """\
side: planner
scenario: standard
rounds_per_match: 3
matches: 2
opponent: adaptive
last_rounds: 1
scale: {zero: 5.73, top: 30.45}
rivals:
  - {ally: idle}
  - {ally: expert}
"""
PLANS = 6  # of an ally


def toy(body: dict[str, Any]) -> str:
    """Return the toy model's text: a path; in the second round at the second attempt, in the third none."""
    asked = body["messages"][0]["content"]
    known = asked.count("\nRound ")
    if known > 1 or (known == 1 and len(body["messages"]) == 1):
        return "To the north."
    points = [{"x": 300 + len(asked) % 100 + 50 * i, "y": 700, "z": 300} for i in range(16)]
    return json.dumps({"waypoints": points})


def record(folder: Path, suite: Path, say: Callable[[dict[str, Any]], str] = toy, **options: Any) -> Any:
    """Record the planner ``llm`` under ``folder/out``; gives what the comparison says of it."""
    with FaultServer([answer(say)]) as server, environment(server.url):
        summaries = evaluate(["llm"], str(suite), folder / "out", planner_options=options)
    return next(summary for summary in summaries if summary.entry == "llm")


def environment(url: str, model: str = "toy") -> Any:
    """The environment in which ``llm`` is a model at this address."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("FPG_LLM_", "OPENAI_"))}
    return mock.patch.dict(os.environ, kept | {"FPG_LLM_BASE_URL": url, "FPG_LLM_MODEL": model}, clear=True)


def enter(out: Path, folder: Path, pack: bool = True) -> Path:
    """Make a submission's folder of what was recorded; packed as the docs say."""
    shutil.copytree(out / "transcripts" / "llm", folder / "transcripts")
    for path in (folder / "transcripts").glob("*.jsonl") if pack else ():
        path.with_name(path.name + ".gz").write_bytes(gzip.compress(path.read_bytes(), 9))
        path.unlink()
    return folder


def rows_of(file: Path) -> list[dict[str, Any]]:
    """The rows of an unpacked transcript."""
    return [json.loads(line) for line in file.read_text().splitlines()]


def write_rows(file: Path, rows: list[dict[str, Any]]) -> None:
    """Write a transcript whose keys fit its requests, as a careful forger would."""
    for row in rows:
        row["key"] = Attempt.read(row, "here").key
    file.write_text("".join(json.dumps(row) + "\n" for row in rows))
