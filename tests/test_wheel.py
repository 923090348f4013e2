"""The wheel holds all that is needed: it is built, installed beside nothing of the repository, and used."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
USE = """
import pathlib, sys, fpg_bench
assert pathlib.Path(fpg_bench.__file__).is_relative_to(sys.prefix), fpg_bench.__file__
from fpg_bench.players.agent import baselines_folder
assert baselines_folder().is_relative_to(sys.prefix) and (baselines_folder() / "hyperparams/ppo.yml").exists()
assert fpg_bench.preset("standard").knowledge_base.entries
import fpg_bench.pictures.replay
from fpg_bench.training.hyperparameters import load_hyperparameters
load_hyperparameters("ppo", "FPG/AllyVsScripted-v0")
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """An environment with the wheel alone; what it depends on is seen through the present one."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    venv.create(folder / "env", with_pip=False, symlinks=True)
    site = next((folder / "env" / "lib").glob("python3*")) / "site-packages"
    (wheel,) = folder.glob("*.whl")
    words = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--target",
        str(site),
        str(wheel),
    ]
    subprocess.run(words, check=True, capture_output=True)
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"])
    return folder / "env" / "bin" / "python"


def run(python, *words, cwd):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.run([str(python), *words], cwd=cwd, env=environment, capture_output=True, text=True)


def test_the_installed_package_finds_its_data(python, tmp_path):
    found = run(python, "-c", USE, cwd=tmp_path)
    assert found.returncode == 0, found.stderr


def test_the_installed_command_plays_a_field(python, tmp_path):
    words = ("-m", "fpg_bench.cli", "evaluate", "expert", "idle", "--matches", "1", "--out", "results")
    found = run(python, *words, cwd=tmp_path)
    assert found.returncode == 0, found.stderr
    assert "expert" in found.stdout
    page = run(python, "-m", "fpg_bench.cli", "play", "--out", "round.html", cwd=tmp_path)
    assert page.returncode == 0, page.stderr
