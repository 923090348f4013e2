"""Agents on the Hugging Face Hub: their names, ``hf://owner/name@revision``, and their download.

Only ``agent.json`` and ``policy.onnx`` are downloaded, and both are data; their sizes are checked before a
byte of them is loaded. The client library ``huggingface_hub`` (extra ``hub``) downloads into its own cache
and uploads; the token comes from ``HF_TOKEN`` alone.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fpg_bench.common.errors import UserError, first_line, printable
from fpg_bench.common.extras import require_extra
from fpg_bench.common.imports import HUB
from fpg_bench.products.sandbox.client import AGENT_FILES
from fpg_bench.version import __version__

if TYPE_CHECKING:
    from huggingface_hub import HfApi

PUSHED_FILES = (*AGENT_FILES, "README.md", "curve.png", "records.jsonl", ".gitattributes")
_NAME = re.compile(rf"{HUB}([\w.-]+/[\w.-]+)(?:@(\S+))?")
_COMMIT = re.compile(r"[0-9a-f]{40}")
TIMEOUT_S = 10  # of a request that transfers no file
_SHORTEST_SECRET = 8
_MOST_NAMED = 3  # of ignored files
_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Snapshot:
    """An agent of one commit of a repository, downloaded.

    Attributes:
        repository: ``owner/name``.
        revision: the branch, tag or commit that was asked for.
        commit: the commit that the revision stands for, 40 hexadecimal digits.
        folder: the folder of its files in the cache.
    """

    repository: str
    revision: str
    commit: str
    folder: Path

    @property
    def name(self) -> str:
        """Name of the player that never changes."""
        return f"{HUB}{self.repository}@{self.commit}"


def hub_name(repository: str, revision: str | None = None) -> str:
    """Return the player's name of ``owner/name`` at a revision; such a name is accepted, too.

    Raises:
        UserError: not of this form, or two revisions.
    """
    name = repository if repository.startswith(HUB) else HUB + repository
    if revision is not None:
        if "@" in name:
            raise UserError(f"{name}: names a revision, and so does --revision; give only one")
        name += f"@{revision}"
    split_name(name)
    return name


def split_name(name: str) -> tuple[str, str]:
    """Return the repository and the revision of a player's name; raises UserError for another form."""
    match = _NAME.fullmatch(name)
    if match is None:
        raise UserError(f"{name!r}: expected owner/name or hf://owner/name, with @revision if you like")
    return match[1], match[2] or "main"


@functools.cache
def resolve(name: str) -> Snapshot:
    """Download an agent by its player's name; a name stands for one commit as long as the program runs.

    Raises:
        UserError: see :func:`download`.
    """
    snapshot = download(name)
    if snapshot.commit != snapshot.revision:
        _logger.info(f"{name} is commit {snapshot.commit}")
    return snapshot


def client() -> HfApi:
    """Return the Hub's client, with the token of ``HF_TOKEN`` or none.

    Raises:
        UserError: the extra ``hub`` is not installed, or the variable holds no token.
    """
    require_extra("hub", "huggingface_hub", "onnx")
    from huggingface_hub import HfApi

    token = os.environ.get("HF_TOKEN", "").strip()
    if not token.isascii() or not token.isprintable():
        raise UserError("HF_TOKEN: holds characters that no token has")
    return HfApi(token=token or False, library_name="fpg-bench", library_version=__version__)


def download(name: str) -> Snapshot:
    """Download the two files of an agent into the Hub's cache, where they may lie already.

    A commit that is there needs no network. A branch or tag is looked up each time.

    Args:
        name: ``hf://owner/name`` (its branch ``main``), or with ``@revision``: a branch, tag or commit.

    Raises:
        UserError: no such repository, revision or agent, no right to read it, a file that is too large, or a
            Hub that cannot be reached.
        OSError: the cache cannot be written.
    """
    repository, revision = split_name(name)
    api = client()
    from huggingface_hub import constants, try_to_load_from_cache

    with hub_errors(name):
        there = [try_to_load_from_cache(repository, file, revision=revision) for file in AGENT_FILES]
        if _COMMIT.fullmatch(revision) and all(isinstance(each, str) for each in there):
            return Snapshot(repository, revision, revision, Path(str(there[0])).parent)
        found = api.model_info(repository, revision=revision, files_metadata=True, timeout=TIMEOUT_S)
        commit = str(found.sha)
        if _COMMIT.fullmatch(revision) and commit != revision:
            raise UserError(f"{name}: {constants.ENDPOINT} answers with another commit, {commit:.40}")
        _check_files(name, {each.rfilename: each.size for each in found.siblings or ()})
        files = [
            api.hf_hub_download(repository, file, revision=commit, etag_timeout=TIMEOUT_S)
            for file in AGENT_FILES
        ]
    return Snapshot(repository, revision, commit, Path(files[0]).parent)


def _check_files(name: str, sizes: Mapping[str, int | None]) -> None:
    """Check that an agent is among the files, and log which files are ignored."""
    for file, most in AGENT_FILES.items():
        if file not in sizes:
            raise UserError(f"{name}: holds no agent: {file} is missing")
        if (sizes[file] or 0) > most:
            raise UserError(f"{name}: {file} holds {sizes[file]:,} bytes, at most {most:,} are allowed")
    if others := sorted(set(sizes) - set(PUSHED_FILES)):
        named = redact(", ".join(f"{other:.40}" for other in others[:_MOST_NAMED]))
        more = f" and {len(others) - _MOST_NAMED} more" if len(others) > _MOST_NAMED else ""
        _logger.info(f"{name}: ignored {named}{more}; only {' and '.join(AGENT_FILES)} are read, no pickle")


def redact(text: str) -> str:
    """Return a text in which a server does not show the token of ``HF_TOKEN``, nor control a terminal."""
    token = os.environ.get("HF_TOKEN", "").strip()
    return printable(text if len(token) < _SHORTEST_SECRET else text.replace(token, "***"))


@contextlib.contextmanager
def hub_errors(where: str) -> Iterator[None]:
    """Turn the client library's exceptions into one line; silence its progress bars and warnings.

    Args:
        where: the repository; begins the message.

    Raises:
        UserError: the Hub refused, failed or could not be reached.
        OSError: a file cannot be read or written.
    """
    from huggingface_hub import constants, errors
    from huggingface_hub.utils.tqdm import (
        are_progress_bars_disabled,
        disable_progress_bars,
        enable_progress_bars,
    )

    logger = logging.getLogger("huggingface_hub")
    level, shows_bars = logger.level, not are_progress_bars_disabled()
    logger.setLevel(logging.CRITICAL)
    disable_progress_bars()
    hub, own = constants.ENDPOINT, os.environ.get("HF_TOKEN", "").strip()
    try:
        yield
    except UserError:
        raise
    except errors.GatedRepoError:
        raise UserError(f"{where}: its owner grants access on request; ask for it at {hub}") from None
    except errors.RepositoryNotFoundError:
        hint = "that HF_TOKEN may not read" if own else "(HF_TOKEN is not set)"
        raise UserError(f"{where}: no such repository on {hub}, or a private one {hint}") from None
    except errors.RevisionNotFoundError:
        raise UserError(f"{where}: has no such revision") from None
    except errors.HfHubHTTPError as error:
        status = error.response.status_code
        refused = {401: "HF_TOKEN is not valid", 403: "HF_TOKEN does not allow this"}
        reason = redact(refused.get(status) or error.server_message or first_line(error))
        raise UserError(f"{where}: {hub} answers with status {status}: {reason:.300}") from None
    except (errors.HTTPError, errors.LocalEntryNotFoundError, ConnectionError) as error:  # type: ignore[attr-defined]
        cause = error.__cause__ or error
        reason = redact(first_line(cause))
        raise UserError(f"{where}: {hub} cannot be reached, or broke off: {reason:.300}") from None
    except (OSError, RuntimeError, ValueError) as error:  # of the library's own checks
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise UserError(f"{where}: {redact(first_line(error.__cause__ or error)):.300}") from None
    except (TypeError, KeyError, AttributeError):  # of the library where it reads an answer
        raise UserError(f"{where}: {hub} does not answer as a Hub does (HF_ENDPOINT)") from None
    finally:
        logger.setLevel(level)
        if shows_bars:
            enable_progress_bars()
