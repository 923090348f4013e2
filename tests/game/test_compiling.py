"""The cache of compiled code: every change begins a new one, and only real compiling is announced."""

import errno
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy
import pytest
from numba.core import config, event

import fpg_bench
from fpg_bench.game import compiling
from fpg_bench.game.rng import mix

PACKAGE = Path(fpg_bench.__file__).parent
PARTS = ("game", "players")

# One small function is enough to ask what is said; the whole game takes seconds.
USE = "import numpy; from fpg_bench.game.rng import mix; print(*map(mix, numpy.arange(4, dtype='u8')))"
NOTICE = "fpg_bench: compiling "


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of the compiled sources that a test may change."""
    for part in PARTS:
        shutil.copytree(PACKAGE / part, tmp_path / "package" / part)
    monkeypatch.setattr(compiling, "_PACKAGE", tmp_path / "package")
    return tmp_path / "package"


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A cache of its own."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "fpg_bench"


def use(cache, program=USE, package=PACKAGE):
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=package.parent,
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(package.parent)},
        capture_output=True,
        text=True,
        check=True,
    )


def test_a_change_of_any_source_or_another_numba_or_numpy_begins_a_new_folder(package, monkeypatch):
    digests = [compiling.source_digest()]
    sources = [path for part in PARTS for path in (package / part).glob("*.py")]
    for source in sources:
        source.write_bytes(source.read_bytes() + b"# changed\n")
        digests.append(compiling.source_digest())
    (package / "game" / "weather.py").touch()
    digests.append(compiling.source_digest())
    for library in (numba, numpy):
        monkeypatch.setattr(library, "__version__", "99.0")
        digests.append(compiling.source_digest())
    assert len(set(digests)) == len(sources) + 4 > 40


def test_a_new_folder_removes_what_was_not_used_for_a_month(package, root):
    ages = {"compiled-old": 31, "compiled-recent": 29, "something-else": 99}
    for name, days in ages.items():
        (root / name / "deep").mkdir(parents=True)
        os.utime(root / name, (time.time() - days * 24 * 3600,) * 2)
    folder = compiling.cache_folder.__wrapped__()
    assert {path.name for path in root.iterdir()} == {folder.name, "compiled-recent", "something-else"}


def test_unchanged_sources_keep_their_folder_and_one_in_use_is_never_old(package, root):
    folder = compiling.cache_folder.__wrapped__()
    assert folder.parent == root
    os.utime(folder, (0, 0))
    assert compiling.cache_folder.__wrapped__() == folder
    assert folder.stat().st_mtime > time.time() - 24 * 3600


@pytest.mark.process
def test_compiling_is_announced_once_for_the_same_sources_wherever_they_lie(tmp_path):
    elsewhere = tmp_path / "elsewhere" / PACKAGE.name
    shutil.copytree(
        PACKAGE, elsewhere, copy_function=shutil.copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    program = f"{USE}; import fpg_bench; print(fpg_bench.__file__)"
    first, second = use(tmp_path, program), use(tmp_path, program, elsewhere)
    assert first.stderr.count(NOTICE) == 1
    assert f"kept in {tmp_path / 'fpg_bench'}" in first.stderr
    assert "about ten seconds" in first.stderr
    assert NOTICE not in second.stderr
    assert str(elsewhere) in second.stdout
    assert second.stdout.split()[:-1] == first.stdout.split()[:-1]


def test_an_unwritable_cache_still_plays_and_says_so(tmp_path, monkeypatch, capfd):
    (tmp_path / "file").touch()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "file"))
    monkeypatch.setattr(compiling, "cache_folder", compiling.cache_folder.__wrapped__)
    with event.install_listener("numba:compile", compiling._Notice()):
        assert compiling.compiled(mix.py_func)(numpy.uint64(1)) == mix(numpy.uint64(1))
    assert f"{NOTICE}the game, about ten seconds" in (message := capfd.readouterr().err)
    assert "cannot be kept: no writable cache folder" in message


def test_what_a_full_disk_cannot_keep_is_played_with_all_the_same(tmp_path, monkeypatch):
    def full(*words):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(compiling, "cache_folder", lambda *words: tmp_path)
    monkeypatch.setattr(compiling._Hashed, "_dump", full)
    assert compiling.compiled(mix.py_func)(numpy.uint64(1)) == mix(numpy.uint64(1))


@pytest.mark.process
@pytest.mark.parametrize("damage", [b"", None])
def test_a_damaged_file_of_the_cache_is_compiled_anew(damage, tmp_path):
    before = use(tmp_path).stdout
    files = [path for path in tmp_path.rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert files
    for file in files:
        flipped = bytearray(file.read_bytes())
        flipped[len(flipped) // 2] ^= 1  # within the machine code
        file.write_bytes(flipped if damage is None else damage)
    again = use(tmp_path)
    assert (again.stdout, NOTICE in again.stderr) == (before, True)
    assert NOTICE not in use(tmp_path).stderr
