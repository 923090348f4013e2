"""Training of an algorithm on an environment id into a run's folder."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.training import require_libraries

require_libraries()

import dataclasses
import json
import logging
import math
import platform
import re
import shutil
import time
from collections.abc import Iterable, Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import TensorBoardOutputFormat, configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from torch.distributions import Distribution

from fpg_bench.common.canvas import write_figure
from fpg_bench.common.checks import integer, of_kind
from fpg_bench.common.errors import UserError, one_line
from fpg_bench.common.files import as_path, naming
from fpg_bench.common.parallel import StopRequest, Workers, check_all_done, folder_job, run_jobs
from fpg_bench.common.products import load, offered
from fpg_bench.common.rows import Row
from fpg_bench.envs.core import first_seeds, policies_of
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.run_description import CURVE, RunDescription
from fpg_bench.evaluation.seeds import TRAINING_STRIDE, training_seed
from fpg_bench.players.agent import load_agent
from fpg_bench.players.card import OfflineData
from fpg_bench.players.planner import CountsPlans, asks_language_model
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.training.algorithms import find_algorithm
from fpg_bench.training.callbacks import (
    Clock,
    EvalCheckpointCallback,
    GameMeasuresCallback,
    ProgressCallback,
)
from fpg_bench.training.checkpoint import (
    load_checkpoint,
    load_weights,
    newest_checkpoint,
    save_model,
    steps_of,
)
from fpg_bench.training.config import LOADED, N_EVALS, RunConfig
from fpg_bench.training.export import check_exportable, write_exported
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.imitation import imitate, teacher_of
from fpg_bench.training.models import by_side, is_finite, make_model, tells_divergence
from fpg_bench.training.run_folder import RunFolder, command, revision

_ROUNDS = 32  # that the exported agent plays in the training's games
_BEYOND = 4  # standard errors that the training must earn more
LOGS = 100  # at least, of a long run that learns from rollouts
_OVERSHOOT = 1.2  # ratio of played to requested steps above which a warning is logged
_logger = logging.getLogger(__name__)
_STOPPING = "stopping as soon as the run can be saved; Ctrl-C again stops at once\n"
_PACKAGES = (
    "fpg-bench",
    "stable-baselines3",
    "sb3-contrib",
    "torch",
    "gymnasium",
    "numpy",
    "numba",
    "onnx",
    "onnxruntime",
)


def train(
    config: RunConfig,
    out: str | Path,
    *,
    evaluations: int = N_EVALS,
    progress: bool | str = True,
    restart: bool = False,
    resume: bool = False,
    curve: bool = True,
) -> Path:
    """Train a run and export the agent.

    >>> import tempfile
    >>> from fpg_bench.players.agent import load_agent
    >>> small = {"n_timesteps": 16, "policy": "MlpPolicy", "n_envs": 2, "n_steps": 8, "batch_size": 16}
    >>> run = RunConfig("ppo", "FPG/AllyVsScripted-v0", hyperparams=small)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load_agent(train(run, folder, evaluations=0, progress=False)).card.training_steps
    16

    The folder then holds ``run.json``, ``evaluations.jsonl`` (the scores during training) with its picture
    ``curve.png``, ``model.zip``, the TensorBoard log and ``agent/`` (``agent.json``, ``policy.onnx``). A
    finished run is not repeated. A stopped or killed run leaves a checkpoint that is at most a minute old;
    resumed, it plays new matches and ends with as many steps as an uninterrupted run, but with a different
    policy; ``part`` in ``run.json`` counts how often it was resumed. If no step was saved, it starts over.

    A language model plans in parallel with the game: each round flies the newest plan. Its delay depends on
    the server's speed, so ``transcript.jsonl`` records which plan each round flew.

    Args:
        config: the run.
        out: the run's folder.
        evaluations: number of evaluations during training; 0 for none.
        progress: show a progress bar, or print lines where there is no terminal; as a name, print lines that
            begin with it, as one of several runs.
        restart: discard an unfinished run in the folder and start over.
        resume: continue an unfinished run in the folder, or start one if there is none.
        curve: draw ``curve.png`` at the end, if the run was evaluated.

    Returns:
        The agent's folder; if both sides learn, it holds an agent folder for each.

    Raises:
        UserError: something unknown or out of range, a policy that cannot be exported, or a folder that holds
            another run or an unfinished one, or that another process trains in.
        KeyboardInterrupt: stopped by the user; the message says what was saved.
    """
    torch.set_num_threads(1)
    if restart and resume:
        raise UserError("resume continues a run, restart starts it over; give only one of them")
    of_kind(config, "config", "a RunConfig", RunConfig)
    run = _Run(config, RunFolder(as_path(out, "out")), integer(evaluations, "evaluations", 0))
    run.setup()
    evaluators = {
        side: PolicyEvaluator(
            suite, scenario=run.games.core.scenario, side=side, allow=config.allow, game=config.spec
        )
        for side, suite in zip(run.sides, run.suites, strict=True)
        if evaluations
    }
    with run.folder.locked(), naming(run.folder.path):
        state = run.folder.state(run.about, allow_unfinished=restart or resume)
        if state is None or not state.finished:
            if state is not None and resume:
                run.resume(state)
            else:
                run.folder.clear()
            run.learn(evaluators, progress)
            run.finish()
        if curve and not run.folder.curve.exists():  # also where a finished run was killed before
            _draw(run.folder.path)
    return run.folder.agent


def _draw(folder: Path) -> None:
    """Draw the curve of finished runs; an error is a warning, since everything is trained and kept."""
    if "curve" not in offered("rendering"):
        return
    try:
        if (figure := load("rendering", "curve")(folder)) is not None:
            write_figure(figure, folder / CURVE)
    except Exception as error:
        _logger.warning(f"no {CURVE}: {one_line(error)}")


def check_run(config: RunConfig) -> None:
    """Raise UserError if a run cannot be trained; nothing is written."""
    _Run(config, RunFolder(Path())).setup()


def is_finished(config: RunConfig, out: str | Path) -> bool:
    """Return True if a folder holds this run, finished.

    Raises:
        UserError: something unknown or out of range, or a folder that holds another run.
    """
    run = _Run(config, RunFolder(Path(out)))
    state = run.folder.state(run.about, allow_unfinished=True)
    return state is not None and state.finished


def train_seeds(
    config: RunConfig,
    out: str | Path,
    seeds: Iterable[int],
    *,
    evaluations: int = N_EVALS,
    restart: bool = False,
    workers: Workers | int = 2,
) -> None:
    """Train several seeds of a run in parallel; finished ones are not repeated.

    The seeds' mean score over their training, with its 95 % interval, is drawn once, as ``curve.png`` in
    ``out``.

    Args:
        config: the run of each seed, apart from the seed.
        out: seed k is trained into its folder ``seed_k``.
        seeds: the training seeds.
        evaluations: number of evaluations during each training.
        restart: discard unfinished runs and start them over; otherwise they are resumed.
        workers: number of parallel trainings, one thread each, or :class:`fpg_bench.common.parallel.Workers`.

    Raises:
        UserError: something unknown or out of range, folders that hold other runs, a language model as the
            planner, or a run that failed; the other runs go on.
        KeyboardInterrupt: stopped by the user; the runs have saved their checkpoints.
    """
    if asks_language_model(config.spec.planner):
        raise UserError("seeds: a language model plans for one run at a time; train the seeds one by one")
    check_run(config)  # before any seed begins
    jobs = []
    for seed in seeds:
        run, folder = dataclasses.replace(config, seed=seed), Path(out) / f"seed_{seed}"
        call = partial(
            train,
            run,
            evaluations=evaluations,
            restart=restart,
            resume=not restart,
            progress=folder.name,
            curve=False,
        )
        jobs.append(folder_job(folder.name, folder, call, partial(is_finished, run, folder)))
    check_all_done(run_jobs(jobs, workers, loads=LOADED))
    if evaluations:
        _draw(Path(out))


MOST_SEEDS = 1000  # of one list


def parse_seeds(text: str) -> list[int]:
    """Return the seeds of ``0-4`` or ``0,2,5``.

    Raises:
        UserError: any other text; also a single number, which could be a seed or a count.
    """
    if text.isdecimal():
        several = f", --seeds 0-{int(text) - 1} for {text} seeds" if 1 < int(text) <= MOST_SEEDS else ""
        raise UserError(f"seeds: expected a list, got {text}; use --seed {text} for this seed alone{several}")
    seeds: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"(\d+)(?:-(\d+))?", part)
        if not match:
            raise UserError(f"seeds: expected 0-4 or 0,2,5, got {text!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise UserError(f"seeds: {part} runs backwards; use {last}-{first}")
        if last - first >= MOST_SEEDS:
            raise UserError(f"seeds: {last - first + 1:,} in {part}, at most {MOST_SEEDS:,} are allowed")
        seeds += range(first, last + 1)
    if len(set(seeds)) < len(seeds):
        raise UserError(f"seeds: each may be listed only once, got {text!r}")
    return seeds


class _Run:
    """A training run; nothing is written before :meth:`learn`.

    Attributes:
        config: what is trained.
        suites: the suite that scores each learning side.
        about: description of the run, with everything needed to repeat it.

    Raises:
        UserError: something unknown or out of range.
    """

    def __init__(self, config: RunConfig, folder: RunFolder, evaluations: int = N_EVALS) -> None:
        self.config, self.folder, self.evaluations = config, folder, evaluations
        self.algorithm, self.sides = find_algorithm(config.algorithm), config.spec.sides
        self.algorithm.check_sides(config.spec.id, self.sides)
        if self.algorithm.offline != (config.dataset is not None):
            how = "offline ALGORITHM DATASET" if self.algorithm.offline else "train ALGORITHM ID"
            raise UserError(f"{self.algorithm.name}: is trained by fpg-bench {how}")
        self.parameters = load_hyperparameters(
            self.algorithm, config.spec, config.hyperparams, allow=config.allow
        )
        budget = self.parameters.n_timesteps if config.steps is None else integer(config.steps, "steps")
        if not budget:
            raise UserError(
                f"steps: {self.algorithm.name} has no hyper-parameter file with a budget; give the steps"
            )
        self.suites = config.suites()
        self.about = self._describe(budget)
        self._seconds_before = 0.0
        self._part = 0  # number of times the run was resumed
        self._starts_fresh = True  # from newly initialized weights
        self._start: RunDescription | None = None  # whose weights it starts from

    def _describe(self, budget: int) -> RunDescription:
        """Return the description of the run; ``policies`` hashes the agents met."""
        config, parameters, name = self.config, self.parameters, self.algorithm.name
        spec, scenario, options = config.spec, config.spec.resolve(), config.options()
        entry = {"n_envs": parameters.n_envs, "normalize": parameters.normalize} | parameters.entry()
        entry.pop("n_timesteps", None)
        data, policies = config.dataset, policies_of(spec)
        about = {
            "command": command(),
            "algorithm": name,
            "game": spec.describe(),
            "side": " and ".join(self.sides),
            "suite": ", ".join(self.suites),
            "scenario": scenario.hash,
            "scenario_fields": scenario.to_dict(),
            **({"options": options} if options else {}),
            "training_seed": config.seed,
            "training_steps": budget,
            "hyperparameters": entry,
            **({} if data is None else {"offline": _offline(data).model_dump()}),
            **({"policies": policies} if policies else {}),
            "versions": {name: version(name) for name in _PACKAGES} | {"python": platform.python_version()},
            "revision": revision(),
        }
        return RunDescription(**json.loads(json.dumps(about, default=str)))  # as it is read from JSON

    def setup(self) -> None:
        """Make the games and the model, and check before anything is written that it can be exported."""
        Distribution.set_default_validate_args(True)  # an export in this process turned torch's checks off
        config = self.config
        planner = config.planner
        if asks_language_model(planner) or config.planner_options:
            make_planner = load("language_model", "of a training")
            planner = make_planner(planner, self.folder.path, config.planner_options)
        game = dataclasses.replace(config.spec, planner=planner)
        first_seed = training_seed(config.seed)
        self.games = make_sb3(game, self.parameters.n_envs, first_seed, stagger=True, stacked=True)
        self.model = make_model(self.algorithm, self.games, self.parameters, self.about.training_seed)
        if config.start is not None:
            start = as_path(config.start, "start")
            self._start = _read_start(start, self.about)
            load_weights(self.model, start)
            self._starts_fresh = False
        if config.dataset is not None:
            cast(Any, self.model).learn_from(config.dataset, self.parameters.frame_stack or 1)
        if (imitation := self.parameters.imitate) is not None:
            teacher_of(imitation, self.model, self.sides[0], self.games.core.scenario)
        try:
            for player in by_side(self.model, self.sides).values():
                check_exportable(player)
        except ValueError as error:
            if not tells_divergence(error, self.sides):
                raise
            raise UserError(
                f"hyper-parameters of {self.algorithm.name}: the new policy draws no finite actions; check "
                "its policy_kwargs, such as log_std_init"
            ) from error

    def resume(self, state: RunDescription) -> None:
        """Load the newest checkpoint; the matches and random numbers from here on are new.

        A run without saved steps starts over, so that it ends with the policy of an uninterrupted run.
        """
        checkpoint = newest_checkpoint(self.folder.checkpoints)
        if checkpoint is None or steps_of(checkpoint) == 0:
            self.folder.clear()
            return
        has_steps_left = steps_of(checkpoint) < self.about.training_steps
        self._part = state.part + has_steps_left
        seed = self.about.training_seed
        self._seconds_before = load_checkpoint(checkpoint, self.model, (seed + self._part * 2**20) % 2**32)
        self._starts_fresh = False
        self._seed_games()
        if has_steps_left:
            drawn = "matches" if self.config.dataset is None else "batches"
            _logger.info(
                f"{self.folder.path}: resumed at {self.model.num_timesteps:,} steps with new {drawn}, so its "
                "policy differs from that of an uninterrupted run"
            )

    def _seed_games(self) -> None:
        """Seed the games with the matches of this part of the run."""
        self.games.seed(training_seed(self.about.training_seed) + self._part % TRAINING_STRIDE)

    def _imitate(self, stop: StopRequest) -> None:
        """Imitate the teacher of the hyper-parameters, if there is one and the weights are new."""
        if self.parameters.imitate is None or not self._starts_fresh:
            return
        error = imitate(self.model, self.games, self.parameters.imitate, stop)
        self.about = self.about.model_copy(update={"imitation_error": round(error, 6)})
        self._seed_games()

    def learn(self, evaluators: Mapping[str, PolicyEvaluator], progress: bool | str) -> None:
        """Train to the budget.

        Args:
            evaluators: evaluator of each learning side; empty for no evaluations.
            progress: show the progress.

        Raises:
            KeyboardInterrupt: stopped by the user.
        """
        self.about.model_copy(update={"finished": False, "part": self._part}).write(self.folder.path)
        budget, model = self.about.training_steps, self.model
        name = (progress,) if isinstance(progress, str) else ()
        bars = [ProgressCallback(budget, *name)] if progress else []
        clock = Clock(self._seconds_before)
        with StopRequest(_STOPPING) as stop:
            self.model.set_logger(configure(str(self.folder.path), ["tensorboard"]))
            if kept := self.model.num_timesteps:  # TensorBoard drops what a killed process logged behind it
                (output,) = self.model.logger.output_formats
                assert isinstance(output, TensorBoardOutputFormat)
                restart = Event(step=kept + 1, session_log=SessionLog(status=SessionLog.START))
                output.writer._get_file_writer().add_event(restart)  # type: ignore[no-untyped-call]
            self._imitate(stop)
            checkpoints = EvalCheckpointCallback(
                self.folder.checkpoints,
                clock,
                evaluators,
                self.folder.evaluations,
                budget,
                self.evaluations,
                stop,
            )
            try:
                if model.num_timesteps < budget:
                    steps = budget - model.num_timesteps
                    interval = _log_interval(model, budget)
                    _warn_of_overshoot(model, steps)
                    callbacks = [GameMeasuresCallback(interval), checkpoints, *bars]
                    model.learn(steps, callbacks, log_interval=interval, reset_num_timesteps=False)
            except (RuntimeError, ValueError) as error:
                if tells_divergence(error, self.sides) or not is_finite(model):
                    raise self._divergence() from error
                raise
            finally:
                for bar in bars:
                    bar.close()
        if not is_finite(model):  # after the last update
            raise self._divergence()
        self.seconds = clock.seconds

    def _divergence(self) -> UserError:
        return UserError(
            f"{self.folder.path}: training diverged by {self.model.num_timesteps:,} steps, the policy has no "
            "finite actions any more; try a smaller learning_rate"
        )

    def finish(self) -> None:
        """Export the agent, save the model, and remove the checkpoints."""
        steps = self.model.num_timesteps
        made: Row = {"steps_done": steps, "seconds": round(self.seconds, 1)}
        if self._start is not None:
            made["steps_done"] += self._start.steps_done or 0
            made["seconds"] = round(self.seconds + self._start.seconds, 1)
        if isinstance(planner := self.games.core.planner, CountsPlans):
            made["plans"] = dict(planner.flown)  # of this part of the run
        about = self.about.model_copy(update=made)
        difference = max(
            write_exported(player, self.folder.agent_of(side, self.sides), about.to_dict() | {"side": side})
            for side, player in by_side(self.model, self.sides).items()
        )
        self._compare_play()
        save_model(self.model, self.folder.path)
        rate = round(steps / self.seconds)
        result = {"finished": True, "part": self._part, "steps_per_s": rate, "largest_difference": difference}
        about.model_copy(update=result).write(self.folder.path)
        shutil.rmtree(self.folder.checkpoints, ignore_errors=True)

    def _compare_play(self) -> None:
        """Warn if the exported agent earns less than the training did in the same games, beyond chance.

        It takes at most 2 % of the CPU time so far, and is given up otherwise.
        """
        infos = getattr(self.model, "ep_info_buffer", None) or ()
        steps = self.games.core.scenario.steps_per_round
        earned = np.array([info["r"] / steps for info in infos if info["l"] == steps])
        if len(earned) < _ROUNDS or asks_language_model(self.config.planner):
            return
        game = dataclasses.replace(self.config.spec, actions=None, observation=None, history=None)
        core, latest = make_sb3(game, _ROUNDS).core, 1.02 * time.process_time()
        core.reset(seeds=first_seeds(training_seed(self.config.seed), core.count))
        agents = {side: load_agent(self.folder.agent_of(side, self.sides)) for side in self.sides}
        runners = [PolicyRunner(side, [agent], core.batch) for side, agent in agents.items()]
        for runner in runners:
            runner.begin(np.ones(core.count, bool))
        while not core.truncated.all():
            if time.process_time() > latest:
                return
            core.step(np.concatenate([runner.act() for runner in runners], axis=1))
        name = f"{core.side}_return"
        played = np.array([(core.measures(row)[name] or 0) / core.length(row) for row in range(core.count)])
        error = math.hypot(*(each.std(ddof=1) / math.sqrt(len(each)) for each in (earned, played)))
        if earned.mean() - played.mean() > _BEYOND * error + abs(earned.mean()) / 100:
            _logger.warning(
                f"{self.folder.path}: in the training's games the agent earns {played.mean():.2f} a step, "
                f"and the last {len(earned)} rounds of the training {earned.mean():.2f}: it lacks something "
                "that the training had, or the training's random actions earn more"
            )


def _log_interval(model: BaseAlgorithm, budget: int) -> int:
    """Return after how many rollouts, of off-policy algorithms rounds, SB3 logs."""
    if not isinstance(model, OnPolicyAlgorithm):
        return 1
    return max(1, budget // (model.n_envs * model.n_steps) // LOGS)


def _warn_of_overshoot(model: BaseAlgorithm, steps: int) -> None:
    """Warn if whole rollouts are many more steps than were requested."""
    if isinstance(model, OnPolicyAlgorithm):
        rollout = model.n_envs * model.n_steps
        played = -(-steps // rollout) * rollout
        if played > _OVERSHOOT * steps:
            _logger.warning(
                f"steps: {played:,} are played, not {steps:,}: a rollout is {rollout:,} steps "
                f"({model.n_envs} games x {model.n_steps})"
            )


def _offline(data: Any) -> OfflineData:
    """Return the description of a data set for ``run.json`` and ``agent.json``."""
    steps = data.spec.episodes * data.spec.load_scenario().steps_per_round
    return OfflineData(dataset=data.spec.dataset_id, content_sha256=data.sha256, transitions=steps)


def _read_start(run: Path, about: RunDescription) -> RunDescription:
    """Return the description of the run to start from; raise UserError if its weights do not fit."""
    if not run.is_dir():
        kind = "is a file" if run.exists() else "does not exist"
        raise UserError(f"start {run}: {kind}; name the folder of a finished run")
    other = RunDescription.read(run, "start")
    is_clone = other.algorithm == about.algorithm.replace("ppo", "bc")  # which has PPO's networks
    normalize = (each.hyperparameters.get("normalize") for each in (other, about))
    for key, found, expected in (
        ("algorithm", other.algorithm, other.algorithm if is_clone else about.algorithm),
        ("side", other.side, about.side),
        ("finished", other.finished, True),
        ("normalize", *normalize),
    ):
        if found != expected:
            raise UserError(f"start {run}: {key} is {found!r} there, expected {expected!r}")
    return other
