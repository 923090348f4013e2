"""Champions: agents trained in stages against a population that responses to them join.

Staged champions meet harder players more often, as in prioritized fictitious self-play (Vinyals et al. 2019).
The others come from a double oracle or from self-play, which stop once no iteration keeps more against a
fresh response.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field as Constraint

from fpg_bench.common.checks import check_keys, integer, mapping, one_of
from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import read_json, read_yaml, write_json
from fpg_bench.common.ids import find_env, policy_env
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.schema import Items, PositiveInt, Strict, parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import load_agent
from fpg_bench.players.population import expand_suites, member_folder
from fpg_bench.products.league.config import (
    DoubleOracleConfig,
    SearchConfig,
    SelfPlayConfig,
    TabularSelfPlayConfig,
)
from fpg_bench.products.league.double_oracle import double_oracle
from fpg_bench.products.league.evaluation import evaluate_against
from fpg_bench.products.league.self_play import self_play
from fpg_bench.products.league.tabular_self_play import tabular_self_play
from fpg_bench.training.config import RunConfig
from fpg_bench.training.rl_zoo3_format import Entry
from fpg_bench.training.train import train

RESPONDER_SEED = 1_000_000  # first training seed of the responders to champions
POPULATION_ROUNDS, CHAMPION_EVALUATIONS = 48, 4
_logger = logging.getLogger(__name__)


class Stage(Strict):
    """A stage of a champion's training: its budget, and hyper-parameters that replace the champion's."""

    steps: PositiveInt
    hyperparams: Entry | None = None


class Responder(Strict):
    """Training of a player against a stage's agent; attributes are as in :class:`ChampionConfig`."""

    algorithm: str
    steps: PositiveInt
    hyperparams: Entry | None = None
    options: JsonObject | None = None


class ChampionConfig(Strict):
    """Configuration of a staged champion, an entry of ``baselines/champions.yml``.

    Attributes:
        name: folder of the agents.
        id: environment id, one of those against any player.
        algorithm, hyperparams: as in :class:`fpg_bench.training.config.RunConfig`.
        against: the population, suites included; one player is drawn per round.
        stages: the stages; each one after the first starts from the weights of the one before.
        responders: players that are trained against the agent of each stage but the last, and then join the
            population.
        priority: how much more often the hardest player is drawn than the easiest, after the first stage.
        options: options of the games, attributes of :class:`fpg_bench.game.spec.GameSpec`.
        seeds: number of training seeds; not part of an agent's recipe.
    """

    name: str
    id: str
    algorithm: str
    hyperparams: Entry
    against: Annotated[list[str], Constraint(min_length=1)]
    stages: Annotated[list[Stage], Constraint(min_length=1)]
    responders: Items[Responder] = ()
    priority: PositiveInt = 4
    options: JsonObject = Constraint(default_factory=dict)
    seeds: Annotated[PositiveInt, Constraint(exclude=True)] = 3

    @property
    def game(self) -> GameSpec:
        """The game, without its players."""
        return GameSpec.of(self.id, **self.options)

    @property
    def side(self) -> str:
        """Side of the champion."""
        return find_env(self.id).side

    @property
    def other_side(self) -> str:
        """Side of the population."""
        return find_env(self.id).other_side


@dataclass(frozen=True)
class SearchedChampion:
    """Configuration of a champion that a search finds, an entry of ``baselines/champions.yml``.

    Attributes:
        name: folder of the agents.
        config: the search, without its seed.
        recipe: the name and the entry without ``seeds``: ``verb`` names the search, the rest are its options.
        seeds: number of training seeds.
    """

    name: str
    config: SearchConfig | TabularSelfPlayConfig
    recipe: JsonObject
    seeds: int

    @classmethod
    def parse(cls, name: str, content: JsonObject, where: str) -> SearchedChampion:
        """Return the configuration of an entry; raises UserError for an invalid one."""
        options = dict(content)
        verb, seeds = one_of(options.pop("verb"), f"{where}: verb", SEARCHES), options.pop("seeds", 3)
        kind = SEARCHES[verb][0]
        check_keys(options, [each.name for each in dataclasses.fields(kind)], where)
        try:
            config = kind(**options)
            return cls(name, config, {"name": name, "verb": verb, **options}, integer(seeds, "seeds"))
        except UserError as error:
            raise UserError(f"{where}: {error}") from error

    @property
    def algorithm(self) -> str:
        """The algorithm of the champion."""
        return self.config.algorithm

    @property
    def side(self) -> str:
        """Side of the champion."""
        return self.config.side


SEARCHES: Mapping[str, tuple[type[SearchConfig | TabularSelfPlayConfig], Callable[..., object]]] = {
    DoubleOracleConfig.verb: (DoubleOracleConfig, double_oracle),
    SelfPlayConfig.verb: (SelfPlayConfig, self_play),
    TabularSelfPlayConfig.verb: (TabularSelfPlayConfig, tabular_self_play),
}


def load_champions(file: Path) -> dict[str, ChampionConfig | SearchedChampion]:
    """Load the configurations of champions from a YAML file, by name; those with a verb come from a search.

    Raises:
        UserError: the file cannot be read, or a key is missing, unknown or invalid.
    """
    configs: dict[str, ChampionConfig | SearchedChampion] = {}
    for name, content in read_yaml(file, "champions").items():
        where = f"champions {file}: {name}"
        check_allowed(content, (), where)
        if "verb" in mapping(content, where):
            configs[name] = SearchedChampion.parse(name, content, where)
        else:
            configs[name] = _staged_champion({"name": name, **content}, where)
    return configs


def _staged_champion(content: JsonObject, where: str) -> ChampionConfig:
    """Return the configuration of a staged champion."""
    config = parse(ChampionConfig, content, where)
    if config.id != policy_env(config.side).id:
        raise UserError(f"{where}: id: expected {policy_env(config.side).id}, got {config.id}")
    for options in (config.options, *(responder.options or {} for responder in config.responders)):
        GameSpec.from_dict({"id": config.id, **options}, f"{where}: options")
    return config


def train_champion(
    config: ChampionConfig | SearchedChampion, seed: int, runs: Path, *, progress: bool = False
) -> Path:
    """Train one champion; a stopped training is resumed, and finished runs are not repeated.

    Of a staged champion, responders are trained against the agent of each stage but the last, and they join
    the population of the next stage. From the second stage on, players against which the champion's return is
    lower are drawn more often.

    Args:
        config: the champion's configuration.
        seed: the training seed.
        runs: folder of all champions' runs. ``NAME/seed_k`` is the folder of a search, or has
            ``stage_i/run`` and ``stage_i/responder_j``.
        progress: show the progress of each training.

    Returns:
        The folder of the agent: of the last stage, or of the iteration that the search exports.

    Raises:
        UserError: something unknown or out of range, or a folder that holds another run.
        KeyboardInterrupt: stopped by the user.
    """
    folder, agent = search_folder(config, seed, runs), Path()
    if isinstance(config, SearchedChampion):
        search = SEARCHES[config.config.verb][1]
        search(dataclasses.replace(config.config, seed=seed), folder, progress=progress)
        return folder / "agent"
    population = [str(spec) for spec in expand_suites(config.against, config.other_side)]
    for number, stage in enumerate(config.stages):
        stage_folder = folder / f"stage_{number}"
        drawn = (
            _prioritized(config, agent, population, stage_folder / "population.json")
            if number
            else population
        )
        run = RunConfig(
            config.algorithm,
            GameSpec.of(config.game, against=drawn),
            seed,
            stage.steps,
            {**config.hyperparams, "n_timesteps": stage.steps, **(stage.hyperparams or {})},
            start=folder / f"stage_{number - 1}" / "run" if number else None,
        )
        agent = train(
            run, stage_folder / "run", evaluations=CHAMPION_EVALUATIONS, progress=progress, resume=True
        )
        _logger.info(f"{config.name}/seed_{seed}: stage {number} trained, against {len(population)} players")
        if number + 1 < len(config.stages):
            first_seed = RESPONDER_SEED + 1000 * seed + 100 * number
            population += _train_responders(config, agent, stage_folder, first_seed, progress)
    return agent


def search_folder(config: ChampionConfig | SearchedChampion, seed: int, runs: Path) -> Path:
    """Return the folder of a champion's training among those of all."""
    return runs / config.name / f"seed_{seed}"


def _train_responders(
    config: ChampionConfig, agent: Path, folder: Path, seed: int, progress: bool
) -> list[str]:
    """Train a champion's responders against an agent, with training seeds from ``seed`` on.

    Returns:
        The folders of their agents.
    """
    agents = []
    for index, responder in enumerate(config.responders):
        run = RunConfig(
            responder.algorithm,
            GameSpec.of(policy_env(config.other_side).id, against=str(agent), **(responder.options or {})),
            seed + index,
            responder.steps,
            responder.hyperparams,
        )
        response = train(run, folder / f"responder_{index}", evaluations=0, progress=progress, resume=True)
        agents.append(str(response))
    return agents


def _prioritized(config: ChampionConfig, agent: Path, population: list[str], file: Path) -> list[str]:
    """Return the population, with harder players listed several times; the numbers are kept in a file."""
    if file.exists():
        content = read_json(file, "population")
        copies = content["copies"]
        if list(copies) != population:
            raise other_content(file, "another population")
        values = content["returns_per_step"].values()
        if max(values) > min(values) and max(copies.values()) != config.priority:
            raise other_content(file, "a population drawn with another priority")
    else:
        scenario = config.game.resolve()
        others = {name: member_folder(name, config.other_side) for name in population}
        summary = evaluate_against(str(agent), others, config.side, scenario, POPULATION_ROUNDS, tuning_seeds)
        returns = [summary.by_rival[name].value for name in population]
        copies = dict(zip(population, copies_by_hardness(returns, config.priority), strict=True))
        rounded = {name: round(value, 3) for name, value in zip(population, returns, strict=True)}
        write_json(file, {"agent": str(agent), "returns_per_step": rounded, "copies": copies})
    return [player for player, count in copies.items() for _ in range(count)]


def copies_by_hardness(returns: Sequence[float], priority: int) -> list[int]:
    """Return how often to list each player: once the easiest, ``priority`` times the hardest.

    In between, the number grows with the square of the hardness, which is linear in the return.
    """
    low, high = min(returns), max(returns)
    hardness = [(high - value) / (high - low) if high > low else 0.0 for value in returns]
    return [1 + round((priority - 1) * share**2) for share in hardness]


def ship_champion(
    agent: Path, folder: Path, config: ChampionConfig | SearchedChampion, seed: int, command: str
) -> None:
    """Copy a champion's agent to its shipped folder; its ``agent.json`` describes the whole training.

    Args:
        agent: the folder of the agent, as :func:`train_champion` returns it.
        folder: the folder of the shipped agent.
        config, seed: how it was made.
        command: the command that reproduces it.

    Raises:
        UserError: the agent is incomplete.
    """
    trained = load_agent(agent, config.side)
    update: JsonObject = {"command": command, "training_seed": seed}
    if isinstance(config, SearchedChampion):  # its agent tells the steps of all iterations
        update["recipe"] = config.recipe
    else:
        update["recipe"] = config.model_dump(mode="json", exclude_none=True)
        update["training_steps"] = sum(stage.steps for stage in config.stages)
    assert trained.card is not None
    trained.card.model_copy(update=update).write(folder, trained.model)
