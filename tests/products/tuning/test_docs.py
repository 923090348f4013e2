"""The page on tuning says what is so."""

import re
from pathlib import Path

from fpg_bench.products.tuning.space import load_space
from fpg_bench.products.tuning.study import open_storage, open_study
from tests.products.tuning.fake import fake_task, highest_x

TEXT = (Path(__file__).parents[3] / "docs/guides/tuning.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)


def test_the_example_of_a_space_is_valid(tmp_path):
    (code,) = [code for language, code in BLOCKS if language == "yaml"]
    (tmp_path / "my_space.yml").write_text(code)
    assert load_space("ppo", tmp_path / "my_space.yml")["n_epochs"].kind == "int"


def test_a_study_is_optunas_own(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    study = open_study(open_storage(Path("runs/tune/ppo")), "ppo FPG/AllyVsScripted-v0", fake_task())
    study.optimize(highest_x, n_trials=1)
    (code,) = [code for language, code in BLOCKS if language == "python"]
    exec(compile(code, "tuning.md", "exec"), {})  # our own page
    assert capsys.readouterr().out == "{'x': 5.0}\n"
