"""A training run under way: made of its spec, begun, gone on with, learned, drawn and kept."""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import platform
import shutil
import threading
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import configure
from torch.distributions import Distribution

from fpg_bench.envs.core import OneSided
from fpg_bench.errors import UserError
from fpg_bench.evaluation.seeds import TRAINING_STRIDE, training_seed
from fpg_bench.evaluation.yardstick import Yardstick
from fpg_bench.files import read_json, write_whole
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.pictures.canvas import SIDE_COLOURS, blank_figure
from fpg_bench.rows import Row
from fpg_bench.training.algorithms import find_algorithm
from fpg_bench.training.callbacks import GameMeasures, TrainingBar
from fpg_bench.training.checkpoints import load_checkpoint, load_weights, newest_checkpoint, save_model
from fpg_bench.training.export import check_exportable, write_exported
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.imitation import imitate, teacher_of
from fpg_bench.training.keeping import Clock, EvalCheckpointCallback, stopped_by_ctrl_c
from fpg_bench.training.language_model import training_planner
from fpg_bench.training.models import by_side, is_finite, make_games, make_model, tells_divergence
from fpg_bench.training.run_folder import RunFolder, command_line, revision, words_of
from fpg_bench.training.spec import RunSpec

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


class Run:
    """A run with its games; nothing is written before :meth:`learn`.

    Args:
        spec: what it is.
        folder: where it lies or shall lie.

    Attributes:
        sides: the sides that learn.
        fields: what scores each of them.
        about: how it is made: everything that is needed to make it again.

    Raises:
        UserError: something unknown or out of range.
    """

    def __init__(self, spec: RunSpec, folder: RunFolder) -> None:
        self.algorithm, self.folder = find_algorithm(spec.algorithm), folder
        spec.check_sides(self.algorithm)
        self.sides, options = spec.sides, spec.games()
        self.parameters = load_hyperparameters(
            self.algorithm, spec.id, spec.hyperparams, path=options.get("path")
        )
        budget = spec.budget(self.algorithm, self.parameters)
        planner = training_planner(spec.planner, folder.path, spec.transcript, spec.llm)
        games = {**options, "planner": planner}
        self.games = make_games(spec.id, self.parameters, training_seed(spec.seed), **games)
        self.fields = spec.fields()
        self.about = self._described(spec, budget)
        self._start = None if spec.start is None else Path(spec.start)
        self._before = 0.0  # seconds of training before this part
        self._part = 0  # how many times it was gone on with
        self._fresh = True  # whether it begins with the weights that it was made with

    def _described(self, spec: RunSpec, budget: int) -> dict[str, Any]:
        """What ``run.json`` and ``agent.json`` say; ``policies`` are those of the agents that it meets."""
        parameters, core, name = self.parameters, self.games.core, self.algorithm.name
        named = {"hyperparams": spec.hyperparams} if isinstance(spec.hyperparams, str | Path) else {}
        stack = {} if parameters.frame_stack is None else {"frame_stack": parameters.frame_stack}
        start = {} if parameters.imitate is None else {"imitate": dataclasses.asdict(parameters.imitate)}
        games = {"n_envs": parameters.n_envs, "normalize": parameters.normalize, **stack, **start}
        told = spec.told()
        about = {
            "command": command_line("train", name, spec.id, seed=spec.seed, steps=budget, **told, **named),
            "algorithm": name,
            "id": spec.id,
            "side": " and ".join(self.sides),
            "field": ", ".join(self.fields),
            "scenario": core.scenario.hash,
            "scenario_fields": _changed(core.scenario),
            "options": {key: words_of(value) for key, value in told.items()},
            "training_seed": spec.seed,
            "training_steps": budget,
            "hyperparameters": {**games, **parameters.algorithm},
            **({"policies": core.policies} if isinstance(core, OneSided) and core.policies else {}),
            "versions": {name: version(name) for name in _PACKAGES} | {"python": platform.python_version()},
            "revision": revision(),
        }
        content: dict[str, Any] = json.loads(json.dumps(about, default=str))  # as it is read again
        return content

    def begin(self) -> None:
        """Make the model, and see that an agent can be made of it: before anything is written."""
        Distribution.set_default_validate_args(True)  # an export in this process turned torch's checks off
        self.model = make_model(self.algorithm, self.games, self.parameters, self.about["training_seed"])
        if self._start is not None:
            _check_start(self._start, self.about)
            load_weights(self.model, self._start)
            self._fresh = False
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
        self._part = state.get("part", 0) + 1
        seed = self.about["training_seed"]
        checkpoint = newest_checkpoint(self.folder.checkpoints)
        if checkpoint is not None:
            del self.model  # and its replay buffer
            self.model, progress = load_checkpoint(
                checkpoint, self.algorithm, self.games, self.parameters, (seed + self._part * 2**20) % 2**32
            )
            self._before, self._fresh = progress["seconds"], False
        self._seed_games()

    def _seed_games(self) -> None:
        """Let the games begin with the matches of this part of the run."""
        count = self.games.num_envs
        offset = self._part * count % (TRAINING_STRIDE - count)
        self.games.seed(training_seed(self.about["training_seed"]) + offset)

    def _imitate(self, stop: threading.Event, progress: bool) -> None:
        """Learn what the hyper-parameters' teacher does, if they name one and nothing was learned yet."""
        if self.parameters.imitate is None or not self._fresh:
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
        self.folder.write(self.about | {"finished": False, "part": self._part})
        self.model.set_logger(configure(str(self.folder.path), ["tensorboard"]))
        budget, model = self.about["training_steps"], self.model
        bar = [TrainingBar(budget)] if progress else []
        clock = Clock(self._before)
        with stopped_by_ctrl_c() as stop:
            self._imitate(stop, progress)
            keeping = EvalCheckpointCallback(
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
        """Export the agent, keep the model, draw its curve, and let the checkpoints go."""
        done = self.model.num_timesteps
        about = self.about | {"steps_done": done, "seconds": round(self.seconds, 1)}
        if (flown := getattr(self.games.core.duel.planner, "flown", None)) is not None:
            about["plans"] = dict(flown)  # of this part of the run
        difference = max(
            write_exported(player, self.folder.agent_of(side, self.sides), about | {"side": side})
            for side, player in by_side(self.model, self.sides).items()
        )
        save_model(self.model, self.folder.path)
        if rows := self.folder.evaluations.read():
            _draw_curve(rows, f"{about['algorithm']}, {about['id']}", self.folder.curve)
        rate = round(done / self.seconds)
        ended = {"finished": True, "part": self._part, "steps_per_s": rate, "largest_difference": difference}
        self.folder.write(about | ended)
        shutil.rmtree(self.folder.checkpoints, ignore_errors=True)


def _check_start(run: Path, about: dict[str, Any]) -> None:
    """Raise UserError where a run can't be begun with the weights of that one."""
    found = read_json(run / "run.json", "start")
    found |= found.get("hyperparameters", {})
    wanted = {key: about[key] for key in ("algorithm", "side")} | {"finished": True}
    for key, value in (wanted | {"normalize": about["hyperparameters"]["normalize"]}).items():
        if found.get(key) != value:
            raise UserError(f"start {run}: {key} is {found.get(key)!r} there, expected {value!r}")


def _changed(scenario: Scenario) -> dict[str, Any]:
    """The fields that differ from the standard scenario."""
    values = {field.name: getattr(scenario, field.name) for field in dataclasses.fields(scenario)}
    return {name: value for name, value in values.items() if value != getattr(STANDARD, name)}


def _draw_curve(rows: Sequence[Row], title: str, path: Path) -> None:
    """Draw each side's score over the steps, the rows of ``evaluations.jsonl``, into a PNG file."""
    figure = blank_figure(6, 3.6)
    axes = figure.subplots()
    for side in dict.fromkeys(row["side"] for row in rows):
        points = [(row["steps"], row["score"]) for row in rows if row["side"] == side]
        axes.plot(*zip(*points, strict=True), "o-", ms=3, color=SIDE_COLOURS[side], label=side)
    axes.set(xlabel="steps", ylabel="score (few rounds, tuning seeds)", title=title)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    image = io.BytesIO()
    figure.savefig(image, format="png")
    write_whole(path, image.getvalue())
