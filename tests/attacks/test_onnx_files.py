"""Generated policies: what must not get in does not, and what is broken is refused in short lines."""

from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.sandbox.client import check_policies
from tests.attacks import SCALE, SEED
from tests.attacks.onnx_files import hostile_files

FILES = list(hostile_files(150 * SCALE, seed=1 + SEED))


def test_what_must_not_get_in_is_refused_in_short_lines():
    problems = check_policies([data for _, data, _ in FILES])
    for (kind, data, must), lines in zip(FILES, problems, strict=True):
        assert lines or not must or (kind == "reader" and not OnnxPlayer(data, {}).row_wise), kind
        assert all(line.isprintable() and len(line) <= 400 for line in lines), kind
        if not lines:
            assert OnnxPlayer(data, {}).noise_size == 0  # what passes can be played
