"""Training of several MADDPG seeds in one process, by torch or by JAX."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import need
from fpg_bench.training.maddpg.maddpg import MADDPG, Transitions

if TYPE_CHECKING:
    from fpg_bench.training.maddpg.jax_learner import JaxLearner

LEARNERS = ("torch", "jax")


class MultiSeedTrainer:
    """Several models that learn in turns; each one is independent of the others.

    A trainer can be pickled; the copy continues exactly as the original would.

    Args:
        models: new models by their training seeds, alike in everything else.
        total_timesteps: steps of each model.
        learner: ``torch``, or ``jax``, which is faster and needs the extra ``fast``. Both give the same
            weights apart from the rounding of sums.

    Raises:
        UserError: an unknown learner, or one whose packages are missing.
    """

    def __init__(self, models: Mapping[int, MADDPG], total_timesteps: int, learner: str = "torch") -> None:
        check_learner(learner)
        self._models, self._total_timesteps = list(models.values()), total_timesteps
        self._jax: JaxLearner | None = None
        if learner == "jax":
            from fpg_bench.training.maddpg.jax_learner import JaxLearner

            self._jax = JaxLearner(self._models)
        self._rngs = [_GlobalRng(seed) for seed in models]
        for model in self._models:
            model.setup_learn(total_timesteps)

    @property
    def is_done(self) -> bool:
        """True once all steps are played; the models have all their weights then."""
        return self._models[0].num_timesteps >= self._total_timesteps

    def step(self) -> None:
        """Play the steps between updates in all models' games, then update the models."""
        batches = list(map(self._collect, self._models, self._rngs))
        if self._jax is None:
            for model, batch in zip(self._models, batches, strict=True):
                model.update(batch)
            return
        if len(batches[0].rewards):
            self._jax.learn(batches)
            self._jax.write_actors()
        if self.is_done:
            self._jax.write()

    def _collect(self, model: MADDPG, rng: _GlobalRng) -> Transitions:
        with rng.active():
            return model.collect()


def check_learner(name: str) -> None:
    """Raise UserError for an unknown learner, or one whose packages are missing."""
    if name not in LEARNERS:
        raise UserError(f"learner: expected torch or jax, got {name!r}{nearest(name, LEARNERS)}")
    if name == "jax":
        need("fast", "jax", "optax")


class _GlobalRng:
    """Per-model state of NumPy's global generator."""

    def __init__(self, seed: int) -> None:
        self._state = np.random.RandomState(seed).get_state()

    @contextlib.contextmanager
    def active(self) -> Iterator[None]:
        """Use and update this state inside the context."""
        np.random.set_state(self._state)  # noqa: NPY002
        yield
        self._state = np.random.get_state()  # noqa: NPY002
