"""Training runs with a life cycle: train, resume after a stop, evaluate, export."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.training import require_libraries

require_libraries()

from collections.abc import Collection
from pathlib import Path

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import as_path, write_whole
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.parallel import Workers
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.run_description import RunDescription
from fpg_bench.evaluation.suite import suite_of
from fpg_bench.evaluation.table import Results
from fpg_bench.players.agent import load_agent, read_card, seed_folders
from fpg_bench.training.config import N_EVALS, RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train


class Run:
    """A training run in a folder, from its first step to the agent that is measured.

    The command line does the same with the same folder: a run may be begun by ``fpg-bench train``, stopped or
    killed, and taken up here, or the other way round.

    >>> import tempfile
    >>> small = {"n_timesteps": 16, "policy": "MlpPolicy", "n_envs": 2, "n_steps": 8, "batch_size": 16}
    >>> config = RunConfig("ppo", "FPG/AllyVsScripted-v0", hyperparams=small)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     run = Run(f"{folder}/ppo", config)
    ...     agent = run.train(evaluations=0, progress=False)
    ...     again = Run(f"{folder}/ppo")  # as in another process
    ...     results = again.evaluate("ally-v2", matches=1)
    ...     difference = again.export(f"{folder}/mine/seed_0")
    >>> again.config.algorithm, len(results), difference < 1e-4
    ('ppo', 1, True)

    Args:
        folder: the run's folder; see :func:`fpg_bench.train` for its files.
        config: what is trained. None: what the folder's ``run.json`` says.
        allow: the ``package.module:object`` and agents of the Hub that ``run.json`` may name; neither is run
            on a file's word.

    Raises:
        UserError: without a configuration: no ``run.json``, a name in it that is not allowed, or a run that
            learns from a data set.
    """

    def __init__(
        self, folder: str | Path, config: RunConfig | None = None, *, allow: Collection[str] = ()
    ) -> None:
        self.path = as_path(folder, "folder")
        self.config = _config_of(self.path, allow) if config is None else config
        self._folder = RunFolder(self.path)

    @property
    def is_finished(self) -> bool:
        """True if the agent is exported."""
        return self._folder.is_finished()

    @property
    def description(self) -> RunDescription:
        """Content of ``run.json``; raises UserError before the first training."""
        return self._folder.read()

    def train(self, *, evaluations: int = N_EVALS, progress: bool = True, restart: bool = False) -> Path:
        """Train the run and export its agent; see :func:`fpg_bench.train`, also for the arguments."""
        return train(self.config, self.path, evaluations=evaluations, progress=progress, restart=restart)

    def resume(self, *, evaluations: int = N_EVALS, progress: bool = True) -> Path:
        """Go on from the newest checkpoint, at most a minute older than the stop; begin if there is none."""
        return train(self.config, self.path, evaluations=evaluations, progress=progress, resume=True)

    def agent(self, side: str | None = None) -> Path:
        """Return the folder of the agent; ``side`` chooses one where both sides were trained.

        Raises:
            UserError: there is no agent, or a damaged one.
        """
        return agent_of(self.path, side)

    def evaluate(
        self,
        suite: str | None = None,
        out: str | Path | None = None,
        *,
        side: str | None = None,
        matches: int | None = None,
        workers: Workers | int = 1,
    ) -> Results:
        """Evaluate the agent on a suite; see :func:`fpg_bench.evaluate`.

        Args:
            suite: a suite's name or YAML file; None: that of the agent's environment.
            out, matches, workers: as there.
            side: which agent, where both sides were trained.
        """
        agent = self.agent(side)
        card = read_card(agent)
        return evaluate(
            [str(agent)], suite or suite_of(card.game, card.side), out, matches=matches, workers=workers
        )

    def export(self, out: str | Path, side: str | None = None) -> float | None:
        """Copy the agent into a folder of its own; see :func:`export_runs`."""
        return next(iter(export_runs(self.path, out, side).values()))


def export_runs(source: str | Path, out: str | Path, side: str | None = None) -> dict[Path, float | None]:
    """Copy the agent of a run, or of each run of several training seeds, into a folder of its own.

    Nothing is written unless all agents are there. A run exports and tests its agents as it ends.

    Args:
        source: folder of a run, of an agent, or of ``seed_0``, ``seed_1``, ...
        out: folder of the agent; of several seeds, each agent's lies in it.
        side: ``ally`` or ``opponent``, for runs that trained both sides.

    Returns:
        The folders of the agents, and the largest difference of each from its model's ``predict``, as it was
        measured at the end of the training.

    Raises:
        UserError: an agent is missing, damaged, or in the way.
    """
    source, out = Path(source), Path(out)
    seeds = seed_folders(source)
    targets = [out / seed.name for seed in seeds] or [out]
    agents = [agent_of(run, side) for run in seeds or [source]]
    for agent in agents:
        if agent.resolve() in (out.resolve(), *out.resolve().parents):
            raise UserError(f"export: --out {out} lies in the agent {agent}; name a folder outside of it")
    check_free(*targets)
    for agent, target in zip(agents, targets, strict=True):
        for name in ("policy.onnx", "agent.json"):
            write_whole(target / name, (agent / name).read_bytes())
    return {target: read_card(target).largest_difference for target in targets}


def check_free(*targets: Path) -> None:
    """Raise UserError if one of the folders holds an agent already."""
    for target in targets:
        if (target / "agent.json").exists():
            raise other_content(f"export: {target}", "an agent already", "remove it")


def agent_of(run: Path, side: str | None = None) -> Path:
    """Return the folder of a run's agent; raises UserError if there is none, or a damaged one."""
    agent = run / "agent" if (run / "agent").is_dir() else run
    if side is not None and (agent / side).is_dir():
        agent = agent / side
    if not (agent / "agent.json").is_file():
        both = (agent / "ally").is_dir()
        hint = "; add --side ally or --side opponent" if both else "; is the run finished?"
        raise UserError(f"export: {run} holds no agent{hint}")
    load_agent(agent, side)  # refuses a damaged one
    return agent


def _config_of(run: Path, allow: Collection[str]) -> RunConfig:
    """Return the configuration that a run's ``run.json`` describes."""
    about = RunDescription.read(run)
    if about.game is None or about.offline is not None:
        kind = "of another program" if about.game is None else "on a data set"
        raise UserError(f"run {run}: is a training {kind}; give its configuration")
    options = dict(about.options)
    check_allowed(
        [about.algorithm, about.game.to_dict(), about.hyperparameters, options], allow, f"run {run}"
    )
    start = options.pop("start", None)
    return RunConfig(
        about.algorithm,
        about.game,
        about.training_seed,
        about.training_steps,
        about.hyperparameters,
        suite=None if about.game.is_duel else about.suite,
        start=start,
        planner_options=options,
        allow=allow,
    )
