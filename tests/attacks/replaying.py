"""An honest record of a small model, and what comes of a copy of it that may have been spoilt."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.leaderboard.playing import Part, matchups_of, part_records
from fpg_bench.leaderboard.transcripts import check_transcripts
from tests.leaderboard.recording import PLANNER_SUITE, enter, record


class Recorded:
    """Records a model in a folder.

    Attributes:
        entry: the honest entry's folder.
        suite: what was played.
        honest: what its flights came to.
    """

    def __init__(self, folder: Path) -> None:
        file = folder / "mine.yml"
        file.write_text(PLANNER_SUITE)
        record(folder, file)
        self.entry, self.suite = enter(folder / "out", folder / "entry", pack=False), load_suite(str(file))
        self.honest = self.flown(self.entry)

    def flown(self, entry: Path) -> list[Any] | None:
        """What an entry's flights come to; None where it is refused in clear lines."""
        found = check_transcripts(entry, self.suite)
        if found:
            if not all(line.isprintable() and len(line) < 1000 for line in found):
                raise AssertionError(f"not one clear line: {found[0]!r:.200}")
            return None
        try:
            part = Part("toy", None, "transcripts", recorded=entry)
            lines = list(part_records(part, matchups_of([self.suite])))
        except (UserError, OSError):
            return None
        return [(line.rounds_sha256, line.returns, line.plans and line.plans.statuses) for line in lines]
