"""Liu, Xu, Jia, Wu and Anpalagan 2018: deep Q-learning on the spectrum waterfall (arXiv 1710.04830)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from fpg_bench.common.checks import one_of
from fpg_bench.evaluation.seeds import EVALUATION_START
from fpg_bench.products.papers.learners import q_learning
from fpg_bench.products.papers.reproduction import (
    Paper,
    PaperClaim,
    PaperResults,
    checked_action,
    differences,
    read_facts,
)

BAND_MHZ, BIN_MHZ, WIDTH_MHZ, STEP_MHZ, ROLL_OFF = 20.0, 0.1, 4.0, 2.0, 0.3
SIGNAL_DBM, JAMMER_DBM, NOISE_DBM, THRESHOLD_DB = 0.0, 30.0, -80.0, 10.0
SLOT_MS, ROW_MS, ROWS, EPISODE = 10, 2, 20, 200
HOP_COST = 0.2
CHANNELS_MHZ = np.arange(STEP_MHZ, BAND_MHZ, STEP_MHZ)
JAMMERS = ("sweep", "comb", "random", "intelligent")
COMB_MHZ = np.array([2.0, 10.0, 18.0])
SWEEP_MHZ_PER_MS, RANDOM_SLOTS, RANDOM_STEP_MHZ, MEMORY = 1.0, 2, 4.0, 20
STEPS, EPISODES, GAMMA, EXPLORED, LEAST = 1_000, 2, 0.8, 0.5, 0.02
MEASURES = {
    "throughput": "share of the time in which the signal was received",
    "reward": "throughput, less 0.2 for each change of channel",
    "hops": "share of slots with a change of channel",
}
_LOW_DBM, _HIGH_DBM, _LOOKS = -100.0, 40.0, 10.0
_BINS_MHZ = (np.arange(round(BAND_MHZ / BIN_MHZ)) + 0.5) * BIN_MHZ


def spectrum(centres_mhz: np.ndarray, power_dbm: float) -> np.ndarray:
    """Return the power of raised-cosine signals in each bin in mW, ``(*centres, bins)``."""
    flat, edge = (WIDTH_MHZ / 2 * share for share in ((1 - ROLL_OFF) / (1 + ROLL_OFF), 1.0))
    distance = np.abs(_BINS_MHZ - np.asarray(centres_mhz)[..., None])
    shape = (1 + np.cos(np.pi * np.clip((distance - flat) / (edge - flat), 0, 1))) / 2
    return np.asarray(10 ** (power_dbm / 10) * shape * BIN_MHZ * (1 + ROLL_OFF) / WIDTH_MHZ)


class WaterfallEnv(gymnasium.Env[np.ndarray, np.int64]):
    """A sender chooses one of nine overlapping channels every 10 ms, and sees the spectrum waterfall.

    The observation is the power that its receiver measured in 200 bins over the last 40 ms, in rows of 2 ms,
    the newest last: ``(1, 20, 200)``, bytes that stand for -100 to 40 dBm. The reward is the share of the
    slot in which the SINR is at least 10 dB, less 0.2 for a change of channel.

    Args:
        jammer: ``sweep``, ``comb``, ``random`` or ``intelligent``.

    Raises:
        UserError: a jammer that the paper lacks.
    """

    def __init__(self, jammer: str = "sweep") -> None:
        self.jammer = one_of(jammer, "jammer", JAMMERS)
        self.action_space = gymnasium.spaces.Discrete(len(CHANNELS_MHZ))
        self.observation_space = gymnasium.spaces.Box(0, 255, (1, ROWS, len(_BINS_MHZ)), np.uint8)
        self._signals = spectrum(CHANNELS_MHZ, SIGNAL_DBM)
        self._bands = np.abs(_BINS_MHZ - CHANNELS_MHZ[:, None]) <= WIDTH_MHZ / 2
        self._rows = np.zeros((ROWS, len(_BINS_MHZ)))
        self._slot = self.channel = 0
        self._chosen: list[int] = []
        self._random_mhz = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode after 40 ms on a random channel."""
        super().reset(seed=seed)
        self._slot, self._chosen = 0, []
        self.channel = int(self.np_random.integers(len(CHANNELS_MHZ)))
        for _ in range(ROWS * ROW_MS // SLOT_MS):
            self._play(self.channel)
        return self._waterfall(), {}

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Send for a slot."""
        channel = checked_action(action, self.action_space)
        hopped = channel != self.channel
        throughput = self._play(channel)
        over = self._slot >= EPISODE + ROWS * ROW_MS // SLOT_MS
        reward = throughput - HOP_COST * hopped
        return self._waterfall(), reward, False, over, {"throughput": throughput, "hopped": hopped}

    def _play(self, channel: int) -> float:
        """Play a slot on a channel, and return the share of it that was received."""
        jamming = self._jamming()
        self._slot, self.channel = self._slot + 1, channel
        self._chosen = [*self._chosen, channel][-MEMORY:]
        noise = 10 ** (NOISE_DBM / 10)
        interference = (jamming + noise) @ self._bands[channel]
        power = (jamming + self._signals[channel] + noise).reshape(-1, ROW_MS, len(_BINS_MHZ)).mean(1)
        measured = power * self.np_random.gamma(_LOOKS, 1 / _LOOKS, power.shape)
        self._rows = np.concatenate([self._rows[len(measured) :], measured])
        sinr_db = SIGNAL_DBM - 10 * np.log10(interference)
        return float((sinr_db >= THRESHOLD_DB).mean())

    def _jamming(self) -> np.ndarray:
        """Return the jammer's power in each bin and millisecond of the slot to come, in mW."""
        times = self._slot * SLOT_MS + np.arange(SLOT_MS) + 0.5
        if self.jammer == "sweep":
            return spectrum(times * SWEEP_MHZ_PER_MS % BAND_MHZ, JAMMER_DBM)
        if self.jammer == "comb":
            centres = COMB_MHZ
        elif self.jammer == "random":
            if self._slot % RANDOM_SLOTS == 0:
                choices = np.arange(WIDTH_MHZ / 2, BAND_MHZ, RANDOM_STEP_MHZ)
                self._random_mhz = float(self.np_random.choice(choices))
            centres = np.array([self._random_mhz])
        else:
            counts = np.bincount(self._chosen, minlength=len(CHANNELS_MHZ))
            centres = CHANNELS_MHZ[[counts.argmax()]]
        return np.tile(spectrum(centres, JAMMER_DBM).sum(0), (SLOT_MS, 1))

    def _waterfall(self) -> np.ndarray:
        share = (10 * np.log10(self._rows) - _LOW_DBM) / (_HIGH_DBM - _LOW_DBM)
        return np.clip(255 * share, 0, 255).astype(np.uint8)[None]


class WaterfallNetwork(BaseFeaturesExtractor):
    """A convolution over the waterfall, and a dense layer."""

    def __init__(self, observation_space: gymnasium.spaces.Box) -> None:
        super().__init__(observation_space, features_dim=64)
        convolution = torch.nn.Conv2d(1, 8, kernel_size=(5, 10), stride=(5, 10))
        size = convolution(torch.zeros(1, *observation_space.shape)).numel()
        self.layers = torch.nn.Sequential(
            convolution, torch.nn.ReLU(), torch.nn.Flatten(), torch.nn.Linear(size, 64), torch.nn.ReLU()
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the features."""
        features: torch.Tensor = self.layers(observations)
        return features


def strongest(waterfall: np.ndarray) -> int:
    """Return the channel with the greatest power in the last row: that of the jammer."""
    near = np.abs(_BINS_MHZ - CHANNELS_MHZ[:, None]) < STEP_MHZ / 2
    return int((near @ waterfall[0, -1].astype(float)).argmax())


def learned(player: str, env: WaterfallEnv, steps: int, seed: int) -> Callable[[np.ndarray], int]:
    """Train a player, and return what it chooses without exploration."""
    count = len(CHANNELS_MHZ)
    if player == "random":
        generator = np.random.default_rng(seed)
        return lambda waterfall: int(generator.integers(count))
    if player == "Q-learning":

        def state_of(waterfall: np.ndarray) -> int:
            return env.channel * count + strongest(waterfall)

        explored: Callable[[float], float] = lambda share: max(1 - share / EXPLORED, LEAST)  # noqa: E731
        values = q_learning(env, state_of, count**2, steps, seed, rate=0.5, gamma=GAMMA, exploration=explored)
        return lambda waterfall: int(values[state_of(waterfall)].argmax())
    torch.set_num_threads(1)
    model = DQN(
        "CnnPolicy",
        env,
        learning_rate=1e-3,
        buffer_size=5_000,
        batch_size=64,
        learning_starts=100,
        gamma=GAMMA,
        train_freq=4,
        target_update_interval=100,
        exploration_fraction=EXPLORED,
        exploration_final_eps=LEAST,
        policy_kwargs={
            "features_extractor_class": WaterfallNetwork,
            "net_arch": [],
            "optimizer_kwargs": {"fused": True},
        },
        seed=seed,
        device="cpu",
    )
    model.learn(steps)
    return lambda waterfall: int(model.predict(waterfall, deterministic=True)[0])


def play(player: str, condition: str, seed: int, share: float) -> dict[str, float]:
    """Train a player against a jammer, and measure it over a few episodes without exploration."""
    env = WaterfallEnv(condition)
    choose = learned(player, env, max(200, round(STEPS * share)), seed)
    totals = np.zeros(len(MEASURES))
    for episode in range(EPISODES):
        waterfall, over = env.reset(seed=EVALUATION_START + seed * EPISODES + episode)[0], False
        while not over:
            waterfall, reward, _, over, info = env.step(np.int64(choose(waterfall)))
            totals += info["throughput"], reward, info["hopped"]
    return dict(zip(MEASURES, (totals / (EPISODES * EPISODE)).tolist(), strict=True))


# Greatest throughput without a cost, of a sender that knows the jammer but not its next random choice.
OPTIMUM = {"sweep": 1.0, "comb": 1.0, "random": 0.9}
_CLOSE = 0.95


def _more_than(rival: str) -> Callable[[PaperResults], Mapping[str, np.ndarray]]:
    return differences("throughput", {name: (("DQN", name), (rival, name)) for name in JAMMERS})


def _reaches(levels: Mapping[str, float]) -> Callable[[PaperResults], Mapping[str, np.ndarray]]:
    return lambda results: {
        f"{jammer} - {level:.3g}": results.values("DQN", jammer, "throughput") - level
        for jammer, level in levels.items()
    }


PAPER = Paper(
    facts=read_facts("liu_2018"),
    players=("DQN", "Q-learning", "random"),
    conditions=JAMMERS,
    measures=MEASURES,
    claims=(
        PaperClaim(
            "Comb jamming is almost completely avoided: throughput close to one",
            "Sec. IV, p. 4",
            _reaches({"comb": _CLOSE}),
        ),
        PaperClaim(
            f"The learner obtains optimal strategies: {_CLOSE} of the optimum",
            "abstract",
            _reaches({jammer: _CLOSE * best for jammer, best in OPTIMUM.items()}),
        ),
        PaperClaim(
            "One learner serves in various scenarios without knowing the pattern: more than random channels",
            "abstract",
            _more_than("random"),
        ),
        PaperClaim(
            "A deep network earns more than a table of states",
            "not in what is quoted",
            _more_than("Q-learning"),
        ),
    ),
    play=play,
)
