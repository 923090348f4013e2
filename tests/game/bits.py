"""One hash of 1,000 rounds of each preset, all scripts against all; prints them as JSON.

python -m tests.game.bits > tests/golden/bits.json     writes the file that ``test_bits.py`` compares
"""

from __future__ import annotations

import dataclasses
import hashlib
import json

import numpy as np

from fpg_bench.common.ids import SCRIPTED
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.record import HASHED_TALLIES
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.scenario import PRESETS, Scenario, preset
from fpg_bench.players.planner import as_planner

PATHS = ("circle", "triangle", "rectangle", "pursuit", "learned")
LEARNERS = ("epsilon-greedy", "ucb", "thompson", "q-learning")
PLANNERS = ("circle", "interceptor", "optimised", "random")


def digest(scenario: Scenario) -> str:
    """Play 960 rounds that draw from all paths, and two of five matches each with planners."""
    sha = hashlib.sha256()
    plain = dataclasses.replace(scenario, opponent_path=PATHS)
    planned = dataclasses.replace(scenario, opponent_path="waypoints", rounds_per_match=2)
    duels = [TwoPlayerBatch(plain, 960)]
    duels += [TwoPlayerBatch(planned, 5, as_planner(name, planned)) for name in PLANNERS]
    for duel in duels:
        match = make_match(duel, [*SCRIPTED["ally"], *LEARNERS], list(SCRIPTED["opponent"]))
        batch = duel.batch

        def add_step(batch=batch):
            for part in (batch.games["snr_db"], batch.ally_observations, batch.opponent_observations):
                sha.update(part.tobytes())

        for number in range(duel.scenario.rounds_per_match if duel.planner else 1):
            play_round(match, seeds=None if number else 2**41 + np.arange(batch.count), on_step=add_step)
            own = [name for name in batch.games.dtype.names if name != "rules"]  # came later
            fields = (batch.games, own), (batch.tallies, HASHED_TALLIES)
            for records, names in fields:  # field by field: padding is nobody's, and sums may be added
                for name in names:
                    sha.update(records[name].tobytes())
            for part in (batch.histograms, batch.segments, batch.waypoints):
                sha.update(part.tobytes())
    return sha.hexdigest()


if __name__ == "__main__":
    print(json.dumps({name: digest(preset(name)) for name in PRESETS}, indent=1))
