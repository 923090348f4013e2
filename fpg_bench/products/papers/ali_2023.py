"""Ali, Naser and Muhaidat 2023: five variants of DQN against proactive jammers (arXiv 2307.06796)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.utils import update_learning_rate
from stable_baselines3.dqn.policies import DQNPolicy

from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import EVALUATION_START
from fpg_bench.products.papers.learners import DuelingPolicy, PrioritisedBuffer, VariantDQN
from fpg_bench.products.papers.reproduction import Paper, PaperClaim, checked_action, differences, read_facts

CHANNELS = 8
SLOTS = 100
JAMMERS = ("constant", "sweeping", "random")
DYNAMIC = "dynamic"
COSTS = (0.0, 0.1)
EPISODES = 100
MEASURES = {
    "throughput": "mean reward per slot, as the paper counts throughput",
    "sent": "share of slots that were not jammed",
    "hops": "share of slots with a change of channel",
}
_CLEAR_DB, _ADJACENT_DB, _JAMMED_DB, _SPREAD_DB = -5.7, 13.8, 27.5, 0.4
_LIMIT_DB = 20.0  # between an adjacent channel and the jammed one
_SOLVED = 95.0  # return of an episode


class ProactiveJammerEnv(gymnasium.Env[np.ndarray, np.int64]):
    """A sender chooses one of eight channels in each slot; a jammer that does not listen jams one.

    The observation is the measured SNR of each channel in dB, ``(8,)``, in which the jammer is already on
    the channel that it jams in the slot to come. The reward is 1 for a slot that is not jammed, less the cost
    if the channel changed, and 0 for a jammed one.

    Args:
        jammer: ``constant``, ``sweeping``, ``random``, or ``dynamic``: one of these, drawn for each episode.
        cost: cost of a change of channel.

    Raises:
        UserError: a jammer or a cost that the paper lacks.
    """

    def __init__(self, jammer: str = DYNAMIC, cost: float = 0.0) -> None:
        self.jammer = one_of(jammer, "jammer", (*JAMMERS, DYNAMIC))
        if not 0 <= cost <= 1:
            raise UserError(f"cost: expected 0 to 1, got {cost}")
        self.cost = cost
        self.action_space = gymnasium.spaces.Discrete(CHANNELS)
        self.observation_space = gymnasium.spaces.Box(-100.0, 100.0, (CHANNELS,), np.float32)
        self._kind = jammer
        self._channel = self._jammed = self._slot = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode on the first channel."""
        super().reset(seed=seed)
        self._kind = str(self.np_random.choice(JAMMERS)) if self.jammer == DYNAMIC else self.jammer
        self._slot = self._channel = 0
        self._jammed = 0 if self._kind == "sweeping" else int(self.np_random.integers(CHANNELS))
        return self._scan(), {}

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Send for a slot."""
        channel = checked_action(action, self.action_space)
        sent, hopped = channel != self._jammed, channel != self._channel
        reward = (1 - self.cost * hopped) * sent
        self._channel, self._slot = channel, self._slot + 1
        if self._kind == "sweeping":
            self._jammed = self._slot % CHANNELS
        elif self._kind == "random":
            self._jammed = int(self.np_random.integers(CHANNELS))
        return self._scan(), float(reward), False, self._slot >= SLOTS, {"sent": sent, "hopped": hopped}

    def _scan(self) -> np.ndarray:
        distance = np.abs(np.arange(CHANNELS) - self._jammed)
        levels = np.select([distance == 0, distance == 1], [_JAMMED_DB, _ADJACENT_DB], _CLEAR_DB)
        return (levels + _SPREAD_DB * self.np_random.standard_normal(CHANNELS)).astype(np.float32)


_DUELING = "dueling DDQN"
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "DQN": {"tau": 1.0},  # the target is the network itself
    "DQN, fixed targets": {},
    "DDQN": {"double": True},
    _DUELING: {"double": True, "policy": DuelingPolicy},
    "DDQN, prioritised": {"double": True, "replay_buffer_class": PrioritisedBuffer},
}
STAY, LEAVE = "stay", "leave if jammed"
RULES: Mapping[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    STAY: lambda channels, scans: channels,
    LEAVE: lambda channels, scans: np.where(
        np.take_along_axis(scans, channels[:, None], 1)[:, 0] > _LIMIT_DB, (channels - 1) % CHANNELS, channels
    ),
}


class ScheduledDQN(VariantDQN):
    """A variant with the learning rate and the exploration of the public implementation."""

    def __init__(self, *args: Any, double: bool = False, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.double = double

    def _update_learning_rate(self, optimizers: Any) -> None:
        returns = [episode["r"] for episode in self.ep_info_buffer or ()]
        update_learning_rate(optimizers, _rate(float(np.mean(returns)) if returns else None))

    def _on_step(self) -> None:
        super()._on_step()
        self.exploration_rate = 1 / (1 + self._episode_num)


def train(variant: Mapping[str, Any], env: gymnasium.Env[Any, Any], episodes: int, seed: int) -> ScheduledDQN:
    """Train a variant with the hyper-parameters of the public implementation."""
    torch.set_num_threads(1)
    arguments: dict[str, Any] = {
        "policy": DQNPolicy,
        "tau": 0.01,
        "target_update_interval": 1,
        "train_freq": 1,
        "buffer_size": min(100_000, episodes * SLOTS),
        "batch_size": 64,
        "learning_starts": 64,
        "gamma": 0.99,
        "max_grad_norm": 0.7,
        "replay_buffer_kwargs": {"handle_timeout_termination": False},
        "policy_kwargs": {"net_arch": [256, 256], "optimizer_kwargs": {"eps": 1e-4, "fused": True}},
        "seed": seed,
        "device": "cpu",
        **variant,
    }
    return ScheduledDQN(env=env, **arguments).learn(episodes * SLOTS)


def _rate(score: float | None) -> float:
    """Return the learning rate, which falls as the mean return of a hundred episodes nears 95."""
    share = -1.0 if score is None else score / _SOLVED
    divisors = ((0.75, 100), (0.6, 20), (0.5, 10), (0.25, 2))
    return 1e-3 / next((divisor for least, divisor in divisors if share > least), 1)


def play(player: str, condition: str, seed: int, share: float) -> dict[str, float]:
    """Train a player, and measure it over a hundred episodes without exploration."""
    jammer, cost = condition.split(", cost ")
    make = partial(ProactiveJammerEnv, jammer, float(cost))
    if player in RULES:
        choose = RULES[player]
    else:
        model = train(VARIANTS[player], make(), max(2, round(EPISODES * share)), seed)
        choose = lambda channels, scans: model.predict(scans, deterministic=True)[0]  # noqa: E731
    envs, first = [make() for _ in range(EPISODES)], EVALUATION_START + seed * EPISODES
    scans = [env.reset(seed=first + index)[0] for index, env in enumerate(envs)]
    channels, totals = np.zeros(EPISODES, int), np.zeros(len(MEASURES))
    for _ in range(SLOTS):
        channels = choose(channels, np.array(scans))
        played = [env.step(channel) for env, channel in zip(envs, channels, strict=True)]
        scans = [scan for scan, *_ in played]
        totals += np.sum([(reward, info["sent"], info["hopped"]) for _, reward, *_, info in played], axis=0)
    return dict(zip(MEASURES, (totals / (EPISODES * SLOTS)).tolist(), strict=True))


_FREE, _DEAR = CONDITIONS = tuple(f"{DYNAMIC}, cost {cost}" for cost in COSTS)
_PLAIN, *_OTHERS = VARIANTS
_DATA = "published data"
PAPER = Paper(
    facts=read_facts("ali_2023"),
    players=(*VARIANTS, *RULES),
    conditions=CONDITIONS,
    measures=MEASURES,
    claims=(
        PaperClaim(
            "Learning avoids proactive jammers, whatever their strategy: it is jammed less than who stays",
            "abstract",
            differences("sent", {name: ((name, _FREE), (STAY, _FREE)) for name in VARIANTS}),
        ),
        PaperClaim(
            f"Without a target network {_PLAIN} falls behind the other four, cost 0",
            _DATA,
            differences("throughput", {name: ((name, _FREE), (_PLAIN, _FREE)) for name in _OTHERS}),
        ),
        PaperClaim(
            "Throughput falls as a change of channel costs more: 0 against 0.1, all but DQN",
            _DATA,
            differences("throughput", {name: ((name, _FREE), (name, _DEAR)) for name in _OTHERS}),
        ),
        PaperClaim(
            f"{_DUELING} earns more than the other four, cost 0.1",
            _DATA,
            differences(
                "throughput",
                {name: ((_DUELING, _DEAR), (name, _DEAR)) for name in VARIANTS if name != _DUELING},
            ),
        ),
        PaperClaim(
            "Learning earns more than a rule of one line, cost 0.1",
            "not asked in the paper",
            differences("throughput", {name: ((name, _DEAR), (LEAVE, _DEAR)) for name in VARIANTS}),
        ),
    ),
    play=play,
)
