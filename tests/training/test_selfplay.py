"""Self-play: who is trained against whom, from which weights, and that nothing is lost or done twice."""

import json

import pytest
import yaml

from fpg_bench.errors import UserError
from fpg_bench.players.agent import load_agent
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile
from fpg_bench.training import selfplay as playing
from fpg_bench.training.callbacks import GameMeasures
from fpg_bench.training.selfplay import draw_past, selfplay
from fpg_bench.training.train import train_run
from tests.programs import fpg
from tests.training.tiny import settings

TINY = settings("ppo", normalize={"norm_obs": False})


def play(out, generations=2, **options):
    given = {"hyperparams": TINY, "steps": 400, "progress": False, "evaluations": 0, "say": lambda line: None}
    return selfplay("ppo", out, generations=generations, **(given | options))


def read(out):
    return RowFile(out / "selfplay.jsonl").read()


def about(out, side, generation):
    return json.loads((out / "generations" / f"{side}_{generation}" / "run.json").read_text())


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """Two generations, scored on their fields."""
    out = tmp_path_factory.mktemp("selfplay") / "out"
    assert play(out, evaluations=1, seed=3) == {"ally": out / "ally", "opponent": out / "opponent"}
    return out


@pytest.mark.slow
def test_each_generation_has_a_row(played):
    rows = read(played)
    assert [(row["generation"], row["side"]) for row in rows] == [
        (0, "ally"),
        (0, "opponent"),
        (1, "ally"),
        (1, "opponent"),
    ]
    assert rows[0]["against"] == list(SCRIPTED["opponent"])
    assert rows[1]["against"] == list(SCRIPTED["ally"])
    assert [row["against"] for row in rows[2:]] == [["opponent_0"], ["ally_0"]]
    for row in rows:
        assert row["steps"] == 400
        assert list(row["returns"]) == row["against"]
        assert row["return"] == pytest.approx(sum(row["returns"].values()) / len(row["returns"]), abs=2e-4)
        shares = [row["measures"][f"share_{kind}"] for kind in ("tone", "narrowband", "broadband", "comb")]
        assert sum(shares) == pytest.approx(1, abs=1e-4)
        assert 0 <= row["measures"]["hop_rate"] <= 1
        looks = RowFile(played / f"generations/{row['side']}_{row['generation']}/evaluations.jsonl").read()
        assert (row["field"], row["field_score"]) == (f"{row['side']}-v1", looks[-1]["score"])


@pytest.mark.slow
def test_a_generation_goes_on_from_the_one_before_against_the_others_past(played):
    for side, other in (("ally", "opponent"), ("opponent", "ally")):
        options = about(played, side, 1)["options"]
        assert options[other] == str(played / "generations" / f"{other}_0" / "agent")
        assert options["start"] == str(played / "generations" / f"{side}_0")
        looks = [RowFile(played / f"generations/{side}_{k}/evaluations.jsonl").read() for k in range(2)]
        assert looks[1][0]["counterparts"] == looks[0][-1]["counterparts"]
        assert [about(played, side, k)["training_seed"] for k in range(2)] == [3000, 3001]


@pytest.mark.slow
def test_the_last_generation_is_shipped_and_says_how_all_was_made(played):
    for side in ("ally", "opponent"):
        agent = load_agent(played / side, side)
        last = load_agent(played / "generations" / f"{side}_1" / "agent")
        assert agent.model == last.model
        assert agent.about["command"] == (
            "fpg-bench selfplay ppo --generations 2 --steps 400 --pool 5 --seed 3"
        )
        assert (agent.about["training_seed"], agent.about["training_steps"]) == (3, 800)
        assert (agent.about["steps_done"], agent.about["options"]) == (800, {})


def test_the_past_is_drawn_by_the_seed_and_from_all_of_it():
    every = [draw_past("ally", 8, 3, seed) for seed in range(60)]
    assert every == [draw_past("ally", 8, 3, seed) for seed in range(60)]
    assert every != [draw_past("opponent", 8, 3, seed) for seed in range(60)]
    assert {len(set(past)) for past in every} == {3}
    assert {past for drawn in every for past in drawn} == set(range(8))
    assert draw_past("ally", 2, 3, 0) == [0, 1]


@pytest.mark.slow
def test_once_finished_it_does_nothing_and_more_generations_go_on(played, monkeypatch):
    trained = []
    monkeypatch.setattr(playing, "train_run", lambda *a, **k: trained.append(a[1].name) or train_run(*a, **k))
    before = read(played)
    play(played, evaluations=1, seed=3)
    assert (read(played), trained) == (before, [])
    play(played, 3, seed=3)
    assert trained == ["ally_2", "opponent_2"]
    assert read(played)[:4] == before
    assert load_agent(played / "ally").about["training_steps"] == 1200
    play(played, 1, seed=3)  # fewer take nothing back
    assert load_agent(played / "ally").about["training_steps"] == 1200


@pytest.mark.slow
def test_stopped_anywhere_it_goes_on(tmp_path, monkeypatch):
    """In a training, before a row, before an agent is shipped: as if killed, nothing is saved on the way."""

    def stop(*arguments, **options):
        raise KeyboardInterrupt

    def stopped(owner, name):
        with monkeypatch.context() as patched:
            patched.setattr(owner, name, stop)
            with pytest.raises(KeyboardInterrupt):
                play(tmp_path, 1)

    stopped(GameMeasures, "_on_rollout_end")
    assert not read(tmp_path)
    stopped(playing, "met")
    finished = about(tmp_path, "ally", 0)
    assert (finished["finished"], finished["part"], finished["steps_done"]) == (True, 1, 400)
    stopped(playing, "write_whole")
    assert len(read(tmp_path)) == 2
    play(tmp_path, 1)
    assert len(read(tmp_path)) == 2
    assert about(tmp_path, "ally", 0) == finished
    load_agent(tmp_path / "ally", "ally")
    with pytest.raises(KeyboardInterrupt):  # when one side alone has its next generation
        play(tmp_path, 2, say=lambda line: stop() if line.startswith("ally_1") else None)
    play(tmp_path, 1)
    steps = {side: load_agent(tmp_path / side).about["training_steps"] for side in ("ally", "opponent")}
    assert steps == {"ally": 800, "opponent": 400}


@pytest.mark.slow
def test_an_agent_of_the_past_that_is_not_whole_is_one_line(tmp_path):
    play(tmp_path, 1)
    policy = tmp_path / "generations" / "opponent_0" / "agent" / "policy.onnx"
    policy.write_bytes(policy.read_bytes()[:100])
    with pytest.raises(UserError, match=r"opponent_0/agent: policy.onnx is not the file that") as caught:
        play(tmp_path, 2)
    assert "\n" not in str(caught.value)
    policy.unlink()
    with pytest.raises(UserError, match=r"opponent_0/agent: policy.onnx cannot be read"):
        play(tmp_path, 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": 800}, "another steps"),
        ({"pool": 2}, "another pool"),
        ({"seed": 4}, "another seed"),
        ({"path": "learned"}, "another scenario"),
        ({"hyperparams": TINY | {"n_epochs": 2}}, "another hyperparameters"),
    ],
)
def test_another_self_play_needs_another_folder(played, changes, message):
    with pytest.raises(UserError, match=f"holds a self-play with {message}"):
        play(played, **({"seed": 3} | changes))


@pytest.mark.slow
def test_words_that_can_t_be_meant(tmp_path):
    for changes, message in (
        ({"generations": 0}, "generations"),
        ({"pool": 0}, "pool"),
        ({"steps": 0}, "steps"),
        ({"path": "waypoints"}, "plans no 'waypoints'"),
        ({"scenario": "papr"}, "did you mean 'paper'"),
    ):
        with pytest.raises(UserError, match=message):
            play(tmp_path, **changes)
    play(tmp_path, 1)  # nothing of all this is left behind


@pytest.mark.process
def test_from_the_command_line(tmp_path):
    entries = dict.fromkeys(("FPG/AllyVsPolicy-v0", "FPG/OpponentVsPolicy-v0"), TINY)
    (tmp_path / "tiny.yml").write_text(yaml.safe_dump(entries))
    words = ["--generations", "1", "--steps", "400", "--path", "learned", "--evaluations", "0"]
    done = fpg("selfplay", "ppo", "--hyperparams", "tiny.yml", *words, "--out", "out", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "agents: out/ally, out/opponent"
    assert load_agent(tmp_path / "out" / "opponent").about["options"] == {"path": "learned"}
    assert read(tmp_path / "out")[1]["field"] == "opponent-learned-v1"
