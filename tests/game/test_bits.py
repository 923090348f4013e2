"""The game has the same bits on every machine: other processors are played by switching features off.

Three libraries choose code by processor: the C library (its ``log``, ``exp`` and ``sin``), Numba's compiler,
and NumPy.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = [pytest.mark.process, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
HASHES = json.loads((ROOT / "tests/golden/bits.json").read_text())
FEATURES = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
MACHINES = {
    "as it is": {},
    "without vectors and fused operations": {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA_Usable,-AVX2_Usable",  # since 2.33, and before
        "NPY_DISABLE_CPU_FEATURES": " ".join(FEATURES),
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
    },
}


@pytest.mark.parametrize(
    "machine",
    [next(iter(MACHINES)), *(pytest.param(name, marks=pytest.mark.full) for name in [*MACHINES][1:])],
)
def test_every_machine_plays_the_same_bits(machine):
    command = [sys.executable, "-m", "tests.game.bits"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | MACHINES[machine]
    played = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    assert json.loads(played.stdout) == HASHES
