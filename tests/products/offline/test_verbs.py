"""The verbs ``dataset list``, ``make`` and ``check``."""

from typer.testing import CliRunner

from fpg_bench.cli.main import app
from fpg_bench.products.offline.spec import spec_names


def run(*words):
    return CliRunner().invoke(app, ["dataset", *map(str, words)], catch_exceptions=False).output


def test_a_data_set_is_listed_made_and_checked(tmp_path):
    assert [name for name in spec_names() if f"{name}: " not in run("list")] == []
    output = run("make", "opponent-link-mixed-v0", "--steps", "600", "--out", tmp_path)
    folder = tmp_path / "fpg/opponent-link-mixed-v0"
    assert output.endswith(f"written: {folder}\n")
    for place in (tmp_path, folder, folder / "data"):
        line = run("check", place, "--sample", "100%")
        assert "fpg/opponent-link-mixed-v0: 2 rounds of 300 steps" in line
        assert "2 played again, all identical" in line
