"""MADDPG's updates compiled by JAX; they equal those of torch apart from rounding.

With small networks, most of torch's time passes between the operations. In one compiled program, consecutive
updates need no Python, and Adam's step for all weights is one operation on one vector. Needs the extra
``fast``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import torch
from torch import nn

from fpg_bench.common.errors import UserError
from fpg_bench.products.maddpg.maddpg import MADDPG, JointTransitions
from fpg_bench.products.maddpg.policies import JointPolicy

Shapes = tuple[tuple[tuple[int, int], ...], ...]  # input and output size of each layer of each network
Network = list[tuple[jax.Array, jax.Array]]  # matrix (inputs, outputs) and bias (outputs,) of each layer

_ACTIVATIONS: dict[type[nn.Module], Callable[[jax.Array], jax.Array]] = {
    nn.ReLU: jax.nn.relu,
    nn.Tanh: jnp.tanh,
    nn.SiLU: jax.nn.silu,
    nn.ELU: jax.nn.elu,
}
_ADAM_KWARGS = {"betas", "eps", "fused", "foreach"}
_TracedTransitions = Any  # JointTransitions of JAX arrays
_ONE_THREAD = {"xla_cpu_multi_thread_eigen": False}


class Networks(NamedTuple):
    """All actors of a model, or all critics.

    Attributes:
        weights: all layers of all players' networks, concatenated.
        targets: those of the target networks.
        moments: state of Adam.
    """

    weights: jax.Array
    targets: jax.Array
    moments: Any


class JaxLearner:
    """Updates of a model; compiled at the first one.

    During training the weights are here; :meth:`write_actors` and :meth:`write` copy them into the model.

    Args:
        model: the model.

    Raises:
        UserError: an optimizer or an activation that is not supported.
    """

    def __init__(self, model: MADDPG) -> None:
        update = _Update(model)
        self._model = model
        self._state = jax.device_put(_read_model(model.policy, update.adam), jax.devices("cpu")[0])
        scan = partial(jax.lax.scan, update)
        self._scan = jax.jit(scan, donate_argnums=0, compiler_options=_ONE_THREAD)

    def learn(self, total_timesteps: int) -> None:
        """Train the model, as its own ``learn`` does."""
        self._model.setup_learn(total_timesteps)
        while self._model.num_timesteps < total_timesteps:
            batches = self._model.collect()
            if len(batches.rewards):
                self.update(batches)
                self.write_actors()
        self.write()

    def update(self, batches: JointTransitions) -> None:
        """Update once with each of the batches, arrays ``(updates, n, size)``."""
        self._state, _ = self._scan(self._state, batches)

    def write_actors(self) -> None:
        """Copy the actors into the model, which acts by them."""
        _write(self._model.policy, "actors", self._state[0].weights)

    def write(self) -> None:
        """Copy all networks into the model, apart from the optimizers' moments."""
        for name, networks in zip(("actor", "critic"), self._state, strict=True):
            _write(self._model.policy, f"{name}s", networks.weights)
            _write(self._model.policy, f"{name}_targets", networks.targets)


class _Update:
    """One update of a model; raises UserError for one that is not supported."""

    def __init__(self, model: MADDPG) -> None:
        policy = model.policy
        if policy.activation_fn not in _ACTIVATIONS:
            known = ", ".join(kind.__name__ for kind in _ACTIVATIONS)
            raise UserError(
                f"learner jax: supports the activations {known}, not {policy.activation_fn.__name__}"
            )
        self.sizes, self.activation = policy.sizes, _ACTIVATIONS[policy.activation_fn]
        self.actor_shapes, self.critic_shapes = _shapes(policy, "actors"), _shapes(policy, "critics")
        self.adam = _adam(model)
        self.gamma, self.tau = model.gamma, model.tau
        self.logit_penalty, self.logit_limit = model.logit_penalty, model.logit_limit

    def __call__(
        self, state: list[Networks], batch: JointTransitions
    ) -> tuple[list[Networks], tuple[jax.Array, jax.Array]]:
        """Update critics, actors and targets once; returns the losses of critics and actors before."""
        actors, critics = state
        target_q = self._target_q(actors.targets, critics.targets, batch)
        critic_networks = _unpack(critics.weights, self.critic_shapes)
        critic_loss, gradient = jax.value_and_grad(self._critic_loss)(critic_networks, target_q, batch)
        critics = self._descend(critics, gradient)
        critic_networks = _unpack(critics.weights, self.critic_shapes)
        actor_networks = _unpack(actors.weights, self.actor_shapes)
        actor_loss, gradient = jax.value_and_grad(self._actor_loss)(actor_networks, critic_networks, batch)
        actors = self._descend(actors, gradient)
        return [self._polyak(actors), self._polyak(critics)], (critic_loss, actor_loss)

    def _target_q(
        self, actor_targets: jax.Array, critic_targets: jax.Array, batch: _TracedTransitions
    ) -> jax.Array:
        """Targets of the critics, ``(n, players)``."""
        actors, next_obs = _unpack(actor_targets, self.actor_shapes), batch.next_observations
        next_actions = jnp.tanh(jnp.concatenate(self._logits(actors, next_obs), -1))
        inputs = jnp.concatenate([next_obs, next_actions], -1)
        next_q = [self._forward(critic, inputs) for critic in _unpack(critic_targets, self.critic_shapes)]
        target_q: jax.Array = batch.rewards + (1 - batch.dones) * self.gamma * jnp.concatenate(next_q, -1)
        return target_q

    def _critic_loss(
        self, critics: list[Network], target_q: jax.Array, batch: _TracedTransitions
    ) -> jax.Array:
        inputs = jnp.concatenate([batch.observations, batch.actions], -1)
        q_values = jnp.concatenate([self._forward(critic, inputs) for critic in critics], -1)
        return jnp.square(q_values - target_q).sum() / len(target_q)

    def _actor_loss(
        self, actors: list[Network], critics: list[Network], batch: _TracedTransitions
    ) -> jax.Array:
        actions = jnp.split(batch.actions, np.cumsum([size for _, size in self.sizes])[:-1], -1)
        loss = jnp.zeros(())
        for player, logits in enumerate(self._logits(actors, batch.observations)):
            joint = [*actions[:player], jnp.tanh(logits), *actions[player + 1 :]]
            inputs = jnp.concatenate([batch.observations, *joint], -1)
            loss = loss - self._forward(critics[player], inputs).sum()
            excess = jax.nn.relu(jnp.abs(logits) - self.logit_limit)
            loss = loss + self.logit_penalty * jnp.square(excess).mean(-1).sum()
        return loss / len(batch.actions)

    def _logits(self, actors: list[Network], obs: jax.Array) -> list[jax.Array]:
        parts = jnp.split(obs, np.cumsum([size for size, _ in self.sizes])[:-1], -1)
        return [self._forward(actor, part) for actor, part in zip(actors, parts, strict=True)]

    def _forward(self, network: Network, x: jax.Array) -> jax.Array:
        """Apply a network to inputs ``(n, size)``."""
        for matrix, bias in network[:-1]:
            x = self.activation(x @ matrix + bias)
        matrix, bias = network[-1]
        return x @ matrix + bias

    def _descend(self, networks: Networks, gradient: list[Network]) -> Networks:
        vector = jnp.concatenate([each.ravel() for each in jax.tree.leaves(gradient)])
        step, moments = self.adam.update(vector, networks.moments)
        return networks._replace(weights=networks.weights + step, moments=moments)

    def _polyak(self, networks: Networks) -> Networks:
        return networks._replace(targets=networks.targets + self.tau * (networks.weights - networks.targets))


def _adam(model: MADDPG) -> optax.GradientTransformation:
    """Return the policy's optimizer; raises UserError if it is not Adam."""
    kind, kwargs = model.policy.optimizer_class, model.policy.optimizer_kwargs
    if kind is not torch.optim.Adam or set(kwargs) - _ADAM_KWARGS:
        shown = ", ".join(f"{name}={value}" for name, value in kwargs.items())
        raise UserError(f"learner jax: supports Adam with betas and eps, not {kind.__name__}({shown})")
    beta_1, beta_2 = kwargs.get("betas", (0.9, 0.999))
    return optax.adam(model.lr_schedule(1), beta_1, beta_2, kwargs.get("eps", 1e-8))


def _linears(network: nn.Module) -> list[nn.Linear]:
    return [layer for layer in network.modules() if isinstance(layer, nn.Linear)]


def _shapes(policy: JointPolicy, name: str) -> Shapes:
    """Return the shapes of the networks of a name: ``actors`` or ``critics``, of all players."""
    return tuple(
        tuple((layer.in_features, layer.out_features) for layer in _linears(network))
        for network in getattr(policy, name)
    )


def _read_model(policy: JointPolicy, adam: optax.GradientTransformation) -> list[Networks]:
    """Return the initial state of a model: its actors, then its critics."""
    state = []
    for name in ("actor", "critic"):
        weights = _read(policy, f"{name}s")
        state.append(Networks(weights, _read(policy, f"{name}_targets"), adam.init(weights)))
    return state


def _read(policy: JointPolicy, name: str) -> jax.Array:
    """Return the weights of all networks of a name, concatenated."""
    linears = _linears(getattr(policy, name))
    parts = [part.ravel() for layer in linears for part in (layer.weight.data.T, layer.bias.data)]
    return jnp.array(torch.cat(parts).numpy())


def _write(policy: JointPolicy, name: str, weights: jax.Array) -> None:
    """Copy the weights into all networks of a name; the inverse of :func:`_read`."""
    networks = _unpack(torch.from_numpy(np.array(weights)), _shapes(policy, name))
    layers = [layer for network in networks for layer in network]
    for linear, (matrix, bias) in zip(_linears(getattr(policy, name)), layers, strict=True):
        linear.weight.data.copy_(matrix.T)
        linear.bias.data.copy_(bias)


def _unpack(vector: Any, shapes: Shapes) -> list[Any]:
    """Return the networks whose weights are concatenated in a vector of JAX or torch."""
    networks, start = [], 0
    for layers in shapes:
        network = []
        for inputs, outputs in layers:
            middle = start + inputs * outputs
            end = middle + outputs
            network.append((vector[start:middle].reshape(inputs, outputs), vector[middle:end]))
            start = end
        networks.append(network)
    return networks
