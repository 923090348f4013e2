"""Jobs that fill folders, seen by their workers or not."""

import pickle
from functools import partial

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.jobs import folders
from fpg_bench.jobs.folders import folder_job, mark, sees
from tests.common import working


@pytest.fixture(params=["seen", "unseen"])
def unseen(request, monkeypatch):
    """Whether the worker sees nothing of the driver's folder."""
    if request.param == "unseen":
        monkeypatch.setattr(folders, "sees", lambda folder, marked: False)
    return request.param == "unseen"


def run(job):
    """Run a job as a worker does, which has a copy of it."""
    job.keep(pickle.loads(pickle.dumps(job.run))())


def test_the_files_come_to_lie_in_the_folder(tmp_path, unseen):
    folder = tmp_path / "out" / "seed_0"
    job = folder_job("job", folder, partial(working.fill, b"policy"), done=(folder / "run.json").exists)
    assert not job.done()
    assert bool(job.run()) is unseen  # files travel only where they have to
    run(job)
    assert job.done()
    assert (folder / "agent" / "policy").read_bytes() == b"policy"
    assert {path.name for path in folder.parent.iterdir()} <= {"seed_0", ".shared"}


def test_what_comes_back_takes_the_place_of_what_was_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "sees", lambda folder, marked: False)
    folder = tmp_path / "seed_0"
    working.fill(b"old", folder)
    (folder / "checkpoint").touch()
    with pytest.raises(UserError, match="out of luck"):
        run(folder_job("job", folder, partial(working.fill, b"bad"), done=bool))
    assert (folder / "agent" / "policy").read_bytes() == b"old"
    run(folder_job("job", folder, partial(working.fill, b"new"), done=bool))
    assert (folder / "agent" / "policy").read_bytes() == b"new"
    assert not (folder / "checkpoint").exists()


def test_nothing_is_replaced_by_half(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "sees", lambda folder, marked: False)
    working.fill(b"old", tmp_path / "seed_0")
    job = folder_job("job", tmp_path / "seed_0", partial(working.fill, b"new"), done=bool)

    def full(path, content):
        raise OSError("No space left on device")

    monkeypatch.setattr(folders, "write_whole", full)
    with pytest.raises(OSError, match="No space"):
        run(job)
    assert {path.name for path in tmp_path.iterdir()} == {"seed_0", ".shared"}
    assert (tmp_path / "seed_0" / "agent" / "policy").read_bytes() == b"old"


def test_a_mark_is_made_once_and_tells_folders_apart(tmp_path):
    marked = mark(tmp_path / "a")
    assert mark(tmp_path / "a") == marked
    assert sees(tmp_path / "a", marked)
    mark(tmp_path / "b")
    assert not sees(tmp_path / "b", marked)
    assert not sees(tmp_path / "nowhere", marked)
