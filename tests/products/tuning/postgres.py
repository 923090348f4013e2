"""A real PostgreSQL server on loopback, in a folder of its own."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path


def programs():
    """Return the folder of initdb and postgres; None if there is none."""
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    found = shutil.which("postgres")
    folders += [Path(found).resolve().parent] if found else []
    return next((folder for folder in folders if (folder / "initdb").exists()), None)


class Server:
    """Started and stopped at will; what it holds stays until the end."""

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="postgres-"))
        self.bin = programs()
        # PostgreSQL refuses to be run by root.
        self.user = {"user": "postgres", "group": "postgres"} if os.getuid() == 0 else {}
        if self.user:
            shutil.chown(self.folder, **self.user)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.process = None
        words = ["-D", "data", "-A", "trust", "-U", "tuner", "--no-sync", "--no-locale", "-E", "UTF8"]
        subprocess.run([self.bin / "initdb", *words], **self._where(), check=True)

    def _where(self):
        log = (self.folder / "log").open("ab")
        return {"cwd": self.folder, "stdout": log, "stderr": log, **self.user}

    @property
    def url(self):
        """Of the database that is always there."""
        return f"postgresql+psycopg://tuner@127.0.0.1:{self.port}/postgres"

    def start(self):
        settings = {"listen_addresses": "127.0.0.1", "unix_socket_directories": "", "fsync": "off"}
        words = [word for name, value in settings.items() for word in ("-c", f"{name}={value}")]
        command = [self.bin / "postgres", "-D", "data", "-p", str(self.port), *words]
        self.process = subprocess.Popen(command, **self._where(), start_new_session=True)
        deadline = time.monotonic() + 60
        ready = [self.bin / "pg_isready", "-q", "-h", "127.0.0.1", "-p", str(self.port)]
        while subprocess.run(ready).returncode:
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError((self.folder / "log").read_text(errors="replace")[-2000:])
            time.sleep(0.05)

    def kill(self):
        """As a power cut does: the server and all that it started."""
        if self.process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGQUIT)
            self.process.wait()
            self.process = None

    def remove(self):
        self.kill()
        shutil.rmtree(self.folder)
