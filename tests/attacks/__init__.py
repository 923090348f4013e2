"""Hostile inputs.

``FPG_ATTACKS=50 FPG_ATTACKS_SEED=1 pytest tests/attacks`` tries fifty times as many, from other seeds.
"""

import os

SCALE = int(os.environ.get("FPG_ATTACKS", "1"))
SEED = int(os.environ.get("FPG_ATTACKS_SEED", "0"))
