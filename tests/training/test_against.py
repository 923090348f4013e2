"""Training against any player of the other side, and from the weights that an earlier run ended with."""

import json
import shutil

import numpy as np
import pytest
import torch

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.summary import TrainingCost
from fpg_bench.players.agent import load_agent
from fpg_bench.training.checkpoint import load_weights, save_model
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model
from tests.training.tiny import ALLY, settings, train, train_tiny

AGAINST_ALLIES, AGAINST_OPPONENTS = "FPG/OpponentVsPolicy-v0", "FPG/AllyVsPolicy-v0"
REWARDS = {"normalize": {"norm_obs": False}}  # the statistics of observations move with the first ones
WIDER = {"policy_kwargs": {"net_arch": [9]}}


@pytest.fixture(scope="module")
def ally(tmp_path_factory):
    """The run of a tiny ally that was scored once."""
    folder = tmp_path_factory.mktemp("against") / "ally"
    train_tiny("ppo", folder, REWARDS, steps=400, evaluations=1)
    return folder


def respond(out, against, env_id=AGAINST_ALLIES, **options):
    given = {"hyperparams": settings("ppo"), "steps": 400}
    return train("ppo", env_id, out, against=against, **(given | options))


@pytest.mark.slow
def test_the_players_met_are_part_of_a_run_s_description(ally, tmp_path):
    agent = str(tmp_path / "other")
    shutil.copytree(ally / "agent", agent)
    respond(tmp_path / "run", [agent, "expert"])
    about = json.loads((tmp_path / "run" / "run.json").read_text())
    assert about["game"] == {"id": AGAINST_ALLIES, "ally": [agent, "expert"]}
    assert about["policies"] == {agent: load_agent(agent).card.policy_sha256}
    assert respond(tmp_path / "run", None, ally=[agent, "expert"]) == tmp_path / "run" / "agent"
    with pytest.raises(UserError, match="holds another run"):
        respond(tmp_path / "run", agent)
    train_tiny("ppo", tmp_path / "changed", steps=400, seed=1)
    shutil.copytree(tmp_path / "changed" / "agent", agent, dirs_exist_ok=True)
    with pytest.raises(UserError, match="which differs in policies;"):
        respond(tmp_path / "run", [agent, "expert"])


@pytest.mark.slow
def test_impossible_players_are_refused(ally, tmp_path):
    other, both = tmp_path / "other", tmp_path / "both"
    other.mkdir()
    about = json.loads((ally / "agent" / "agent.json").read_text()) | {
        "game": {"id": "FPG/AllyVsScripted-v9"}
    }
    (other / "agent.json").write_text(json.dumps(about))
    for side in ("ally", "opponent"):
        (both / "agent" / side).mkdir(parents=True)
    for env_id, against, message in (
        (AGAINST_OPPONENTS, ally / "agent", "plays the ally .*, not the opponent"),
        (AGAINST_ALLIES, ally, "is a run's folder; the agent is"),
        (AGAINST_ALLIES, both, r"of both sides, .*agent/ally and .*agent/opponent; name one"),
        (AGAINST_ALLIES, both / "agent", "holds agents of both sides"),
        (AGAINST_ALLIES, other, r"made for the id 'FPG/AllyVsScripted-v9', which this version does not"),
        (AGAINST_ALLIES, "exprt", "did you mean 'expert'"),
        ("FPG/OpponentVsScripted-v0", ally / "agent", "is not a script"),
    ):
        with pytest.raises(UserError, match=message):
            respond(tmp_path / "run", str(against), env_id)
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_run_starts_with_the_score_of_the_run_it_starts_from(ally, tmp_path):
    train_tiny("ppo", tmp_path / "next", REWARDS, steps=400, evaluations=1, start=ally, seed=1)
    rows = RowFile(tmp_path / "next" / "evaluations.jsonl").read()
    before = RowFile(ally / "evaluations.jsonl").read()[-1]
    assert (rows[0]["steps"], rows[0]["rivals"]) == (0, before["rivals"])
    assert rows[-1]["rivals"] != before["rivals"]
    about = json.loads((tmp_path / "next" / "run.json").read_text())
    assert about["options"] == {"start": str(ally)}


@pytest.mark.slow
def test_tables_show_the_steps_and_seconds_that_were_played_with_those_of_the_run_started_from(
    ally, tmp_path
):
    before = json.loads((ally / "run.json").read_text())
    assert before["steps_done"] == 400
    shutil.copytree(ally, tmp_path / "before")
    (tmp_path / "before" / "run.json").write_text(json.dumps(before | {"seconds": 1000.0}))
    train_tiny("ppo", tmp_path / "next", REWARDS, steps=1, start=tmp_path / "before")  # of a rollout of 400
    card = load_agent(tmp_path / "next" / "agent").card
    assert (card.training_steps, card.steps_done) == (1, 800)
    assert 1000 <= card.seconds < 1500
    about = json.loads((tmp_path / "next" / "run.json").read_text())
    assert (about["steps_done"], about["seconds"]) == (800, card.seconds)
    summary = evaluate([str(tmp_path / "next")], "ally-v2", matches=1)
    assert summary[0].training == TrainingCost(800, card.seconds)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "sac", "recurrent-ppo"])
def test_weights_optimizer_and_normalization_are_loaded(algorithm, tmp_path):
    parameters = load_hyperparameters(algorithm, ALLY, settings(algorithm))
    first, second = (make_model(algorithm, make_sb3(ALLY, 4, 0), parameters, seed) for seed in (0, 1))
    first.learn(400)
    save_model(first, tmp_path)
    load_weights(second, tmp_path)
    assert second.num_timesteps == 0
    assert flat(second) == flat(first)
    theirs, ours = first.get_vec_normalize_env(), second.get_vec_normalize_env()
    np.testing.assert_array_equal(ours.obs_rms.mean, theirs.obs_rms.mean)
    assert ours.ret_rms.var == theirs.ret_rms.var
    if algorithm == "sac":
        assert torch.equal(second.log_ent_coef, first.log_ent_coef)


def flat(model):
    """Weights and optimisers, to be compared."""
    return json.dumps(model.get_parameters(), default=lambda x: np.asarray(x.detach()).tolist())


@pytest.mark.slow
def test_an_unsuitable_start_is_refused(ally, tmp_path):
    for changes, options, message in (
        (REWARDS | WIDER, {"start": ally}, "no finished run of PPO with these networks"),
        ({}, {"start": ally}, "normalize is {'norm_obs': False} there, expected"),
    ):
        with pytest.raises(UserError, match=message):
            train_tiny("ppo", tmp_path / "run", changes, **options)
    with pytest.raises(UserError, match="side is 'ally' there, expected 'opponent'"):
        respond(tmp_path / "run", "expert", start=ally)
    with pytest.raises(UserError, match="algorithm is 'ppo' there, expected 'ppo-stack2'"):
        train_tiny("ppo-stack2", tmp_path / "run", start=ally)
    assert not (tmp_path / "run").exists()


def test_a_file_is_no_run_to_start_from(tmp_path):
    (tmp_path / "model.zip").touch()
    for name, problem in (("model.zip", "is a file"), ("nowhere", "does not exist")):
        with pytest.raises(UserError, match=f"start .*{name}: {problem}; name the folder of a finished run"):
            train_tiny("ppo", tmp_path / "run", start=tmp_path / name)
    assert not (tmp_path / "run").exists()
