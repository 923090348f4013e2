"""From a trained SB3 model to an agent folder: the policy's networks walked, normalisation folded in."""

from __future__ import annotations

import hashlib
import logging
import tempfile
import warnings
from pathlib import Path
from typing import Any, cast

import numpy as np
import onnx
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from fpg_bench.errors import UserError
from fpg_bench.files import write_json, write_whole
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.players.agent import AGENT_FORMAT, OnnxPlayer

GREATEST_DIFFERENCE = 1e-4
_OPSET = 18


class _Actor(nn.Module):
    """The deterministic policy as one module: normalisation, networks, squashing or clipping."""

    def __init__(self, policy: nn.Module, normalize: VecNormalize | None) -> None:
        super().__init__()
        self.networks = _networks(policy)
        # TD3's networks end in a tanh of their own.
        self.squash = not isinstance(policy, TD3Policy) and policy.squash_output
        mean: np.ndarray = np.zeros(OBSERVATION_SIZE)
        scale: np.ndarray = np.ones(OBSERVATION_SIZE)
        clip = np.inf
        if normalize is not None and normalize.norm_obs:
            statistics = cast(RunningMeanStd, normalize.obs_rms)
            mean, scale = statistics.mean, np.sqrt(statistics.var + normalize.epsilon)
            clip = normalize.clip_obs
        self.clip = clip
        self.mean = nn.Buffer(torch.as_tensor(mean, dtype=torch.float32))
        self.scale = nn.Buffer(torch.as_tensor(scale, dtype=torch.float32))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        if np.isfinite(self.clip):
            observation = ((observation - self.mean) / self.scale).clamp(-self.clip, self.clip)
        action = self.networks(observation)
        return torch.tanh(action) if self.squash else action.clamp(-1.0, 1.0)


def _networks(policy: nn.Module) -> nn.Sequential:
    """The layers between observation and action, as SB3 chains them in ``predict``."""
    if isinstance(policy, ActorCriticPolicy):
        features = policy.pi_features_extractor
        return nn.Sequential(features, policy.mlp_extractor.policy_net, policy.action_net)
    if isinstance(policy, SACPolicy):
        return nn.Sequential(policy.actor.features_extractor, policy.actor.latent_pi, policy.actor.mu)
    if isinstance(policy, TD3Policy):
        return nn.Sequential(policy.actor.features_extractor, policy.actor.mu)
    raise UserError(f"export: {type(policy).__name__} is not a policy of PPO, A2C, SAC, TD3 or DDPG")


def export_onnx(model: BaseAlgorithm) -> bytes:
    """The model's deterministic policy as ONNX: ``observation`` (n, 15) to ``action`` (n, 9), float32.

    Raises:
        UserError: a policy of another kind.
    """
    actor = _Actor(model.policy, model.get_vec_normalize_env()).cpu().eval()
    example = torch.zeros(2, OBSERVATION_SIZE)
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        logging.getLogger("onnxscript").setLevel(logging.ERROR)
        path = Path(folder) / "policy.onnx"
        torch.onnx.export(
            actor,
            (example,),
            str(path),
            input_names=["observation"],
            output_names=["action"],
            dynamic_shapes=({0: torch.export.Dim("n")},),
            opset_version=_OPSET,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        return _stripped(onnx.load(path))


def _stripped(proto: onnx.ModelProto) -> bytes:
    """Without what the exporter noted of this machine: paths, stack traces, names of modules."""
    del proto.metadata_props[:]
    proto.doc_string = proto.graph.doc_string = ""
    del proto.graph.metadata_props[:]
    for item in (*proto.graph.node, *proto.graph.value_info, *proto.graph.input, *proto.graph.output):
        item.doc_string = ""
        del item.metadata_props[:]
    del proto.graph.value_info[:]
    return proto.SerializeToString(deterministic=True)


def export_agent(model: BaseAlgorithm, folder: Path, about: dict[str, Any]) -> float:
    """Write an agent folder: ``policy.onnx`` and ``agent.json``.

    Args:
        model: a trained PPO, SAC or TD3 (with its ``VecNormalize``, if it was trained with one).
        folder: where to.
        about: what ``agent.json`` says: algorithm, id, scenario hash, training seed and steps, versions.

    Returns:
        The largest difference to the model's own ``predict``.

    Raises:
        UserError: a policy of another kind, or one that plays differently once exported.
    """
    data = export_onnx(model)
    about = {"format": AGENT_FORMAT, **about, "policy_sha256": hashlib.sha256(data).hexdigest()}
    difference = largest_difference(model, OnnxPlayer(data, about))
    if not difference <= GREATEST_DIFFERENCE:
        raise UserError(f"export: the exported policy differs from predict by {difference:g}")
    write_whole(folder / "policy.onnx", data)
    write_json(folder / "agent.json", about | {"largest_difference": difference})
    return difference


def largest_difference(model: BaseAlgorithm, player: OnnxPlayer, count: int = 1000) -> float:
    """The largest difference of any action entry between the model and the player, on random observations."""
    observations = np.random.default_rng(0).uniform(-1, 1, (count, OBSERVATION_SIZE)).astype(np.float32)
    normalize = model.get_vec_normalize_env()
    seen = observations if normalize is None else normalize.normalize_obs(observations.copy())
    theirs, _ = model.predict(seen, deterministic=True)
    ours, _ = player.predict(observations)
    return float(np.max(np.abs(theirs - ours)))
