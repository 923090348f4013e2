"""Descriptions of training runs: ``run.json``, as one type with one reader."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pydantic

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json, write_json
from fpg_bench.common.schema import NonNegativeInt, Strict, parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.card import Game, OfflineData

FILE = "run.json"
EVALUATIONS = "evaluations.jsonl"  # scores during training, in a run's folder
CURVE = "curve.png"  # their picture
_Number = Annotated[float, pydantic.Field(strict=False)]
# What runs, and their agents, of one entry have in common; they differ by their training seed alone.
MADE_BY = (
    "algorithm",
    "game",
    "scenario",
    "training_steps",
    "hyperparameters",
    "options",
    "policies",
    "offline",
)
# What tells a run from another; the command and the versions may change when it is resumed.
IDENTITY = (*MADE_BY, "training_seed")


class RunDescription(Strict):
    """Content of ``run.json``; further keys are kept.

    Trainings of other libraries, logged by :func:`fpg_bench.log_evaluation`, have no game.

    Attributes:
        command: the command that made it; None: it was made from Python.
        algorithm: name of the algorithm.
        game: the game. Opening it imports the code that it names.
        side: the side that learns, or ``ally and opponent``.
        suite: the suites that score it during training.
        scenario, scenario_fields: hash of the scenario, and its fields that differ from ``standard``.
        options: options of the run beside those of the game.
        training_seed: training seed.
        training_steps: training budget.
        hyperparameters: hyper-parameters, as an entry of a file.
        offline: the data set of an offline algorithm.
        policies: hashes of the policies that it is trained against, by name.
        versions, revision: of the packages, and of this code.
        imitation_error: difference from the teacher at the end of an imitation.
        steps_done, seconds: steps that were played in whole rollouts and seconds of the training, with those
            of the runs that it started from.
        steps_per_s: rate of the training.
        plans: how often plans of each kind were flown, where a language model plans.
        finished: the agent is exported.
        part: how often it was resumed.
        largest_difference: between the actions of the trained model and the exported policy.
    """

    model_config = pydantic.ConfigDict(extra="allow", allow_inf_nan=True)

    command: str | None = None
    algorithm: str
    game: Game | None = None
    side: str = ""
    suite: str | None = None
    scenario: str | None = None
    scenario_fields: JsonObject = pydantic.Field(default_factory=dict)
    options: JsonObject = pydantic.Field(default_factory=dict)
    training_seed: int = 0
    training_steps: NonNegativeInt = 0
    hyperparameters: JsonObject = pydantic.Field(default_factory=dict)
    offline: OfflineData | None = None
    policies: dict[str, str] = pydantic.Field(default_factory=dict)
    versions: dict[str, str] = pydantic.Field(default_factory=dict)
    revision: str | None = None
    imitation_error: _Number | None = None
    steps_done: int | None = None
    seconds: _Number = 0.0
    plans: dict[str, int] = pydantic.Field(default_factory=dict)
    finished: bool = False
    part: NonNegativeInt = 0
    steps_per_s: int | None = None
    largest_difference: _Number | None = None

    @pydantic.model_validator(mode="before")
    @classmethod
    def _read_any(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        if "game" not in content and "id" in content:
            raise UserError("is of an older format; train again in another folder (--out)")
        if isinstance(fields := content.get("game"), dict):
            return content | {"game": GameSpec.from_dict(fields, "game")}
        return content

    @classmethod
    def read(cls, run: Path, what: str = "run") -> RunDescription:
        """Read the ``run.json`` of a run's folder.

        Raises:
            UserError: it cannot be read, or is no description of a run; ``what`` begins the message.
        """
        file = run / FILE
        try:
            return parse(cls, read_json(file, what), f"{what} {file}")
        except UserError as error:
            if "lacks" in str(error):
                raise UserError(f"{error}; it is no description of a run") from error
            raise

    @property
    def played(self) -> Scenario:
        """The scenario."""
        return Scenario.from_dict(self.scenario_fields)

    def write(self, run: Path) -> None:
        """Write ``run.json`` into a run's folder."""
        write_json(run / FILE, self.to_dict())

    def to_dict(self) -> JsonObject:
        """Return the content of ``run.json``: all that is set."""
        return self.model_dump(mode="json", exclude_unset=True)

    def differences(self, other: RunDescription) -> list[str]:
        """Return the names of the attributes that tell this run from another; empty if it is the same."""
        return [name for name in IDENTITY if getattr(self, name) != getattr(other, name)]
