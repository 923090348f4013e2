"""Promises of a release: one version, ids and hashes that stay, one lower bound for each package."""

import hashlib
import json
import re
import subprocess
import sys
import tomllib
from collections import defaultdict

import yaml
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
    "link": "42f0c96777a3337072dcc9eee23df6cf0f1c0c8f14a5dd6a998ff272769da0cc",
    "link-fast-hop": "af71f38a9081284b30bda1dc3b16ab84943bd15ef07f5f022988020dc8504dab",
    "link-quick-check": "36ae911fc7f22ce9f3ffbf95057fca2882899154cb79d48b6388622889aaa6a5",
    "link-slow-hop": "d76aa317e0799737801af48e1461f33a167ddf7ee8dcbf382ef44913932c292f",
    "link-throughput": "5dcb41827537c23b3c3572e734a715bae052f289921b5d5acd277cc95ae3309a",
}
SEASONS = {
    "season-4": "4038b64adc95b0136bd1fe9bf7f864d0b169bdc442a94077f1d8d7781009ceb2",
    "season-4-link": "d23d9f763ffc49a383db33b9b5f2538f00287bb863f4e67b1b24bcf0f54ee3f7",
    "season-5-link": "c5a6853b096641dc756ef3344c2dbcdcc7b01988956c82fcbb85c572610887be",
    "season-5": "9d37e9c1b5e5ee646025ce2a1688e03396341b4c098db59c589b623231d1094f",
}


def test_the_version_stands_in_one_place():
    project = (ROOT / "pyproject.toml").read_text()
    assert 'dynamic = ["version"]' in project
    assert not re.search(r"^version = ", project, re.M)
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?", __version__)


def test_codemeta_citation_and_project_agree():
    about = json.loads((ROOT / "codemeta.json").read_text())
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (article,) = citation["references"]
    assert about["@context"] == "https://w3id.org/codemeta/3.0"
    assert about["version"] == __version__
    assert about["name"] == project["name"] == citation["title"].partition(":")[0]
    assert about["license"].rpartition("/")[2] == project["license"] == citation["license"]
    assert {key: about[key] for key in ("description", "keywords")} == {
        key: project[key] for key in ("description", "keywords")
    }
    assert about["runtimePlatform"] == f"Python {project['requires-python']}"
    assert (ROOT / about["readme"]).samefile(ROOT / project["readme"])
    assert [each["name"] for each in about["author"]] == [each["name"] for each in citation["authors"]]
    assert about["referencePublication"]["@id"] == f"https://doi.org/{article['doi']}"
    assert about["referencePublication"]["name"] == article["title"]


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


def test_committed_agents_name_no_folder_of_a_machine():
    cards = [
        path for folder in ("baselines", "leaderboard") for path in (ROOT / folder).glob("**/agent.json")
    ]
    absolute = re.compile(r'["\' =](/[a-z]+/|[A-Z]:\\)')
    assert [path for path in cards if absolute.search(path.read_text(encoding="utf-8"))] == []
    assert absolute.search('{"teacher": "/home/me/runs/agent"}')
    assert len(cards) > 200
