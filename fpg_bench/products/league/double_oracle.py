"""Double oracle: a side learns against responses to it, until no fresh response breaks it.

McMahan, Gordon and Blum, "Planning in the presence of cost functions controlled by an adversary", 2003, with
trained policies as the oracles (PSRO: Lanctot et al., "A unified game-theoretic approach to multiagent
reinforcement learning", 2017). In the mode ``both`` the populations of both sides grow, and each side answers
the other's mixture in the meta-game's equilibrium. In the mode ``one`` the side answers a weighted mixture of
all responses so far, and a response the side's newest policy. In the mode ``selfplay`` no oracle is asked
within a stage: the side and a rival learn at the same time, and responses only measure both. Each search
stops on what a fresh response leaves, not on the meta-game's value: that rises while a new response still
breaks every policy.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import re
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

from fpg_bench.common.checks import integer, one_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import check_own_folder, read_json, write_json, write_whole
from fpg_bench.common.ids import SCRIPTED, find_env, other_side, policy_env
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.strict_json import JsonObject, read_object
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.payoffs import Payoffs
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.store import RECORDS, Pairing, Store
from fpg_bench.evaluation.suite import Rival, Suite, side_suite
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import read_card
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import SIDES
from fpg_bench.players.population import expand_suites, member_folder
from fpg_bench.products.league.best_responses import RESPONSE_REWARDS
from fpg_bench.products.league.evaluation import MATCHES, check_same
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import Hyperparams, as_option, load_hyperparameters
from fpg_bench.training.rl_zoo3_format import Entry
from fpg_bench.training.run_folder import RunFolder, command_line
from fpg_bench.training.train import RIVAL, check_run, train, train_together

ROWS, ABOUT = "double_oracle.jsonl", "double_oracle.json"
# Stage k with seed s has training seed 1000 s + k, its rival in self-play 1000 s + 250 + k, responses to it
# 1000 s + 500 + 2 k and the next, and that to its rival 1000 s + 750 + k.
SEED_STRIDE = 1000
MODES = ("one", "both", "selfplay")
PARTS = 100  # into which the shares of an equilibrium's players are rounded
FINALISTS = 2  # stages that a second response is trained against
_OWN_AGENT = re.compile(r'"[^"]*/(runs/(?:stage|response)_\d+[^"]*)"')  # in JSON
_logger = logging.getLogger(__name__)


class _Settings(TypedDict):
    """Settings that tell a search from another; of pairs, the side's part is first."""

    game: JsonObject
    response: JsonObject
    scenario: str
    algorithms: list[str]
    steps: list[int]
    weight: int
    seed: int
    hyperparameters: list[Entry]


class DoubleOracleResult(_Settings):
    """Content of ``double_oracle.json``; see :func:`double_oracle`."""

    rows: list[Row]
    confirmed: dict[str, float]
    stage: int


def double_oracle(
    out: str | Path,
    *,
    side: str = "ally",
    mode: str = "one",
    stages: int = 3,
    steps: int = 1_000_000,
    response_steps: int | None = None,
    algorithm: str = "ppo-stack8",
    actions: str | None = None,
    response_algorithm: str = "ppo-stack8",
    response_actions: str | None = "discrete",
    against: str | Sequence[str] | None = None,
    weight: int = 8,
    patience: int = 2,
    seed: int = 0,
    hyperparams: Hyperparams = None,
    response_hyperparams: Hyperparams = None,
    progress: bool = True,
    allow: Collection[str] = (),
    **game: Any,
) -> DoubleOracleResult:
    """Train a side in stages, each against fresh responses to the stages before.

    A stage goes on from the weights of the one before; then a fresh response is trained. In the mode ``one``
    it answers the stage's policy alone, and joins the rivals of later stages ``weight`` times. In the mode
    ``both`` the stage answers the other side's mixture in the equilibrium of all policies so far, and the
    response that of the side, the new policy included. In the mode ``selfplay`` the side and a rival learn at
    the same time (:func:`fpg_bench.training.train.train_together`), and one fresh response to each measures
    what it keeps. A stopped call is resumed: what is finished is not trained again, and a larger number of
    stages adds to them.

    Args:
        out: a folder for ``double_oracle.jsonl``, a row per stage; ``runs``, a run each; ``records.jsonl``,
            who met whom; ``agent``, the exported policy; ``rival``, in the mode ``selfplay`` the policy that
            learned beside it; and ``double_oracle.json``, the settings and result.
        side: the side that learns.
        mode: ``one``, ``both`` or ``selfplay``, as above.
        stages: the most stages.
        steps: training budget of a stage.
        response_steps: training budget of a response; None: that of a stage.
        algorithm, actions: algorithm and action mode of the side.
        response_algorithm, response_actions: those of the responses.
        against: rivals of the first stage, with weights such as ``tone*8``, and ``suite:NAME`` for all
            members of a suite; None: all scripts of the other side.
        weight: how often a response is listed among the rivals, in the mode ``one``; in the mode
            ``selfplay``, how often the rival that learns is.
        patience: stops after as many stages without a higher ``low``.
        seed: decides the training seeds.
        hyperparams, response_hyperparams: hyper-parameters of the side and of the responses; None takes the
            shipped file.
        progress: show the progress of each training.
        allow: the ``package.module:object`` and agents of the Hub that the files of the hyper-parameters may
            name; neither is run on a file's word.
        **game: attributes of :class:`fpg_bench.game.spec.GameSpec` that both sides share, ``scenario`` and
            ``path`` for instance.

    Returns:
        The content of ``double_oracle.json``. ``rows`` has of each stage ``low``, what the policy (in the
        mode ``both`` the mixture) that the fresh response answers keeps against it, per step; ``high``, the
        return against the rivals of its training, by their weights, which bounds the game's value from above
        as far as the training found a best answer (in the mode ``selfplay`` what the policy or a fresh
        response earns from the rival, whichever is more); ``meta_value``, the value of the game between all
        stages and all rivals so far; and ``seconds``. ``confirmed`` has of the two stages with the highest
        ``low`` the return of the stage's policy alone against a second response to it, trained afterwards
        with another seed, and ``stage`` is the one that keeps most, which is exported. All are returns of the
        side, on tuning seeds.

    Raises:
        UserError: something unknown or out of range, or a folder with another search or other files.
        KeyboardInterrupt: stopped by the user.
    """
    one_of(side, "side", SIDES)
    one_of(mode, "mode", MODES)
    for name, value in (("stages", stages), ("weight", weight), ("patience", patience)):
        integer(value, name)
    other = other_side(side)
    own = GameSpec.of(
        policy_env(side).id,
        against=list(SCRIPTED[other]) if against is None else against,
        actions=actions,
        **game,
    )
    rivals = [member_folder(str(name), other) for name in expand_suites(own.others, other)]
    league = _DoubleOracle(
        folder=Path(out),
        mode=mode,
        game=GameSpec.of(own, **{other: rivals}),
        response=GameSpec.of(
            policy_env(other).id, actions=response_actions, reward=RESPONSE_REWARDS[side], **game
        ),
        algorithms=(algorithm, response_algorithm),
        steps=(steps, steps if response_steps is None else response_steps),
        weight=weight,
        seed=seed,
        hyperparams=(hyperparams, response_hyperparams),
        progress=progress,
        allow=allow,
    )
    check_run(RunConfig(algorithm, own, seed, steps, hyperparams, allow=allow))
    check_run(RunConfig(response_algorithm, league.response, seed, steps, response_hyperparams, allow=allow))
    about, file = league.describe(), RowFile(league.folder / ROWS, {"stage": int})
    check_own_folder(league.folder, ABOUT, "double oracle", ROWS)
    with file.locked():
        rows = file.read()
        if not rows:
            write_json(league.folder / ABOUT, about)
        known = check_same(league.folder / ABOUT, "a double oracle", about).get("confirmed", {})
        for stage in range(len(rows), stages):
            if _is_flat(rows, patience):
                break
            rows.append(league.play_stage(stage))
            file.append(rows[-1:])
            _logger.info(_row_text(rows[-1]))
        best = sorted(rows, key=lambda row: row["low"], reverse=True)[:FINALISTS]
        confirmed = {
            stage: known[stage] if stage in known else league.confirm(int(stage))
            for stage in (str(row["stage"]) for row in best)
        }
        stage = int(max(confirmed, key=lambda stage: confirmed[stage]))
        league.export_agent(stage)
        result: DoubleOracleResult = {**about, "rows": rows, "confirmed": confirmed, "stage": stage}
        write_json(league.folder / ABOUT, result)
        return result


def search_rows(folder: Path) -> list[Row]:
    """Return the rows of a finished search, each with the search's settings and what its stage kept later.

    Raises:
        UserError: the folder holds no finished search.
    """
    result = read_json(folder / ABOUT, "double oracle")
    if "confirmed" not in result:
        raise UserError(f"{folder}: the search is not finished; run its command again")
    settings = {
        "scenario": result["game"].get("scenario", "standard"),
        "side": find_env(result["game"]["id"]).side,
        "mode": result["mode"],
        "actions": result["game"].get("actions", "continuous"),
        "seed": result["seed"],
        "steps": result["steps"][0],
        "response_steps": result["steps"][1],
    }
    confirmed = result["confirmed"]
    return [{**settings, **row, "confirmed": confirmed.get(str(row["stage"]))} for row in result["rows"]]


def keep_search(folder: Path, file: Path, search: str | None = None) -> None:
    """Put the rows of a finished search into a file, in the place of those of its name and seed.

    Args:
        folder: the search's folder.
        file: a file of rows, which need not exist.
        search: the search's name, in a file of several.

    Raises:
        UserError: the search is not finished, or the file cannot be read.
    """
    named = {} if search is None else {"search": search}
    rows = [{**named, **row} for row in search_rows(folder)]
    key = search, rows[0]["seed"]
    others = [
        row
        for row in RowFile(file, {"seed": int, "stage": int}).read()
        if (row.get("search"), row["seed"]) != key
    ]
    rows = sorted([*others, *rows], key=lambda row: (row.get("search", ""), row["seed"], row["stage"]))
    write_whole(file, "".join(json.dumps(row) + "\n" for row in rows))


@dataclass(frozen=True)
class _DoubleOracle:
    """A search in a folder; pairs have the side's part first, then that of the responses."""

    folder: Path
    mode: str
    game: GameSpec
    response: GameSpec
    algorithms: tuple[str, str]
    steps: tuple[int, int]
    weight: int
    seed: int
    hyperparams: tuple[Hyperparams, Hyperparams]
    progress: bool
    allow: Collection[str]

    @property
    def side(self) -> str:
        """The side that learns."""
        return self.game.config.side

    def describe(self) -> _Settings:
        """Return the settings that distinguish it from another search, as they are read from JSON."""
        parameters = [
            load_hyperparameters(algorithm, game, file, allow=self.allow).entry()
            for algorithm, game, file in zip(
                self.algorithms, (self.game, self.response), self.hyperparams, strict=True
            )
        ]
        about = {
            "game": self.game.to_dict(),
            "response": self.response.to_dict(),
            "scenario": self.game.resolve().hash,
            "algorithms": self.algorithms,
            "steps": self.steps,
            "mode": self.mode,
            "weight": self.weight,
            "seed": self.seed,
            "hyperparameters": parameters,
        }
        content: _Settings = json.loads(json.dumps(about))
        return content

    def run(self, stage: int) -> RunFolder:
        """Return the folder of a stage's run."""
        return RunFolder(self.folder / "runs" / f"stage_{stage}")

    def response_run(self, stage: int, number: int = 0) -> RunFolder:
        """Return the folder of the run of a response to a stage: 0 the fresh one, 1 the second."""
        return RunFolder(self.folder / "runs" / f"response_{stage}_{number}")

    def rival_run(self, stage: int) -> RunFolder:
        """Return the folder of the run of the rival that learned beside a stage in self-play."""
        return RunFolder(self.run(stage).path / RIVAL)

    def rivals(self, stage: int) -> list[str]:
        """Return the rivals of a stage's training, those with a weight several times."""
        if self.mode == "selfplay":
            return list(self.game.others)
        responses = [str(self.response_run(before).agent) for before in range(stage)]
        if self.mode == "one" or not stage:
            return [*self.game.others, *(name for name in responses for _ in range(self.weight))]
        return _in_parts(self._meta_game(stage, stage).equilibrium().rivals)

    def answered(self, stage: int) -> list[str]:
        """Return the policies of the side that a stage's fresh response answers, by their shares."""
        if self.mode != "both":
            return [str(self.run(stage).agent)]
        return _in_parts(self._meta_game(stage + 1, stage).equilibrium().players)

    def _meta_game(self, stages: int, responses: int) -> Payoffs:
        """Return the game of so many stages' policies against the first rivals and so many responses."""
        agents = [str(self.run(number).agent) for number in range(stages)]
        found = [str(self.response_run(number).agent) for number in range(responses)]
        return self.payoffs(agents, list(dict.fromkeys([*self.game.others, *found])))

    def play_stage(self, stage: int) -> Row:
        """Train a stage and its fresh response; return its row."""
        start = time.monotonic()
        rivals = self.rivals(stage)
        config = RunConfig(
            self.algorithms[0],
            GameSpec.of(self.game, **{other_side(self.side): rivals}),
            SEED_STRIDE * self.seed + stage,
            self.steps[0],
            self.hyperparams[0],
            start=self.run(stage - 1).path if stage else None,
            allow=self.allow,
        )
        if self.mode == "selfplay":
            self._train_with_rival(stage, config)
        else:
            train(config, self.run(stage).path, evaluations=0, progress=self.progress, resume=True)
        low = self.answer(stage, self.answered(stage))
        meta_game = self._meta_game(stage + 1, stage + 1)
        if self.mode == "selfplay":
            high = self.answer_rival(stage)
        else:
            high = meta_game.interval(str(self.run(stage).agent), _shares(rivals)).value
        return {
            "stage": stage,
            "low": low,
            "high": round(high, 4),
            "meta_value": round(meta_game.equilibrium().value, 4),
            "rivals": len(rivals) + (self.weight if self.mode == "selfplay" else 0),
            "seconds": round(time.monotonic() - start, 1),
        }

    def _train_with_rival(self, stage: int, config: RunConfig) -> None:
        """Train a stage and its rival at the same time; both learn by the same algorithm."""
        rival = dataclasses.replace(
            config,
            game=self.response,
            seed=config.seed + SEED_STRIDE // 4,
            start=self.rival_run(stage - 1).path if stage else None,
        )
        train_together(config, rival, self.run(stage).path, weight=self.weight, progress=self.progress)

    def answer_rival(self, stage: int) -> float:
        """Train a response of the side to a stage's rival; return what it or the stage earns, if more."""
        run, rival = RunFolder(self.folder / "runs" / f"answer_{stage}"), str(self.rival_run(stage).agent)
        config = RunConfig(
            self.algorithms[0],
            GameSpec.of(self.game, **{other_side(self.side): [rival]}),
            SEED_STRIDE * self.seed + 3 * SEED_STRIDE // 4 + stage,
            self.steps[1],
            self.hyperparams[0],
            allow=self.allow,
        )
        train(config, run.path, evaluations=0, progress=self.progress, resume=True)
        known = [str(run.agent), str(self.run(stage).agent)]
        payoffs = self.payoffs(known, [rival])
        return max(payoffs.interval(name, rival).value for name in known)

    def confirm(self, stage: int) -> float:
        """Return what a stage's policy alone keeps against a second response to it."""
        return self.answer(stage, [str(self.run(stage).agent)], number=1)

    def answer(self, stage: int, policies: Sequence[str], number: int = 0) -> float:
        """Train a response to policies of the side, and return what their mixture keeps against it."""
        run, shares = self.response_run(stage, number), _shares(policies)
        game = GameSpec.of(self.response, against=list(policies))
        seed = SEED_STRIDE * self.seed + SEED_STRIDE // 2 + 2 * stage + number
        config = RunConfig(
            self.algorithms[1], game, seed, self.steps[1], self.hyperparams[1], allow=self.allow
        )
        train(config, run.path, evaluations=0, progress=self.progress, resume=True)
        payoffs = self.payoffs(list(shares), [str(run.agent)])
        kept = sum(share * payoffs.interval(name, str(run.agent)).value for name, share in shares.items())
        return round(float(kept), 4)

    def payoffs(self, agents: Sequence[str], rivals: Sequence[str]) -> Payoffs:
        """Return what agents of the side earn from rivals; only pairings without a record are played."""
        scenario, scale = self.game.resolve(), side_suite(self.side, self.game.resolve()).scale
        suites = [
            Suite("double-oracle", self.side, scenario, MATCHES, (Rival(rival, (rival,), scenario),), scale)
            for rival in rivals
        ]
        wanted = [
            Pairing(player_entry(agent), suite, suite.rivals[0]) for agent in agents for suite in suites
        ]
        store = Store(self.folder / RECORDS)
        store.fill(wanted, partial(play, seeds=tuning_seeds))
        return Payoffs.of(store, wanted)

    def export_agent(self, stage: int) -> None:
        """Copy the agent of a stage, and its rival's; ``agent.json`` describes the whole search up to it.

        Names of the search's own agents begin at its folder, wherever that was when they were trained.
        """
        game = self.game.to_dict()
        del game["id"]
        settings = {
            "side": self.side,
            "mode": self.mode,
            "stages": stage + 1,
            "steps": self.steps[0],
            "response_steps": self.steps[1],
            "algorithm": self.algorithms[0],
            "response_algorithm": self.algorithms[1],
            "response_actions": self.response.actions or "continuous",
            "against": game.pop(other_side(self.side)),
            "weight": self.weight,
            "seed": self.seed,
            "hyperparams": as_option(self.hyperparams[0]),
            "response_hyperparams": as_option(self.hyperparams[1]),
        }
        command = command_line("double-oracle", out=self.folder, allow=self.allow, **game, **settings)
        exported = {"agent": self.run} | ({RIVAL: self.rival_run} if self.mode == "selfplay" else {})
        for name, run_of in exported.items():
            last = run_of(stage).agent
            update = {
                "command": command,
                "training_seed": self.seed,
                "training_steps": (stage + 1) * self.steps[0],
            }
            named = _OWN_AGENT.sub(r'"\1"', json.dumps(read_card(last).to_dict()))
            card = AgentCard.parse(read_object(named), str(last))
            card.model_copy(update=update).write(self.folder / name, (last / "policy.onnx").read_bytes())


def _shares(names: Sequence[str]) -> dict[str, float]:
    """Return the share of each name in a list that names some several times."""
    return {name: names.count(name) / len(names) for name in dict.fromkeys(names)}


def _in_parts(shares: Mapping[str, float]) -> list[str]:
    """Return a list that names each player by its share, in parts of all: those with the largest rest first.

    >>> _in_parts({"tone": 0.4951, "comb": 0.5, "sweep": 0.0049}).count("tone")
    50
    """
    parts = {name: int(PARTS * share) for name, share in shares.items()}
    by_rest = sorted(shares, key=lambda name: parts[name] - PARTS * shares[name])
    for name in by_rest[: PARTS - sum(parts.values())]:
        parts[name] += 1
    return [name for name, count in parts.items() for _ in range(count)]


def _is_flat(rows: Sequence[Row], patience: int) -> bool:
    """Return True if the last stages brought no higher ``low`` than those before them."""
    lows = [row["low"] for row in rows]
    return len(lows) > patience and max(lows[-patience:]) <= max(lows[:-patience])


def _row_text(row: Row) -> str:
    """Return a log line for a stage's row."""
    return (
        f"stage {row['stage']}: low {row['low']:.2f}, high {row['high']:.2f}, meta-value "
        f"{row['meta_value']:.2f} per step; {row['seconds']:.0f} s"
    )
