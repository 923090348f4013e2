"""The shipped ally with even hops: it decides as the agent does, and its points are drawn."""

import numpy as np

from fpg_bench.game.actions import HOP_GATE, KNOWLEDGE_GATE, PREFERENCE, SPREAD_GATE
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import load_agent
from fpg_bench.players.registry import as_player
from scripts.even_hops import AGENT

GAMES = 3000


def test_a_player_with_even_hops_decides_as_the_agent_and_draws_where_to_hop():
    player, agent = as_player("scripts.even_hops:EvenHops", "ally", STANDARD), load_agent(AGENT)
    keys = np.arange(GAMES, dtype=np.uint64)
    player.reset(np.ones(GAMES, bool), keys)
    state = memory = None
    hops, starts = [], np.zeros(GAMES, bool)
    for seen in np.random.default_rng(0).random((6, GAMES, 15), np.float32):
        own, state = player.predict(seen, state, starts)
        others, memory = agent.predict(seen, memory, starts)
        gates = [HOP_GATE, SPREAD_GATE]
        np.testing.assert_array_equal(own[:, gates], others[:, gates])
        assert (own[:, KNOWLEDGE_GATE] < 0).all()
        hops.append(own[:, PREFERENCE])
    counts, _ = np.histogram(hops, bins=15, range=(-1, 1))
    assert counts.sum() == 6 * GAMES
    assert abs(counts / counts.sum() - 1 / 15).max() < 0.01
    assert not np.array_equal(hops[0], hops[1])
    again, _ = player.predict(seen, state, ~starts)  # the first step of a round with the same keys
    np.testing.assert_array_equal(again[:, PREFERENCE], hops[0])
