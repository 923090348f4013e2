"""Several seeds of MADDPG at once: networks of the same shape are updated as one batch of matrices.

Small networks spend their time between the operations, not in them: in torch an update of ten seeds takes
about twice as long as one of a single seed. :mod:`fpg_bench.training.maddpg_jax` takes that time away.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from torch import nn

from fpg_bench.errors import UserError, nearest
from fpg_bench.extras import need
from fpg_bench.training.maddpg import MADDPG, Transitions
from fpg_bench.training.maddpg_learner import Learner

if TYPE_CHECKING:
    from fpg_bench.training.maddpg_jax import JaxLearner


LEARNERS = ("torch", "jax")


class Together:
    """Several models that learn at once, each by its own games, buffer and chance, as it would alone.

    It can be pickled, and what comes of that goes on as this would.

    Args:
        seeded: new ones by their training seeds, alike in everything else.
        steps: of each.
        learner: who updates them: ``torch``, or ``jax``, which takes less time and needs the extra ``fast``.
            Both give the same weights but for the rounding of sums.

    Raises:
        UserError: another learner, or one whose packages are missing.
    """

    def __init__(self, seeded: Mapping[int, MADDPG], steps: int, learner: str = "torch") -> None:
        self._models, self._steps = list(seeded.values()), steps
        self._learning = find_learner(learner)(self._models)
        self._chances = [_Chance(seed) for seed in seeded]
        for model in self._models:
            model.begin_learning(steps)

    @property
    def done(self) -> bool:
        """Whether all steps are played; the models have all that was learned then."""
        return self._models[0].num_timesteps >= self._steps

    def go_on(self) -> None:
        """Play as many steps in all models' games as there are between updates, then update."""
        batches = list(map(self._played, self._models, self._chances))
        if len(batches[0].rewards):
            self._learning.learn(batches)
            self._learning.write_actors()
        if self.done:
            self._learning.write()

    def _played(self, model: MADDPG, chance: _Chance) -> Transitions:
        """The batches of the updates that follow what is played now."""
        with chance.of_its_own():
            return model.replay_buffer.sample_many(model.play_on(), model.batch_size)  # type: ignore[union-attr]


def find_learner(name: str) -> type[TorchLearner] | type[JaxLearner]:
    """The learner of a name: ``torch`` or ``jax``.

    Raises:
        UserError: another one, or one whose packages are missing.
    """
    if name not in LEARNERS:
        raise UserError(f"learner: expected torch or jax, got {name!r}{nearest(name, LEARNERS)}")
    if name == "torch":
        return TorchLearner
    need("fast", "jax", "optax")
    from fpg_bench.training.maddpg_jax import JaxLearner

    return JaxLearner


class _Chance:
    """The numbers that NumPy's global generator would give to a model that is trained alone."""

    def __init__(self, seed: int) -> None:
        self._state = np.random.RandomState(seed).get_state()

    @contextlib.contextmanager
    def of_its_own(self) -> Iterator[None]:
        np.random.set_state(self._state)  # noqa: NPY002
        yield
        self._state = np.random.get_state()  # noqa: NPY002


class TorchLearner:
    """The networks of several models, which are updated as one; what is learned, the models have at once.

    Args:
        models: alike in everything but their weights, buffers and chance.
    """

    def __init__(self, models: Sequence[MADDPG]) -> None:
        self._models, self._learner = models, _joined(models)

    def learn(self, batches: Sequence[Transitions]) -> None:
        """Update all models once with each of their batches.

        Args:
            batches: of each model, arrays ``(updates, n, size)``.
        """
        kinds = [torch.from_numpy(np.stack(parts, axis=1)) for parts in zip(*batches, strict=True)]
        for each in zip(*kinds, strict=True):
            self._learner.update(ReplayBufferSamples(*each))

    def write_actors(self) -> None:
        """Do nothing: the models' weights are parts of these."""

    def write(self) -> None:
        """Do nothing, either."""

    def __getstate__(self) -> dict[str, Any]:
        return {"models": self._models, "optimizers": [each.state_dict() for each in self._optimizers]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["models"])  # type: ignore[misc]
        for optimizer, moments in zip(self._optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(moments)

    @property
    def _optimizers(self) -> list[torch.optim.Optimizer]:
        return [self._learner.actor_optimizer, self._learner.critic_optimizer]


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


def _joined(models: Sequence[MADDPG]) -> Learner:
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
