"""A server of a model on this machine, in a process of its own that ends with this one."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import need
from fpg_bench.common.strict_json import read_plain

CONTEXT = 8192  # tokens; what SmolLM2 was trained for
_MOST_THREADS = 8
_PLAN = (1600, 500)  # tokens read and written for a plan
_PATIENCE = 6  # a deadline is so many times what a plan should take
_SHORTEST_DEADLINE_S = 60.0
_PROMPT = "The opponent flies towards the ally and jams its frequency point. " * 8
_STARTING_S = 120.0
_ASKING_S = 2.0  # for a word about its state


@dataclass(frozen=True)
class Speed:
    """How fast a server was when it began, in tokens a second.

    Attributes:
        reading, writing: of a prompt and of an answer.
    """

    reading: float
    writing: float

    @property
    def plan_s(self) -> float:
        """About how long a plan takes, in s."""
        return _PLAN[0] / self.reading + _PLAN[1] / self.writing

    @property
    def deadline_s(self) -> float:
        """How long a plan may take, in s, where nobody says otherwise: this machine may become busy."""
        return max(_SHORTEST_DEADLINE_S, round(_PATIENCE * self.plan_s))


def free_cores() -> int:
    """How many cores nothing has used in the last minute; never less than half of them, or than one."""
    cores = len(os.sched_getaffinity(0))
    return max(1, cores // 2, round(cores - os.getloadavg()[0]))


class LocalServer:
    """Serves a GGUF file on loopback.

    Args:
        file: the model.
        threads: how many; None: as many as cores are free now, :func:`free_cores`. They wait for each
            other, so that more of them than are free make it slow.
        context: the longest prompt with its answer, in tokens.
        port: 0: any that is free.

    Attributes:
        url: its base URL.
        speed: as measured at its start.
        started_again: how often it had ended and was started again.

    Raises:
        UserError: the extra is missing, or it does not come up: no memory, the port is taken, a broken file.
    """

    def __init__(self, file: Path, threads: int | None = None, context: int = CONTEXT, port: int = 0) -> None:
        need("local-llm", "xllamacpp")
        self.file, self.context = file, context
        self.threads = threads or min(free_cores(), _MOST_THREADS)
        self.started_again = 0
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115  as long as the server
        self._process, self._address = self._started(port)
        self.speed = self._measured()

    @property
    def url(self) -> str:
        """Its base URL."""
        return f"{self._address}/v1"

    @property
    def alive(self) -> bool:
        """Whether its process runs."""
        return self._process.poll() is None

    def written(self) -> int | None:
        """How many tokens of the present answer are written; None: none is under way."""
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError):
            (slot,) = self._ask("/slots", timeout=_ASKING_S)
            return int(slot["next_token"][0]["n_decoded"]) if slot["is_processing"] else None
        return None

    def start_again(self) -> None:
        """Start a process at the same address in the place of one that has ended."""
        self.started_again += 1
        self._process, self._address = self._started(int(self._address.rpartition(":")[2]))

    def wait(self) -> None:
        """Wait until it ends by itself.

        Raises:
            UserError: it did.
        """
        status = self._process.wait()
        raise UserError(f"language model {self.file}: its server has ended with status {status}")

    def stop(self) -> None:
        """End the process; it has nothing to save."""
        self._process.kill()
        self._process.communicate()

    def _started(self, port: int) -> tuple[subprocess.Popen[str], str]:
        words = [str(self.file.absolute()), *map(str, (self.threads, self.context, port))]
        process = subprocess.Popen(
            [sys.executable, "-m", f"{__package__}.process", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            start_new_session=True,  # Ctrl-C is for whoever asks it, not for the server
        )
        late = threading.Timer(_STARTING_S, process.kill)
        late.start()
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
        except BaseException:
            process.kill()
            raise
        finally:
            late.cancel()
        if not address.startswith("http"):
            process.kill()
            process.communicate()
            why = self._last_words(process)
            raise UserError(f"language model {self.file}: its server did not come up{why}")
        return process, address

    def _last_words(self, process: subprocess.Popen[str]) -> str:
        """Why it ended, as far as it said so."""
        self._errors.seek(0)
        lines = [line.strip() for line in self._errors if line.strip()]
        telling = [line for line in lines if "rror" in line or "failed" in line]
        said = next(reversed(telling or lines), "")
        return f": {said}" if said else f" (status {process.returncode})"

    def _measured(self) -> Speed:
        body = {"prompt": _PROMPT, "n_predict": 16, "cache_prompt": False, "ignore_eos": True}
        try:
            timings = self._ask("/completion", body, _STARTING_S)["timings"]
            return Speed(float(timings["prompt_per_second"]), float(timings["predicted_per_second"]))
        except (OSError, ValueError, LookupError, TypeError) as error:
            self.stop()
            raise UserError(f"language model {self.file}: its server gives no answer: {error}") from error

    def _ask(self, path: str, body: dict[str, Any] | None = None, timeout: float = _ASKING_S) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._address + path, data, {"Content-Type": "application/json"})
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # no proxy on loopback
        with opener.open(request, timeout=timeout) as reply:
            return read_plain(reply.read())


# Those of this process, by their base URLs; whoever asks for the same model shares one

_SERVERS: dict[str, LocalServer] = {}
_GUARD = threading.Lock()


def shared_server(file: Path) -> LocalServer:
    """The server of a model, which is started where this process has none; it ends with the process."""
    with _GUARD:
        for server in _SERVERS.values():
            if server.file == file and server.alive:
                return server
        server = LocalServer(file)
        _SERVERS[server.url] = server
        atexit.register(server.stop)
    size = file.stat().st_size / 1e6
    about = f"{file.stem}, {size:,.0f} MB, on this machine with {server.threads} threads"
    pace = f"reads {server.speed.reading:,.0f} and writes {server.speed.writing:,.0f} tokens a second"
    plan = f"a plan takes about {server.speed.plan_s:.0f} s and may take {server.speed.deadline_s:.0f}"
    print(f"fpg_bench: language model {about}; {pace}; {plan}", file=sys.stderr, flush=True)
    return server


def tokens_under_way() -> int | None:
    """How many tokens of present answers the servers of this process have written; None: none is asked."""
    counts = [count for server in list(_SERVERS.values()) if (count := server.written()) is not None]
    return sum(counts) if counts else None


def brought_back(url: str) -> bool:
    """Whether a server of this process had ended and was started again, which is done once.

    Raises:
        UserError: it does not come up again.
    """
    with _GUARD:
        server = _SERVERS.get(url)
        if server is None or server.started_again:
            return False
        for _ in range(10):  # a process that was killed may take a moment to be gone
            if not server.alive:
                server.start_again()
                return True
            time.sleep(0.05)
        return False
