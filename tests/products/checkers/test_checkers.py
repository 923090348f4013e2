"""The checkers pass what is sound, and each fault has its own message."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import SCRIPTED
from fpg_bench.players.planner import Plan
from fpg_bench.products.checkers import check_planner, check_player


@pytest.mark.parametrize("side", SCRIPTED)
def test_every_script_and_oracle_passes(side):
    for name in (*SCRIPTED[side], "oracle"):
        check_player(name, side, "paper" if name == "oracle" else "standard")


class Sound:
    """A sound player with a memory (a step count per game); the broken ones change one thing."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        steps = np.zeros(len(observation)) if state is None else state.copy()
        if episode_start is not None:
            steps[episode_start] = 0
        actions = np.tanh(observation[:, :9] + 0.1 * steps[:, None]).astype(np.float32)
        return self.spoil(actions), steps + 1

    def __init__(self, spoil=lambda actions: actions):
        self.spoil = spoil


class Bare(Sound):
    def predict(self, *args):
        return super().predict(*args)[0]


class Meddler(Sound):
    def predict(self, observation, *args):
        observation[:] = 0
        return super().predict(observation, *args)


class HiddenCount(Sound):
    """Keeps its memory in itself, and never hears of a round's start."""

    count = 0

    def predict(self, observation, *args):
        self.count += 1
        return np.full((len(observation), 9), np.cos(self.count), np.float32), None


class Elephant(Sound):
    """Never forgets."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return super().predict(observation, state, None, deterministic)


class Amnesiac(Sound):
    """Forgets every game where one starts."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        state = None if episode_start is not None and episode_start.any() else state
        return super().predict(observation, state, None, deterministic)


BROKEN_PLAYERS = [
    (lambda: Sound(lambda a: a[:, :8]), r"actions are \(7, 8\) for a batch of 7; return shape \(7, 9\)"),
    (lambda: Sound(np.ndarray.tolist), "actions are list"),
    (lambda: Sound(lambda a: np.sign(a).astype(int)), "return a float32 NumPy array"),
    (lambda: Sound(lambda a: np.where(a == a[-1, 2], np.nan, a)), "hold NaN or infinity"),
    (lambda: Sound(lambda a: 1.5 * a), r"reach .*; clip them to \[-1, 1\]"),
    (Bare, r"return \(actions, state\)"),
    (Meddler, "changed its observation; work on a copy"),
    (
        lambda: Sound(lambda a: np.random.default_rng().uniform(-1, 1, a.shape)),
        "same observations and seeds gave other",
    ),
    (HiddenCount, "keep memory in the returned state"),
    (lambda: Sound(lambda a: np.clip(a - a.mean(axis=0), -1, 1)), "gets other actions than alone"),
    (Elephant, "remembers the round before; empty the memory where episode_start is True"),
    (Amnesiac, "a round that starts in one game changed another's"),
]


@pytest.mark.parametrize(
    ("check", "kind"),
    [
        (lambda: check_player(Sound(), "ally"), "players"),
        (lambda: check_player(Sound(), "opponent"), "players"),
        (lambda: check_planner(Fixed()), "planners"),
    ],
    ids=["ally", "opponent", "planner"],
)
def test_what_is_sound_passes(check, kind, capsys):
    check()
    assert capsys.readouterr().out.endswith(f": keeps to the contract of {kind}\n")


def test_a_torch_model_may_differ_in_its_last_bits_and_no_more():
    torch = pytest.importorskip("torch")

    class Net(Sound):
        def __init__(self, spoil):
            super().__init__(spoil)
            self.net = torch.nn.Linear(15, 9)

        def predict(self, observation, *_):
            with torch.no_grad():
                actions = torch.tanh(self.net(torch.as_tensor(observation))).numpy()
            return np.clip(actions + self.spoil * len(observation), -1, 1), None

    check_player(Net(1e-6), "ally")
    with pytest.raises(AssertionError, match="than alone"):
        check_player(Net(1e-3), "ally")


def test_an_unknown_player_or_side_is_refused():
    with pytest.raises(UserError, match="did you mean 'expert'"):
        check_player("expart", "ally")
    with pytest.raises(AssertionError, match="'ally' or 'opponent'"):
        check_player("expert", "red")


class Fixed:
    """A sound planner; the broken ones change one thing."""

    name, tier = "fixed", "history"

    def plan(self, history, current_position, limits, rng):
        return Plan(self.spoil(rng.uniform(0, limits.box_m, (limits.waypoints, 3))), self.name)

    def __init__(self, spoil=lambda waypoints: waypoints, **changes):
        self.spoil = spoil
        vars(self).update(changes)


class Revisionist(Fixed):
    def plan(self, history, *args):
        history[:] = 0
        return super().plan(history, *args)


class Mover(Fixed):
    def plan(self, history, current_position, *args):
        current_position += 1
        return super().plan(history, current_position, *args)


BROKEN_PLANNERS = [
    (lambda: Fixed(lambda w: w[1:]), r"waypoints are \(15, 3\) after 0 rounds; return shape \(16, 3\)"),
    (lambda: Fixed(lambda w: np.where(w == w[3], np.nan, w)), "hold NaN or infinity"),
    (lambda: Fixed(lambda w: np.where(w == w[3, 2], 601, w)), "waypoint 3 lies outside the box"),
    (
        lambda: Fixed(lambda w: np.random.default_rng().uniform(0, 100, w.shape)),
        "generator gave another plan",
    ),
    (Revisionist, "changed the history"),
    (Mover, "changed the current position"),
]


@pytest.mark.parametrize(
    ("check", "kind", "message"),
    [
        *((lambda player: check_player(player, "ally"), *each) for each in BROKEN_PLAYERS),
        *((check_planner, *each) for each in BROKEN_PLANNERS),
    ],
)
def test_each_broken_player_or_planner_is_caught_by_its_own_message(check, kind, message):
    with pytest.raises(AssertionError, match=message) as caught:
        check(kind())
    assert "\n" not in str(caught.value)
