"""Hyper-parameters in rl-zoo3's format: one YAML file per algorithm, keyed by environment id."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated

from pydantic import ConfigDict, Field

from fpg_bench.common.errors import UserError, nearest, shown
from fpg_bench.common.files import as_path, read_yaml
from fpg_bench.common.ids import DUEL, ENVS
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.schema import Expected, Strict, problems_of
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder, shipped_files
from fpg_bench.players.card import MOST_STEPS
from fpg_bench.training.algorithms import Algorithm, find_algorithm
from fpg_bench.training.config import Hyperparams
from fpg_bench.training.rl_zoo3_format import Entry, argument_problems, read_entry, whole_arguments

# Arguments of algorithms that the runner sets itself.
_RESERVED = {"env", "seed", "tensorboard_log", "verbose", "_init_setup_model"}
_NOISE = ("noise_type", "noise_std")  # rl-zoo3's form of action_noise
_TRANSLATED = ("log_std_init", "net_arch")  # of policies; checked where the model is made
_OF_POLICIES = {"observation_space", "action_space", "lr_schedule"}  # given by the algorithm
MOST_ENVS, MOST_FRAMES, MOST_EPOCHS = 100_000, 1000, 1_000_000
CUSTOM_N_ENVS = 64  # of a custom class without hyper-parameters


def _at_most(most: int) -> Expected:
    return Expected(f"a whole number above 0, at most {most:,}")


class ImitationConfig(Strict):
    """Imitation of a teacher before training, the entry ``imitate``.

    Attributes:
        teacher: name of a player of the learner's side.
        steps: environment steps over all games, in addition to the training budget.
        learning_rate: of Adam.
        batch_size: size of a minibatch.
        n_epochs: epochs per round of data.
    """

    teacher: str
    steps: Annotated[int, Field(ge=1, le=MOST_STEPS), _at_most(MOST_STEPS)] = 400_000
    learning_rate: Annotated[float, Field(gt=0, lt=1), Expected("a number between 0 and 1")] = 0.001
    batch_size: Annotated[int, Field(ge=2), Expected("a whole number, 2 or more")] = 1024
    n_epochs: Annotated[int, Field(ge=1, le=MOST_EPOCHS), _at_most(MOST_EPOCHS)] = 5


class Hyperparameters(Strict):
    """Hyper-parameters of an algorithm on one environment id: an entry of a file.

    Attributes:
        n_envs: number of games played in parallel; 1 if none is given, as in rl-zoo3.
        n_timesteps: training budget in steps, over all games; 0 if none is given.
        normalize: arguments of SB3's ``VecNormalize``; None trains without it.
        frame_stack: number of stacked observations; None for no stacking.
        memory: whether it observes its memory, see :mod:`fpg_bench.players.memory`.
        imitate: imitation before training; None trains without it.
    """

    model_config = ConfigDict(extra="allow", allow_inf_nan=True)

    n_envs: Annotated[int, Field(ge=1, le=MOST_ENVS), _at_most(MOST_ENVS)] = 1
    n_timesteps: Annotated[int, Field(ge=1, le=MOST_STEPS), _at_most(MOST_STEPS)] = 0
    normalize: Entry | None = None
    frame_stack: Annotated[int | None, Field(ge=1, le=MOST_FRAMES), _at_most(MOST_FRAMES)] = None
    memory: bool = False
    imitate: ImitationConfig | None = None

    @property
    def algorithm(self) -> Entry:
        """All other keys: arguments of the algorithm's constructor, ``policy`` included."""
        return dict(self.model_extra or {})

    def entry(self) -> Entry:
        """Return the hyper-parameters as an entry of a file."""
        values: Entry = {
            "n_envs": self.n_envs,
            "n_timesteps": self.n_timesteps or None,
            "normalize": self.normalize,
            "frame_stack": self.frame_stack,
            "memory": self.memory or None,
            "imitate": self.imitate and self.imitate.model_dump(),
        }
        return {name: value for name, value in values.items() if value is not None} | self.algorithm


def load_hyperparameters(
    algorithm: str | Algorithm, game: str | GameSpec, file: Hyperparams = None, *, allow: Collection[str] = ()
) -> Hyperparameters:
    """Load the hyper-parameters of an algorithm in a game.

    Args:
        algorithm: its name; see :func:`fpg_bench.training.algorithms.find_algorithm`.
        game: an environment id, or a specification. Opponents that choose their own path and players with
            discrete actions have their own shipped values.
        file: a YAML file, the name of a shipped one (``ppo-fast``), or its entry for the id; None takes the
            shipped file of the algorithm, and for a custom class the defaults of that class with 64 games.
        allow: the ``package.module:object`` and agents of the Hub that the file may name; neither is run on a
            file's word.

    Raises:
        UserError: an unknown algorithm, no entry for the id, a name that is not allowed, or invalid keys, all
            in one line.
    """
    if not isinstance(algorithm, Algorithm):
        algorithm = find_algorithm(algorithm)
    if isinstance(game, str) and game not in (DUEL, *ENVS) and file is not None:
        env_id = game  # rl-zoo3's files hold other environments, too
    else:
        game = GameSpec.of(game)
        env_id = game.id
    if isinstance(file, Mapping):
        return _parse(algorithm, dict(file), f"hyper-parameters: {env_id}")
    if file is None and algorithm.custom:
        return Hyperparameters.model_construct(n_envs=CUSTOM_N_ENVS, n_timesteps=0, policy="MlpPolicy")
    file = _named_file(file) if file else _shipped_file(algorithm, GameSpec.of(game))
    content = read_yaml(file, "hyper-parameters")
    if isinstance(content.get("policy"), str):  # of a run of rl-zoo3: one entry, without an id
        return _parse(algorithm, content, f"hyper-parameters {file}")
    entry = content.get(env_id, content.get("default"))
    if not isinstance(entry, dict):
        raise UserError(
            f"hyper-parameters {file}: no entry for {env_id!r}{nearest(env_id, map(str, content))}"
        )
    check_allowed(entry, allow, f"hyper-parameters {file}")
    return _parse(algorithm, entry, f"hyper-parameters {file}: {env_id}")


def _named_file(name: str | Path) -> Path:
    """Return a file, or the shipped file of this name if there is none.

    Raises:
        UserError: a name without a suffix that is not the name of a shipped file.
    """
    file = as_path(name, "hyper-parameters")
    if file.suffix or file.is_file():
        return file
    shipped = shipped_files("hyperparams")
    if str(file) not in shipped:
        hint = nearest(str(file), shipped)
        raise UserError(f"hyper-parameters {file}: neither a file nor a shipped name{hint}")
    return shipped[str(file)]


def _shipped_file(algorithm: Algorithm, game: GameSpec) -> Path:
    """Return the shipped file of an algorithm; stacked frames fall back to the plain algorithm's file."""
    names = [algorithm.name, algorithm.base]
    if game.action_mode != "continuous":
        names.insert(0, f"{algorithm.base}-discrete")
    elif game.path == ("learned",) and game.sides == ("opponent",):
        names.insert(0, f"{algorithm.base}-learned")
    shipped = shipped_files("hyperparams")
    missing = baselines_folder() / "hyperparams" / f"{names[-1]}.yml"
    return next((shipped[name] for name in names if name in shipped), missing)


def _parse(algorithm: Algorithm, content: Entry, where: str) -> Hyperparameters:
    content, unreadable = read_entry(content)
    content = whole_arguments(content, algorithm.kind)
    parameters, invalid = problems_of(Hyperparameters, content)
    if problems := [*unreadable, *invalid, *_argument_problems(algorithm, parameters)]:
        raise UserError(f"{where}: {'; '.join(problems)}")
    frame_stack = parameters.frame_stack or algorithm.frame_stack
    if algorithm.frame_stack not in (None, frame_stack):
        raise UserError(
            f"{where}: frame_stack: {algorithm.name} stacks {algorithm.frame_stack}, got {frame_stack}"
        )
    memory = parameters.memory or algorithm.memory
    return parameters.model_copy(update={"frame_stack": frame_stack, "memory": memory})


def _argument_problems(algorithm: Algorithm, parameters: Hyperparameters) -> list[str]:
    """Return a line per invalid argument of the algorithm, of its policy, or of ``VecNormalize``."""
    from stable_baselines3.common.vec_env import VecNormalize

    arguments = {name: value for name, value in parameters.algorithm.items() if name not in _NOISE}
    normalize = argument_problems(parameters.normalize or {}, VecNormalize, {"venv"})
    own = argument_problems(arguments, algorithm.kind, _RESERVED, algorithm.custom)
    return [*own, *_policy_problems(algorithm, arguments), *(f"normalize: {each}" for each in normalize)]


def _policy_problems(algorithm: Algorithm, arguments: Mapping[str, object]) -> list[str]:
    """Return a line per problem of ``policy`` and ``policy_kwargs``."""
    from torch.optim import Adam

    known = getattr(algorithm.kind, "policy_aliases", {})
    policy = arguments.get("policy")
    if "policy" in arguments and known and not isinstance(policy, type):
        if not isinstance(policy, str) or policy not in known:
            hint = nearest(policy, known) if isinstance(policy, str) else ""
            return [f"policy: expected one of {', '.join(known)}, got {shown(policy)}{hint}"]
        policy = known[policy]
    values = arguments.get("policy_kwargs", {})
    if not isinstance(values, Mapping):
        return [f"policy_kwargs: expected a mapping, got {shown(values)}"]
    plain = {name: value for name, value in values.items() if name not in _TRANSLATED}
    problems: list[str] = []
    if isinstance(policy, type):
        problems = argument_problems(plain, policy, _OF_POLICIES, is_custom=True)
    for name in ("optimizer_kwargs", "features_extractor_kwargs"):
        inner = values.get(name)
        if inner is not None and not isinstance(inner, Mapping):
            problems.append(f"{name}: expected a mapping, got {shown(inner)}")
        elif inner and name == "optimizer_kwargs" and "optimizer_class" not in values:
            found = argument_problems(inner, Adam, {"params", "lr"})
            problems += [f"{name}: {problem}" for problem in found]
    return [f"policy_kwargs: {problem}" for problem in problems]
