"""Options of a planner that asks a language model, the same in matches, comparisons and trainings."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class LLMOptions:
    """Options of a language model's planner; what is None has its default.

    Attributes:
        prompt: the prompt: brief, paper, standard or a YAML file; None: the one set in the server profile.
        control: control experiment: none, shuffled-rewards or no-history; None: that of the planner's name.
        server: the server profile, by name or as a YAML file.
        temperature: sampling temperature; None: the one set in the server profile.
        sampling_seed: seed of the sampling seeds sent to the server; None: 0.
        calls: maximum number of calls in the run; None: 20,000.
        tokens: maximum number of prompt and completion tokens; None: 200 million.
        seconds: maximum number of seconds spent in calls; None: a week.
        deadline: time limit of a call in seconds; None: 30; for the embedded model, from its measured speed.
        concurrency: maximum number of concurrent calls; None: 1.
    """

    prompt: str | None = None
    control: str | None = None
    server: str | None = None
    temperature: float | None = None
    sampling_seed: int | None = None
    calls: int | None = None
    tokens: int | None = None
    seconds: float | None = None
    deadline: float | None = None
    concurrency: int | None = None

    def given(self) -> dict[str, str | int | float]:
        """Return the options that are set, by name."""
        values = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def arguments(self) -> dict[str, Any]:
        """Return them as arguments of :class:`fpg_bench.products.language_models.llm_planner.LLMPlanner`."""
        named = self.given() | {"deadline_s": self.deadline}
        return {k: v for k, v in named.items() if v is not None and k not in ("server", "deadline")}
