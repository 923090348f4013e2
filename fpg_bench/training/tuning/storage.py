"""Where a study lies: a journal file, or any database that Optuna reads; both may fail for a while."""

from __future__ import annotations

import contextlib
import fcntl
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, TypeVar

import optuna
import sqlalchemy
from optuna.storages import JournalStorage, RDBStorage, fail_stale_trials
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import need
from fpg_bench.training.tuning.claim import try_again

JOURNAL = "journal.log"
HEARTBEAT_S = 60
PATIENCE_S = 600.0
_LONGEST_PAUSE_S = 30.0
_AGAIN_S = 1.0
_DOWN = (OSError, optuna.exceptions.StorageInternalError, sqlalchemy.exc.SQLAlchemyError)
_T = TypeVar("_T")


class Patience:
    """Calls a storage until it answers, with growing pauses, for a bounded time.

    Args:
        where: what messages call the storage.
        limit_s: how long to wait for it.
        say: prints a line.
    """

    def __init__(self, where: str, limit_s: float, say: Callable[[str], None]) -> None:
        self._where, self._limit_s, self._say = where, limit_s, say

    def __call__(self, call: Callable[..., _T], *args: Any, **kwargs: Any) -> _T:
        """What the call gives.

        Raises:
            UserError: the storage does not answer in time.
        """
        start, pause_s = time.monotonic(), 0.5
        while True:
            try:
                return call(*args, **kwargs)
            except _DOWN as error:
                left_s = self._limit_s - (time.monotonic() - start)
                if left_s <= 0:
                    raise UserError(
                        f"{self._where}: does not answer for {self._limit_s:g} s ({reason(error)}); bring it "
                        "up and run the same command again, finished trials are kept"
                    ) from error
                if pause_s == 0.5:
                    self._say(f"{self._where}: does not answer ({reason(error)}); waiting {left_s:.0f} s")
                time.sleep(min(pause_s, left_s))
                pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)


class _JournalLock(JournalFileOpenLock):
    """Held by the kernel, which lets go of it when its process is killed; cuts off what was half written.

    Optuna's own locks are files that outlive their process.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self._path = path
        self._held: IO[bytes] | None = None

    def acquire(self) -> bool:
        held = open(f"{self._path}.flock", "ab")  # noqa: SIM115 (Optuna's own lock is another file)
        fcntl.flock(held, fcntl.LOCK_EX)
        self._held = held
        self._cut_torn_line()
        return True

    def release(self) -> None:
        if self._held is not None:
            self._held.close()

    def _cut_torn_line(self) -> None:
        """What is appended to half a line can never be read again."""
        with self._path.open("r+b") as file:
            if file.seek(0, os.SEEK_END) and (file.seek(-1, os.SEEK_END), file.read(1))[1] != b"\n":
                file.seek(0)
                file.truncate(file.read().rfind(b"\n") + 1)


class Storage:
    """A study's storage.

    Attributes:
        where: what messages call it; a password in the URL is left out.
        optuna: what Optuna is given.
        patient: calls with patience.
        journal: whether it is a journal file, which knows no heartbeat.
    """

    def __init__(self, where: str, storage: JournalStorage | RDBStorage, patient: Patience) -> None:
        self.where, self.optuna, self.patient = where, storage, patient
        self.journal = isinstance(storage, JournalStorage)

    def beating(self, trial: optuna.Trial) -> contextlib.AbstractContextManager[None]:
        """A context in which a database is told that the trial's worker lives; the first time at once."""
        if isinstance(self.optuna, JournalStorage):
            return contextlib.nullcontext()
        number = trial._trial_id  # a private door, opened here alone: heartbeats know trials by no other name
        self.patient(self.optuna.record_heartbeat, number)
        return _heartbeat(self.optuna, number)

    def fail_stale(self, study: optuna.Study) -> None:
        """Fail the trials whose worker has not been heard of for long (a database's only)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fail_stale_trials(study)


@contextlib.contextmanager
def _heartbeat(storage: RDBStorage, trial: int) -> Iterator[None]:
    """Tell a database every now and then that a trial's worker lives; a beat that fails is left out."""
    stop = threading.Event()

    def beat() -> None:
        while not stop.wait(storage.heartbeat_interval):
            with contextlib.suppress(*_DOWN):  # the next one may be heard
                storage.record_heartbeat(trial)

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def open_storage(
    out: Path,
    url: str | None,
    *,
    say: Callable[[str], None],
    patience_s: float = PATIENCE_S,
    heartbeat_s: int = HEARTBEAT_S,
    there: bool = False,
) -> Storage:
    """Open the journal in a folder, or a database.

    Args:
        out: the folder.
        url: a database's URL as Optuna takes it (``postgresql+psycopg://...``); None: the folder's journal.
        say: prints a line.
        patience_s: how long to wait for a storage that has gone down.
        heartbeat_s: between two signs of life of a worker; after three without one its trial is given up.
        there: whether the journal must be there already.

    Raises:
        UserError: it cannot be opened, the folder is a training run's, or the extra ``postgres`` is not
            installed.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    if (out / "run.json").exists():
        raise UserError(f"{out}: holds a training run; choose another folder for the study")
    if url is None:
        if there and not (out / JOURNAL).is_file():
            raise UserError(f"{out}: holds no study")
        return _journal(out.resolve() / JOURNAL, say, patience_s)
    where = f"storage {_without_password(url)}"
    if url.startswith("postgresql+psycopg:"):
        need("postgres", "psycopg")
    return Storage(where, _database(url, where, heartbeat_s), Patience(where, patience_s, say))


def _journal(path: Path, say: Callable[[str], None], patience_s: float) -> Storage:
    where = f"storage {path}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        storage = JournalStorage(JournalFileBackend(str(path), _JournalLock(path)))
    except (OSError, ValueError, KeyError) as error:
        raise UserError(f"{where}: cannot be opened: {reason(error)}") from error
    return Storage(where, storage, Patience(where, patience_s, say))


def _database(url: str, where: str, heartbeat_s: int) -> RDBStorage:
    kwargs: dict[str, Any] = {"pool_pre_ping": True}
    if url.startswith("postgresql"):
        kwargs["connect_args"] = {"connect_timeout": 10}

    def made() -> RDBStorage:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return RDBStorage(
                url,
                kwargs,
                heartbeat_interval=heartbeat_s,
                grace_period=3 * heartbeat_s,
                heartbeat_stale_trial_callback=try_again,
            )

    for last in (False, True):
        try:
            return made()
        except (*_DOWN, ImportError, RuntimeError) as error:
            if last:
                raise UserError(f"{where}: cannot be opened: {reason(error)}") from error
            time.sleep(_AGAIN_S)  # another worker may have been making the tables
    raise AssertionError


def _without_password(url: str) -> str:
    try:
        return sqlalchemy.make_url(url).render_as_string(hide_password=True)
    except sqlalchemy.exc.ArgumentError as error:
        raise UserError(
            "storage: expected a URL like postgresql+psycopg://user@host/database; a password is best left "
            "to the environment"
        ) from error


def reason(error: BaseException) -> str:
    """The first line of what a database or the system says."""
    while error.__cause__ is not None:
        error = error.__cause__
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    lines = str(getattr(error, "orig", None) or error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
