"""Our hyper-parameter files are rl-zoo3's: its own command trains with them."""

import importlib.util
import os

import pytest

from fpg_bench.players.agent import baselines_folder, load_agent
from tests.programs import python
from tests.training.tiny import ALLY

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("rl_zoo3") is None and not os.environ.get("CI"),
    reason="rl-zoo3 is not installed (it is a part of the extra dev)",
)


@pytest.mark.process
@pytest.mark.parametrize(
    ("name", "theirs", "small"),
    [
        ("ppo", "ppo", "n_envs:2 n_steps:8 batch_size:16"),
        ("recurrent-ppo", "ppo_lstm", "n_envs:2 n_steps:8 batch_size:16"),
        ("dqn", "dqn", "n_envs:2 learning_starts:8"),
    ],
)
def test_rl_zoo3_trains_with_our_file(name, theirs, small, tmp_path):
    file = baselines_folder() / "hyperparams" / f"{name}.yml"
    words = ["--algo", theirs, "--env", ALLY, "--gym-packages", "fpg_bench", "--conf-file", str(file)]
    words += ["--n-timesteps", "32", "--eval-freq", "-1", "--log-folder", str(tmp_path), "--num-threads", "1"]
    words += ["--env-kwargs", "actions:'discrete'"] if name == "dqn" else []
    done = python("-m", "rl_zoo3.train", *words, "-params", *small.split(), folder=tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    (model,) = tmp_path.rglob(f"{theirs}/*/*.zip")
    if name == "ppo":  # the others are no plain MlpPolicy
        done = python("-m", "fpg_bench", "export", str(model), "--out", "mine", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert load_agent(tmp_path / "mine").card.game.id == ALLY
