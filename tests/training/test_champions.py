"""Champions: stages against a population that grows by those who learned to beat them."""

from __future__ import annotations

import json

import pytest

from fpg_bench.errors import UserError
from fpg_bench.players.agent import load_agent
from fpg_bench.training.champions import copies_by_hardness, load_recipes, ship_champion, train_champion
from tests.training.tiny import settings

RECIPE = {
    "id": "FPG/AllyVsPolicy-v0",
    "algorithm": "ppo",
    "hyperparams": settings("ppo"),
    "against": ["tone", "opponent-pursuit/td3/seed_0"],
    "stages": [{"steps": 400}, {"steps": 400, "hyperparams": {"learning_rate": 0.0001}}],
    "responders": [
        {"algorithm": "ppo", "steps": 400, "hyperparams": settings("ppo"), "options": {"reward": "against"}}
    ],
    "priority": 3,
}


def written(folder, **changes):
    file = folder / "champions.yml"
    file.write_text(json.dumps({"brave": {**RECIPE, **changes}}))  # JSON is YAML
    return file


@pytest.mark.slow
def test_each_stage_begins_with_the_last_and_meets_who_beat_it(tmp_path):
    recipe = load_recipes(written(tmp_path))["brave"]
    said = []
    agent = train_champion(recipe, 3, tmp_path / "runs", say=said.append)
    folder = tmp_path / "runs" / "brave" / "seed_3"
    first, last = (json.loads((folder / f"stage_{i}" / "run" / "run.json").read_text()) for i in (0, 1))
    responder = str(folder / "stage_0" / "responder_0" / "agent")
    assert first["options"]["opponent"] == "tone,opponent-pursuit/td3/seed_0"
    assert set(last["options"]["opponent"].split(",")) == {*RECIPE["against"], responder}
    assert last["options"]["start"] == str(folder / "stage_0" / "run")
    assert last["hyperparameters"]["learning_rate"] == 0.0001
    kept = json.loads((folder / "stage_1" / "population.json").read_text())
    hardest = min(kept["returns_a_step"], key=kept["returns_a_step"].get)
    assert kept["copies"][hardest] == 3
    assert len(last["options"]["opponent"].split(",")) == sum(kept["copies"].values())
    assert agent == folder / "stage_1" / "run" / "agent"
    assert len(said) == 2


@pytest.mark.slow
def test_what_is_done_is_not_done_again_and_what_was_stopped_goes_on(tmp_path, monkeypatch):
    from fpg_bench.training import champions

    recipe = load_recipes(written(tmp_path))["brave"]
    real, calls = champions.train_run, []

    def stopped(*words, **options):
        calls.append(words)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*words, **options)

    monkeypatch.setattr(champions, "train_run", stopped)
    with pytest.raises(KeyboardInterrupt):
        train_champion(recipe, 0, tmp_path / "runs")
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").rglob("policy.onnx")}
    assert len(made) == 2
    agent = train_champion(recipe, 0, tmp_path / "runs")
    assert all(path.stat().st_mtime_ns == time for path, time in made.items())
    whole = train_champion(recipe, 0, tmp_path / "again")
    del whole  # its responders lie elsewhere, but are the same agents
    first = "brave/seed_0/stage_0/responder_0/agent"
    hashes = [load_agent(tmp_path / root / first).about["policy_sha256"] for root in ("runs", "again")]
    assert hashes[0] == hashes[1]
    assert agent.is_dir()


@pytest.mark.slow
def test_a_shipped_champion_says_how_all_of_it_was_made(tmp_path):
    recipe = load_recipes(written(tmp_path, stages=[{"steps": 400}]))["brave"]
    ship_champion(train_champion(recipe, 0, tmp_path / "runs"), tmp_path / "out", recipe, 0, "make brave")
    about = load_agent(tmp_path / "out", "ally").about
    assert about["command"] == "make brave"
    assert about["recipe"]["against"] == RECIPE["against"]
    assert about["training_steps"] == 400


def test_the_hardest_is_drawn_most_often():
    assert copies_by_hardness([5.0, 0.0, 10.0], 5) == [2, 5, 1]
    assert copies_by_hardness([1.0, 1.0], 5) == [1, 1]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stage": []}, "unknown key 'stage'; did you mean 'stages'"),
        ({"stages": []}, "stages: expected a list"),
        ({"stages": [{"step": 3}]}, "stages: expected a mapping with hyperparams, steps"),
        ({"responders": [{"steps": 3}]}, "responders: expected a mapping"),
        ({"id": "FPG/AllyVsScripted-v0"}, "id: expected FPG/AllyVsPolicy-v0"),
        ({"id": "FPG/AllyVsPolicy"}, "FPG/AllyVsPolicy"),
    ],
)
def test_a_recipe_that_cannot_be_is_refused_in_one_line(tmp_path, changes, words):
    with pytest.raises(UserError, match=words) as caught:
        load_recipes(written(tmp_path, **changes))
    assert "\n" not in str(caught.value)
