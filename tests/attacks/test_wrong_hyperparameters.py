"""Hyper-parameter files in which one thing is wrong: one line that names it, before anything is trained."""

from __future__ import annotations

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.players.agent import baselines_folder
from fpg_bench.training.algorithms import find_algorithm
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model
from tests.attacks.mutations import misspelt, mutations

FILES = sorted(path.stem for path in (baselines_folder() / "hyperparams").glob("*.yml"))
SMALL = {"n_envs": 2, "n_steps": 16, "batch_size": 32, "buffer_size": 1000}
# Of these some of the values that are tried are sound, such as null, -1 or 2.5
SOUND = {
    "ent_coef", "fused", "gradient_steps", "imitate", "learning_rate", "learning_starts", "log_std_init",
    "logit_limit", "logit_penalty", "noise_std", "normalize", "optimizer_kwargs", "reward_scale", "teacher",
}  # fmt: skip
# sb3_contrib's own words, which name what the keys mean
UNNAMED = [("missing", "enable_critic_lstm")]


def opened(file: str):
    """The algorithm of a shipped file, one of its ids, its entry with small numbers, and a batch of games."""
    content = yaml.safe_load((baselines_folder() / "hyperparams" / f"{file}.yml").read_text())
    env_id = next(key for key, value in content.items() if isinstance(value, dict))
    entry = content[env_id] | {key: value for key, value in SMALL.items() if key in content[env_id]}
    name = next(part for part in (file, *(file.rsplit("-", n)[0] for n in (1, 2))) if known(part))
    is_discrete = "discrete" in file or name in ("dqn", "qr-dqn", "maskable-ppo", "dueling-ddqn")
    options = {"actions": "discrete"} if is_discrete else {}
    options |= {"observation": "waterfall"} if "waterfall" in file else {}
    return name, entry, make_sb3(env_id, 2, seed=0, **options)


def known(name: str) -> bool:
    try:
        return find_algorithm(name).name == name
    except UserError:
        return False


@pytest.mark.parametrize("file", FILES)
def test_each_wrong_value_of_a_shipped_file_is_named_in_one_line(file):
    name, entry, games = opened(file)
    refused = 0
    for what, place, content in mutations(entry):
        key = [part for part in place if isinstance(part, str)][-1]
        where = f"{what} in {place}"
        try:
            parameters = load_hyperparameters(name, games.game_spec, content)
            make_model(name, games, parameters, 0)
        except UserError as error:
            line = str(error)
            assert line.isprintable(), where
            assert len(line) <= 600, where
            named = misspelt(key) if what == "misspelt" else key
            assert named in line or (what, key) in UNNAMED, f"{where}: {line}"
            refused += 1
        else:
            assert what == "missing" or (key in SOUND and what != "misspelt"), where
    assert refused > 50
