"""Draw the picture of the README: one step of a round as the renderer shows it.

python scripts/make_picture.py docs/game.png
"""

from __future__ import annotations

import sys
from pathlib import Path

from matplotlib.image import imsave

from fpg_bench import make_duel
from fpg_bench.pictures.rendering import Renderer
from fpg_bench.players.naming import as_player
from fpg_bench.players.seat import Seat

STEPS, SEED = 170, 12


def main(path: Path) -> None:
    """Play expert-spread against adaptive and draw step 170."""
    duel = make_duel(1)
    ally, opponent = (
        Seat(side, [as_player(name, side, duel.scenario)], duel.arena)
        for side, name in (("ally", "expert-spread"), ("opponent", "adaptive"))
    )
    mask = duel.reset(seeds=SEED)
    ally.begin(mask)
    opponent.begin(mask)
    renderer = Renderer(duel.arena)
    renderer.record(begin=True)
    for _ in range(STEPS):
        duel.arena.step(ally.act(), opponent.act())
        renderer.record(begin=False)
    imsave(path, renderer.draw())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
