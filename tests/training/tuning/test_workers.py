"""Several workers of one study, as one command starts them."""

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.training.tuning import tune
from fpg_bench.training.tuning.storage import open_storage
from fpg_bench.training.tuning.study import find_study
from fpg_bench.training.tuning.tune import tune_together
from tests.training.tuning.test_tune import HYPERPARAMS, SPACE, VIEW


@pytest.fixture
def words(tmp_path):
    (tmp_path / "mine.yml").write_text(HYPERPARAMS)
    (tmp_path / "space.yml").write_text(SPACE)
    files = {"hyperparams": tmp_path / "mine.yml", "space": tmp_path / "space.yml"}
    return {"workers": 2, "seeds": 1, "steps": 600, "rounds": 2} | files


@pytest.mark.slow
def test_two_workers_share_the_trials(tmp_path, words, capsys):
    tune_together("ppo", VIEW, tmp_path / "study", trials=2, **words)
    storage = open_storage(tmp_path / "study", None, say=print)
    study, _ = find_study(storage, None)
    assert 2 <= len(study.trials) <= 3
    assert "worker 1: done after" in capsys.readouterr().out


@pytest.mark.slow
def test_a_worker_that_does_not_see_the_study_needs_a_database(tmp_path, words, monkeypatch):
    monkeypatch.setattr(tune, "mark", lambda folder: "of another machine")
    with pytest.raises(UserError, match=r"worker 0: .* does not see .*study, where the study lies; name a"):
        tune_together("ppo", VIEW, tmp_path / "study", **words | {"workers": 1})
