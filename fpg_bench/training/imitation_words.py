"""What hyper-parameters say of a start from imitation; read without torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fpg_bench.checks import check_keys, whole
from fpg_bench.errors import UserError

_LEAST = {"steps": 1, "batch_size": 2, "n_epochs": 1}


@dataclass(frozen=True)
class Imitation:
    """What hyper-parameters say under ``imitate``.

    Attributes:
        teacher: a player of the learner's side, by its name.
        steps: how many are played, over all games; they come on top of the training's.
        learning_rate: of Adam.
        batch_size: of an update.
        n_epochs: how often what a round showed is learned from.
    """

    teacher: str
    steps: int = 400_000
    learning_rate: float = 0.001
    batch_size: int = 1024
    n_epochs: int = 5


def parse_imitation(content: Any, where: str) -> Imitation:
    """What a file says under ``imitate``; ``where`` begins the message of an error.

    Raises:
        UserError: a missing or unknown key, or a value of another kind.
    """
    known = Imitation.__dataclass_fields__
    if not isinstance(content, Mapping) or not isinstance(content.get("teacher"), str):
        raise UserError(f"{where}: expected a mapping with a teacher, a player's name; got {content!r}")
    check_keys(content, known, where)
    found = Imitation(**content)
    for key, least in _LEAST.items():
        whole(getattr(found, key), f"{where}: {key}", least)
    rate = found.learning_rate
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate < 1:
        raise UserError(f"{where}: learning_rate: expected a number between 0 and 1, got {rate!r}")
    return found
