"""Published results on learning against jammers, each reproduced in a small game of its own.

Importing the package registers the games as environments of Gymnasium.
"""

from __future__ import annotations

import gymnasium

for _id, _place in {
    "FPG-papers/Ali2023-v0": "ali_2023:ProactiveJammerEnv",
    "FPG-papers/Firouzbakht2013-v0": "firouzbakht_2013:RateEnv",
    "FPG-papers/Liu2018-v0": "liu_2018:WaterfallEnv",
}.items():
    gymnasium.register(_id, f"{__name__}.{_place}")
