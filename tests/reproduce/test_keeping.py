"""A run that is killed goes on from its last checkpoint, and gives what it would have given."""

import pytest

from fpg_bench.errors import UserError
from fpg_bench.reproduce import keeping
from fpg_bench.reproduce.conditions import conditions_of
from fpg_bench.reproduce.experiment import Budget, run_experiment
from fpg_bench.reproduce.keeping import Checkpoint
from fpg_bench.reproduce.windows import read_windows
from fpg_bench.training.maddpg_seeds import Together

TINY = Budget("tiny", 8_000, 8, 25, 2, 1)
(PLANNED,) = conditions_of("fig4", "paper", full=False)


def paths_in(folder):
    return {seed: folder / f"seed_{seed}.csv" for seed in (0, 1)}


def killed_at(monkeypatch, steps):
    """Let a run keep all that it does, and be killed after so many steps of all its games."""
    monkeypatch.setattr(keeping, "EVERY_S", 0.0)
    whole = Together.go_on

    def go_on(self):
        if self._models[0].num_timesteps >= steps:
            raise KeyboardInterrupt
        whole(self)

    monkeypatch.setattr(Together, "go_on", go_on)


@pytest.mark.parametrize("learner", ["torch", "jax"])
def test_a_killed_run_goes_on_to_the_same_rows(learner, monkeypatch, tmp_path):
    if learner == "jax":
        pytest.importorskip("jax", reason='the extra is missing: pip install "fpg-bench[fast]"')
    run_experiment(PLANNED, "paper", TINY, paths_in(tmp_path / "whole"), learner=learner)
    killed = paths_in(tmp_path / "killed")
    with monkeypatch.context() as patch:
        killed_at(patch, 6_000)
        with pytest.raises(KeyboardInterrupt):
            run_experiment(PLANNED, "paper", TINY, killed, learner=learner)
    assert [path.suffix for path in (tmp_path / "killed").iterdir()] == [".checkpoint"]
    with monkeypatch.context() as patch:
        patch.setattr(Together, "__init__", None)  # nothing begins anew
        run_experiment(PLANNED, "paper", TINY, killed, learner=learner)
    assert {path.suffix for path in (tmp_path / "killed").iterdir()} == {".csv"}
    for found, wanted in zip(killed.values(), paths_in(tmp_path / "whole").values(), strict=True):
        assert read_windows(found)[1] == read_windows(wanted)[1]


def test_a_checkpoint_of_another_run_or_cut_off_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(keeping, "EVERY_S", 0.0)
    path = tmp_path / "run.checkpoint"
    assert Checkpoint(path, {"seed": 0}).read() is None
    Checkpoint(path, {"seed": 0}).keep([1, 2])
    assert Checkpoint(path, {"seed": 0}).read() == [1, 2]
    with pytest.raises(UserError, match=r"of another run .*; remove it"):
        Checkpoint(path, {"seed": 1}).read()
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(UserError, match=r"cannot be read .*; remove it"):
        Checkpoint(path, {"seed": 0}).read()


def test_a_checkpoint_is_written_now_and_then_only(tmp_path):
    Checkpoint(tmp_path / "run.checkpoint", {}).keep(1)
    assert not list(tmp_path.iterdir())
