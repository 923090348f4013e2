"""What MADDPG learns by: the losses of all players' critics and actors, and an update of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from torch.nn import functional

Sizes = tuple[tuple[int, int], ...]
ActorNetwork = Callable[[torch.Tensor], torch.Tensor]
CriticNetwork = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]


@dataclass(frozen=True)
class Learner:
    """The networks of all players (Lowe et al. 2017, Algorithm 1), of one model or of several at once.

    Batches are ``(n, size)``, or ``(models, n, size)`` where networks take several models' at once.

    Attributes:
        sizes: of each player's observation and action.
        actors, actor_targets: of each player, from its own observation to its logits ``(..., n, size)``, of
            which tanh makes its action.
        critics, critic_targets: of each player, from all observations and all actions to ``(..., n, 1)``.
        actor_optimizer, critic_optimizer: of the weights of all actors, and of all critics.
        weights, targets: of actors and critics, and of their targets in the same order.
        gamma, tau: the discount, and how much of the weights goes into the targets at an update.
        logit_penalty, logit_limit: the mean square of what an actor's logits are beyond the limit costs it so
            much, in units of its critic.
    """

    sizes: Sizes
    actors: Sequence[ActorNetwork]
    critics: Sequence[CriticNetwork]
    actor_targets: Sequence[ActorNetwork]
    critic_targets: Sequence[CriticNetwork]
    actor_optimizer: torch.optim.Optimizer
    critic_optimizer: torch.optim.Optimizer
    weights: list[torch.Tensor]
    targets: list[torch.Tensor]
    gamma: float
    tau: float
    logit_penalty: float
    logit_limit: float

    def update(self, batch: ReplayBufferSamples) -> tuple[torch.Tensor, torch.Tensor]:
        """Update critics, actors and targets once; gives the losses of critics and actors before."""
        critic_loss = self._critic_loss(batch)
        _descend(critic_loss, self.critic_optimizer)
        actor_loss = self._actor_loss(batch)
        _descend(actor_loss, self.actor_optimizer)
        torch._foreach_lerp_(self.targets, self.weights, self.tau)  # Polyak's average
        return critic_loss, actor_loss

    def _critic_loss(self, batch: ReplayBufferSamples) -> torch.Tensor:
        """The mean squared error of each critic's estimate of its player's return, summed over players."""
        with torch.no_grad():
            seen = batch.next_observations
            acts = torch.cat(each_its_own(self.sizes, self.actor_targets, seen), -1).tanh()
            future = torch.cat([critic(seen, acts) for critic in self.critic_targets], -1)
            wanted = batch.rewards + (1 - batch.dones) * self.gamma * future
        found = [critic(batch.observations, batch.actions) for critic in self.critics]
        return functional.mse_loss(torch.cat(found, -1), wanted, reduction="sum") / wanted.shape[-2]

    def _actor_loss(self, batch: ReplayBufferSamples) -> torch.Tensor:
        """How little each critic expects where its player acts by its actor and the others as they did.

        To this comes the penalty on the actors' logits.
        """
        did = batch.actions.split([size for _, size in self.sizes], dim=-1)
        loss = torch.zeros(())
        for player, logits in enumerate(each_its_own(self.sizes, self.actors, batch.observations)):
            acts = torch.cat([*did[:player], logits.tanh(), *did[player + 1 :]], -1)
            loss = loss - self.critics[player](batch.observations, acts).sum()
            beyond = (logits.abs() - self.logit_limit).relu()
            loss = loss + self.logit_penalty * beyond.square().mean(-1).sum()
        return loss / batch.actions.shape[-2]


def each_its_own(
    sizes: Sizes, actors: Sequence[ActorNetwork], observation: torch.Tensor
) -> list[torch.Tensor]:
    """What each actor makes of its own part of the observation ``(..., n, all)``."""
    seen = observation.split([size for size, _ in sizes], dim=-1)
    return [actor(part) for actor, part in zip(actors, seen, strict=True)]


def _descend(loss: torch.Tensor, optimizer: torch.optim.Optimizer) -> None:
    optimizer.zero_grad()
    loss.backward(inputs=optimizer.param_groups[0]["params"])  # not those of critics that judge an actor
    optimizer.step()
