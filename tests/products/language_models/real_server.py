"""A real llama.cpp server on loopback, with a tiny model of random weights, in a process of its own::

    with LlamaServer() as server:
        ...  # a client that is pointed at server.url, asking for server.model

Free text from it is garbage, and a JSON schema gives valid but meaningless paths.
"""

from __future__ import annotations

import itertools
import string
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.programs import ROOT

WIDTH, LAYERS, HEAD, FORWARD = 64, 2, 16, 128
CONTEXT = 32768
SHAPE = {
    **{"context_length": CONTEXT, "embedding_length": WIDTH, "block_count": LAYERS},
    **{"feed_forward_length": FORWARD, "head_count": 1, "head_count_kv": 1, "key_length": HEAD},
    **{"value_length": HEAD, "rope_dimension_count": HEAD, "layer_norm_rms_eps": 1e-5},
}
SERVER = ROOT / "examples/llama_server.py"  # as the guide serves a model


class LlamaServer:
    """Serves while the ``with`` block lasts; ``url`` is the base URL, ``model`` the model's name."""

    model = "tiny"

    def __enter__(self) -> LlamaServer:
        self._folder = tempfile.TemporaryDirectory()
        file = Path(self._folder.name) / f"{self.model}.gguf"
        write_model(file)
        command = [sys.executable, SERVER, file, "--port", "0", "--context", str(CONTEXT)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        variables = dict(each.split("=") for each in self._process.stdout.readline().split()[1:])
        self.url = variables["FPG_LLM_BASE_URL"]
        assert variables["FPG_LLM_MODEL"] == self.model
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.communicate()
        self._folder.cleanup()


def write_model(path: Path) -> None:
    """Write a llama of random weights; its vocabulary is all bytes, and pairs so that prompts are short."""
    import gguf
    import numpy as np

    writer = gguf.GGUFWriter(path, "llama")
    for name, value in SHAPE.items():
        getattr(writer, f"add_{name}")(value)
    pieces = _add_vocabulary(writer, gguf.TokenType)
    rng = np.random.default_rng(0)
    for name, shape in _tensors(pieces).items():
        norm = name.endswith("norm.weight")
        writer.add_tensor(name, np.ones(shape, "f4") if norm else rng.normal(0, 0.1, shape).astype("f2"))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()


def _add_vocabulary(writer, kinds) -> int:
    """Special tokens, bytes, and all pairs of digits, small letters and spaces; returns how many."""
    pairs = map("".join, itertools.product(string.digits + string.ascii_lowercase + "▁", repeat=2))
    pieces = [("<unk>", kinds.UNKNOWN), ("<s>", kinds.CONTROL), ("</s>", kinds.CONTROL)]
    pieces += [(f"<0x{byte:02X}>", kinds.BYTE) for byte in range(256)]
    pieces += [(pair, kinds.NORMAL) for pair in pairs]
    writer.add_tokenizer_model("llama")
    writer.add_token_list([piece for piece, _ in pieces])
    writer.add_token_types([kind for _, kind in pieces])
    writer.add_token_scores([0.0] * len(pieces))
    writer.add_unk_token_id(0)
    writer.add_bos_token_id(1)
    writer.add_eos_token_id(2)
    writer.add_add_space_prefix(False)
    return len(pieces)


def _tensors(pieces: int) -> dict[str, tuple[int, ...]]:
    shapes: dict[str, tuple[int, ...]] = {
        "token_embd.weight": (pieces, WIDTH),
        "output_norm.weight": (WIDTH,),
        "output.weight": (pieces, WIDTH),
    }
    for layer in range(LAYERS):
        block = {
            "attn_norm": (WIDTH,),
            "attn_q": (HEAD, WIDTH),
            "attn_k": (HEAD, WIDTH),
            "attn_v": (HEAD, WIDTH),
            "attn_output": (WIDTH, HEAD),
            "ffn_norm": (WIDTH,),
            "ffn_gate": (FORWARD, WIDTH),
            "ffn_up": (FORWARD, WIDTH),
            "ffn_down": (WIDTH, FORWARD),
        }
        shapes |= {f"blk.{layer}.{name}.weight": shape for name, shape in block.items()}
    return shapes
