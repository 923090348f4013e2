"""Generated policies: what must not get in does not, and what is broken is told in short lines."""

import pytest

from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.sandbox.client import check_policies
from tests.attacks import SCALE, SEED
from tests.attacks.onnx_files import hostile_files

FILES = list(hostile_files(150 * SCALE, seed=1 + SEED))


@pytest.fixture(scope="module")
def found():
    return check_policies([data for _, data, _ in FILES])


@pytest.mark.parametrize("number", range(len(FILES)))
def test_what_must_not_get_in_is_told(number, found):
    kind, data, must = FILES[number]
    lines = found[number]
    assert lines or not must or (kind == "reader" and not OnnxPlayer(data, {}).row_wise)
    assert all(line.isprintable() and len(line) <= 400 for line in lines)
    if not lines:
        assert OnnxPlayer(data, {}).noise_size == 0  # what passes can be played
