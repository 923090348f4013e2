"""Loading of a Stable-Baselines3 zip without unpickling: weights, sizes and plain JSON only."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.training import require_libraries

require_libraries()

import dataclasses
import re
import zipfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch
from stable_baselines3 import A2C, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack

from fpg_bench.common.checks import is_integer
from fpg_bench.common.errors import UserError, nearest, one_line
from fpg_bench.common.files import read_yaml
from fpg_bench.common.strict_json import JsonObject, read_object
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.evaluation.run_description import FILE, RunDescription
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.spec import GameSpec
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.training.checkpoint import NORMALIZE, read_model
from fpg_bench.training.export import export_agent
from fpg_bench.training.models import ACTIVATIONS
from fpg_bench.training.rl_zoo3_format import net_arch, read_entry

_STATISTICS = "vecnormalize.pkl"
KINDS: dict[str, type[PPO | A2C | SAC | TD3]] = {"ppo": PPO, "a2c": A2C, "sac": SAC, "td3": TD3}
# policy_kwargs that do not change predict, apart from the sizes, which follow from the weights.
_HARMLESS = {
    "net_arch",
    "activation_fn",
    "log_std_init",
    "ortho_init",
    "n_critics",
    "share_features_extractor",
}
_HARMLESS |= {"use_sde", "optimizer_class", "optimizer_kwargs", ":type:", ":serialized:"}
INSTEAD = "load it yourself and call fpg_bench.export_agent(model, folder, training_seed=...)"


@dataclasses.dataclass(frozen=True)
class _Training:
    """Facts of a training from the files beside a zip; None where they do not tell.

    Attributes:
        algorithm, game, seed: how it was trained.
        is_plain: True if it is known that observations were not normalized.
        statistics: the file of the statistics that observations were normalized by.
    """

    algorithm: str | None = None
    game: GameSpec | None = None
    seed: int | None = None
    is_plain: bool = False
    statistics: Path | None = None


def export_zip(
    path: Path,
    out: Path,
    algorithm: str | None,
    game: GameSpec | None = None,
    seed: int | None = None,
    *,
    is_plain: bool = False,
) -> float:
    """Export a zip written by SB3's ``save`` as an agent folder.

    Args:
        path: the zip.
        out: the agent's folder.
        algorithm: see :func:`load_zip`; None: what rl-zoo3's ``args.yml`` beside it says.
        game: the game that it was trained in, with its scenario; None: that of the run whose folder it is in,
            or of ``args.yml``.
        seed: the training seed; None: that of a folder named ``seed_<k>``, or of ``args.yml``.
        is_plain: confirms that it was trained without VecNormalize, which a zip does not show; rl-zoo3's
            ``config.yml`` beside it does.

    Returns:
        The largest difference from the model's own ``predict``.

    Raises:
        UserError: as :func:`load_zip`, or something that neither the zip nor a file beside it tells is not
            given, all in one line; statistics of VecNormalize lie beside it.
    """
    if not path.is_file():
        raise UserError(f"export: {path} does not exist; expected the folder of a run, or a zip")
    if not zipfile.is_zipfile(path):
        raise UserError(f"export: {path} is not a zip written by save() of SB3; that of a run is model.zip")
    _frames(_read(path)[1])  # refuses a model of other games before it asks for options
    told = _read_beside(path)
    algorithm = algorithm or told.algorithm
    if seed is None:
        named = re.fullmatch(r"seed_(\d+)", out.name)
        seed = told.seed if named is None else int(named[1])
    if game is None or game.scenario is None:
        game = told.game if game is None else None
    if told.statistics is not None:
        is_run = told.statistics.name == NORMALIZE
        raise UserError(
            f"export: it was trained with VecNormalize, whose statistics are in {told.statistics}"
            + (f"; export the run, {path.parent}" if is_run else f", a pickle, never opened; {INSTEAD}")
        )
    lacking = {
        "add --algo ppo, a2c, sac or td3": algorithm is None,
        "add --seed, the training seed, or name the folder seed_<k>": seed is None,
        "a zip does not name its game; add --id and --scenario, such as standard": game is None,
        f"add --not-normalized if VecNormalize was not used, else {INSTEAD}": not (is_plain or told.is_plain),
    }
    if problems := [text for text, lacks in lacking.items() if lacks]:
        raise UserError(f"export: a zip does not tell all of its training; {'; '.join(problems)}")
    assert algorithm is not None
    assert game is not None
    assert seed is not None
    model = load_zip(path, algorithm, game)
    return export_agent(model, out, training_seed=seed, game=game, algorithm=algorithm)


def _read_beside(path: Path) -> _Training:
    """Return what ``run.json``, or ``args.yml`` and ``config.yml`` of rl-zoo3, tell of a zip's training."""
    if (path.parent / FILE).is_file():
        own = path.parent / NORMALIZE
        statistics = own if own.is_file() else None
        return _Training(game=RunDescription.read(path.parent).game, statistics=statistics)
    pickles = [*path.parent.glob(_STATISTICS), *path.parent.glob(f"*/{_STATISTICS}")]
    statistics = next(iter(pickles), None)
    files = sorted(path.parent.glob("*/args.yml"))
    if len(files) != 1:
        return _Training(statistics=statistics)
    (file,) = files
    args, config = read_yaml(file, "training"), read_yaml(file.with_name("config.yml"), "training")
    game = GameSpec.from_dict({"id": args.get("env"), **(args.get("env_kwargs") or {})}, f"training {file}")
    if game.scenario is None:
        game = dataclasses.replace(game, scenario=STANDARD.name)
    normalize = read_entry(config)[0].get("normalize")
    is_plain = normalize is None or normalize.get("norm_obs") is False
    seed = args.get("seed")
    return _Training(
        args.get("algo"),
        game,
        seed if is_integer(seed, 0) else None,
        is_plain,
        None if is_plain else statistics or file.with_name(_STATISTICS),
    )


def load_zip(path: Path, algorithm: str, game: str | GameSpec) -> BaseAlgorithm:
    """Load a model from a zip written by SB3's ``save``; its pickles are never opened.

    Args:
        path: the zip.
        algorithm: ``ppo``, ``a2c``, ``sac`` or ``td3``.
        game: the game that it was trained in, or its id; the other side's player does not matter.

    Raises:
        UserError: no such zip, or a policy that does not follow from its weights alone.
    """
    if algorithm not in KINDS:
        raise UserError(f"export: algorithm {algorithm!r}{nearest(algorithm, KINDS)}; else {INSTEAD}")
    data, weights = _read(path)
    try:
        model: BaseAlgorithm = KINDS[algorithm](
            "MlpPolicy",
            _games(GameSpec.of(game), _frames(weights)),
            policy_kwargs=_policy_kwargs(data, weights),
            device="cpu",
        )
        model.policy.load_state_dict(weights)
    except (KeyError, RuntimeError, TypeError, AssertionError) as error:
        raise UserError(
            f"export: {path} holds no plain MlpPolicy of {algorithm} ({one_line(error)[:120]}); {INSTEAD}"
        ) from error
    steps = data.get("num_timesteps")
    model.num_timesteps = steps if isinstance(steps, int) else 0
    return model


def _read(path: Path) -> tuple[JsonObject, dict[str, torch.Tensor]]:
    """Return the plain JSON of a zip, and the policy's weights."""
    try:
        weights: Any = read_model(path)[0]["policy"]
        if sum(tensor.nbytes for tensor in weights.values()) > path.stat().st_size:
            raise ValueError("its tensors have more numbers than it holds")
        with zipfile.ZipFile(path) as archive:
            data = read_object(archive.read("data"), nan=True)
    except Exception as error:  # zip's, JSON's and torch's kinds
        raise UserError(f"export: {path} is not a zip written by save() of SB3: {error}") from error
    return data, weights


def _policy_kwargs(data: JsonObject, weights: dict[str, torch.Tensor]) -> dict[str, Any]:
    """Return the sizes of the networks, from the weights, and their activation, from its name."""
    saved = data.get("policy_kwargs") or {}
    if other := sorted(set(saved) - _HARMLESS):
        raise UserError(f"export: its policy_kwargs name {', '.join(other)}; {INSTEAD}")
    seen = (data.get("observation_space") or {}).get("_shape", ())
    if len(seen) > 1:
        raise UserError(f"export: it sees a waterfall of {tuple(seen)}; {INSTEAD}")
    if data.get("use_sde") or saved.get("use_sde"):
        raise UserError(f"export: it was trained with use_sde; {INSTEAD}")
    kwargs: dict[str, Any] = {"net_arch": net_arch(_sizes(weights), "export: layers")}
    if "activation_fn" in saved:
        name = re.sub(r"\W+$", "", str(saved["activation_fn"])).rpartition(".")[2]
        if name not in ACTIVATIONS:
            raise UserError(f"export: its activation is {name!r}; {INSTEAD}")
        kwargs["activation_fn"] = ACTIVATIONS[name]
    if critics := {key.split(".")[1] for key in weights if key.startswith("critic.qf")}:
        kwargs["n_critics"] = len(critics)
    return kwargs


def _sizes(weights: dict[str, torch.Tensor]) -> dict[str, list[int]]:
    if any(key.startswith("mlp_extractor.") for key in weights) or "action_net.weight" in weights:
        parts = {"pi": "mlp_extractor.policy_net", "vf": "mlp_extractor.value_net"}
        return {name: _layers(weights, prefix) for name, prefix in parts.items()}
    actor = _layers(weights, "actor.latent_pi") or _layers(weights, "actor.mu")[:-1]
    return {"pi": actor, "qf": _layers(weights, "critic.qf0")[:-1]}


def _layers(weights: dict[str, torch.Tensor], prefix: str) -> list[int]:
    """Return the output sizes of a chain of layers, first to last."""
    shapes = {
        int(match[1]): tensor.shape
        for key, tensor in weights.items()
        if tensor.ndim == 2 and (match := re.fullmatch(re.escape(prefix) + r"\.(\d+)\.weight", key))
    }
    chain = [shapes[index] for index in sorted(shapes)]
    if any(after[1] != before[0] for before, after in pairwise(chain)):
        raise UserError(f"export: its layers {prefix} do not follow each other; {INSTEAD}")
    return [shape[0] for shape in chain]


def _frames(weights: dict[str, torch.Tensor]) -> int:
    """Return how many stacked frames the first layer reads; raise UserError if it reads something else."""
    name = r"(mlp_extractor\.policy_net|actor\.latent_pi|actor\.mu)\.0\.weight|action_net\.weight"
    plain = {key: tensor for key, tensor in weights.items() if tensor.ndim == 2}
    first = next((tensor.shape[1] for key, tensor in plain.items() if re.fullmatch(name, key)), None)
    frames, rest = divmod(first or OBSERVATION_SIZE, OBSERVATION_SIZE)
    if rest:
        raise UserError(
            f"export: it reads {first} numbers, and no game of fpg-bench shows these: a player sees "
            f"{OBSERVATION_SIZE}, or stacked frames of them; train a model in a game first"
        )
    return frames


def _games(spec: GameSpec, frames: int) -> VecEnv:
    """Return a game with stacked frames, whomever it was played against."""
    alone = dataclasses.replace(spec, opponent=None, ally=None, planner=None, untrusted=frozenset())
    games: VecEnv = make_sb3(alone, 1)
    return games if frames == 1 else VecFrameStack(games, frames)
