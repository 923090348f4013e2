"""The lowest versions that pyproject.toml allows can be named, and are said once for each package."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from collections import defaultdict

from packaging.requirements import Requirement

from tests.environments import ROOT


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
