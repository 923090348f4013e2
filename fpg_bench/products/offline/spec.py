"""Specifications of data sets, and their YAML files in ``baselines/datasets``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import pydantic

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml
from fpg_bench.common.ids import id_with, other_side, policy_env
from fpg_bench.common.schema import Expected, Items, NonNegativeInt, PositiveInt, Strict, parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.seeds import dataset_seed
from fpg_bench.evaluation.suite import SHIPPED, identity
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder
from fpg_bench.version import __version__

NAMESPACE = "fpg"
# As in a suite of the board, since data sets may be untrusted.
_Name = Annotated[
    str, pydantic.Field(pattern=SHIPPED), Expected("the name of a script or an agent of the package")
]
_Names = Annotated[Items[_Name], pydantic.Field(min_length=1)]


class DatasetSpec(Strict):
    """Everything that decides the content of a data set.

    Attributes:
        name: Minari's name and version, such as ``ally-expert-v0``.
        description: one or two sentences.
        side: the side whose observations, actions and rewards are recorded.
        scenario: a preset, or a YAML file.
        actions: ``continuous`` or ``discrete``.
        behaviour: ``random``, ``script``, ``medium``, ``expert``, or ``mixed`` of several players.
        players: players of the side; one is drawn per round.
        rivals: players of the other side; one is drawn per round.
        best: the best known player, whose mean return is the reference ``ref_max_score``.
        steps: number of transitions, rounded up to whole rounds.
        seed: number of the block of seeds; see :func:`fpg_bench.evaluation.seeds.dataset_seed`.
    """

    name: Annotated[
        str, pydantic.Field(pattern=r"^[\w-]+-v\d+$"), Expected("a name and a version, such as ally-mine-v0")
    ]
    description: str
    side: Literal["ally", "opponent"]
    scenario: _Name = "standard"
    actions: Literal["continuous", "discrete"] = "continuous"
    behaviour: Literal["random", "script", "medium", "expert", "mixed"]
    players: _Names
    rivals: _Names
    best: _Name
    steps: PositiveInt
    seed: NonNegativeInt = 0

    @pydantic.model_validator(mode="after")
    def _check(self) -> DatasetSpec:
        if (len(self.players) > 1) != (self.behaviour == "mixed"):
            count = "several players" if self.behaviour == "mixed" else "one player"
            raise UserError(f"players: {self.behaviour} behaviour has {count}, got {len(self.players)}")
        dataset_seed(self.seed)
        return self

    @property
    def dataset_id(self) -> str:
        """Minari's id of the data set."""
        return f"{NAMESPACE}/{self.name}"

    @property
    def other_side(self) -> str:
        """The side that the rivals play."""
        return other_side(self.side)

    @property
    def env_id(self) -> str:
        """The id of the environment in which the recorded side acts."""
        return id_with(policy_env(self.side).id, self.actions)

    @property
    def game(self) -> GameSpec:
        """The game in which the recorded side acts."""
        return GameSpec.of(self.env_id, against=self.rivals, scenario=self.scenario)

    def load_scenario(self) -> Scenario:
        """Return the scenario; raises UserError if there is none of this name."""
        return as_scenario(self.scenario)

    @property
    def episodes(self) -> int:
        """Number of rounds."""
        return math.ceil(self.steps / self.load_scenario().steps_per_round)

    @property
    def first_seed(self) -> int:
        """Seed of the first round; each round is the first of a separate match."""
        return dataset_seed(self.seed)

    def recipe(self) -> JsonObject:
        """Return the origin of a data set: the specification, and hashes of its scenario and players.

        Raises:
            UserError: no such scenario or player.
        """
        return {
            "version": __version__,
            "spec": self.model_dump(mode="json"),
            "scenario_sha256": self.load_scenario().hash,
            "identities": {name: identity(name) for name in (*self.players, *self.rivals)},
        }


def load_spec(name: str, steps: int | None = None) -> DatasetSpec:
    """Load a specification by its name, or from a YAML file of the same form.

    Args:
        name: the name of a shipped specification, such as ``ally-expert-v0``, or a file.
        steps: number of transitions; None takes that of the specification.

    Raises:
        UserError: no such specification or file, or an invalid value.
    """
    path = Path(name)
    if path.suffix not in (".yml", ".yaml"):
        path = _folder() / f"{name}.yml"
        if name not in spec_names():
            raise UserError(f"unknown data set {name!r}{nearest(name, spec_names())}")
    content = {**read_yaml(path, "data set"), "name": path.stem}
    return parse(DatasetSpec, content if steps is None else {**content, "steps": steps}, f"data set {path}")


def spec_names() -> list[str]:
    """Return the names of the shipped specifications."""
    return sorted(path.stem for path in _folder().glob("*.yml"))


def _folder() -> Path:
    return baselines_folder() / "datasets"
