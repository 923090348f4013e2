"""The verbs that list what can be named."""

import subprocess
import sys

from fpg_bench import __version__
from fpg_bench.game.names import PATHS
from fpg_bench.planning import PLANNERS
from fpg_bench.players.agent import fields_folder
from fpg_bench.players.scripted import SCRIPTED


def fpg(*words):
    return subprocess.run([sys.executable, "-m", "fpg_bench", *words], capture_output=True, text=True)


def test_players_lists_all_that_can_be_named():
    found = fpg("players")
    assert found.returncode == 0, found.stderr
    words = found.stdout.replace(",", " ").replace(":", " ").split()
    assert {*SCRIPTED["ally"], *SCRIPTED["opponent"], *PLANNERS, *PATHS} <= set(words)
    assert "planners, tier history" in found.stdout
    assert "ally-scripted/ppo/seed_{0" in found.stdout


def test_fields_lists_each_with_its_counterparts():
    found = fpg("fields")
    assert found.returncode == 0, found.stderr
    for path in fields_folder().glob("*.yml"):
        assert f"{path.stem}: measures the " in found.stdout
    assert "adaptive/interceptor" in found.stdout
    assert "score: 0 = -5.66 a step (random), 100 = 22" in found.stdout


def test_the_package_is_a_program():
    assert fpg("--version").stdout.strip() == __version__
