"""Data sets: what Minari reads is what was played, however it was made, and nothing half is left."""

import errno
import json
import shutil
from collections import Counter
from functools import cache
from types import SimpleNamespace

import minari
import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.offline import make, storage
from fpg_bench.products.offline.make import make_dataset
from fpg_bench.products.offline.rounds import play_rounds
from fpg_bench.products.offline.spec import load_spec, spec_names
from tests.products.offline.making import AGENT, ALLIES, OPPONENTS, metadata, sha256, tiny
from tests.programs import ROOT


@cache
def expected_sha256():
    """Return the hash of five rounds of ``tiny()``, played one by one."""
    spec = tiny()
    rounds = [play_rounds(spec, [spec.first_seed + k]) for k in range(5)]
    return make.content_sha256(b"".join(digest for each in rounds for digest in each.digests()))


def no_space(*_):
    raise OSError(errno.ENOSPC, "No space left on device", "part_00001.hdf5")


@pytest.mark.parametrize(
    "changes",
    [
        {"players": (AGENT, "random")},
        {"actions": "discrete"},
        {"side": "opponent", "players": OPPONENTS, "rivals": ALLIES, "best": "adaptive"},
        {
            "scenario": "link",
            "side": "opponent",
            "actions": "discrete",
            "players": ("herd",),
            "rivals": ("by-type",),
        }
        | {"behaviour": "script", "best": "herd"},
    ],
    ids=["ally", "ally-discrete", "opponent", "link-discrete"],
)
def test_the_recovered_environment_replays_every_round_to_the_bit(tmp_path, monkeypatch, changes):
    spec = tiny(3, **changes)
    make_dataset(spec, tmp_path, rounds_per_part=2)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    assert list(minari.list_local_datasets(compatible_minari_version=True)) == ["fpg/tiny-v0"]
    dataset = minari.load_dataset("fpg/tiny-v0")
    assert (dataset.total_episodes, dataset.total_steps) == (3, 900)
    env = dataset.recover_environment()
    assert env.observation_space == dataset.observation_space
    assert env.action_space == dataset.action_space
    about = list(dataset.storage.get_episode_metadata(range(3)))
    for k, episode in enumerate(dataset.iterate_episodes()):
        assert about[k]["seed"] == spec.first_seed + k
        assert episode.observations.shape == (301, 15)
        assert episode.observations.dtype == np.float32
        assert episode.actions.dtype == (np.int64 if spec.actions == "discrete" else np.float32)
        assert all(map(env.action_space.contains, episode.actions))
        seen, _ = env.reset(seed=about[k]["seed"])
        assert np.array_equal(seen, episode.observations[0])
        for step, action in enumerate(episode.actions):
            seen, reward, terminated, truncated, _ = env.step(action)
            assert np.array_equal(seen, episode.observations[step + 1])
            assert reward == episode.rewards[step]
            assert (terminated, truncated) == (episode.terminations[step], episode.truncations[step])


def test_the_content_is_the_same_in_parts_of_any_size(tmp_path):
    folders = [make_dataset(tiny(), tmp_path / str(size), rounds_per_part=size) for size in (2, 3, 512)]
    assert [sha256(folder) for folder in folders] == [expected_sha256()] * 3


@pytest.mark.full
@pytest.mark.process
@pytest.mark.slow
def test_the_content_is_the_same_from_several_processes_and_with_an_agent(tmp_path):
    spec = tiny(players=("random", AGENT))
    done = []
    folders = [
        make_dataset(
            spec, tmp_path / str(n), workers=n, rounds_per_part=n, progress=lambda *of: done.append(of)
        )
        for n in (1, 2)
    ]
    assert sha256(folders[0]) == sha256(folders[1])
    assert done[:5] == [(k, 5) for k in range(1, 6)]
    assert done[-1] == (5, 5)


def test_a_larger_data_set_begins_with_the_rounds_of_a_smaller_one():
    spec = tiny()
    rounds = [play_rounds(spec, range(spec.first_seed, spec.first_seed + n)) for n in (2, 5)]
    assert list(rounds[0].digests()) == list(rounds[1].digests())[:2]


def test_players_are_drawn_without_regard_to_their_rivals():
    spec = tiny()
    rounds = play_rounds(spec, range(spec.first_seed, spec.first_seed + 200))
    pairs = Counter(zip(rounds.players, rounds.rivals, strict=True))
    assert set(pairs) == {(ally, opponent) for ally in ALLIES for opponent in OPPONENTS}
    assert min(pairs.values()) >= 10


def test_choices_are_those_nearest_to_the_floats_of_the_player():
    spec = tiny(1, behaviour="script", players=("expert",))
    floats, choices = (
        play_rounds(spec.model_copy(update={"actions": mode}), [5]) for mode in ("continuous", "discrete")
    )
    assert np.array_equal(floats.rewards, choices.rewards)  # expert's actions are choices


def test_metadata_say_who_played_and_how_good_that_is(tmp_path):
    spec = tiny(2)
    folder = make_dataset(spec, tmp_path)
    about = metadata(folder)
    assert about["algorithm_name"] == "mixed: random, expert, always-hop"
    assert about["ref_min_score"] < about["ref_max_score"]
    assert about["total_steps"] == 600
    assert make.RECIPE in about
    assert about[make.RECIPE]["spec"] == json.loads(spec.model_dump_json())
    dataset = minari.MinariDataset(folder / "data")
    best = minari.get_normalized_score(dataset, np.array([about["ref_max_score"]]))
    assert best == pytest.approx(1.0)
    played = play_rounds(spec, range(spec.first_seed, spec.first_seed + 2))
    attributes = list(dataset.storage.get_episode_metadata(range(2)))
    assert [each["player"] for each in attributes] == played.players
    assert [each["rival"] for each in attributes] == played.rivals


def test_the_page_lists_every_shipped_data_set():
    page = (ROOT / "docs/guides/datasets.md").read_text()
    table = page.split("<!-- data sets -->")[1].split("<!-- end -->")[0]
    assert [name for name in spec_names() if f"| `{name}` |" not in table] == []


def test_a_stopped_making_goes_on_with_the_parts_that_are_there(tmp_path, monkeypatch):
    folder = tmp_path / "fpg" / "tiny-v0"
    parts = folder.with_name(".tiny-v0.partial") / "data"

    def stop(path, *rest):
        if path.name == "part_00002.hdf5":
            raise KeyboardInterrupt
        storage.write_part(path, *rest)

    with monkeypatch.context() as patched:
        patched.setattr(make, "write_part", stop)
        with pytest.raises(KeyboardInterrupt):
            make_dataset(tiny(), tmp_path, rounds_per_part=1)
    assert not folder.exists()
    times = {path.name: path.stat().st_mtime_ns for path in parts.glob("part_*")}
    assert sorted(times) == ["part_00000.hdf5", "part_00001.hdf5"]
    assert make_dataset(tiny(), tmp_path, rounds_per_part=1) == folder
    assert not parts.exists()
    assert {name: (folder / "data" / name).stat().st_mtime_ns for name in times} == times
    assert sha256(folder) == expected_sha256()


def test_a_full_disk_leaves_nothing_under_the_name_and_what_is_finished(tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(storage, "write_whole", no_space)
        with pytest.raises(UserError, match=r"part 0: part_.*No space left"):
            make_dataset(tiny(), tmp_path)
    assert not list(tmp_path.glob("fpg/tiny*"))
    assert not list(tmp_path.rglob("part_*"))
    with monkeypatch.context() as patched:
        patched.setattr(make, "link_parts", no_space)
        with pytest.raises(OSError, match="No space"):
            make_dataset(tiny(), tmp_path)
    assert not list(tmp_path.glob("fpg/tiny*"))
    assert sha256(make_dataset(tiny(), tmp_path)) == expected_sha256()


def test_a_data_set_that_does_not_fit_on_the_disk_is_not_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(make.shutil, "disk_usage", lambda path: SimpleNamespace(free=10**6))
    with pytest.raises(UserError, match=r"needs 34 MB .* 1 MB are free"):
        make_dataset(tiny(1000), tmp_path)
    with pytest.raises(UserError, match="needs 113,000,000 MB"):
        make_dataset(tiny(name="huge-v0", steps=10**12), tmp_path)


def test_a_finished_data_set_stays_and_another_is_refused(tmp_path, monkeypatch):
    folder = make_dataset(tiny(), tmp_path)
    monkeypatch.setattr(make, "run_jobs", None)  # nothing is played any more
    assert make_dataset(tiny(), tmp_path) == folder
    with pytest.raises(UserError, match="differs in steps; delete it, or choose another folder"):
        make_dataset(tiny(6), tmp_path)
    with pytest.raises(UserError, match="differs in rivals, identities; delete it"):
        make_dataset(tiny(rivals=("tone",)), tmp_path)
    monkeypatch.setattr("fpg_bench.products.offline.spec.__version__", "9.9")
    with pytest.raises(UserError, match=r"begun by fpg-bench 0\..*, not this version, 9.9"):
        make_dataset(tiny(), tmp_path)


def test_foreign_folders_and_torn_parts_are_refused(tmp_path):
    (tmp_path / "fpg/tiny-v0").mkdir(parents=True)
    with pytest.raises(UserError, match="cannot be read"):
        make_dataset(tiny(), tmp_path)
    data = tmp_path / "fpg/tiny-v0/data"
    data.mkdir()
    (data / "metadata.json").write_text("{}")
    with pytest.raises(UserError, match="that fpg-bench dataset make did not make"):
        make_dataset(tiny(), tmp_path)
    shutil.rmtree(tmp_path / "fpg")
    (tmp_path / "fpg").write_text("")
    with pytest.raises(UserError, match="is a file"):
        make_dataset(tiny(), tmp_path)
    (tmp_path / "fpg").unlink()
    folder = make_dataset(tiny(), tmp_path)
    part = folder / "data/part_00000.hdf5"
    part.write_bytes(part.read_bytes()[:-1000])
    folder.rename(folder.with_name(".tiny-v0.partial"))
    with pytest.raises(UserError, match=r"part_00000.hdf5 is damaged; delete it"):
        make_dataset(tiny(), tmp_path)


def test_without_a_folder_it_goes_where_minari_looks(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "here"))
    make_dataset(tiny(1))
    assert minari.load_dataset("fpg/tiny-v0").total_episodes == 1
    monkeypatch.delenv("MINARI_DATASETS_PATH")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert make.datasets_root() == tmp_path / ".minari/datasets"


@pytest.mark.parametrize("name", spec_names())
def test_shipped_data_sets_can_be_made(name):
    spec = load_spec(name)
    assert spec.name == name
    rounds = play_rounds(spec, [spec.first_seed])
    assert np.isfinite(rounds.rewards).all()
    assert {spec.side, spec.behaviour} <= {*name.split("-")}
    assert ("discrete" in name) == (spec.actions == "discrete")
    assert ("link" in name) == (spec.scenario == "link")
    play_rounds(spec.model_copy(update={"players": (spec.best,)}), [spec.first_seed])


def test_shipped_data_sets_have_seeds_of_their_own():
    seeds = [load_spec(name).seed for name in spec_names()]
    assert len(set(seeds)) == len(seeds)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("behaviour: mixed", "mixed behaviour has several players, got 1"),
        ("players: [random, expert]", "random behaviour has one player, got 2"),
        ("players: [mine:Player]", "the name of a script or an agent of the package"),
        ("players: [../mine]", "the name of a script or an agent of the package"),
        ("seed: 9999999999", "seed of a data set: expected 0 to"),
        ("rivals: [nobody]", "unknown opponent 'nobody'"),
        ("rivals: [expert]", "'expert' plays the ally"),
    ],
)
def test_specifications_that_cannot_be_played_are_refused_in_one_line(tmp_path, content, message):
    base = {"description": "Mine.", "side": "ally", "behaviour": "random", "players": ["random"]}
    base |= {"rivals": ["tone"], "best": "expert", "steps": 300}
    lines = [f"{key}: {json.dumps(value)}" for key, value in base.items() if key != content.split(":")[0]]
    file = tmp_path / "mine-v0.yml"
    file.write_text("\n".join([*lines, content]))
    with pytest.raises(UserError, match=message):
        make_dataset(load_spec(str(file)), tmp_path / "out")
    assert not list(tmp_path.glob("out/fpg/mine*"))


def test_names_are_known_or_files_with_a_version(tmp_path):
    with pytest.raises(UserError, match="did you mean 'ally-expert-v0'"):
        load_spec("ally-expert-v1")
    shutil.copy(baselines_folder() / "datasets/ally-random-v0.yml", tmp_path / "mine.yml")
    with pytest.raises(UserError, match="name: expected a name and a version"):
        load_spec(str(tmp_path / "mine.yml"))
