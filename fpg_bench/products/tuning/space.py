"""Search spaces: the hyper-parameters to tune and their ranges, read from YAML."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import optuna
from pydantic import Field, field_validator, model_validator

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml
from fpg_bench.common.schema import Expected, Strict, parse
from fpg_bench.players.agent import shipped_files
from fpg_bench.training.rl_zoo3_format import Entry

_MOST = 10**12
Number = Annotated[float, Field(ge=-_MOST, le=_MOST), Expected("a number (1.0e-4, not 1e-4)")]
Whole = Annotated[int, Field(ge=-_MOST, le=_MOST), Expected("a whole number")]


class _Interval(Strict):
    """Base class of numeric ranges."""

    low: Any
    high: Any
    log: bool = False

    @model_validator(mode="after")
    def _check(self) -> _Interval:
        if self.low > self.high:
            raise UserError(f"low {self.low:g} is above high {self.high:g}")
        if self.log and self.low <= 0:
            raise UserError(f"low {self.low:g}: a logarithmic range must start above 0")
        return self

    def __contains__(self, value: object) -> bool:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and bool(self.low <= value <= self.high)

    def first(self) -> Any:
        """Return the lowest value."""
        return self.low


class FloatRange(_Interval):
    """A float from ``low`` to ``high``, with ``log`` on a logarithmic scale."""

    kind: Literal["float"]
    low: Number
    high: Number

    def suggest(self, trial: optuna.trial.BaseTrial, name: str) -> float:
        """Suggest a value, rounded to four digits so that the exact value can be written to a file."""
        return float(f"{trial.suggest_float(name, self.low, self.high, log=self.log):.4g}")


class IntRange(_Interval):
    """An integer from ``low`` to ``high``, with ``log`` on a logarithmic scale."""

    kind: Literal["int"]
    low: Whole
    high: Whole

    def suggest(self, trial: optuna.trial.BaseTrial, name: str) -> int:
        """Suggest a value."""
        return trial.suggest_int(name, self.low, self.high, log=self.log)


class Choice(Strict):
    """One of a list of values, which may themselves be lists or mappings."""

    kind: Literal["choice"]
    choices: Annotated[list[Any], Field(min_length=1)]

    @field_validator("choices")
    @classmethod
    def _check(cls, choices: list[Any]) -> list[Any]:
        try:
            json.dumps(choices, allow_nan=False)
        except (TypeError, ValueError):  # such as a date
            raise UserError(f"expected words or finite numbers, got {choices!r:.60}") from None
        return choices

    def suggest(self, trial: optuna.trial.BaseTrial, name: str) -> Any:
        """Suggest a value."""
        params = [_to_categorical(choice) for choice in self.choices]
        return self.choices[params.index(trial.suggest_categorical(name, params))]

    def __contains__(self, value: object) -> bool:
        return value in self.choices

    def first(self) -> Any:
        """Return the first choice."""
        return self.choices[0]


def _to_categorical(choice: object) -> Any:
    """Return a choice as Optuna can store it: lists and mappings become JSON."""
    return json.dumps(choice) if isinstance(choice, list | dict) else choice


# By hyper-parameter; a dot in a name leads into a mapping (``policy_kwargs.net_arch``).
Space = dict[str, Annotated[FloatRange | IntRange | Choice, Field(discriminator="kind")]]


def load_space(algorithm: str, file: Path | None = None, actions: str = "continuous") -> Space:
    """Load the search space of an algorithm.

    Args:
        algorithm: name of the algorithm, without its stacked frames.
        file: a YAML file; None for the shipped one.
        actions: action mode; PPO has a separate space for discrete actions.

    Raises:
        UserError: there is no shipped space, or the file is not a search space.
    """
    shipped = shipped_files("search")
    is_discrete = algorithm == "ppo" and actions != "continuous"
    path = file or shipped.get("ppo-discrete" if is_discrete else algorithm)
    if path is None:
        raise UserError(
            f"no search space for {algorithm!r}{nearest(algorithm, shipped)} (or provide your own file)"
        )
    content = read_yaml(path, "search space")
    if not content:
        raise UserError(f"search space {path}: names no hyper-parameter")
    for name in content:
        if not isinstance(name, str) or name == "n_timesteps":
            raise UserError(f"search space {path}: {name!r} is not a hyper-parameter that can be tuned")
    return parse(Space, content, f"search space {path}")


def suggest(space: Space, trial: optuna.trial.BaseTrial) -> Entry:
    """Return the values that the sampler suggests for a trial, by hyper-parameter."""
    return {name: values.suggest(trial, name) for name, values in space.items()}


def from_params(space: Space, params: Entry) -> Entry:
    """Return the values of a trial from the parameters that Optuna stored."""
    return suggest(space, optuna.trial.FixedTrial(params))


def to_params(space: Space, hyperparameters: Mapping[str, object]) -> Entry:
    """Return the hyper-parameters that lie in the space, as Optuna stores them."""
    present = {name: _look_up(hyperparameters, name) for name in space}
    return {name: _to_categorical(value) for name, value in present.items() if value in space[name]}


def merge_values(hyperparameters: Mapping[str, object], values: Mapping[str, object]) -> Entry:
    """Return a copy of the hyper-parameters with some values replaced; dots lead into mappings."""
    merged: Entry = copy.deepcopy(dict(hyperparameters))
    for name, value in values.items():
        *outer, last = name.split(".")
        inner = merged
        for key in outer:
            inner = inner[key] if isinstance(inner.get(key), dict) else inner.setdefault(key, {})
        inner[last] = value
    return merged


def _look_up(hyperparameters: object, name: str) -> Any:
    for key in name.split("."):
        if not isinstance(hyperparameters, Mapping) or key not in hyperparameters:
            return None
        hyperparameters = hyperparameters[key]
    return hyperparameters


def format_values(values: Mapping[str, object]) -> str:
    """Return values by name, in one line."""
    return ", ".join(
        f"{name} {v:.3g}" if isinstance(v, float) else f"{name} {v}" for name, v in values.items()
    )
