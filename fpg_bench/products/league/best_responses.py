"""Best responses to a fixed player: trained, and evaluated against it."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypedDict, TypeVar, cast

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import check_own_folder, write_json
from fpg_bench.common.ids import SCRIPTED, SCRIPTS, other_side, policy_env
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.rows import Row
from fpg_bench.evaluation.entry import code_fingerprint
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.game.spec import GameSpec, Options
from fpg_bench.players.agent import read_card
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import SIDES
from fpg_bench.players.registry import as_player, card_of, policy_hash
from fpg_bench.players.tactics import draw_variants
from fpg_bench.products.league.evaluation import MATCHES, check_same, evaluate_against, result_row
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import Hyperparams, load_hyperparameters
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

T = TypeVar("T", str, int)

RESULT = "best_responses.json"
STARTS = ("nothing", "strongest")
# Reward of best responses by the side of the player: an ally's lowest return is what anybody can do to it, an
# opponent's is taken against allies that play for themselves.
RESPONSE_REWARDS = {"ally": "zero_sum", "opponent": "own"}


class _Kind(TypedDict, total=False):
    """Arguments of a call of :func:`best_responses`."""

    algorithm: str
    steps: int
    n_seeds: int
    actions: str
    start: str
    search: int


Lowest = TypedDict("Lowest", {"return": float, "against": str})


class _Measured(TypedDict):
    """The player, and how it is measured: what one folder's responses have in common."""

    side: str
    policy: str
    scenario: str
    path: str | list[str]
    matches: int
    protocol: str


class BestResponses(_Measured):
    """Content of ``best_responses.json``; see :func:`best_responses`."""

    agent: str
    scripts: dict[str, Row]
    responses: list[Row]
    lowest: Lowest


# Calls in a full search. No kind of response finds the lowest return of
# every player, so the search has four: SAC with few steps, and random scripts; PPO with stacked frames; the
# same with discrete actions; and that as a pupil of the strongest response of these.
DISCRETE_PPO: _Kind = {
    "algorithm": "ppo-stack8",
    "steps": 3_000_000,
    "n_seeds": 2,
    "actions": "discrete",
}
FULL_SEARCH: tuple[_Kind, ...] = (
    {"algorithm": "sac", "steps": 200_000, "n_seeds": 2, "search": 100},
    {"algorithm": "ppo-stack8", "steps": 3_000_000, "n_seeds": 2},
    DISCRETE_PPO,
    {**DISCRETE_PPO, "start": "strongest"},
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
) -> BestResponses:
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
    target = find_target(agent, side, scenario, path)
    reward = RESPONSE_REWARDS[target.side] if reward is None else reward
    file = Path(out) / RESULT
    about: _Measured = {
        "side": target.side,
        "policy": target.fingerprint,
        "scenario": target.scenario.hash,
        "path": target.game.to_dict()["path"],
        "matches": MATCHES,
        "protocol": PROTOCOL,
    }
    check_own_folder(file.parent, RESULT, "best responses")
    other = other_side(target.side)
    names = [*SCRIPTED[other], *draw_variants(other, search, target.scenario)]
    begun: Row = {"agent": agent, **about, "scripts": {}, "responses": []}
    result = cast("BestResponses", check_same(file, "best responses", about) if file.exists() else begun)
    if missing := [name for name in names if name not in result["scripts"]]:
        result["scripts"] |= {name: target.evaluate(name) for name in missing}
        # The folder is taken before any training
        result["lowest"] = _lowest_return(result)
        write_json(file, result)
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
        game = GameSpec.of(target.game, reward=reward, actions=actions)
        values = load_hyperparameters(name, game, hyperparams, allow=allow).entry()
        if kind == "strongest":
            values |= {"imitate": {"teacher": _teacher(run_folder) or _strongest_player(result, Path(out))}}
        config["hyperparameters"] = json.loads(json.dumps(values, default=str))  # as they are read from JSON
        same = [r for r in result["responses"] if r.get("actions") == config.get("actions")]
        if not any(config.items() <= response.items() for response in same):
            run = RunConfig(name, game, seed, budget, values)
            response = train(run, run_folder.path, evaluations=0, progress=progress, resume=True)
            ran = run_folder.read()
            cost = {"seconds": ran.seconds} | ({"n_resumes": ran.part} if ran.part else {})
            result["responses"].append(config | cost | target.evaluate(str(response)))
        result["lowest"] = _lowest_return(result)
        write_json(file, result)
    return result


def full_search(agent: str, out: str | Path, **options: Any) -> BestResponses:
    """Find the lowest return of a player with four kinds of responses, which takes about half an hour.

    Args:
        agent, out: see :func:`best_responses`, which is called for each kind.
        **options: its ``side``, ``scenario``, ``path``, ``reward``, ``progress`` and ``allow``.

    Returns:
        The content of ``best_responses.json`` after the last of them.
    """
    return [best_responses(agent, out, **{**options, "actions": None, **kind}) for kind in FULL_SEARCH][-1]


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
    imitation = run.read().hyperparameters.get("imitate") or {}
    teacher: str | None = imitation.get("teacher")
    check_allowed(teacher, (), f"run {run.description}")
    return teacher


def _strongest_player(result: BestResponses, out: Path) -> str:
    """Return the script, or the agent of a response from nothing, with the player's lowest return."""
    returns = {name: row["return"] for name, row in result["scripts"].items()}
    for response in result["responses"]:
        if response["start"] == "nothing":
            returns[str(out / response_folder(response) / "agent")] = response["return"]
    return str(min(returns, key=lambda name: returns[name]))


def _lowest_return(result: BestResponses) -> Lowest:
    """Return the player's lowest return per step, and against whom that was."""
    returns = {name: row["return"] for name, row in result["scripts"].items()}
    returns |= {response_label(response): response["return"] for response in result["responses"]}
    name = min(returns, key=lambda name: returns[name])
    return {"return": returns[name], "against": name}


@dataclass(frozen=True)
class ResponseTarget:
    """A fixed player that responses are trained against, and the game of their training."""

    agent: str
    fingerprint: str
    game: GameSpec

    @property
    def side(self) -> str:
        """The side of the player."""
        return self.game.config.other_side

    @property
    def scenario(self) -> Scenario:
        """The scenario that is played."""
        return self.game.resolve()

    def evaluate(self, other: str) -> Row:
        """Return the player's results against another player, and the other's return per step, ``earned``."""
        summary = evaluate_against(self.agent, {other: other}, self.side, self.scenario, MATCHES)
        row = result_row(summary)
        del row["returns"]
        tally = summary.pooled.tally
        return row | {"earned": round(tally[f"{other_side(self.side)}_return"] / tally["steps"], 4)}


def find_target(
    agent: str, side: str | None, scenario: str | Path | None, path: str | Sequence[str] | None
) -> ResponseTarget:
    """Load a player; the game is that of its training, except for what the caller sets."""
    side = _side_of(agent) if side is None else side
    if side not in SIDES:
        raise UserError(f"side: expected ally or opponent, got {side!r}")
    player = as_player(agent, side, STANDARD)
    options: Options = {"path": path or "pursuit", "scenario": scenario}
    if (card := card_of(player)) is not None:
        options["path"] = path or card.flies
        if scenario is None:
            options["scenario"] = _scenario_of(agent, card)
        else:
            kept = ("knowledge", "jamming_types")
            options |= {name: getattr(card.game, name) for name in kept}
    game = GameSpec.of(policy_env(other_side(side)).id, against=agent, **options)
    return ResponseTarget(agent, policy_hash(player) or code_fingerprint(agent), game)


def _scenario_of(agent: str, card: AgentCard) -> Scenario | str | None:
    """Return the scenario of an agent's training, by the name of its preset if it has one."""
    try:
        home = card.home()
    except UserError as error:
        raise UserError(f"agent {agent}: {error}") from error
    return None if home == STANDARD else home.name or home


def _side_of(agent: str) -> str:
    """Return the side that an agent or a script plays."""
    sides = [side for side in SIDES if agent in SCRIPTS[side]]
    if "/" in agent or Path(agent).is_dir():
        sides = [read_card(agent).side]
    if len(sides) != 1:
        if sides:
            raise UserError(f"player {agent!r} plays both sides; set side to ally or opponent")
        hint = nearest(agent, [name for side in SIDES for name in SCRIPTS[side]])
        raise UserError(f"player {agent!r}: no such agent or script{hint}")
    return sides[0]
