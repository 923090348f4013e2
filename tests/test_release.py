"""What a release promises: one version, ids and hashes that stay, one lower bound for each package."""

import hashlib
import re
import subprocess
import sys
import tomllib
from collections import defaultdict

from packaging.requirements import Requirement

from fpg_bench.common.ids import DUEL, ENVS
from fpg_bench.game.scenario import PRESETS, preset
from fpg_bench.players.agent import suites_folder
from fpg_bench.version import __version__
from tests.programs import ROOT

IDS = {  # published: none goes, and none means another game
    "FPG/AllyVsScripted-v0": ("ally", "adaptive", "pursuit", None),
    "FPG/AllyVsPlanner-v0": ("ally", "adaptive", "waypoints", "interceptor"),
    "FPG/AllyVsLLM-v0": ("ally", "adaptive", "waypoints", "llm"),
    "FPG/OpponentVsScripted-v0": ("opponent", "expert", "pursuit", None),
    "FPG/AllyVsPolicy-v0": ("ally", "adaptive", "pursuit", None),
    "FPG/OpponentVsPolicy-v0": ("opponent", "expert", "pursuit", None),
}
HASHES = {
    "standard": "60e61eb0686fbb75cef62d67fae4cd8a922bdae74d0af4607cf2a59020fe65d8",
    "paper": "0fd90129e192bbf7840e0f374000c4a3e08ee74b060810bb728bf284eec8863e",
    "figures": "c95abd590ba8255df1280371f3ab5e96ab49f633afcb3294df06d9e831b318f3",
    "link": "c2d6530856a37ee33e9ec0ecdd8320394395996d2f01cdb4cf1f91e49ea86fc3",
    "link-fast-hop": "2b4a283c121c6615edec2127dcdf5fc3c58cfcc7e7cf56e2d8bdb161bf92ddae",
    "link-quick-check": "e14d391b07a5006657c814c588615f3f877ac0e0b8f9659ffc73dbb4627e380b",
    "link-slow-check": "91544bfc6292aaa5dddf3d1576c8e0097354a845cd2ec4d70426d135426cd154",
    "link-slow-hop": "13765a15f9e15ba35da842c16a0076ad9f5e3b5cadcb95d4edf4427902406ed5",
    "link-throughput": "d8bedbc6b4a205fdcbb6fd02f6b0bad4efb28068955d2a6bbf0edca3b41348e4",
}
SEASONS = {"season-1": "0f8e36742a9772d6a2c0cc26bbff9dff286edc94164772012543dedfd77ee27c"}


def test_the_version_stands_in_one_place():
    project = (ROOT / "pyproject.toml").read_text()
    assert 'dynamic = ["version"]' in project
    assert not re.search(r"^version = ", project, re.M)
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?", __version__)


def test_the_changelog_begins_with_this_version_and_dates_it_once_it_is_released():
    version, rest = re.search(r"^## (\S+) (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.M).groups()
    assert version == re.sub(r"\.dev\d+", "", __version__)
    dated = re.fullmatch(r"\(\d{4}-\d\d-\d\d\)", rest)
    assert dated if version == __version__ else rest == "(not released yet)"


def test_ids_stay():
    assert {env.id: (env.side, env.other, env.path, env.planner) for env in ENVS.values()} == IDS
    assert DUEL == "FPG/duel_v0"


def test_presets_play_the_game_that_they_played():
    assert {name: preset(name).hash for name in PRESETS} == HASHES


def test_a_closed_season_s_file_stays():
    """It names its agents by their hashes, so they stay, too."""
    folder = suites_folder()
    files = {path.parent.name: path.read_bytes() for path in folder.glob("season-*/season.yml")}
    assert {name: hashlib.sha256(content).hexdigest() for name, content in files.items()} == SEASONS


def test_a_package_has_one_lower_bound_wherever_it_is_asked_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [
        *project["dependencies"],
        *(line for e in project["optional-dependencies"].values() for line in e),
    ]
    bounds = defaultdict(set)
    for asked in map(Requirement, lines):
        bounds[asked.name].add(str(asked.specifier))
    assert not {name: found for name, found in bounds.items() if len(found) > 1}


def test_the_lowest_versions_are_those_of_the_core_and_of_training():
    found = subprocess.check_output([sys.executable, ROOT / "scripts" / "lowest.py"], text=True).split()
    assert {"gymnasium==1.1", "pettingzoo==1.26", "onnx==1.17"} <= set(found)
    assert len({line.partition("==")[0] for line in found}) == len(found)
