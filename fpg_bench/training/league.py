"""League training: best responses to a player, self-play against the past, champions against populations.

Self-play is fictitious self-play (Heinrich, Lanctot and Silver, "Fictitious self-play in extensive-form
games", 2015) with a pool of past policies in the place of their average. Champions use prioritized
fictitious self-play (Vinyals et al. 2019).
"""

from __future__ import annotations

import dataclasses
import json
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import Field as Constraint

from fpg_bench.common.checks import integer, mapping
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import check_own_folder, read_json, read_yaml, write_json, write_whole
from fpg_bench.common.ids import SCRIPTED, find_env, other_side, policy_env, sides_of
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.schema import Items, PositiveInt, Strict, parse
from fpg_bench.evaluation.entry import code_fingerprint, player_entry
from fpg_bench.evaluation.play import SeedSource, play
from fpg_bench.evaluation.seeds import PROTOCOL, tuning_seeds
from fpg_bench.evaluation.suite import Rival, Scale, Suite, side_suite
from fpg_bench.evaluation.summary import Summary, summarise
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD, Scenario, as_scenario
from fpg_bench.players.agent import load_agent
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.population import expand_suites, flight_of, member_folder
from fpg_bench.players.registry import as_player, policy_hash
from fpg_bench.players.tactics import draw_variants
from fpg_bench.training.config import GameOptions, RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder, command_line
from fpg_bench.training.train import train

Hyperparams = str | Path | Mapping[str, Any] | None
T = TypeVar("T", str, int)

RESULT = "best_responses.json"
ROWS, ABOUT = "selfplay.jsonl", "selfplay.json"
STARTS = ("nothing", "strongest")
# Reward of best responses by the side of the player: an ally's lowest return is what anybody can do to it, an
# opponent's is taken against allies that play for themselves.
RESPONSE_REWARDS = {"ally": "zero_sum", "opponent": "own"}
MATCHES = 100  # against each player, in the evaluation of best responses and generations
SEED_STRIDE = 1000  # generation g of self-play with seed k has training seed 1000 k + g
RESPONDER_SEED = 1_000_000  # first training seed of the responders to champions
POPULATION_ROUNDS, CHAMPION_EVALUATIONS = 48, 4
_logger = logging.getLogger(__name__)


def evaluate_against(
    player: str | Player,
    others: Mapping[str, str],
    side: str,
    scenario: Scenario,
    matches: int,
    seeds: SeedSource | None = None,
) -> Summary:
    """Evaluate a player against players that no suite names.

    The scale of the scores is that of the side's public suite where the scenario is that suite's own, apart
    from the path.

    Args:
        player: the player, as :func:`fpg_bench.players.registry.as_player` takes it.
        others: players of the other side, by the names that the summary calls them.
        side: side of the player.
        scenario: the scenario that is played.
        matches: number of matches against each of the others.
        seeds: function from a number of matches to their seeds; None takes the evaluation seeds.

    Raises:
        UserError: no such player, or one of the wrong side.
    """
    public = side_suite(side, scenario)
    same_path = dataclasses.replace(scenario, opponent_path=public.scenario.opponent_path)
    scale = public.scale if same_path.hash == public.scenario.hash else Scale()
    rivals = tuple(Rival(name, (other,), scenario) for name, other in others.items())
    suite = Suite("league", side, scenario, matches, rivals, scale)
    entry = player_entry(player)
    (summary,) = summarise([play(entry, suite, rival, seeds) for rival in rivals], suite)
    return summary


def _result_row(summary: Summary) -> Row:
    """Return the means ``score`` and ``return`` per step, ``returns`` against each, and ``measures``."""
    return {
        "score": round(summary.score.value, 2),
        "return": round(summary.reward.value, 4),
        "returns": {name: round(result.value, 4) for name, result in summary.by_rival.items()},
        "measures": {name: None if x is None else round(x, 5) for name, x in summary.measures.items()},
    }


def _check_same(file: Path, kind: str, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a file; raise UserError if it was made with settings other than ``about``."""
    content = read_json(file, kind)
    if different := [key for key in about if content.get(key) != about[key]]:
        raise UserError(f"{file}: holds {kind} with another {different[0]}; choose another folder")
    return content


# Best responses

# Arguments of the calls of best_responses in a full search. No kind of response finds the lowest return of
# every player, so the search has four: SAC with few steps, and random scripts; PPO with stacked frames; the
# same with discrete actions; and that as a pupil of the strongest response of these.
_DISCRETE: dict[str, Any] = {
    "algorithm": "ppo-stack8",
    "steps": 3_000_000,
    "n_seeds": 2,
    "actions": "discrete",
}
FULL_SEARCH: tuple[dict[str, Any], ...] = (
    {"algorithm": "sac", "steps": 200_000, "n_seeds": 2, "search": 100},
    {"algorithm": "ppo-stack8", "steps": 3_000_000, "n_seeds": 2},
    _DISCRETE,
    _DISCRETE | {"start": "strongest"},
)


def best_responses(
    agent: str,
    out: str | Path,
    *,
    algorithm: str | Sequence[str] = "ppo",
    steps: int | Sequence[int] = 500_000,
    n_seeds: int = 3,
    start: str | Sequence[str] = "nothing",
    hyperparams: Hyperparams = None,
    reward: str | None = None,
    side: str | None = None,
    scenario: str | Path | None = None,
    path: str | Sequence[str] | None = None,
    actions: str | None = None,
    search: int = 0,
    progress: bool = True,
    allow: Collection[str] = (),
) -> dict[str, Any]:
    """Train best responses to a fixed player, and evaluate the player against them.

    The opponent's path is that of the player's training: ``learned`` where it was among its paths, else
    ``pursuit``. A stopped call is resumed: finished responses are not trained again, and further algorithms,
    budgets and seeds add responses to them. A response that imitates keeps the teacher that it began with.

    Args:
        agent: the player: a shipped agent, a folder, a script, or ``package.module:object``.
        out: a folder for ``best_responses.json`` and the runs, ``<start>-<algorithm>-<steps>/seed_<k>``, with
            the action mode behind the algorithm where it is not continuous.
        algorithm: algorithm of the responses, or several; see
            :class:`fpg_bench.training.config.RunConfig`.
        steps: training budget of each response, or several.
        n_seeds: number of responses of each kind, with training seeds 0, 1, 2, ...
        start: ``nothing``; or ``strongest``, to imitate first whichever script or response from ``nothing``
            has the lowest return of the player so far; or both, one after the other.
        hyperparams: hyper-parameters of a single algorithm.
        reward: reward of the responses: ``zero_sum``, to lower the player's return, or any other of
            :class:`fpg_bench.envs.core.SingleAgentGame`; None for ``zero_sum`` against an ally and ``own``
            against an opponent.
        side: side of the player; None takes that of the agent or the script.
        scenario: a scenario to play instead of that of the agent's training, on the same path and with the
            same knowledge base and jamming types.
        path: flight path of the opponent; None chooses it as described above.
        actions: action mode of the responses; None for continuous.
        search: number of scripts with random constants to evaluate in addition to the scripts.
        progress: show the progress of each training.
        allow: the ``package.module:object`` and agents of the Hub that the file of the hyper-parameters may
            name; neither is run on a file's word.

    Returns:
        The content of ``best_responses.json``: the player, the game, ``responses`` (how each was made, the
        ``seconds`` of its training, the player's ``return`` per step and ``score`` against it, ``earned``,
        the response's own return per step, and the ``measures``; also ``n_resumes`` if its training was
        resumed, as its policy then differs from that of an uninterrupted training), the same for the other
        side's ``scripts``, and ``lowest``, the lowest return and against whom. It is an upper bound of the
        player's worst return: another response may find a lower one.

    Raises:
        UserError: no such player, a player whose training scenario no longer exists, or a folder with other
            files or with best responses to another player.
        KeyboardInterrupt: stopped by the user.
    """
    algorithms, budgets, starts = _as_list(algorithm), _as_list(steps), _as_list(start)
    if unknown := [each for each in starts if each not in STARTS]:
        raise UserError(f"start: expected nothing or strongest, got {unknown[0]!r}")
    for name, value in (("n_seeds", n_seeds), *(("steps", budget) for budget in budgets)):
        integer(value, name)
    if hyperparams is not None and len(algorithms) > 1:
        raise UserError("hyperparams: belong to one algorithm, but several are named; name one")
    integer(search, "search", least=0)
    target = _find_target(agent, side, scenario, path)
    reward = RESPONSE_REWARDS[target.side] if reward is None else reward
    env_id, file = policy_env(other_side(target.side)).id, Path(out) / RESULT
    about = {
        "side": target.side,
        "policy": target.fingerprint,
        "scenario": target.scenario.hash,
        "path": target.game.path,
        "matches": MATCHES,
        "protocol": PROTOCOL,
    }
    check_own_folder(file.parent, RESULT, "best responses")
    other = other_side(target.side)
    names = [*SCRIPTED[other], *draw_variants(other, search, target.scenario)]
    result: dict[str, Any] = {"agent": agent, **about, "scripts": {}, "responses": []}
    if file.exists():
        result = _check_same(file, "best responses", about)
    if missing := [name for name in names if name not in result["scripts"]]:
        result["scripts"] |= {name: target.evaluate(name) for name in missing}
        # The folder is taken before any training
        write_json(file, result | {"lowest": _lowest_return(result)})
    for kind, name, budget, seed in product(starts, algorithms, budgets, range(n_seeds)):
        config: Row = {
            "algorithm": name,
            "steps": budget,
            "start": kind,
            "training_seed": seed,
            "reward": reward,
            **({} if actions in (None, "continuous") else {"actions": actions}),
        }
        run_folder = RunFolder(Path(out) / response_folder(config))
        values = load_hyperparameters(
            name,
            env_id,
            hyperparams,
            path=target.game.path,
            actions=actions or "continuous",
            allow=allow,
        ).entry()
        if kind == "strongest":
            values |= {"imitate": {"teacher": _teacher(run_folder) or _strongest_player(result, Path(out))}}
        config["hyperparameters"] = json.loads(json.dumps(values, default=str))  # as they are read from JSON
        same = [r for r in result["responses"] if r.get("actions") == config.get("actions")]
        if not any(config.items() <= response.items() for response in same):
            game = dataclasses.replace(target.game, reward=reward, actions=actions)
            run = RunConfig(name, env_id, seed, budget, values, game, against=agent)
            response = train(run, run_folder.path, evaluations=0, progress=progress, resume=True)
            ran = run_folder.read()
            cost = {"seconds": ran["seconds"]} | ({"n_resumes": ran["part"]} if ran.get("part") else {})
            result["responses"].append(config | cost | target.evaluate(str(response)))
        result["lowest"] = _lowest_return(result)
        write_json(file, result)
    return result


def response_folder(response: Row) -> str:
    """Return the folder of a response's run, relative to the folder of all responses."""
    parts = [response["start"], response["algorithm"], response["steps"]]
    parts[2:2] = [response["actions"]] if "actions" in response else []
    return f"{'-'.join(map(str, parts))}/seed_{response['training_seed']}"


def response_label(response: Row) -> str:
    """Return a description of how a response was made."""
    start = "" if response["start"] == "nothing" else ", from the strongest"
    actions = f" {response['actions']}" if "actions" in response else ""
    steps = f"{response['steps']:,} steps"
    return f"{response['algorithm']}{actions}, {steps}{start}, seed {response['training_seed']}"


def _as_list(value: T | Sequence[T]) -> list[T]:
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else [value]


def _teacher(run: RunFolder) -> str | None:
    """Return the teacher that a response's run has begun with; None if the run has not begun."""
    if not run.description.exists():
        return None
    imitation = run.read().get("hyperparameters", {}).get("imitate") or {}
    teacher: str | None = imitation.get("teacher")
    check_allowed(teacher, (), f"run {run.description}")
    return teacher


def _strongest_player(result: Mapping[str, Any], out: Path) -> str:
    """Return the script, or the agent of a response from nothing, with the player's lowest return."""
    returns = {name: row["return"] for name, row in result["scripts"].items()}
    for response in result["responses"]:
        if response["start"] == "nothing":
            returns[str(out / response_folder(response) / "agent")] = response["return"]
    return str(min(returns, key=lambda name: returns[name]))


def _lowest_return(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return the player's lowest return per step, and against whom that was."""
    returns = {name: row["return"] for name, row in result["scripts"].items()}
    returns |= {response_label(response): response["return"] for response in result["responses"]}
    name = min(returns, key=lambda name: returns[name])
    return {"return": returns[name], "against": name}


@dataclass(frozen=True)
class _Target:
    """A fixed player that responses are trained against, and the game that is played."""

    agent: str
    side: str
    fingerprint: str
    game: GameOptions
    scenario: Scenario

    def evaluate(self, other: str) -> Row:
        """Return the player's results against another player, and the other's return per step, ``earned``."""
        summary = evaluate_against(self.agent, {other: other}, self.side, self.scenario, MATCHES)
        row = _result_row(summary)
        del row["returns"]
        tally = summary.pooled.tally
        return row | {"earned": round(tally[f"{other_side(self.side)}_return"] / tally["steps"], 4)}


def _find_target(
    agent: str, side: str | None, scenario: str | Path | None, path: str | Sequence[str] | None
) -> _Target:
    """Load a player; the game is that of its training, except for what the caller sets."""
    side = _side_of(agent) if side is None else side
    if side not in SIDES:
        raise UserError(f"side: expected ally or opponent, got {side!r}")
    player = as_player(agent, side, STANDARD)
    about = getattr(player, "about", {})  # empty for a script
    own = mapping(about.get("options") or {}, f"agent {agent}: agent.json: options")
    options: dict[str, Any] = {
        key: own[key] for key in ("scenario", "knowledge", "jamming_types") if key in own
    }
    if scenario is not None:
        options["scenario"] = str(scenario)
    fields = about.get("scenario_fields") or {}
    game = GameOptions(path=path or flight_of(about), **options)
    played = game_scenario(game)
    if about and scenario is None:
        same = {key: fields.get(key, getattr(STANDARD, key)) for key in ("opponent_path", "rounds_per_match")}
        if dataclasses.replace(played, **same).hash != about["scenario"]:
            raise UserError(
                f"agent {agent}: was trained in a scenario that no longer exists; name the scenario"
            )
    return _Target(agent, side, policy_hash(player) or code_fingerprint(agent), game, played)


def game_scenario(game: GameOptions) -> Scenario:
    """Return the scenario that game options describe."""
    return as_scenario(
        game.scenario, opponent_path=game.path, knowledge=game.knowledge, jamming_types=game.jamming_types
    )


def _side_of(agent: str) -> str:
    """Return the side that an agent or a script plays."""
    sides = [side for side in SIDES if agent in SCRIPTED[side]]
    if "/" in agent or Path(agent).is_dir():
        about = load_agent(agent).about
        sides = [str(about.get("side") or sides_of(about["id"])[0])]
    if len(sides) != 1:
        if sides:
            raise UserError(f"player {agent!r} plays both sides; set side to ally or opponent")
        hint = nearest(agent, [name for side in SIDES for name in SCRIPTED[side]])
        raise UserError(f"player {agent!r}: no such agent or script{hint}")
    return sides[0]


# Self-play


def selfplay(
    algorithm: str,
    out: str | Path,
    *,
    generations: int = 10,
    steps: int = 500_000,
    pool: int = 5,
    seed: int = 0,
    hyperparams: Hyperparams = None,
    scenario: Scenario | str | Path | None = None,
    path: str | Sequence[str] | None = None,
    knowledge: str | None = None,
    jamming_types: str | Sequence[str] | None = None,
    evaluations: int = 1,
    progress: bool = True,
    allow: Collection[str] = (),
) -> dict[str, Path]:
    """Train both sides alternately, each generation against past generations of the other side.

    Generation 0 of a side plays all scripts of the other side. Each later generation starts from the weights
    of the one before. Every generation is a separate run. A stopped call is resumed: finished generations are
    not trained again, and a larger number adds generations to them.

    Args:
        algorithm: algorithm of both sides; see :class:`fpg_bench.training.config.RunConfig`.
        out: a folder for ``generations/<side>_<g>``, the runs; ``selfplay.jsonl``, one row per generation;
            ``ally`` and ``opponent``, the agents of the last generation.
        generations: number of generations of each side.
        steps: training budget of one generation of one side.
        pool: maximum number of past generations of the other side that are drawn for a generation.
        seed: decides the draws and the training seeds, ``1000 * seed + g`` for generation g; it is also the
            ``training_seed`` of the exported agents.
        hyperparams: a YAML file, or an entry for the ids of both sides; None takes the shipped file.
        scenario, path, knowledge, jamming_types: the game, as in
            :class:`fpg_bench.training.config.GameOptions`.
        evaluations: number of evaluations of each generation on its suite, besides the one at its start; 0
            for none.
        progress: show the progress of each training.
        allow: the ``package.module:object`` and agents of the Hub that the file of the hyper-parameters may
            name; neither is run on a file's word.

    Returns:
        The folders of both agents.

    Raises:
        UserError: something unknown or out of range, a folder with another self-play or other files, or an
            agent of a past generation that is incomplete.
        KeyboardInterrupt: stopped by the user.
    """
    for name, value in (("generations", generations), ("pool", pool)):
        integer(value, name)
    game = GameOptions(scenario=scenario, path=path, knowledge=knowledge, jamming_types=jamming_types)
    league = _SelfPlay(algorithm, Path(out), steps, pool, seed, hyperparams, game, allow)
    about, file = league.describe(), RowFile(league.folder / ROWS, {"generation": int, "side": str})
    check_own_folder(league.folder, ABOUT, "self-play", ROWS)
    with file.locked():
        done = {(row["generation"], row["side"]) for row in file.read()}
        if not done:
            write_json(league.folder / ABOUT, about)
        _check_same(league.folder / ABOUT, "a self-play", about)
        for generation, side in product(range(generations), SIDES):
            if (generation, side) not in done:
                run = league.run_config(side, generation)
                folder = league.run(side, generation).path
                train(run, folder, evaluations=evaluations, progress=progress, resume=True)
                row = league.evaluate(side, generation)
                file.append([row])
                _logger.info(_row_text(row))
        last = {row["side"]: row["generation"] for row in file.read()}
        return {side: league.export_agent(side, last[side] + 1) for side in SIDES}


@dataclass(frozen=True)
class _SelfPlay:
    """A self-play league in a folder; its attributes are arguments of :func:`selfplay`."""

    algorithm: str
    folder: Path
    steps: int
    pool: int
    seed: int
    hyperparams: Hyperparams
    game: GameOptions
    allow: Collection[str]

    def describe(self) -> dict[str, Any]:
        """Return the settings that distinguish it from another self-play, as they are read from JSON."""
        parameters = {
            side: load_hyperparameters(
                self.algorithm,
                policy_env(side).id,
                self.hyperparams,
                path=self.game.path,
                allow=self.allow,
            )
            for side in SIDES
        }
        about = {
            "algorithm": self.algorithm,
            "scenario": game_scenario(self.game).hash,
            "steps": self.steps,
            "pool": self.pool,
            "seed": self.seed,
            "hyperparameters": {side: each.entry() for side, each in parameters.items()},
        }
        content: dict[str, Any] = json.loads(json.dumps(about))
        return content

    def run(self, side: str, generation: int) -> RunFolder:
        """Return the folder of a generation's run."""
        return RunFolder(self.folder / "generations" / f"{side}_{generation}")

    def others(self, side: str, generation: int) -> dict[str, str]:
        """Return the players that a generation is trained against, by their names in rows."""
        other = other_side(side)
        if generation == 0:
            return {name: name for name in SCRIPTED[other]}
        past = draw_past(side, generation, self.pool, self.seed)
        return {f"{other}_{number}": str(self.run(other, number).agent) for number in past}

    def run_config(self, side: str, generation: int) -> RunConfig:
        """Return the run of a generation."""
        return RunConfig(
            self.algorithm,
            policy_env(side).id,
            SEED_STRIDE * self.seed + generation,
            self.steps,
            self.hyperparams,
            self.game,
            against=list(self.others(side, generation).values()),
            start=self.run(side, generation - 1).path if generation else None,
            allow=self.allow,
        )

    def evaluate(self, side: str, generation: int) -> Row:
        """Return a generation's row: its scores on the suite, and against the players of its training."""
        run, others = self.run(side, generation), self.others(side, generation)
        about, scores = run.read(), run.last_scores()
        head = {
            "generation": generation,
            "side": side,
            "steps": about["steps_done"],
            "against": list(others),
            "suite": about["suite"],
            "suite_score": scores.get(side),
        }
        scenario = game_scenario(self.game)
        summary = evaluate_against(str(run.agent), others, side, scenario, MATCHES, tuning_seeds)
        return head | _result_row(summary)

    def export_agent(self, side: str, generations: int) -> Path:
        """Copy the agent of the last generation; its ``agent.json`` describes the whole self-play."""
        last = self.run(side, generations - 1).agent
        runs = [self.run(side, generation).read() for generation in range(generations)]
        about = read_json(last / "agent.json", "agent")
        settings = {"generations": generations, "steps": self.steps, "pool": self.pool, "seed": self.seed}
        options = self.game.to_dict()
        about |= {
            "command": command_line("selfplay", self.algorithm, **settings, **options),
            "options": {name: about["options"][name] for name in options},
            "training_seed": self.seed,
            "training_steps": generations * self.steps,
            **{key: round(sum(run[key] for run in runs), 1) for key in ("steps_done", "seconds")},
        }
        return _write_agent(self.folder / side, last, about)


def draw_past(side: str, generation: int, pool: int, seed: int) -> list[int]:
    """Draw uniformly the past generations of the other side that a generation is trained against."""
    rng = np.random.default_rng([seed, generation, SIDES.index(side)])
    return sorted(rng.choice(generation, min(pool, generation), replace=False).tolist())


def _row_text(row: Row) -> str:
    """Return a log line for a generation's row."""
    measures = row["measures"]
    shares = ", ".join(f"{kind} {100 * measures[f'share_{kind}']:.0f} %" for kind in JAMMING_TYPES)
    on_suite = "" if row["suite_score"] is None else f", {row['suite_score']:.1f} on {row['suite']}"
    return (
        f"{row['side']}_{row['generation']}: {row['score']:.1f} against {', '.join(row['against'])}{on_suite}"
        f"; hops {100 * measures['hop_rate']:.0f} %, spreading {100 * measures['spread_ratio']:.0f} %, "
        f"{shares}"
    )


def _write_agent(folder: Path, agent: Path, about: Mapping[str, Any]) -> Path:
    """Copy an agent's policy to a folder, and write ``about`` as its ``agent.json`` last."""
    write_whole(folder / "policy.onnx", (agent / "policy.onnx").read_bytes())
    write_json(folder / "agent.json", about)
    return folder


# Champions


class Stage(Strict):
    """A stage of a champion's training: its budget, and hyper-parameters that replace the champion's."""

    steps: PositiveInt
    hyperparams: dict[str, Any] | None = None


class Responder(Strict):
    """Training of a player against a stage's agent; attributes are as in :class:`ChampionConfig`."""

    algorithm: str
    steps: PositiveInt
    hyperparams: dict[str, Any] | None = None
    options: dict[str, Any] | None = None


class ChampionConfig(Strict):
    """Configuration of a champion's training, an entry of ``baselines/champions.yml``.

    Attributes:
        name: folder of the agents.
        id: environment id, one of those against any player.
        algorithm, hyperparams: as in :class:`fpg_bench.training.config.RunConfig`.
        against: the population, suites included; one player is drawn per round.
        stages: the stages; each one after the first starts from the weights of the one before.
        responders: players that are trained against the agent of each stage but the last, and then join the
            population.
        priority: how much more often the hardest player is drawn than the easiest, after the first stage.
        options: options of the games, as in :class:`fpg_bench.training.config.GameOptions`.
    """

    name: str
    id: str
    algorithm: str
    hyperparams: dict[str, Any]
    against: Annotated[list[str], Constraint(min_length=1)]
    stages: Annotated[list[Stage], Constraint(min_length=1)]
    responders: Items[Responder] = ()
    priority: PositiveInt = 4
    options: dict[str, Any] = Constraint(default_factory=dict)

    @property
    def side(self) -> str:
        """Side of the champion."""
        return find_env(self.id).side

    @property
    def other_side(self) -> str:
        """Side of the population."""
        return find_env(self.id).other_side


def load_champions(file: Path) -> dict[str, ChampionConfig]:
    """Load the configurations of champions from a YAML file, by name.

    Raises:
        UserError: the file cannot be read, or a key is missing, unknown or invalid.
    """
    configs = {}
    for name, content in read_yaml(file, "champions").items():
        where = f"champions {file}: {name}"
        check_allowed(content, (), where)
        config = parse(ChampionConfig, {"name": name, **mapping(content, where)}, where)
        if config.id != policy_env(config.side).id:
            raise UserError(f"{where}: id: expected {policy_env(config.side).id}, got {config.id}")
        for options in (config.options, *(responder.options or {} for responder in config.responders)):
            GameOptions.parse(options, f"{where}: options")
        configs[config.name] = config
    return configs


def train_champion(config: ChampionConfig, seed: int, runs: Path, *, progress: bool = False) -> Path:
    """Train one champion; a stopped training is resumed, and finished runs are not repeated.

    After each stage but the last, responders are trained against its agent, and they join the population of
    the next stage. From the second stage on, players against which the champion's return is lower are drawn
    more often.

    Args:
        config: the champion's configuration.
        seed: the training seed.
        runs: folder of all champions' runs: ``NAME/seed_k/stage_i/run`` and ``.../responder_j``.
        progress: show the progress of each training.

    Returns:
        The folder of the last stage's agent.

    Raises:
        UserError: something unknown or out of range, or a folder that holds another run.
        KeyboardInterrupt: stopped by the user.
    """
    population = [str(spec) for spec in expand_suites(config.against, config.other_side)]
    folder, agent = runs / config.name / f"seed_{seed}", Path()
    for number, stage in enumerate(config.stages):
        stage_folder = folder / f"stage_{number}"
        drawn = (
            _prioritized(config, agent, population, stage_folder / "population.json")
            if number
            else population
        )
        run = RunConfig(
            config.algorithm,
            config.id,
            seed,
            stage.steps,
            {**config.hyperparams, "n_timesteps": stage.steps, **(stage.hyperparams or {})},
            GameOptions(**config.options),
            against=drawn,
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
            policy_env(config.other_side).id,
            seed + index,
            responder.steps,
            responder.hyperparams,
            GameOptions(**(responder.options or {})),
            against=str(agent),
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
            raise UserError(f"{file}: holds another population; choose another folder")
        values = content["returns_per_step"].values()
        if max(values) > min(values) and max(copies.values()) != config.priority:
            raise UserError(f"{file}: was drawn with another priority; choose another folder")
    else:
        scenario = game_scenario(GameOptions(**config.options))
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


def ship_champion(agent: Path, folder: Path, config: ChampionConfig, seed: int, command: str) -> None:
    """Copy a champion's agent to its shipped folder; its ``agent.json`` describes the whole training.

    Args:
        agent: the folder of the last stage's agent.
        folder: the folder of the shipped agent.
        config, seed: how it was made.
        command: the command that reproduces it.

    Raises:
        UserError: the agent is incomplete.
    """
    about = dict(load_agent(agent, config.side).about)
    steps = sum(stage.steps for stage in config.stages)
    about |= {"command": command, "training_steps": steps, "training_seed": seed}
    about["recipe"] = config.model_dump(mode="json", exclude_none=True)
    _write_agent(folder, agent, about)
