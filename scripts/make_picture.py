"""Draw the animation of the README: the first 170 steps of a round.

python scripts/make_picture.py docs/game.gif
"""

from __future__ import annotations

import sys
from pathlib import Path

from fpg_bench import make_duel
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from fpg_bench.rendering.film import write_gif
from fpg_bench.rendering.recording import Recording

STEPS, SEED = 170, 12
EVERY = 3  # steps per frame


def main(path: Path) -> None:
    """Record expert-spread against adaptive."""
    duel = make_duel(1)
    ally, opponent = (
        PolicyRunner(side, [as_player(name, side, duel.scenario)], duel.batch)
        for side, name in (("ally", "expert-spread"), ("opponent", "adaptive"))
    )
    mask = duel.reset(seeds=SEED)
    ally.begin(mask)
    opponent.begin(mask)
    recording = Recording(duel.batch, 0)
    for _ in range(STEPS):
        duel.batch.step(ally.act(), opponent.act())
        recording.add()
    write_gif([recording], path, every=EVERY)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
