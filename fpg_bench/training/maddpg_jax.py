"""MADDPG's updates compiled by JAX: those of :mod:`fpg_bench.training.maddpg_learner` but for rounding.

Small networks spend their time between the operations, not in them. Compiled into one program, updates that
follow each other need no Python, and Adam's step for all weights is one operation on one vector. Needs the
extra ``fast``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import torch
from torch import nn

from fpg_bench.errors import UserError
from fpg_bench.training.maddpg import MADDPG, Transitions
from fpg_bench.training.maddpg_learner import Sizes
from fpg_bench.training.maddpg_policy import JointPolicy

Shapes = tuple[tuple[tuple[int, int], ...], ...]  # inputs and outputs of each network's layers
Network = list[tuple[jax.Array, jax.Array]]  # a matrix (inputs, outputs) and a bias (outputs,) a layer

_ACTIVATIONS: dict[type[nn.Module], Callable[[jax.Array], jax.Array]] = {
    nn.ReLU: jax.nn.relu,
    nn.Tanh: jnp.tanh,
    nn.SiLU: jax.nn.silu,
    nn.ELU: jax.nn.elu,
}
_ADAM_S = {"betas", "eps", "fused", "foreach"}
_Traced = Any  # Transitions, whose arrays are JAX's while they are traced
_ONE_THREAD = {"xla_cpu_multi_thread_eigen": False}


class Part(NamedTuple):
    """All actors of a model, or all critics.

    Attributes:
        weights: of all layers of all players, one after the other.
        targets: those of the target networks.
        moments: Adam's.
    """

    weights: jax.Array
    targets: jax.Array
    moments: Any


class JaxLearner:
    """The networks of several models, updated one model after the other; compiled at the first update.

    A model's networks stay in the processor's cache for all updates of a call, so that there is nothing to
    gain by updating the models as one batch, as torch does. While they learn, the weights are here:
    :meth:`write_actors` and :meth:`write` put them into the models.

    Args:
        models: alike in everything but their weights, buffers and chance.

    Raises:
        UserError: an optimiser or an activation that it does not know.
    """

    def __init__(self, models: Sequence[MADDPG]) -> None:
        rules, cpu = _rules(models[0]), jax.devices("cpu")[0]
        self._models = models
        self._parts = [jax.device_put(_parts(model.policy, rules.adam), cpu) for model in models]
        learn = partial(jax.lax.scan, rules.update)
        self._learn = jax.jit(learn, donate_argnums=0, compiler_options=_ONE_THREAD)

    def learn(self, batches: Sequence[Transitions]) -> None:
        """Update all models once with each of their batches.

        Args:
            batches: of each model, arrays ``(updates, n, size)``.
        """
        self._parts = [
            self._learn(parts, batch)[0] for parts, batch in zip(self._parts, batches, strict=True)
        ]

    def write_actors(self) -> None:
        """Let the models act by what was learned."""
        for model, (actors, _) in zip(self._models, self._parts, strict=True):
            _write(model.policy, "actors", actors.weights)

    def write(self) -> None:
        """Let the models have all that was learned, but the optimisers' moments."""
        for model, parts in zip(self._models, self._parts, strict=True):
            for name, part in zip(("actor", "critic"), parts, strict=True):
                _write(model.policy, f"{name}s", part.weights)
                _write(model.policy, f"{name}_targets", part.targets)

    def __getstate__(self) -> dict[str, Any]:
        return {"models": self._models, "parts": jax.device_get(self._parts)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["models"])  # type: ignore[misc]
        self._parts = jax.device_put(state["parts"], jax.devices("cpu")[0])


@dataclass(frozen=True)
class _Rules:
    """How one model is updated; the words are those of :class:`fpg_bench.training.maddpg_learner.Learner`."""

    sizes: Sizes
    actor_shapes: Shapes
    critic_shapes: Shapes
    activation: Callable[[jax.Array], jax.Array]
    adam: optax.GradientTransformation
    gamma: float
    tau: float
    logit_penalty: float
    logit_limit: float

    def update(self, parts: list[Part], batch: Transitions) -> tuple[list[Part], tuple[jax.Array, jax.Array]]:
        """Update critics, actors and targets once; gives the losses of critics and actors before."""
        actors, critics = parts
        wanted = self._wanted(actors.targets, critics.targets, batch)
        judges = _unpacked(critics.weights, self.critic_shapes)
        critic_loss, slope = jax.value_and_grad(self._critic_loss)(judges, wanted, batch)
        critics = self._descended(critics, slope)
        judges = _unpacked(critics.weights, self.critic_shapes)
        players = _unpacked(actors.weights, self.actor_shapes)
        actor_loss, slope = jax.value_and_grad(self._actor_loss)(players, judges, batch)
        actors = self._descended(actors, slope)
        return [self._followed(actors), self._followed(critics)], (critic_loss, actor_loss)

    def _wanted(self, actor_targets: jax.Array, critic_targets: jax.Array, batch: _Traced) -> jax.Array:
        """What the critics should say, ``(n, players)``."""
        players, seen = _unpacked(actor_targets, self.actor_shapes), batch.next_observations
        acts = jnp.tanh(jnp.concatenate(self._logits(players, seen), -1))
        judged = jnp.concatenate([seen, acts], -1)
        future = [self._made(critic, judged) for critic in _unpacked(critic_targets, self.critic_shapes)]
        return batch.rewards + (1 - batch.dones) * self.gamma * jnp.concatenate(future, -1)

    def _critic_loss(self, critics: list[Network], wanted: jax.Array, batch: _Traced) -> jax.Array:
        judged = jnp.concatenate([batch.observations, batch.actions], -1)
        found = jnp.concatenate([self._made(critic, judged) for critic in critics], -1)
        return jnp.square(found - wanted).sum() / len(wanted)

    def _actor_loss(self, actors: list[Network], critics: list[Network], batch: _Traced) -> jax.Array:
        did = jnp.split(batch.actions, np.cumsum([size for _, size in self.sizes])[:-1], -1)
        loss = jnp.zeros(())
        for player, logits in enumerate(self._logits(actors, batch.observations)):
            acts = [*did[:player], jnp.tanh(logits), *did[player + 1 :]]
            judged = jnp.concatenate([batch.observations, *acts], -1)
            loss = loss - self._made(critics[player], judged).sum()
            beyond = jax.nn.relu(jnp.abs(logits) - self.logit_limit)
            loss = loss + self.logit_penalty * jnp.square(beyond).mean(-1).sum()
        return loss / len(batch.actions)

    def _logits(self, actors: list[Network], observations: jax.Array) -> list[jax.Array]:
        seen = jnp.split(observations, np.cumsum([size for size, _ in self.sizes])[:-1], -1)
        return [self._made(actor, part) for actor, part in zip(actors, seen, strict=True)]

    def _made(self, network: Network, x: jax.Array) -> jax.Array:
        """What a network makes of its inputs ``(n, size)``."""
        for matrix, bias in network[:-1]:
            x = self.activation(x @ matrix + bias)
        matrix, bias = network[-1]
        return x @ matrix + bias

    def _descended(self, part: Part, slope: list[Network]) -> Part:
        steepest = jnp.concatenate([each.ravel() for each in jax.tree.leaves(slope)])
        step, moments = self.adam.update(steepest, part.moments)
        return part._replace(weights=part.weights + step, moments=moments)

    def _followed(self, part: Part) -> Part:
        return part._replace(targets=part.targets + self.tau * (part.weights - part.targets))


def _rules(model: MADDPG) -> _Rules:
    policy = model.policy
    if policy.activation_fn not in _ACTIVATIONS:
        known = ", ".join(kind.__name__ for kind in _ACTIVATIONS)
        raise UserError(f"learner jax: knows the activations {known}, not {policy.activation_fn.__name__}")
    return _Rules(
        policy.sizes,
        _shapes(policy, "actors"),
        _shapes(policy, "critics"),
        _ACTIVATIONS[policy.activation_fn],
        _adam(model),
        model.gamma,
        model.tau,
        model.logit_penalty,
        model.logit_limit,
    )


def _adam(model: MADDPG) -> optax.GradientTransformation:
    """The policy's optimiser, which has to be Adam."""
    kind, words = model.policy.optimizer_class, model.policy.optimizer_kwargs
    if kind is not torch.optim.Adam or set(words) - _ADAM_S:
        told = ", ".join(f"{name}={value}" for name, value in words.items())
        raise UserError(f"learner jax: knows Adam with betas and eps, not {kind.__name__}({told})")
    first, second = words.get("betas", (0.9, 0.999))
    return optax.adam(model.lr_schedule(1), first, second, words.get("eps", 1e-8))


def _linears(network: nn.Module) -> list[nn.Linear]:
    return [layer for layer in network.modules() if isinstance(layer, nn.Linear)]


def _shapes(policy: JointPolicy, name: str) -> Shapes:
    """Of the networks of a name: actors or critics of all players."""
    return tuple(
        tuple((layer.in_features, layer.out_features) for layer in _linears(network))
        for network in getattr(policy, name)
    )


def _parts(policy: JointPolicy, adam: optax.GradientTransformation) -> list[Part]:
    """What a model begins with: its actors, then its critics."""
    found = []
    for name in ("actor", "critic"):
        weights = _read(policy, f"{name}s")
        found.append(Part(weights, _read(policy, f"{name}_targets"), adam.init(weights)))
    return found


def _read(policy: JointPolicy, name: str) -> jax.Array:
    """The weights of all networks of a name, one after the other."""
    linears = _linears(getattr(policy, name))
    parts = [part.ravel() for layer in linears for part in (layer.weight.data.T, layer.bias.data)]
    return jnp.array(torch.cat(parts).numpy())


def _write(policy: JointPolicy, name: str, weights: jax.Array) -> None:
    """Undo :func:`_read`."""
    networks = _unpacked(torch.from_numpy(np.array(weights)), _shapes(policy, name))
    layers = [layer for network in networks for layer in network]
    for linear, (matrix, bias) in zip(_linears(getattr(policy, name)), layers, strict=True):
        linear.weight.data.copy_(matrix.T)
        linear.bias.data.copy_(bias)


def _unpacked(vector: Any, shapes: Shapes) -> list[Any]:
    """The networks whose weights lie in a vector, of JAX or of torch, one after the other."""
    networks, at = [], 0
    for layers in shapes:
        network = []
        for inputs, outputs in layers:
            bias = at + inputs * outputs
            network.append((vector[at:bias].reshape(inputs, outputs), vector[bias : bias + outputs]))
            at = bias + outputs
        networks.append(network)
    return networks
