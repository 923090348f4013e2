"""Memory: what it counts, and that models, batches, tensors and ONNX graphs have the same bits."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.vec_env import VecFrameStack

from fpg_bench import make_sb3
from fpg_bench.common.errors import UserError
from fpg_bench.envs.sb3_vec_env import VecMemory
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.sensing import KNOWN_AGE, KNOWN_FREQUENCY, OWN_FREQUENCY, SENSED_COVERS
from fpg_bench.players.memory import MEMORY_SIZES, remember
from fpg_bench.players.preprocessing import Preprocessing
from fpg_bench.training.export import Graph, Value, rows_of

GAMES = {"ally": "FPG/AllyVsScripted-v0", "opponent": "FPG/OpponentVsScripted-v0"}


def walked(side, columns):
    """Return the memory after each step, of observations that are zero but for the given columns."""
    steps, memory = len(next(iter(columns.values()))), np.zeros((1, MEMORY_SIZES[side]), np.float32)
    found = []
    for step in range(steps):
        seen = np.zeros((1, 15), np.float32)
        for column, values in columns.items():
            seen[0, column] = values[step]
        memory = np.concatenate(remember(side, seen, memory), axis=1)
        found.append(memory[0])
    return np.array(found).T


def test_an_ally_counts_hops_and_hits():
    frequency, stayed, quiet, hits, hop_share, hit_share = walked(
        "ally", {OWN_FREQUENCY: [0.5, 0.5, 0.5, -0.2, -0.2], SENSED_COVERS: [-1, 1, 1, -1, -1]}
    )
    assert frequency == pytest.approx([0.5, 0.5, 0.5, -0.2, -0.2])
    assert (stayed * 32).tolist() == [1, 2, 3, 0, 1]
    assert (quiet * 32).tolist() == [1, 0, 0, 1, 2]
    assert (hits * 8).tolist() == [0, 1, 2, 0, 0]
    assert hop_share.tolist() == [0, 0, 0, 1 / 16, 15 / 256]
    assert hit_share[1:4].tolist() == [1 / 16, 1 / 16 + 15 / 256, (1 / 16 + 15 / 256) * 15 / 16]


def test_an_opponent_counts_where_its_checks_find_the_ally():
    """It knows the first point from the start; checks find it there, elsewhere, elsewhere and there."""
    known, before, moved, same, elsewhere, share, finds = walked(
        "opponent",
        {KNOWN_FREQUENCY: [0.5, 0.5, 0.5, -0.5, -0.5, 0.0, 0.0], KNOWN_AGE: [0, 0.1, 0, 0, 0.1, 0, 0]},
    )
    assert known.tolist() == [0.5, 0.5, 0.5, -0.5, -0.5, 0, 0]
    assert before.tolist() == [0, 0, 0.5, 0.5, 0.5, -0.5, 0]
    assert moved.tolist() == [0, 0, 0, 1, 1, 1, 0]
    assert (same * 4).tolist() == [0, 0, 1, 0, 0, 0, 1]
    assert (elsewhere * 4).tolist() == [0, 0, 0, 1, 1, 2, 0]
    assert share[:4].tolist() == [0, 0, 0, 1 / 4]
    assert (finds * 16).tolist() == [1, 1, 2, 3, 3, 4, 5]


@pytest.mark.parametrize("side", GAMES)
def test_games_players_tensors_and_graphs_have_the_same_bits(side):
    """Over 220 steps of four games, whose rounds end at different steps."""
    plain, stacked = (make_sb3(GAMES[side], n_envs=4, seed=3, stagger=True) for _ in range(2))
    games, preprocessing = VecMemory(VecFrameStack(stacked, 2)), Preprocessing(frames=2, memory=side)
    session, size = written(side), MEMORY_SIZES[side]
    seen, observed, starts, stack = plain.reset(), games.reset(), np.ones(4, bool), None
    alone, tensor, state = [None] * 4, torch.zeros(4, size), np.zeros((4, size), np.float32)
    chance, ends = np.random.default_rng(0), 0
    for _ in range(220):
        stack = preprocessing.pushed(stack, seen, starts)
        assert np.array_equal(stack, observed)
        for k in range(4):
            alone[k] = preprocessing.pushed(alone[k], seen[k : k + 1], starts[k : k + 1])
            assert np.array_equal(alone[k][0], observed[k])
        tensor[torch.from_numpy(starts)], state[starts] = 0, 0
        tensor = torch.cat(remember(side, torch.from_numpy(seen), tensor), 1)
        (state,) = session.run(None, {"observation": seen, "state": state})
        state = state.copy()
        assert np.array_equal(tensor.numpy(), observed[:, 30:])
        assert np.array_equal(state, observed[:, 30:])
        actions, last = chance.uniform(-1, 1, (4, 9)).astype(np.float32), observed
        seen, *_ = plain.step(actions)
        observed, _, starts, infos = games.step(actions)
        ends += starts.sum()
        for k in np.flatnonzero(starts):
            final = infos[k]["terminal_observation"]
            assert np.array_equal(final[:15], last[k, 15:30])
            assert np.array_equal(final[30:], later(side, final[None, 15:30], last[k : k + 1, 30:])[0])
    assert ends == 2
    assert (np.ptp(observed[:, 30:], axis=0) > 0).any()
    assert games.observation_space.contains(observed[0])


def later(side, seen, past):
    return np.concatenate(remember(side, seen, past), axis=1)


def written(side):
    """Return an onnxruntime session of the memory's graph."""
    import onnxruntime

    graph, size = Graph(), MEMORY_SIZES[side]
    columns = remember(side, Value(graph, "observation"), Value(graph, "state"))
    graph.add("Concat", *(each.name for each in columns), axis=1, to="next_state")
    inputs = [rows_of("observation", 15), rows_of("state", size)]
    return onnxruntime.InferenceSession(graph.to_bytes(inputs, [rows_of("next_state", size)]))


def test_games_without_the_numbers_of_one_side_have_no_memory():
    for games in (make_sb3("FPG/duel_v0"), make_sb3(GAMES["ally"], observation="waterfall")):
        with pytest.raises(UserError, match="memory: needs the 15 numbers of a side of the duel"):
            VecMemory(games)
    assert STANDARD.age_scale_s < 1e4  # ages differ by more than what counts as equal
