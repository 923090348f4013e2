"""Best responses to a fixed player: trained, and evaluated against it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, cast

from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import write_json
from fpg_bench.common.ids import NAMED, SCRIPTED, other_side, policy_env
from fpg_bench.common.imports import code_fingerprint
from fpg_bench.common.locks import own_folder
from fpg_bench.common.rows import Row
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.game.spec import GameSpec, Options
from fpg_bench.players.agent import read_card
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import SIDES
from fpg_bench.players.registry import as_player, card_of, policy_hash
from fpg_bench.products.league.config import BestResponseConfig
from fpg_bench.products.league.evaluation import MATCHES, evaluate_against, result_row
from fpg_bench.products.league.folder import as_json, check_same
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import check_run, train

_logger = logging.getLogger(__name__)

RESULT = "best_responses.json"
# Reward of best responses by the side of the player: an ally's lowest return is what anybody can do to it, an
# opponent's is taken against allies that play for themselves.
RESPONSE_REWARDS = {"ally": "zero_sum", "opponent": "own"}


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


def best_responses(config: BestResponseConfig, out: str | Path, *, progress: bool = True) -> BestResponses:
    """Train best responses to a fixed player, and evaluate the player against them.

    The opponent's path is that of the player's training: ``learned`` where it was among its paths, else
    ``pursuit``. A stopped call is resumed: finished responses are not trained again, and calls with other
    configurations add responses to them.

    Args:
        config: the player, and the kind of responses.
        out: a folder for ``best_responses.json`` and the runs, ``<algorithm>-<steps>/seed_<k>``, with
            the action mode behind the algorithm where it is not continuous.
        progress: show the progress of each training.

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
    target, out = find_target(config.agent, config.side, config.game), Path(out)
    file = out / RESULT
    about: _Measured = {
        "side": target.side,
        "policy": target.fingerprint,
        "scenario": target.scenario.hash,
        "path": target.game.to_dict()["path"],
        "matches": MATCHES,
        "protocol": PROTOCOL,
    }
    other = other_side(target.side)
    check_run(_response_run(config, target, 0))
    with own_folder(out, RESULT, "best responses"):
        begun: Row = {"agent": config.agent, **about, "scripts": {}, "responses": []}
        result = cast("BestResponses", check_same(file, "best responses", about) if file.exists() else begun)
        if not result["scripts"]:
            result["scripts"] = {name: target.evaluate(name) for name in SCRIPTED[other]}
            # The folder is taken before any training
            result["lowest"] = _lowest_return(result)
            write_json(file, result)
        for seed in range(config.n_seeds):
            if (response := _respond(config, target, seed, out, result["responses"], progress)) is not None:
                result["responses"].append(response)
                result["lowest"] = _lowest_return(result)
                write_json(file, result)
                _logger.info(f"trained with seed {seed}: {response['return']:.2f} per step")
    return result


def _respond(
    config: BestResponseConfig,
    target: ResponseTarget,
    seed: int,
    out: Path,
    known: Sequence[Row],
    progress: bool,
) -> Row | None:
    """Train one response, and evaluate the player against it; None if it is known already."""
    made: Row = {
        "algorithm": config.algorithm,
        "steps": config.steps,
        "training_seed": seed,
        "reward": _reward(config, target),
        **({} if config.actions in (None, "continuous") else {"actions": config.actions}),
    }
    folder = RunFolder(out / response_folder(made))
    run = _response_run(config, target, seed)
    made["hyperparameters"] = as_json(cast("Mapping[str, object]", run.hyperparams))
    same = [row for row in known if row.get("actions") == made.get("actions")]
    if any(made.items() <= row.items() for row in same):
        return None
    agent = train(run, folder.path, evaluations=0, progress=progress, resume=True)
    ran = folder.read()
    cost = {"seconds": ran.seconds} | ({"n_resumes": ran.part} if ran.part else {})
    return made | cost | target.evaluate(str(agent))


def _reward(config: BestResponseConfig, target: ResponseTarget) -> str:
    return RESPONSE_REWARDS[target.side] if config.reward is None else config.reward


def _response_run(config: BestResponseConfig, target: ResponseTarget, seed: int) -> RunConfig:
    """Return the run of a response."""
    game = GameSpec.of(target.game, reward=_reward(config, target), actions=config.actions)
    values = load_hyperparameters(config.algorithm, game, config.hyperparams, allow=config.allow).entry()
    return RunConfig(config.algorithm, game, seed, config.steps, values)


def response_folder(response: Row) -> str:
    """Return the folder of a response's run, relative to the folder of all responses."""
    parts = [response["algorithm"], response["steps"]]
    parts[1:1] = [response["actions"]] if "actions" in response else []
    return f"{'-'.join(map(str, parts))}/seed_{response['training_seed']}"


def response_label(response: Row) -> str:
    """Return a description of how a response was made."""
    actions = f" {response['actions']}" if "actions" in response else ""
    steps = f"{response['steps']:,} steps"
    return f"{response['algorithm']}{actions}, {steps}, seed {response['training_seed']}"


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


def find_target(agent: str, side: str | None, replaced: Mapping[str, Any]) -> ResponseTarget:
    """Load a player; the game is that of its training, except for the options that are replaced."""
    side = _side_of(agent) if side is None else one_of(side, "side", SIDES)
    player = as_player(agent, side, STANDARD)
    options: Options = {"path": "pursuit"}
    if (card := card_of(player)) is not None:
        options["path"] = card.flies
        if replaced.get("scenario") is None:
            options["scenario"] = _scenario_of(agent, card)
        else:
            kept = ("knowledge", "jamming_types")
            options |= {name: getattr(card.game, name) for name in kept}
    options |= {name: value for name, value in replaced.items() if value is not None}
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
    sides = [side for side in SIDES if agent in NAMED[side]]
    if "/" in agent or Path(agent).is_dir():
        sides = [read_card(agent).side]
    if len(sides) != 1:
        if sides:
            raise UserError(f"player {agent!r} plays both sides; set side to ally or opponent")
        hint = nearest(agent, [name for side in SIDES for name in NAMED[side]])
        raise UserError(f"player {agent!r}: no such agent or script{hint}")
    return sides[0]
