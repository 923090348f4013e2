"""A run that is killed goes on from its last checkpoint, and gives what it would have given."""

from dataclasses import replace

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.paper import keeping
from fpg_bench.paper.conditions import conditions_of
from fpg_bench.paper.experiment import Budget
from fpg_bench.paper.keeping import Checkpoint
from fpg_bench.paper.reproduce import _jobs
from fpg_bench.paper.runs import RunFile
from fpg_bench.training.maddpg.multi_seed import MultiSeedTrainer

TINY = Budget("tiny", 4_000, 8, 25, 2, 1)
PLANNED = replace(conditions_of("fig4", "paper", full=False)[0], changes={"rounds_per_match": 2})

pytestmark = [pytest.mark.usefixtures("cache"), pytest.mark.slow]


def job_of(folder, learner="torch"):
    """The job of two seeds, and the file that their rows go to."""
    file = RunFile(folder, "paper", "tiny")
    (job,) = _jobs(file, [PLANNED], "paper", TINY, (0, 2), None, learner)
    return job, file


def run(folder, learner="torch"):
    """The rows of two seeds, once they are on disk."""
    job, file = job_of(folder, learner)
    job.keep(job.run())
    return {key: run.rows for key, run in file.read().items()}


def killed_at(monkeypatch, steps):
    """Let a run keep all that it does, and be killed after so many steps of all its games."""
    monkeypatch.setattr(keeping, "EVERY_S", 0.0)
    whole = MultiSeedTrainer.step

    def go_on(self):
        if self._models[0].num_timesteps >= steps:
            raise KeyboardInterrupt
        whole(self)

    monkeypatch.setattr(MultiSeedTrainer, "step", go_on)


@pytest.mark.parametrize("learner", ["torch", "jax"])
def test_a_killed_run_goes_on_to_the_same_rows(learner, monkeypatch, tmp_path, cache):
    if learner == "jax":
        pytest.importorskip("jax", reason='the extra is missing: pip install "fpg-bench[fast]"')
    wanted = run(tmp_path / "whole", learner)
    assert not list(cache.glob("*"))
    with monkeypatch.context() as patch:
        killed_at(patch, 3_000)
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path / "killed", learner)
    assert len(list(cache.iterdir())) == 1
    with monkeypatch.context() as patch:
        patch.setattr(MultiSeedTrainer, "__init__", None)  # nothing begins anew
        assert run(tmp_path / "killed", learner) == wanted
    assert not list(cache.iterdir())


def test_a_run_is_not_lost_between_its_end_and_its_rows(monkeypatch, tmp_path, cache):
    job, file = job_of(tmp_path)
    ended = [each.line() for each in job.run()]  # and killed before the rows are written
    with monkeypatch.context() as patch:
        patch.setattr(RunFile, "add", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            job.keep(job.run())
    assert len(list(cache.iterdir())) == 1
    monkeypatch.setattr(MultiSeedTrainer, "__init__", None)  # nothing begins anew
    again, _ = job_of(tmp_path)
    runs = again.run()
    assert [each.line() for each in runs] == ended
    again.keep(runs)
    assert not list(cache.iterdir())
    assert len(file.read()) == 2 * len(PLANNED.runs)


def test_each_run_has_a_checkpoint_of_its_own_and_one_that_was_cut_off_is_refused(monkeypatch, cache):
    monkeypatch.setattr(keeping, "EVERY_S", 0.0)
    assert Checkpoint({"seed": 0}).read() is None
    Checkpoint({"seed": 0}).keep([1, 2])
    assert Checkpoint({"seed": 0}).read() == [1, 2]
    assert Checkpoint({"seed": 1}).read() is None
    (path,) = cache.iterdir()
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(UserError, match=r"cannot be read .*; remove it"):
        Checkpoint({"seed": 0}).read()


def test_a_checkpoint_is_written_now_and_then_only(cache):
    Checkpoint({}).keep(1)
    assert not cache.exists()
