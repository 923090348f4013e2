"""The process that serves a model, on loopback: it writes its address, and ends with its standard input.

So it ends with whoever started it, however that ends.

    python -m fpg_bench.planning.llm.local.process FILE THREADS CONTEXT PORT
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

_KEPT_MIB = 1024  # of prompts that were read: matches in turn find theirs again; 50 MiB each for SmolLM2


def main() -> None:
    """Serve until standard input is closed."""
    import xllamacpp

    file, threads, context, port = sys.argv[1], *map(int, sys.argv[2:])
    params = xllamacpp.CommonParams()
    params.model.path, params.model_alias = file, {Path(file).stem}
    params.n_ctx, params.n_parallel = context, 1
    params.cache_ram_mib = _KEPT_MIB
    params.flash_attn_type = xllamacpp.llama_flash_attn_type.LLAMA_FLASH_ATTN_TYPE_DISABLED  # slower on a CPU
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = threads
    params.hostnames, params.port = ["127.0.0.1"], port
    params.warmup = params.fit_params = params.ui = False
    params.endpoint_slots = True  # tells how many tokens were written so far
    params.verbosity = -1
    server = xllamacpp.Server(params)
    print(server.listening_address, flush=True)
    sys.stdin.read()
    os._exit(0)  # at once, also in the middle of an answer


if __name__ == "__main__":
    main()
