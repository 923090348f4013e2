import numpy as np
import onnx
import pytest

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import STANDARD
from tests.products.leaderboard.making import policy

TOLD = {"algorithm": "mine", "id": "FPG/AllyVsScripted-v0", "training_seed": 0, "training_steps": 1}


def test_a_file_of_another_framework_becomes_an_agent(tmp_path):
    model = onnx.load_model_from_string(policy(0))
    model.graph.node[0].doc_string = "where/somebody/works/secret.py"
    model.graph.node[0].metadata_props.add(key="stack", value="where/somebody/works/secret.py")
    onnx.save(model, tmp_path / "mine.onnx")
    fpg_bench.write_agent(tmp_path / "agent", tmp_path / "mine.onnx", **TOLD)
    agent = fpg_bench.load_agent(tmp_path / "agent", "ally")
    assert agent.card.scenario == STANDARD.hash
    assert b"somebody" not in agent.model
    seen = np.ones((2, 15), np.float32)
    assert (agent.predict(seen)[0] == agent.predict(seen)[0]).all()


def test_an_id_of_discrete_actions_becomes_the_plain_id_and_an_action_mode(tmp_path):
    fpg_bench.write_agent(tmp_path, policy(0), **(TOLD | {"id": "FPG/AllyVsScriptedDiscrete-v0"}))
    about = fpg_bench.load_agent(tmp_path, "ally").card.to_dict()
    assert about["game"] == {"id": "FPG/AllyVsScripted-v0", "actions": "discrete"}


@pytest.mark.parametrize(
    ("model", "change", "message"),
    [
        (b"nonsense", {}, "not an ONNX file"),
        (policy(0), {"id": "FPG/Nothing-v0"}, "unknown id"),
        (policy(0), {"side": "ally", "id": "FPG/duel_v0", "format": 3}, "format 3"),
    ],
)
def test_what_could_not_be_loaded_is_not_written(tmp_path, model, change, message):
    with pytest.raises(UserError, match=message):
        fpg_bench.write_agent(tmp_path / "agent", model, **(TOLD | change))
    with pytest.raises(UserError, match="lacks training_steps"):
        fpg_bench.write_agent(tmp_path, policy(0), **{k: v for k, v in TOLD.items() if k != "training_steps"})
    assert not (tmp_path / "agent").exists()
