"""Writing an agent folder around a policy of any framework."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import need
from fpg_bench.common.files import write_json, write_whole
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import AGENT_FORMAT, OnnxPlayer, check_about


def write_agent(folder: str | os.PathLike[str], model: bytes | str | os.PathLike[str], **about: Any) -> None:
    """Write an agent folder: ``policy.onnx`` and ``agent.json``.

    Args:
        folder: where to.
        model: the policy as ONNX, its bytes or its file, with the inputs and outputs of
            :class:`fpg_bench.players.agent.OnnxPlayer`. What an exporter notes of this machine is left out.
        **about: what ``agent.json`` says: ``algorithm``, ``id`` (the environment id), ``training_seed`` and
            ``training_steps`` at least; ``scenario`` (its hash) where it was not ``standard``; of
            ``FPG/duel_v0`` also ``side``.

    Raises:
        UserError: a field missing, a policy off the contract, or no ONNX.
    """
    where = f"agent {os.fspath(folder)}"
    data = stripped(model if isinstance(model, bytes) else Path(model).read_bytes())
    sha256 = hashlib.sha256(data).hexdigest()
    told = {"format": AGENT_FORMAT, "scenario": STANDARD.hash, **about, "policy_sha256": sha256}
    check_about(told, where)
    try:
        OnnxPlayer(data, told)
    except UserError as error:
        raise UserError(f"{where}: {error}") from error
    write_whole(Path(folder) / "policy.onnx", data)
    write_json(Path(folder) / "agent.json", told)


def stripped(model: bytes) -> bytes:
    """A policy without what an exporter noted of this machine: paths, stack traces, names of modules.

    Raises:
        UserError: no ONNX, or the package ``onnx`` is not installed.
    """
    need("evaluate", "onnx")
    import onnx

    try:
        proto = onnx.load_model_from_string(model)
    except Exception as error:  # protobuf's own kinds
        raise UserError("policy.onnx: is no ONNX file, or a truncated one") from error
    del proto.metadata_props[:]
    proto.doc_string = proto.graph.doc_string = ""
    del proto.graph.metadata_props[:]
    for item in (*proto.graph.node, *proto.graph.value_info, *proto.graph.input, *proto.graph.output):
        item.doc_string = ""
        del item.metadata_props[:]
    del proto.graph.value_info[:]
    return proto.SerializeToString(deterministic=True)
