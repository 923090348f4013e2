"""Cards of agents: ``agent.json``, which says what an agent is and how it was made, as one type."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import pydantic

from fpg_bench.common.checks import mapping, title
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json, write_json, write_whole
from fpg_bench.common.ids import DUEL, ENVS
from fpg_bench.common.products import offered
from fpg_bench.common.schema import Expected, NonNegativeInt, Strict, parse
from fpg_bench.common.strict_json import Json, JsonObject
from fpg_bench.game.scenario import PRESETS, STANDARD, Scenario, as_scenario
from fpg_bench.game.spec import GameSpec, OtherGame

AGENT_FORMAT: Literal[2] = 2
FILE = "agent.json"
MOST_STEPS = 10**13  # of a training
MOST_SECONDS = 36 * 10**8  # of a training: a million hours
_LONGEST_NAME = 60

if TYPE_CHECKING:
    Game = GameSpec
else:  # in a model of a file; of ``Any``, since pydantic cannot look into the dataclass

    def _game(value: object) -> GameSpec:
        return value if isinstance(value, GameSpec) else GameSpec.from_dict(value)

    Game = Annotated[Any, pydantic.PlainValidator(_game), pydantic.PlainSerializer(GameSpec.to_dict)]

_Name = Annotated[str, pydantic.Field(min_length=1, max_length=_LONGEST_NAME), pydantic.AfterValidator(title)]
_Steps = Annotated[
    int, pydantic.Field(ge=0, le=MOST_STEPS), Expected(f"a whole number from 0 to {MOST_STEPS:,}")
]
_Seconds = Annotated[
    float,
    pydantic.Field(strict=False, ge=0, le=MOST_SECONDS),
    Expected(f"a number from 0 to {MOST_SECONDS:,}"),
]
_Sha256 = Annotated[str, pydantic.Field(pattern=r"^[0-9a-f]{64}$"), Expected("a SHA-256 hash")]


class OfflineData(Strict):
    """Data set that an agent learned from."""

    model_config = pydantic.ConfigDict(extra="allow")

    dataset: _Name
    content_sha256: str | None = None
    transitions: NonNegativeInt | None = None


class AgentCard(Strict):
    """Content of ``agent.json``; further keys are kept as they are.

    Attributes:
        algorithm: name of the algorithm.
        game: the game of the training. Code that it names is imported only if you allow it:
            ``make_sb3(card.game, allow=["package.module:object"])``.
        side: the side that the agent plays.
        scenario: hash of the scenario of the training.
        scenario_fields: the fields of that scenario that differ from ``standard``.
        training_seed: training seed; None where there was none.
        training_steps: training budget in environment steps, of offline algorithms in gradient steps.
        policy_sha256: hash of ``policy.onnx``.
        skills: of an agent of another game than the duel, what that game says of the games that it can play;
            by default those of its training (:attr:`fpg_bench.game.spec.OtherGame.skills`).
        sample: whether it draws its actions by its noise.
        command: the command that made it.
        suite: the suites that scored it during training.
        options: options of the run beside those of the game.
        hyperparameters: hyper-parameters of the run.
        policies: hashes of the policies that it was trained against, by name.
        offline: the data set that it learned from.
        steps_done, seconds: steps that were played in whole rollouts and seconds of the training, with those
            of the runs that it started from.
        recipe: configuration of a champion's training.
        largest_difference: between the actions of the trained model and the exported policy.
    """

    model_config = pydantic.ConfigDict(extra="allow")

    format: Literal[2] = AGENT_FORMAT
    skills: JsonObject = pydantic.Field(default_factory=dict)
    sample: bool = False
    command: str | None = None
    algorithm: _Name
    game: Game
    side: Literal["ally", "opponent"]
    suite: str | None = None
    scenario: _Sha256
    scenario_fields: JsonObject = pydantic.Field(default_factory=dict)
    options: JsonObject = pydantic.Field(default_factory=dict)
    training_seed: Annotated[int | None, pydantic.Field(ge=0), Expected("a whole number or null")]
    training_steps: _Steps
    hyperparameters: JsonObject = pydantic.Field(default_factory=dict)
    policies: dict[str, str] = pydantic.Field(default_factory=dict)
    offline: OfflineData | None = None
    steps_done: _Steps | None = None
    seconds: _Seconds | None = None
    recipe: JsonObject | None = None
    policy_sha256: _Sha256
    largest_difference: Annotated[float, pydantic.Field(strict=False)] | None = None

    @pydantic.model_validator(mode="before")
    @classmethod
    def _read_any(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        if not _is_finite(content):
            raise UserError("contains a number that is not finite")
        if isinstance(game := content.get("game"), dict):
            _check_id(game.get("id"))
            game = GameSpec.from_dict(game, "game")
        if isinstance(game, GameSpec):
            content = content | {"game": game}
            if isinstance(game, OtherGame):
                content["skills"] = game.skills | dict(mapping(content.get("skills", {}), "skills"))
                game.check_skills(content["skills"])
            if not game.is_duel:  # the id says the side
                content["side"] = game.sides[0]
        return content

    @classmethod
    def read(cls, file: Path, where: str = "agent") -> AgentCard:
        """Read an ``agent.json``; raises as :meth:`parse`, and UserError where it cannot be read."""
        return cls.parse(read_json(file, where), f"{where} {file}")

    @classmethod
    def parse(cls, content: Json, where: str, side: str | None = None) -> AgentCard:
        """Return the card of an ``agent.json``.

        Args:
            content: the content of the file.
            where: begins the message of an error.
            side: the side that the agent must play; None: either.

        Raises:
            UserError: a key missing or invalid, a number that is not finite, another format, id or side.
        """
        if (version := content.get("format", AGENT_FORMAT)) != AGENT_FORMAT:
            raise UserError(
                f"{where}: format {version!r:.40}, this version reads {AGENT_FORMAT}; "
                "export the agent again, or write it with fpg_bench.write_agent"
            )
        card = parse(cls, dict(content), where)
        if side is not None and card.side != side:
            raise UserError(f"{where}: plays the {card.side} ({card.game.id}), not the {side}")
        return card

    @property
    def is_search(self) -> bool:
        """True for a table or rule found by search, which is no sample of a trainable algorithm."""
        return self.algorithm in ("tabular", "rule")

    def write(self, folder: Path, model: bytes | None = None) -> None:
        """Write ``agent.json``, after ``policy.onnx`` if its bytes are given."""
        if model is not None:
            write_whole(folder / "policy.onnx", model)
        write_json(folder / FILE, self.to_dict())

    def to_dict(self) -> JsonObject:
        """Return the content of ``agent.json``."""
        return {"format": AGENT_FORMAT} | self.model_dump(mode="json", exclude_unset=True, exclude={"format"})

    def played(self) -> Scenario:
        """Return the scenario of the training.

        Raises:
            UserError: its fields are not known, or this version plays them by other rules.
        """
        if self.scenario == STANDARD.hash:
            return STANDARD
        try:
            scenario = Scenario.from_dict(self.scenario_fields)
        except UserError as error:
            raise UserError(f"its scenario can't be played here: {error}; name the scenario") from error
        if scenario.hash != self.scenario:
            raise UserError("it was trained in a scenario that no longer exists; name the scenario")
        return scenario

    def home(self) -> Scenario:
        """Return the scenario in which the agent is played elsewhere: that of its training, on a plain path.

        Where the training's path was an option or a planner's, the path is that of ``standard``; rounds that
        an id with a planner adds to a match go as well.

        Raises:
            UserError: as :meth:`played`.
        """
        played = self.played()
        changes: dict[str, Any] = {}
        is_planned = not self.game.is_duel and self.game.config.planner is not None
        if is_planned or self.game.path is not None:
            changes["opponent_path"] = STANDARD.opponent_path
        if is_planned and (self.game.scenario is None or self.game.scenario in PRESETS):
            changes["rounds_per_match"] = STANDARD.rounds_per_match
        return as_scenario(played, **changes)

    def fits(self, scenario: Scenario) -> bool:
        """Return False if the agent was trained by other rules than those of a scenario.

        Flight path, rounds of a match, knowledge base and jamming types may differ. Of a training whose
        scenario cannot be told nothing is known, which counts as True.
        """
        if self.scenario == scenario.hash:
            return True
        try:
            home = self.home()
        except UserError:
            return True
        varied = ("opponent_path", "rounds_per_match", "knowledge", "jamming_types")
        return dataclasses.replace(home, **{name: getattr(scenario, name) for name in varied}) == scenario

    def __str__(self) -> str:
        return f"{self.game.id}, {self.algorithm}"

    @property
    def flies(self) -> str:
        """``learned`` if the opponent chose its own flight path in the training, otherwise ``pursuit``."""
        path = self.scenario_fields.get("opponent_path")
        return "learned" if path == "learned" or (isinstance(path, list) and "learned" in path) else "pursuit"

    @property
    def played_steps(self) -> int:
        """Steps of the training as it was played; the budget where the card does not tell more."""
        return max(self.training_steps, self.steps_done or 0)

    def describes(self, model: bytes) -> bool:
        """Return True if the policy is the one that the card names."""
        return hashlib.sha256(model).hexdigest() == self.policy_sha256


def _check_id(env_id: object) -> None:
    if env_id not in (DUEL, *ENVS, *offered("game")):
        raise UserError(f"made for the id {env_id!r:.60}, which this version does not have")


def _is_finite(value: object) -> bool:
    """Return True if all numbers in a JSON value are finite."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(map(_is_finite, value.values()))
    return all(map(_is_finite, value)) if isinstance(value, list) else True
