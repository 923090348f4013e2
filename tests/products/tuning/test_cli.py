import pytest
import yaml

from fpg_bench.cli.main import main
from tests.products.tuning.test_tune import ENV_ID, HYPERPARAMS, SPACE
from tests.programs import fpg as program

TUNE = f"tune run ppo {ENV_ID} --out study --space space.yml --hyperparams mine.yml --rounds 2 --n-seeds 1"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.yml").write_text(HYPERPARAMS)
    (tmp_path / "space.yml").write_text(SPACE)
    return tmp_path


@pytest.fixture
def fpg(folder, monkeypatch, capfd):
    """Runs a command within this process; gives its status, what it printed and its error."""
    monkeypatch.chdir(folder)

    def run(words):
        monkeypatch.setattr("sys.argv", ["fpg-bench", *words.split()])
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code or 0, *capfd.readouterr()

    return run


@pytest.mark.process
def test_search_look_and_write(folder, fpg):
    done = program(*f"{TUNE} --n-trials 2 --steps 240".split(), folder=folder)
    assert done.returncode == 0, done.stderr
    assert "2 finished (1 pruned), 2 asked for" in done.stdout
    status, out, error = fpg("tune export study best.yml --n-best 1 --n-seeds 2")
    assert status == 0, error
    assert f"written: best.yml, {ENV_ID}" in out
    text = (folder / "best.yml").read_text()
    assert "# tuned: study" in text
    assert yaml.safe_load(text)[ENV_ID]["n_timesteps"] == 960
