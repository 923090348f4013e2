"""Search spaces as data: which hyper-parameters are tried, and in which range."""

from __future__ import annotations

import copy
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna

from fpg_bench.common.checks import check_keys, flag
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml
from fpg_bench.players.agent import baselines_folder

_KEYS = {"float": {"low", "high", "log"}, "int": {"low", "high", "log"}, "choice": {"choices"}}
_LIKE = {"recurrent-ppo": "ppo"}  # searched in the space of another


@dataclass(frozen=True)
class Space:
    """What is searched.

    Attributes:
        ranges: by name (a key of the hyper-parameter file; a dot leads into a mapping) the ``kind`` with
            ``low``, ``high`` and ``log``, or ``choices``.
    """

    ranges: dict[str, dict[str, Any]]

    @property
    def hash(self) -> str:
        """SHA-256 of the ranges, as 64 hexadecimal digits."""
        return hashlib.sha256(json.dumps(self.ranges, sort_keys=True).encode()).hexdigest()

    def suggest(self, trial: optuna.Trial) -> dict[str, Any]:
        """A trial's values by name, as Optuna's sampler proposes them."""
        return {name: self._suggested(trial, name, wanted) for name, wanted in self.ranges.items()}

    def _suggested(self, trial: optuna.Trial, name: str, wanted: dict[str, Any]) -> Any:
        if wanted["kind"] == "choice":
            words = [_word(choice) for choice in wanted["choices"]]
            return wanted["choices"][words.index(trial.suggest_categorical(name, words))]
        low, high, log = wanted["low"], wanted["high"], wanted.get("log", False)
        if wanted["kind"] == "int":
            return trial.suggest_int(name, low, high, log=log)
        return float(f"{trial.suggest_float(name, low, high, log=log):.4g}")  # what is trained can be written

    def first(self) -> dict[str, Any]:
        """The lowest value, or first choice, of each name."""
        return {name: wanted.get("choices", [wanted.get("low")])[0] for name, wanted in self.ranges.items()}

    def values(self, params: dict[str, Any]) -> dict[str, Any]:
        """What the parameters that Optuna stored stand for."""
        return self.suggest(optuna.trial.FixedTrial(params))  # type: ignore[arg-type]

    def params_of(self, hyperparameters: dict[str, Any]) -> dict[str, Any]:
        """The hyper-parameters that lie in the space, as Optuna stores them."""
        found = {}
        for name, wanted in self.ranges.items():
            value = _looked_up(hyperparameters, name)
            if wanted["kind"] == "choice":
                if value in wanted["choices"]:
                    found[name] = _word(value)
            elif _is_number(value) and wanted["low"] <= value <= wanted["high"]:
                found[name] = value
        return found


def load_space(algorithm: str, file: Path | None = None) -> Space:
    """The search space of an algorithm (without its stacked frames), from the shipped file or the user's own.

    Raises:
        UserError: no shipped space, or a file that is no search space.
    """
    folder = baselines_folder() / "search"
    path = file or folder / f"{_LIKE.get(algorithm, algorithm)}.yml"
    if file is None and not path.is_file():
        known = [found.stem for found in folder.glob("*.yml")]
        raise UserError(
            f"no search space for {algorithm!r}{nearest(algorithm, known)} (or name a file of your own)"
        )
    content = read_yaml(path, "search space")
    if not content:
        raise UserError(f"search space {path}: names no hyper-parameter")
    for name, wanted in content.items():
        if not isinstance(name, str) or name == "n_timesteps":
            raise UserError(f"search space {path}: {name!r} is no hyper-parameter that can be searched")
        _check(wanted, f"search space {path}: {name}")
    return Space(content)


def merged(hyperparameters: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """The hyper-parameters with other values; a dot in a name leads into a mapping."""
    found = copy.deepcopy(hyperparameters)
    for name, value in values.items():
        *outer, last = name.split(".")
        inner = found
        for key in outer:
            inner = inner[key] if isinstance(inner.get(key), dict) else inner.setdefault(key, {})
        inner[last] = value
    return found


def _check(wanted: Any, where: str) -> None:
    """Raise UserError where a range is not of its kind."""
    if not isinstance(wanted, dict) or wanted.get("kind") not in _KEYS:
        raise UserError(f"{where}: expected a mapping with kind {', '.join(_KEYS)}, got {wanted!r}")
    kind = wanted["kind"]
    check_keys(wanted, _KEYS[kind] | {"kind"}, where, sorted(_KEYS[kind] - {"log"}))
    if kind == "choice":
        if not isinstance(wanted["choices"], list) or not wanted["choices"]:
            raise UserError(f"{where}: choices: expected a list, got {wanted['choices']!r}")
        return
    _check_range(wanted, kind, where)


def _check_range(wanted: dict[str, Any], kind: str, where: str) -> None:
    for key in ("low", "high"):
        if not _is_number(wanted[key], whole=kind == "int"):
            number = "a whole number" if kind == "int" else "a number (1.0e-4, not 1e-4)"
            raise UserError(f"{where}: {key}: expected {number}, got {wanted[key]!r}")
    flag(wanted.get("log", False), f"{where}: log")
    if wanted["low"] > wanted["high"]:
        raise UserError(f"{where}: low {wanted['low']} lies above high {wanted['high']}")
    if wanted.get("log") and wanted["low"] <= 0:
        raise UserError(f"{where}: low {wanted['low']}: a range in logarithms begins above 0")


def _is_number(value: Any, whole: bool = False) -> bool:
    return isinstance(value, int if whole else int | float) and not isinstance(value, bool)


def _word(choice: Any) -> Any:
    """A choice as Optuna can store it: lists and mappings as JSON."""
    return json.dumps(choice) if isinstance(choice, list | dict) else choice


def _looked_up(hyperparameters: Any, name: str) -> Any:
    for key in name.split("."):
        if not isinstance(hyperparameters, dict) or key not in hyperparameters:
            return None
        hyperparameters = hyperparameters[key]
    return hyperparameters
