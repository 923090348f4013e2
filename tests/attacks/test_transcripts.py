"""A transcript that somebody spoilt is one clear line, or plays to the bit what the honest one does."""

import shutil

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.leaderboard.playing import Part, matchups_of, part_records
from fpg_bench.leaderboard.transcripts import check_transcripts
from tests.attacks import SCALE, SEED
from tests.attacks.transcripts import spoil_transcripts
from tests.leaderboard.recording import PLANNER_SUITE, enter, record, toy


def _seeded(body):
    """The toy model, with a path for each seed."""
    text = toy(body)
    return text if "seed" not in body else text.replace('"z": 300', f'"z": {body["seed"] % 300}')


class Recorded:
    """Records a model in a folder.

    Attributes:
        entry: the honest entry's folder.
        suite: the suite that was played.
        honest: the records of the honest entry; see :meth:`flown`.
    """

    def __init__(self, folder):
        file = folder / "mine.yml"
        file.write_text(PLANNER_SUITE)
        profile = folder / "seeded.yml"
        profile.write_text("about: It answers each seed in another way.\nseed: true\n")
        record(folder, file, _seeded, server=str(profile))
        self.entry, self.suite = enter(folder / "out", folder / "entry", pack=False), load_suite(str(file))
        self.honest = self.flown(self.entry)

    def flown(self, entry):
        """Return what must agree of an entry's records; None where it is refused in clear lines."""
        found = check_transcripts(entry, self.suite)
        assert all(line.isprintable() and len(line) < 1000 for line in found)
        if found:
            return None
        try:
            part = Part("toy", None, "transcripts", recorded=entry)
            lines = list(part_records(part, matchups_of([self.suite])))
        except (UserError, OSError):
            return None
        return [(line.rounds_sha256, line.returns, line.plans and line.plans.statuses) for line in lines]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return Recorded(tmp_path_factory.mktemp("recorded"))


def test_the_honest_one_is_played(recorded, tmp_path):
    folder = shutil.copytree(recorded.entry, tmp_path / "entry")
    assert check_transcripts(folder, recorded.suite) == []
    assert recorded.flown(folder) == recorded.honest


@pytest.mark.parametrize("seed", range(SEED, SEED + 60 * SCALE))
def test_what_was_spoilt_is_named_or_changes_nothing(recorded, tmp_path, seed):
    folder = shutil.copytree(recorded.entry, tmp_path / "entry")
    spoil_transcripts(folder / "transcripts", seed)
    assert recorded.flown(folder) in (None, recorded.honest)
