"""What planning the opponent's path costs: the interceptor, the loop of rounds, a slow language model.

    python scripts/benchmark_planning.py [--quick] [--json FILE]

The loop's speeds are in thousands of game steps a second on one thread; they move with the machine, so the
ratio of both is shown, too. Training is measured in turns, with a server that answers after five seconds
and on a fixed path.
"""

from __future__ import annotations

import json
import threading
import time
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
from benchmark_speed import PPO_GAMES, PPO_SETTINGS, Figure, interleaved, median_ratio, ppo_rate, report
from stable_baselines3 import PPO

import fpg_bench
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.scenario import as_scenario
from fpg_bench.planning.llm.background import BackgroundPlanner
from fpg_bench.planning.llm.llm_planner import LLMPlanner
from fpg_bench.planning.llm.servers import Endpoint, load_server

MATCHES = 256
ROUNDS = 10
ANSWER_S = 5.0
PLANNED = as_scenario(None, opponent_path="waypoints", rounds_per_match=ROUNDS)


def rounds_rate(planner: str, rounds: int, plan_ms: list[float]) -> float:
    """Thousands of game steps a second of whole matches on one thread; notes what each game's plans took."""
    duel = make_duel(MATCHES, scenario=PLANNED, planner=planner, threads=1)
    table = make_match(duel, "expert", "adaptive")
    begin = time.perf_counter()
    for number in range(rounds):
        play_round(table, seeds=None if number else 0)
        plan_ms += [1000 * (duel.plans[0].seconds or 0.0)] if number and duel.plans[0] else []
    return rounds * PLANNED.steps_per_round * MATCHES / (time.perf_counter() - begin) / 1000


def running(quick: bool) -> list[Figure]:
    """The loop with a fixed shape and with the interceptor, and the plans themselves."""
    rounds, repeats = (2, 1) if quick else (ROUNDS, 5)
    plan_ms: list[float] = []
    rounds_rate("interceptor", 2, [])  # compiles
    rates = interleaved(
        repeats,
        {
            "circle": partial(rounds_rate, "circle", rounds, []),
            "interceptor": partial(rounds_rate, "interceptor", rounds, plan_ms),
        },
    )
    last = np.median(plan_ms[rounds - 2 :: rounds - 1])
    middle = {name: float(np.median(found)) for name, found in rates.items()}
    return [
        Figure("interceptor, a game's plan, mean over rounds", float(np.mean(plan_ms)), None, unit="ms"),
        Figure("interceptor, a game's plan in the last round", float(last), 2, at_least=False, unit="ms"),
        Figure("rounds, 256 matches, circle", middle["circle"], 500, unit="k/s"),
        Figure("rounds, 256 matches, interceptor", middle["interceptor"], 100, unit="k/s"),
        Figure("rounds, interceptor / circle", median_ratio(rates, "interceptor", "circle"), None),
    ]


class _Slow(BaseHTTPRequestHandler):
    """A chat completion after five seconds, always the same path."""

    def do_POST(self) -> None:
        """Answer."""
        self.rfile.read(int(self.headers["Content-Length"]))
        time.sleep(ANSWER_S)
        path = json.dumps({"waypoints": [{"x": 90 * i, "y": 700, "z": 200} for i in range(16)]})
        choice = {"index": 0, "message": {"role": "assistant", "content": path}, "finish_reason": "stop"}
        body = json.dumps({"choices": [choice]}).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        """Nothing."""


def training(quick: bool) -> list[Figure]:
    """PPO against a language model that plans beside the game, and on a fixed path."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Slow)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    endpoint = Endpoint(f"http://127.0.0.1:{server.server_port}/v1", "slow", None, load_server("generic"))
    planners = {
        "slow": lambda scenario: BackgroundPlanner(LLMPlanner(scenario, endpoint)),
        "circle": "circle",
    }
    settings = PPO_SETTINGS | {"n_steps": 32} if quick else PPO_SETTINGS
    models = {
        name: PPO(
            "MlpPolicy",
            fpg_bench.make_sb3("FPG/AllyVsPlanner-v0", n_envs=PPO_GAMES, seed=0, planner=planner),
            seed=0,
            **settings,
        )
        for name, planner in planners.items()
    }
    repeats, rollouts = (1, 1) if quick else (5, 20)
    rates = interleaved(repeats, {name: partial(ppo_rate, model, rollouts) for name, model in models.items()})
    ratio = median_ratio(rates, "slow", "circle")
    return [Figure("PPO with a model that answers after 5 s / on the circle", ratio, 0.9)]


def measure_all(quick: bool) -> list[Figure]:
    """All figures of this script."""
    return running(quick) + training(quick)


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
