"""Champions: trained against a population, in stages, each against those who learned to beat the last one."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.checks import check_keys
from fpg_bench.envs.core import OneSided
from fpg_bench.errors import UserError
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.files import read_json, read_yaml, write_json, write_whole
from fpg_bench.ids import find_view, policy_view
from fpg_bench.players.agent import load_agent
from fpg_bench.players.naming import as_player
from fpg_bench.players.population import with_members
from fpg_bench.training.spec import RunSpec
from fpg_bench.training.train import train_run

RESPONDER_SEED = 1_000_000  # training seeds that nobody else takes
ROUNDS, LOOKS = 48, 4
_RESPONDER = {"algorithm", "steps", "hyperparams", "options"}


@dataclass(frozen=True)
class Recipe:
    """How a champion is made.

    Attributes:
        name: what the agents' folder is called.
        id: the environment id, one against any player.
        algorithm, hyperparams: what trains it, as :class:`fpg_bench.training.spec.RunSpec` takes them.
        against: the population, fields included; one is drawn per round.
        stages: of each, ``steps`` and the ``hyperparams`` that differ. Each begins with the weights of the
            one before.
        responders: of each, what trains it against the champion of a stage. They join the population.
        priority: how much more often the hardest of a population is drawn than the easiest, after the first
            stage.
        options: those of :class:`fpg_bench.envs.core.OneSided`.
    """

    name: str
    id: str
    algorithm: str
    hyperparams: dict[str, Any]
    against: list[str]
    stages: list[dict[str, Any]]
    responders: list[dict[str, Any]] = field(default_factory=list)
    priority: int = 4
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def side(self) -> str:
        """The champion's."""
        return find_view(self.id).side

    @property
    def other_side(self) -> str:
        """The population's."""
        return find_view(self.id).other_side


def load_recipes(file: Path) -> dict[str, Recipe]:
    """The champions of a YAML file, by name.

    Raises:
        UserError: the file cannot be read, or a key is missing, unknown or of another kind.
    """
    content = read_yaml(file, "champions")
    return {
        str(name): _recipe(str(name), found, f"champions {file}: {name}") for name, found in content.items()
    }


def _recipe(name: str, content: Any, where: str) -> Recipe:
    fields = {f.name: f for f in dataclasses.fields(Recipe) if f.name != "name"}
    needed = {key for key, f in fields.items() if f.default_factory is f.default is dataclasses.MISSING}
    check_keys(content, fields, where, sorted(needed))
    recipe = Recipe(name, **content)
    for key in ("against", "stages", "responders"):
        if not isinstance(getattr(recipe, key), list) or not (getattr(recipe, key) or key == "responders"):
            raise UserError(f"{where}: {key}: expected a list, got {getattr(recipe, key)!r}")
    for stage in recipe.stages:
        _check(stage, {"steps", "hyperparams"}, {"steps"}, f"{where}: stages")
    for responder in recipe.responders:
        _check(responder, _RESPONDER, {"algorithm", "steps"}, f"{where}: responders")
    if recipe.id != policy_view(recipe.side).id:
        raise UserError(f"{where}: id: expected {policy_view(recipe.side).id}, got {recipe.id}")
    return recipe


def _check(content: Any, known: set[str], needed: set[str], where: str) -> None:
    if not isinstance(content, Mapping) or not needed <= set(content) <= known:
        raise UserError(
            f"{where}: expected a mapping with {', '.join(sorted(known))} (steps at least), got {content!r}"
        )


def train_champion(
    recipe: Recipe, seed: int, runs: Path, *, say: Callable[[str], None] = print, progress: bool = False
) -> Path:
    """Train one champion; what was stopped goes on, what is done is not done again.

    After a stage, responders are trained against its agent, and the next stage meets them, too. From the
    second stage on, a player that leaves the champion less is drawn more often (prioritised fictitious
    self-play, Vinyals et al. 2019).

    Args:
        recipe: how.
        seed: the training seed.
        runs: the folder of all champions' runs: ``NAME/seed_k/stage_i``, and ``responder_j`` in it.
        say: told a line where something is done.
        progress: whether to show how each training goes.

    Returns:
        The agent's folder of the last stage.

    Raises:
        UserError: something unknown or out of range, or a folder that holds another run.
        KeyboardInterrupt: stopped by the user.
    """
    population = [str(spec) for spec in with_members(recipe.against, recipe.other_side)]
    folder, agent = runs / recipe.name / f"seed_{seed}", Path()
    for number, stage in enumerate(recipe.stages):
        here = folder / f"stage_{number}"
        drawn = population if number == 0 else _drawn(recipe, agent, population, here / "population.json")
        run = RunSpec(
            recipe.algorithm,
            recipe.id,
            seed,
            stage["steps"],
            {**recipe.hyperparams, "n_timesteps": stage["steps"], **stage.get("hyperparams", {})},
            against=drawn,
            start=folder / f"stage_{number - 1}" / "run" if number else None,
            options=recipe.options,
        )
        agent = train_run(run, here / "run", evaluations=LOOKS, progress=progress, resume=True)
        say(f"{recipe.name}/seed_{seed}: stage {number} trained, against {len(population)} players")
        if number + 1 < len(recipe.stages):
            population += respond(recipe, agent, here, RESPONDER_SEED + 1000 * seed + 100 * number, progress)
    return agent


def respond(recipe: Recipe, agent: str | Path, folder: Path, seed: int, progress: bool = False) -> list[str]:
    """Train a recipe's responders against an agent; what is done is not done again.

    Args:
        recipe: says how.
        agent: the agent's folder or name.
        folder: of the runs, ``responder_<j>``.
        seed: the first one's training seed.
        progress: whether to show how each training goes.

    Returns:
        Their agents' folders.
    """
    found = []
    for index, responder in enumerate(recipe.responders):
        run = RunSpec(
            responder["algorithm"],
            policy_view(recipe.other_side).id,
            seed + index,
            responder["steps"],
            responder.get("hyperparams"),
            against=str(agent),
            options=responder.get("options", {}),
        )
        where = folder / f"responder_{index}"
        found.append(str(train_run(run, where, evaluations=0, progress=progress, resume=True)))
    return found


def _drawn(recipe: Recipe, agent: str | Path, population: list[str], file: Path) -> list[str]:
    """The population, each as often as it is to be drawn; kept in a file, so that it stays."""
    if file.exists():
        kept = read_json(file, "population")
        copies = kept["copies"]
        if list(copies) != population:
            raise UserError(f"{file}: holds another population; choose another folder")
    else:
        returns = returns_a_step(recipe, agent, population)
        copies = dict(zip(population, copies_by_hardness(returns, recipe.priority), strict=True))
        told = dict(zip(population, (round(x, 3) for x in returns), strict=True))
        write_json(file, {"agent": str(agent), "returns_a_step": told, "copies": copies})
    return [player for player, count in copies.items() for _ in range(count)]


def copies_by_hardness(returns: Sequence[float], priority: int) -> list[int]:
    """How often each player stands in the list to draw from: 1 for the easiest, ``priority`` for the hardest.

    The share between them grows with the square of how hard a player is.
    """
    low, high = min(returns), max(returns)
    hard = [(high - x) / (high - low) if high > low else 0.0 for x in returns]
    return [1 + round((priority - 1) * share**2) for share in hard]


def returns_a_step(
    recipe: Recipe, agent: str | Path, population: Sequence[str], rounds: int = ROUNDS
) -> list[float]:
    """The agent's mean return a step against each player of a population, on tuning seeds."""
    found = []
    for other in population:
        options: dict[str, Any] = {**recipe.options, recipe.other_side: other}
        core = OneSided(recipe.id, rounds, **options)
        player: Any = as_player(str(agent), recipe.side, core.scenario)
        core.reset(seeds=np.array(tuning_seeds(rounds)))
        memory, starts, total = None, np.ones(rounds, bool), 0.0
        while not core.truncated.all():
            actions, memory = player.predict(core.observations, memory, starts)
            core.step(actions)
            total, starts = total + float(core.rewards.mean()), np.zeros(rounds, bool)
        found.append(total / core.scenario.steps_per_round)
    return found


def ship_champion(agent: Path, folder: Path, recipe: Recipe, seed: int, command: str) -> None:
    """Copy a champion's agent to where it is shipped; its ``agent.json`` says how all of it was made.

    Args:
        agent: the agent's folder of the last stage.
        folder: where to.
        recipe, seed: how it was made.
        command: what makes it again.

    Raises:
        UserError: the agent is not whole.
    """
    about = dict(load_agent(agent, recipe.side).about)
    steps = sum(stage["steps"] for stage in recipe.stages)
    about |= {"command": command, "training_steps": steps, "training_seed": seed}
    about["recipe"] = json.loads(json.dumps(dataclasses.asdict(recipe)))
    write_whole(folder / "policy.onnx", (agent / "policy.onnx").read_bytes())
    write_json(folder / "agent.json", about)
