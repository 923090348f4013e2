"""Scenarios as YAML files, and the hash that says which game is played."""

from __future__ import annotations

import dataclasses

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.game import scenario as module
from fpg_bench.game.knowledge import EXPERT_FILE
from fpg_bench.game.scenario import PAPER, RELEASED, STANDARD, Scenario, preset
from tests.logged import logged

from .test_options import OF_SCRIPTS, OTHERWISE


def written(folder, text: str):
    path = folder / "mine.yml"
    path.write_text(text)
    return path


def knowledge(folder, name: str, **changes):
    """A copy of the package's knowledge base with the entry for broadband changed."""
    content = yaml.safe_load(EXPERT_FILE.read_text())
    content["broadband"] |= changes
    path = folder / name
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.mark.parametrize("spec", dataclasses.fields(Scenario), ids=lambda spec: spec.name)
def test_a_changed_default_changes_the_hash(spec):
    value, base = (*(OTHERWISE | OF_SCRIPTS)[spec.name], STANDARD)[:2]
    default = dataclasses.field(default=value, metadata=spec.metadata)
    field = (spec.name, object, default)
    changed = dataclasses.make_dataclass("Changed", [field], bases=(Scenario,), frozen=True)
    others = {}  # a field of the radio model link is tried beside others of that model
    if spec.metadata.get("needs"):
        others = {s.name: getattr(base, s.name) for s in dataclasses.fields(Scenario) if s != spec}
    before = Scenario(**others)
    assert changed(**others).hash != before.hash
    assert changed(**others, **{spec.name: spec.default}).hash == before.hash  # the game of before


def test_every_field_has_its_number_in_the_released_rules():
    names = {spec.name for spec in dataclasses.fields(Scenario)} - {"knowledge"}  # that is hashed whole
    assert set(RELEASED) == names


def test_a_neutral_new_field_keeps_the_hash():
    @dataclasses.dataclass(frozen=True)
    class Extended(Scenario):
        wind_m_s: float = module._number(0.0, 0, 100, "a field of the future")

    assert Extended().hash == STANDARD.hash
    assert Extended(wind_m_s=3.0).hash != STANDARD.hash


def test_the_way_a_value_is_written_does_not_enter_the_hash():
    assert Scenario(hop_cost=7).hash == Scenario(hop_cost=7.0).hash
    assert Scenario(box_m=[1500, 1500, 600], jamming_types=list(module.JAMMING_TYPES)).hash == STANDARD.hash


def test_words_of_a_knowledge_base_are_not_hashed_but_what_is_played_is(tmp_path):
    copy = knowledge(tmp_path, "copy.yml")
    reworded = knowledge(tmp_path, "words.yml", advice="Run.", strategy="far away")
    assert Scenario(knowledge=copy).hash == Scenario(knowledge=reworded).hash == STANDARD.hash
    changes = {"candidates": 2}, {"guard_mhz": 3.0}, {"spread": False}
    changed = [knowledge(tmp_path, f"{i}.yml", **change) for i, change in enumerate(changes)]
    hashes = {Scenario(knowledge=path).hash for path in changed}
    assert len(hashes | {STANDARD.hash}) == 4


@pytest.mark.parametrize(
    "scenario",
    [
        STANDARD,
        PAPER,
        preset("link"),
        Scenario(
            opponent_path=("circle", "pursuit"), jamming_types=("comb",), snr_cap_db=None, knowledge="none"
        ),
    ],
)
def test_a_scenario_survives_its_file(tmp_path, scenario):
    path = tmp_path / "new" / "mine.yml"
    scenario.to_yaml(path)
    again = Scenario.from_yaml(path)
    assert again == scenario
    assert again.hash == scenario.hash


def test_a_file_changes_a_preset(tmp_path):
    path = written(tmp_path, "preset: paper\nhop_cost: 60\nopponent_path: [circle, triangle]\n")
    expected = dataclasses.replace(PAPER, hop_cost=60, opponent_path=("circle", "triangle"))
    assert Scenario.from_yaml(path) == expected
    assert Scenario.from_yaml(written(tmp_path, "hop_cost: 60")) == Scenario(hop_cost=60)


def test_channels_that_overlap_are_said(tmp_path):
    with logged() as lines:
        Scenario.from_yaml(written(tmp_path, "bandwidth_mhz: 7"))
    assert lines == []
    with logged() as lines:
        Scenario.from_yaml(written(tmp_path, "bandwidth_mhz: 20"))
    assert "channels of 20 MHz overlap, as the frequency points lie 7.14 MHz apart" in lines[0]


def test_a_file_or_its_knowledge_that_is_not_there(tmp_path):
    for name, path in (
        ("absent", tmp_path / "absent.yml"),
        ("gone", written(tmp_path, "knowledge: gone.yml")),
    ):
        with pytest.raises(UserError, match=rf"{name}\.yml: cannot be read: No such file"):
            Scenario.from_yaml(path)
    with pytest.raises(UserError, match=r"mine\.yml: expected a mapping, got list"):
        Scenario.from_yaml(written(tmp_path, "- hop_cost"))


def test_a_relative_knowledge_file_survives_being_written_again(tmp_path, monkeypatch):
    folder = tmp_path / "mine"
    folder.mkdir()
    knowledge(folder, "far.yml", candidates=2)
    written(folder, "knowledge: far.yml")
    monkeypatch.chdir(tmp_path)
    first = Scenario.from_yaml("mine/mine.yml")
    first.to_yaml("elsewhere/mine.yml")
    assert Scenario.from_yaml("elsewhere/mine.yml").hash == first.hash
