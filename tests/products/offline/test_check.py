"""``dataset check`` finds whatever was changed, torn, or made by other rules."""

import shutil

import h5py
import minari
import numpy as np
import pytest
from minari.data_collector import EpisodeBuffer

from fpg_bench.common.errors import UserError
from fpg_bench.products.offline.check import check_dataset
from fpg_bench.products.offline.make import content_sha256, make_dataset
from fpg_bench.products.offline.read import find_datasets
from fpg_bench.products.offline.rounds import round_digest
from tests.products.offline.making import rewrite, sha256, tiny


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return make_dataset(tiny(), tmp_path_factory.mktemp("made"), rounds_per_part=2)


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "copy")


def test_a_whole_data_set_is_identical(folder):
    line = check_dataset(folder / "data", sample=0.5)
    assert line.startswith(
        f"fpg/tiny-v0: 5 rounds of 300 steps, sha256 {sha256(folder)[:16]}; 3 played again"
    )
    assert "; 1 played again" in check_dataset(folder / "data")


@pytest.mark.parametrize("name", ["observations", "actions", "rewards", "terminations", "truncations"])
def test_one_changed_bit_is_found_wherever_it_is(folder, name):
    with h5py.File(folder / "data/part_00001.hdf5", "r+") as file:
        array = file[f"episode_3/{name}"]
        values = array[()]
        flat = values.reshape(-1).view(np.uint8)
        flat[len(flat) // 2] ^= 1
        array[...] = values
    with pytest.raises(UserError, match=r"has changed|not those"):
        check_dataset(folder / "data")


def test_another_seed_is_found(folder):
    with h5py.File(folder / "data/part_00001.hdf5", "r+") as file:
        file["episode_3"].attrs["seed"] += 1
    with pytest.raises(UserError, match="round 3 has the seed"):
        check_dataset(folder / "data")


def test_a_forged_hash_is_found_by_playing_again(folder):
    with h5py.File(folder / "data/part_00001.hdf5", "r+") as file:
        file["episode_3/rewards"][7] += 1
    dataset = minari.MinariDataset(folder / "data")
    digests = b"".join(round_digest(e.observations, e.actions, e.rewards) for e in dataset)
    rewrite(folder, content_sha256=content_sha256(digests))
    with pytest.raises(UserError, match="round 3: rewards are not those that its seed gives"):
        check_dataset(folder / "data", sample=1)


@pytest.mark.parametrize("file", ["part_00001.hdf5", "main_data.hdf5"])
def test_torn_and_missing_files_are_one_line(folder, file):
    path = folder / "data" / file
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(UserError, match="cannot be read from round"):
        check_dataset(folder / "data")
    path.unlink()
    with pytest.raises(UserError, match="cannot be read from round"):
        check_dataset(folder / "data")


def test_data_sets_of_other_rules_players_or_versions_are_refused(folder):
    rewrite(folder, version="0.1.0", scenario_sha256="0")
    with pytest.raises(UserError, match=r"made by fpg-bench 0.1.0: scenario 'standard' differs"):
        check_dataset(folder / "data")
    rewrite(folder, scenario_sha256=tiny().recipe()["scenario_sha256"], identities={})
    with pytest.raises(UserError, match=r"made by fpg-bench 0.1.0: a player differs"):
        check_dataset(folder / "data")
    rewrite(folder, spec={"name": "tiny-v0", "pace": 3})
    with pytest.raises(UserError, match=r"made by fpg-bench 0.1.0: unknown key 'pace'"):
        check_dataset(folder / "data")
    rewrite(folder, spec=tiny().model_dump(mode="json") | {"players": ["os:system", "random"]})
    with pytest.raises(
        UserError, match=r"made by fpg-bench 0.1.0: players\[0\]: expected the name of a script"
    ):
        check_dataset(folder / "data")


@pytest.mark.filterwarnings("ignore::UserWarning:minari")
def test_other_data_sets_and_none_are_refused(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "others"))
    env = minari.MinariDataset(folder / "data").recover_environment()
    zeros = np.zeros((1, 9), np.float32)
    buffer = EpisodeBuffer(0, 1, None, np.zeros((2, 15), np.float32), zeros, [0.0], [False], [True])
    minari.create_dataset_from_buffers("other/mine-v0", [buffer], env=env)
    (data,) = find_datasets(tmp_path / "others")
    with pytest.raises(UserError, match="was not made by fpg-bench dataset make, or is not finished"):
        check_dataset(data)
    folder.rename(tmp_path / ".hidden")
    shutil.rmtree(tmp_path / "others")
    with pytest.raises(UserError, match="holds no finished data set"):
        find_datasets(tmp_path)


@pytest.mark.parametrize("share", [0, -1, 1.01])
def test_a_sample_is_a_share(folder, share):
    with pytest.raises(UserError, match="sample: expected a share above 0"):
        check_dataset(folder / "data", share)
