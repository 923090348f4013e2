"""A transcript that somebody spoilt is one clear line, or plays to the bit what the honest one does."""

import shutil

import pytest

from fpg_bench.leaderboard.transcripts import check_transcripts
from tests.attacks import SCALE, SEED
from tests.attacks.replaying import Recorded
from tests.attacks.transcripts import spoil_transcripts


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
