"""Helpers of the language models' tests: clients, planners, short matches, paths as text."""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from fpg_bench.envs.two_player import make_duel
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.planner import Limits, Plan, Request
from fpg_bench.products.language_models.client import Client, Reply
from fpg_bench.products.language_models.llm_planner import LLMPlanner
from fpg_bench.products.language_models.servers import Endpoint, load_server

from .fault_server import ok

STEPS, ROUNDS = 32, 4
SHORT = dataclasses.replace(
    STANDARD, steps_per_round=STEPS, rounds_per_match=ROUNDS, opponent_path="waypoints"
)
LIMITS = Limits.of(SHORT)
KEY = "sk-0123456789-a-key-that-nobody-may-see"
BAD = "I would fly to the north."
CHAT = [{"role": "user", "content": "Where to?"}]
SCHEMA = {"type": "object", "properties": {"x": {"type": "integer"}}, "required": ["x"]}


def client(url: str, server: str = "generic", deadline_s: float = 5.0, **settings) -> Client:
    """A client of a URL; ``settings`` replace entries of the server's profile."""
    profile = load_server(server).model_copy(update=settings)
    return Client(Endpoint(url, "some-model", KEY, profile), deadline_s)


def ask(asked: Client, seed: int = 7) -> Reply:
    """The reply to one question."""
    (reply,) = asked.complete_all([asked.request_body(CHAT, seed, SCHEMA)])
    return reply


def path(shift: int = 0) -> np.ndarray:
    """A path in whole metres; another for each ``shift``."""
    return np.array([[100 + 10 * i + shift, 200 + shift, 150] for i in range(16)], float)


def path_text(shift: int = 0) -> str:
    """The path as a model writes it."""
    points = [{"x": int(x), "y": int(y), "z": int(z)} for x, y, z in path(shift)]
    return json.dumps({"waypoints": points})


GOOD = ok(path_text())


def endpoint(server, profile: str = "generic") -> Endpoint:
    """The endpoint of a test server; its model is called ``tiny``."""
    return Endpoint(server.url, "tiny", KEY, load_server(profile))


def planner(server=None, **options) -> LLMPlanner:
    """A planner that asks a test server; None: that replays."""
    return LLMPlanner(SHORT, None if server is None else endpoint(server), **options)


def request(round: int = 0, seed: int = 1, match: int = 0, game: int = 0, reward: float = 0.5) -> Request:
    """A request after some rounds, all alike."""
    history = np.zeros((round, 16, 4))
    history[..., :3], history[..., 3] = path(), reward
    rng = np.random.default_rng([seed, match, round])
    return Request(history, np.array([700.0, 800.0, 90.0]), LIMITS, rng, game, seed, match, round)


def play(with_planner, rounds: int = ROUNDS, games: int = 1, seed: int = 5) -> tuple[list[Plan], np.ndarray]:
    """A match with resting players: the plans, round by round, and the state of every step."""
    duel, rest = make_duel(games, scenario=SHORT, planner=with_planner), np.zeros((games, 9))
    plans, states = [], []
    for index in range(rounds):
        duel.reset(seeds=seed if index == 0 else None)
        plans += duel.plans
        for _ in range(STEPS):
            duel.step(rest, rest)
            states.append(duel.state())
    return plans, np.array(states)


def statuses(plans: list[Plan]) -> list[str]:
    """The status of each plan."""
    return [plan.status for plan in plans]


def assert_same(first: tuple[list[Plan], np.ndarray], second: tuple[list[Plan], np.ndarray]) -> None:
    """Two matches are identical to the bit, and so are their plans."""
    assert np.array_equal(first[1], second[1])
    for x, y in zip(first[0], second[0], strict=True):
        assert np.array_equal(x.waypoints, y.waypoints)
        assert dataclasses.replace(x, waypoints=None) == dataclasses.replace(y, waypoints=None)
