"""Several seeds of MADDPG at once: networks of the same shape are updated as one batch of matrices.

Small networks spend their time between the operations, not in them: an update of ten seeds takes about one
and a half times as long as one of a single seed.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import torch
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from torch import nn

from fpg_bench.training.maddpg import MADDPG
from fpg_bench.training.maddpg_learner import Learner


def learn_together(seeded: Mapping[int, MADDPG], steps: int) -> None:
    """Train several models, each by its own games, buffer and chance, as ``learn`` would train it alone.

    Args:
        seeded: new ones by their training seeds, alike in everything else.
        steps: of each.
    """
    models = list(seeded.values())
    learner = _learner(models)
    chances = [_Chance(seed) for seed in seeded]
    callbacks = [model.begin_learning(steps) for model in models]
    first = models[0]
    while first.num_timesteps < steps:
        batches = []
        for model, chance, callback in zip(models, chances, callbacks, strict=True):
            with chance.of_its_own():
                model.collect_rollouts(
                    model.env,  # type: ignore[arg-type]
                    callback,
                    model.train_freq,  # type: ignore[arg-type]
                    model.replay_buffer,  # type: ignore[arg-type]
                    model.action_noise,
                    model.learning_starts,
                )
                updates = model.gradient_steps if model.num_timesteps > model.learning_starts else 0
                batches.append([model.replay_buffer.sample(model.batch_size) for _ in range(updates)])  # type: ignore[union-attr]
            model.count_updates(updates)
        for each in zip(*batches, strict=True):
            learner.update(_stacked(each))


class _Chance:
    """The numbers that NumPy's global generator would give to a model that is trained alone."""

    def __init__(self, seed: int) -> None:
        self._state = np.random.RandomState(seed).get_state()

    @contextlib.contextmanager
    def of_its_own(self) -> Iterator[None]:
        np.random.set_state(self._state)  # noqa: NPY002
        yield
        self._state = np.random.get_state()  # noqa: NPY002


class _Network:
    """The same network of several models: matrices ``(models, out, in)``, whose parts are the models' own."""

    def __init__(self, networks: Sequence[nn.Sequential]) -> None:
        self.weights: list[torch.Tensor] = []
        self._layers: list[Callable[[torch.Tensor], torch.Tensor]] = []
        for layers in zip(*networks, strict=True):
            if isinstance(layers[0], nn.Linear):
                weight, bias = (
                    self._shared([getattr(layer, name) for layer in layers]) for name in ("weight", "bias")
                )
                self._layers.append(partial(_linear, weight, bias))
            else:
                self._layers.append(layers[0])

    def _shared(self, parts: Sequence[nn.Parameter]) -> torch.Tensor:
        stacked = torch.stack([part.data for part in parts]).requires_grad_()
        for part, own in zip(parts, stacked.data, strict=True):
            part.data = own
        self.weights.append(stacked)
        return stacked

    def __call__(self, *inputs: torch.Tensor) -> torch.Tensor:
        x = torch.cat(inputs, -1)
        for layer in self._layers:
            x = layer(x)
        return x


def _linear(weight: torch.Tensor, bias: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    return torch.baddbmm(bias[:, None], x, weight.mT)


def _learner(models: Sequence[MADDPG]) -> Learner:
    """All models' networks as one; what it learns, they have learnt."""
    policies, first = [model.policy for model in models], models[0]
    players = range(len(first.policy.sizes))
    actors, actor_targets = (
        [_Network([getattr(policy, name)[player].mu[:-1] for policy in policies]) for player in players]
        for name in ("actors", "actor_targets")
    )
    critics, critic_targets = (
        [_Network([getattr(policy, name)[player].q_networks[0] for policy in policies]) for player in players]
        for name in ("critics", "critic_targets")
    )
    acting, judging = _weights(actors), _weights(critics)
    kind, rate = first.policy.optimizer_class, {"lr": first.lr_schedule(1), **first.policy.optimizer_kwargs}
    return Learner(
        first.policy.sizes,
        actors,
        critics,
        actor_targets,
        critic_targets,
        kind(acting, **rate),
        kind(judging, **rate),
        [each.data for each in acting + judging],
        [each.data for each in _weights(actor_targets + critic_targets)],
        first.gamma,
        first.tau,
        first.logit_penalty,
        first.logit_limit,
    )


def _weights(networks: Sequence[_Network]) -> list[torch.Tensor]:
    return [each for network in networks for each in network.weights]


def _stacked(batches: Sequence[ReplayBufferSamples]) -> ReplayBufferSamples:
    kinds = zip(*(batch[:5] for batch in batches), strict=True)
    return ReplayBufferSamples(*(torch.stack(parts) for parts in kinds))
