"""One training run: an algorithm on an id, into a folder that says how it was made."""

from __future__ import annotations

import functools
import shutil
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure
from torch.distributions import Distribution

from fpg_bench.checks import whole
from fpg_bench.envs.one_sided import OneSided
from fpg_bench.envs.sb3 import SB3View
from fpg_bench.errors import UserError
from fpg_bench.evaluation.field_file import field_of
from fpg_bench.evaluation.seeds import TRAINING_STRIDE, training_seed
from fpg_bench.evaluation.yardstick import Yardstick
from fpg_bench.files import read_json
from fpg_bench.ids import DUEL, VIEWS, find_view, sides_of
from fpg_bench.training.algorithms import Algorithm, find_algorithm
from fpg_bench.training.callbacks import GameMeasures, TrainingBar
from fpg_bench.training.checkpoints import load_checkpoint, load_weights, newest_checkpoint, save_model
from fpg_bench.training.divergence import is_finite, tells_divergence
from fpg_bench.training.export import check_exportable, export_agent
from fpg_bench.training.hyperparameters import Hyperparameters, load_hyperparameters
from fpg_bench.training.imitation import imitate, teacher_of
from fpg_bench.training.keeping import Clock, Keeping, stopped_by_ctrl_c
from fpg_bench.training.language_model import training_planner
from fpg_bench.training.models import by_side, make_games, make_model
from fpg_bench.training.run_folder import RunFolder, described

LOOKS = 20


def train(
    algorithm: str | type[BaseAlgorithm],
    view_id: str,
    out: str | Path,
    *,
    seed: int = 0,
    steps: int | None = None,
    hyperparams: str | Path | Mapping[str, Any] | None = None,
    field: str | None = None,
    evaluations: int = LOOKS,
    progress: bool = True,
    restart: bool = False,
    resume: bool = False,
    transcript: str | Path | None = None,
    llm: Mapping[str, Any] | None = None,
    against: Any = None,
    start: str | Path | None = None,
    **options: Any,
) -> Path:
    """Train an algorithm on an id and export the agent.

    The folder then holds ``run.json``, ``evaluations.jsonl`` (what the policy was worth on the way),
    ``model.zip``, the TensorBoard log and ``agent/`` (``agent.json``, ``policy.onnx``). A finished run is not
    repeated. A stopped or killed one leaves a checkpoint that is at most a minute old; resumed, it plays new
    matches and ends with as many steps as if it had never stopped.

    A language model plans beside the game: each round flies the newest plan that is there. How far that is
    behind depends on the server's speed, so ``transcript.jsonl`` keeps what each round flew.

    Args:
        algorithm: ``ppo``, ``ppo-fast``, ``sac``, ``td3``, ``recurrent-ppo``, ``ppo-stack8`` and the like,
            ``maddpg``, ``package.module:Class``, or a class of SB3's kind.
        view_id: ``FPG/AllyVsScripted-v0`` and the like; ``FPG/duel_v0`` for both sides.
        out: the run's folder.
        seed: the training seed k; games begin at seed k * 10^6.
        steps: the budget over all games, rounded up to what the algorithm collects at once; None: the
            hyper-parameter file's.
        hyperparams: a YAML file of one's own, or what it says for the id; None: the shipped one.
        field: under which the policy is scored on the way, on tuning seeds; None: the id's (both sides have
            one each).
        evaluations: how many times; 0: never.
        progress: whether to draw a bar, or print lines where standard output is no terminal.
        restart: whether to begin an unfinished run of the folder again, from the start.
        resume: whether to go on with an unfinished run; begins it where there is none.
        transcript: of a run with a language model: fly its plans again, without a server.
        llm: options of :class:`fpg_bench.planning.llm.llm_planner.LLMPlanner`, and ``server``, the profile of
            its endpoint.
        against: the other side's player, or a list to draw from per round, whatever that side's option is
            called.
        start: the folder of a finished run of one's own, of the same side, algorithm and networks: begin
            with its weights, optimiser and normalisation, and imitate nobody.
        **options: those of :class:`fpg_bench.envs.one_sided.OneSided`, or of
            :func:`fpg_bench.envs.duel.make_duel` where both sides learn.

    Returns:
        The agent's folder; where both sides learn, it holds one of each.

    Raises:
        UserError: something unknown or out of range, a policy that can't be exported, or a folder that holds
            another or an unfinished run, or that another process trains in.
        KeyboardInterrupt: stopped by the user; says what is saved.
    """
    torch.set_num_threads(1)
    if restart and resume:
        raise UserError("resume goes on with a run, restart begins it again: say one of them")
    run = _prepared(
        algorithm,
        view_id,
        out,
        seed=seed,
        steps=steps,
        hyperparams=hyperparams,
        field=field,
        transcript=transcript,
        llm=llm,
        against=against,
        start=start,
        **options,
    )
    run.begin(start)
    with run.folder.locked():
        state = run.folder.found(run.about, again=restart or resume)
        if state is None or not state.get("finished"):
            yardsticks = {
                side: Yardstick(field, scenario=run.games.core.scenario, side=side)
                for side, field in zip(run.sides, run.fields, strict=True)
                if evaluations
            }
            run.go_on(state) if state is not None and resume else run.folder.clear()
            run.learn(yardsticks, evaluations, progress)
            run.finish()
    return run.folder.agent


def is_finished(algorithm: str | type[BaseAlgorithm], view_id: str, out: str | Path, **words: Any) -> bool:
    """Whether a folder holds this very run, finished; takes the words of :func:`train` that describe a run.

    Raises:
        UserError: something unknown or out of range, or a folder that holds another run.
    """
    run = _prepared(algorithm, view_id, out, **words)
    state = run.folder.found(run.about, again=True)
    return bool(state and state.get("finished"))


def _prepared(
    algorithm: str | type[BaseAlgorithm],
    view_id: str,
    out: str | Path,
    *,
    seed: int = 0,
    steps: int | None = None,
    hyperparams: str | Path | Mapping[str, Any] | None = None,
    field: str | None = None,
    transcript: str | Path | None = None,
    llm: Mapping[str, Any] | None = None,
    against: Any = None,
    start: str | Path | None = None,
    **options: Any,
) -> _Run:
    """A run with its games, and how it is made; nothing is written yet."""
    found, folder = find_algorithm(algorithm), RunFolder(Path(out))
    view_id, sides = _sides(found, view_id)
    options = _against(view_id, against, options)
    parameters = load_hyperparameters(found, view_id, hyperparams, path=options.get("path"))
    budget = _budget(found, parameters, steps)
    own = VIEWS[view_id].planner if view_id in VIEWS else None
    planner = training_planner(options.get("planner") or own, folder.path, transcript, llm)
    games = make_games(view_id, parameters, training_seed(seed), **options | {"planner": planner})
    if field and len(sides) == 2:
        raise UserError(f"field: each side of {DUEL} is scored by its own; name none")
    fields = [field] if field else [field_of(view_id, options, side) for side in sides]
    about = described(
        found.name,
        view_id,
        " and ".join(sides),
        games.core.scenario,
        seed=seed,
        steps=budget,
        field=", ".join(fields),
        parameters=parameters,
        file=hyperparams,
        options=options
        | {"transcript": transcript, "start": start}
        | {n.removesuffix("_s"): v for n, v in (llm or {}).items()},
        policies=games.core.policies if isinstance(games.core, OneSided) else {},
    )
    return _Run(found, sides, fields, parameters, games, folder, about)


def _sides(algorithm: Algorithm, view_id: str) -> tuple[str, tuple[str, ...]]:
    """The id as it is registered, and the sides that learn in it."""
    sides = sides_of(view_id)
    if algorithm.joint != (len(sides) == 2):
        both = "trains both sides, in" if algorithm.joint else "trains one side, not both, as in"
        raise UserError(f"{algorithm.name}: {both} {DUEL}; got {view_id}")
    return view_id.removeprefix("fpg_bench:"), sides


def _against(view_id: str, against: Any, options: dict[str, Any]) -> dict[str, Any]:
    """The options with the other side's players under that side's name."""
    if against is None:
        return options
    if view_id == DUEL:
        raise UserError(f"against: in {DUEL} both sides learn; name nobody")
    other = find_view(view_id).other_side
    if options.get(other) is not None:
        raise UserError(f"against: names the {other}, and so does {other}; say one of them")
    return options | {other: against}


def _check_start(run: Path, about: dict[str, Any]) -> None:
    """Raise UserError where a run can't be begun with the weights of that one."""
    found = read_json(run / "run.json", "start")
    found |= found.get("hyperparameters", {})
    wanted = {key: about[key] for key in ("algorithm", "side")} | {"finished": True}
    for key, value in (wanted | {"normalize": about["hyperparameters"]["normalize"]}).items():
        if found.get(key) != value:
            raise UserError(f"start {run}: {key} is {found.get(key)!r} there, expected {value!r}")


def _budget(algorithm: Algorithm, parameters: Hyperparameters, steps: int | None) -> int:
    budget = parameters.n_timesteps if steps is None else whole(steps, "steps")
    if not budget:
        raise UserError(f"steps: {algorithm.name} has no hyper-parameter file that says how many; say it")
    return budget


@dataclass
class _Run:
    """A run under way.

    Attributes:
        fields: what scores each of the sides.
        before: seconds of training before this part.
        part: how many times it was gone on with.
        fresh: whether it begins with the weights that it was made with.
    """

    algorithm: Algorithm
    sides: tuple[str, ...]
    fields: list[str]
    parameters: Hyperparameters
    games: SB3View
    folder: RunFolder
    about: dict[str, Any]
    before: float = 0.0
    part: int = 0
    fresh: bool = True

    def begin(self, start: str | Path | None) -> None:
        """Make the model, and see that an agent can be made of it: before anything is written."""
        Distribution.set_default_validate_args(True)  # an export in this process turned torch's checks off
        self.model = make_model(self.algorithm, self.games, self.parameters, self.about["training_seed"])
        if start is not None:
            _check_start(Path(start), self.about)
            load_weights(self.model, Path(start))
            self.fresh = False
        if (imitation := self.parameters.imitate) is not None:
            teacher_of(imitation, self.model, self.sides[0], self.games.core.scenario)
        try:
            for player in by_side(self.model, self.sides).values():
                check_exportable(player)
        except ValueError as error:
            if not tells_divergence(error, self.sides):
                raise
            raise UserError(
                f"hyper-parameters of {self.algorithm.name}: the new policy draws no finite actions; see its "
                "policy_kwargs, log_std_init for instance"
            ) from error

    def go_on(self, state: dict[str, Any]) -> None:
        """Take up the newest checkpoint; from here on, other matches are played and other numbers drawn."""
        self.part = state.get("part", 0) + 1
        seed = self.about["training_seed"]
        checkpoint = newest_checkpoint(self.folder.checkpoints)
        if checkpoint is not None:
            del self.model  # and its replay buffer
            self.model, progress = load_checkpoint(
                checkpoint, self.algorithm, self.games, self.parameters, (seed + self.part * 2**20) % 2**32
            )
            self.before, self.fresh = progress["seconds"], False
        self._seed_games()

    def _seed_games(self) -> None:
        """Let the games begin with the matches of this part of the run."""
        count = self.games.num_envs
        offset = self.part * count % (TRAINING_STRIDE - count)
        self.games.seed(training_seed(self.about["training_seed"]) + offset)

    def _imitate(self, stop: threading.Event, progress: bool) -> None:
        """Learn what the hyper-parameters' teacher does, if they name one and nothing was learned yet."""
        if self.parameters.imitate is None or not self.fresh:
            return
        say = functools.partial(print, flush=True) if progress else lambda line: None
        error = imitate(self.model, self.games, self.parameters.imitate, stop, say)
        self.about["imitation_error"] = round(error, 6)
        self._seed_games()

    def learn(self, yardsticks: Mapping[str, Yardstick], looks: int, progress: bool) -> None:
        """Train to the budget.

        Raises:
            KeyboardInterrupt: stopped by the user.
        """
        self.folder.write(self.about | {"finished": False, "part": self.part})
        self.model.set_logger(configure(str(self.folder.path), ["tensorboard"]))
        budget, model = self.about["training_steps"], self.model
        bar = [TrainingBar(budget)] if progress else []
        clock = Clock(self.before)
        with stopped_by_ctrl_c() as stop:
            self._imitate(stop, progress)
            keeping = Keeping(
                self.folder.checkpoints, clock, yardsticks, self.folder.evaluations, budget, looks, stop
            )
            try:
                if model.num_timesteps < budget:
                    left = budget - model.num_timesteps
                    model.learn(left, [GameMeasures(), keeping, *bar], 1, reset_num_timesteps=False)
            except ValueError as error:
                if tells_divergence(error, self.sides) or not is_finite(model):
                    raise self._diverged() from error
                raise
            finally:
                for drawn in bar:
                    drawn.close()
        if not is_finite(model):  # after the last update
            raise self._diverged()
        self.seconds = clock.seconds

    def _diverged(self) -> UserError:
        return UserError(
            f"{self.folder.path}: training diverged by {self.model.num_timesteps:,} steps, the policy has no "
            "finite actions any more; try a smaller learning_rate"
        )

    def finish(self) -> None:
        """Export the agent, keep the model, and let the checkpoints go."""
        done = self.model.num_timesteps
        about = self.about | {"steps_done": done, "seconds": round(self.seconds, 1)}
        if (flown := getattr(self.games.core.duel.planner, "flown", None)) is not None:
            about["plans"] = dict(flown)  # of this part of the run
        difference = max(
            export_agent(player, self.folder.agent_of(side, self.sides), about | {"side": side})
            for side, player in by_side(self.model, self.sides).items()
        )
        save_model(self.model, self.folder.path)
        rate = round(done / self.seconds)
        ended = {"finished": True, "part": self.part, "steps_per_s": rate, "largest_difference": difference}
        self.folder.write(about | ended)
        shutil.rmtree(self.folder.checkpoints, ignore_errors=True)
