"""Options of a planner that asks a language model, the same in play, comparisons and trainings."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from fpg_bench.cli.fields import Fields, Given
from fpg_bench.cli.options import LANGUAGE_MODEL
from fpg_bench.common.checks import check_keys
from fpg_bench.common.schema import parse

_ASKED = ("server", "temperature", "sampling_seed", "calls", "tokens", "seconds", "deadline")


@dataclass(frozen=True)
class LLMOptions:
    """Options of a language model's planner; what is None has its default.

    Attributes:
        prompt: the prompt: brief, paper, standard or a YAML file; None: the one set in the server profile.
        server: the server profile, by name or as a YAML file.
        temperature: sampling temperature; None: the one set in the server profile.
        sampling_seed: seed of the sampling seeds sent to the server; None: 0.
        calls: maximum number of calls in the run; None: 20,000.
        tokens: maximum number of prompt and completion tokens; None: 200 million.
        seconds: maximum number of seconds spent in calls; None: a week.
        deadline: time limit of a call in seconds; None: 30.
        concurrency: maximum number of concurrent calls; None: 1.
    """

    prompt: str | None = None
    server: str | None = None
    temperature: float | None = None
    sampling_seed: int | None = None
    calls: int | None = None
    tokens: int | None = None
    seconds: float | None = None
    deadline: float | None = None
    concurrency: int | None = None

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Return the options that are given by name; raises UserError for something else."""
        check_keys(
            given, [each.name for each in dataclasses.fields(cls)], where := "options of the language model"
        )
        return parse(cls, dict(given), where)

    def arguments(self) -> dict[str, Any]:
        """Return them as arguments of :class:`fpg_bench.products.language_models.llm_planner.LLMPlanner`."""
        named = dataclasses.asdict(self) | {"deadline_s": self.deadline}
        others = ("server", "deadline", "transcript", "transcripts", "record")
        return {k: v for k, v in named.items() if v is not None and k not in others}


@dataclass(frozen=True)
class TrainingOptions(LLMOptions):
    """Options of a training with a language model.

    Attributes:
        transcript: transcript of a run with a language model, whose plans are replayed without a server.
    """

    transcript: str | Path | None = None


@dataclass(frozen=True)
class EvaluationOptions(LLMOptions):
    """Options of an evaluation with language models.

    Attributes:
        transcripts: folder of transcripts of language models; each adds a planner, which asks no server.
    """

    transcripts: str | Path | None = None


@dataclass(frozen=True)
class PlayOptions(TrainingOptions):
    """Options of rounds with a language model.

    Attributes:
        record: file that keeps what the model was asked and answered; what it has is not asked again.
    """

    record: str | Path | None = None


def _fields(*names: str, kind: type = PlayOptions) -> Fields:
    """Return the options of a verb, by name."""
    details: dict[str, Given] = {name: {"min": 1} for name in ("calls", "tokens", "concurrency")}
    details |= {name: {"min": 0} for name in ("sampling_seed", "seconds", "deadline")}
    return Fields(kind, names, panel=LANGUAGE_MODEL, details=details | {"temperature": {"min": 0, "max": 2}})


OF_TRAIN = _fields("transcript", "prompt", "server", "calls", "tokens", "seconds", "deadline")
OF_PLAY = _fields("record", "transcript", "prompt", *_ASKED)
OF_EVALUATE = _fields("transcripts", "prompt", *_ASKED, "concurrency", kind=EvaluationOptions)
