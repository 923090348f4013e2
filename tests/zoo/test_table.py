import pytest

from fpg_bench.evaluation.field import load_field
from fpg_bench.evaluation.summary import summarise
from fpg_bench.zoo.curves import keep_curve
from fpg_bench.zoo.scores import add_missing_lines, read_zoo_lines
from fpg_bench.zoo.table import page, write_page
from tests.zoo.making import FIELD, evaluations, make_agent, make_zoo


@pytest.fixture
def zoo(tmp_path):
    return make_zoo(tmp_path)


def summaries(zoo):
    view = zoo.views[0]
    field = load_field(view.fields[0])
    return summarise(read_zoo_lines(zoo, view, field), field)


def test_a_zoo_without_scores_says_so(zoo):
    write_page(zoo)
    text = (zoo.folder / "README.md").read_text()
    assert "## small" in text
    assert "Not trained yet." in text


def test_a_table_of_algorithms_and_scripts_with_pictures(zoo, tmp_path):
    members = zoo.members("small/ppo") + zoo.members("small/td3")[:1]
    for member in members:
        make_agent(member)
        run = tmp_path / "run"
        run.mkdir(exist_ok=True)
        (run / "evaluations.jsonl").write_text(evaluations())
        keep_curve(zoo, member, run)
    add_missing_lines(zoo, zoo.views[0])
    write_page(zoo)
    text = (zoo.folder / "README.md").read_text()
    assert text == page(zoo)
    lines = {
        line.split(" | ")[0].strip("|* "): line.split(" | ") for line in text.splitlines() if "|" in line
    }
    assert {"ppo", "td3", "expert", "random"} <= set(lines)
    assert lines["ppo"][1:3] == ["3", "0.002M"]
    assert lines["td3"][1] == "1"
    assert "†" in lines["td3"][4]
    assert "†" not in lines["ppo"][4]
    expert = next(line for line in summaries(zoo) if line.entry == "expert")
    assert lines["expert"][3] == f"{expert.score.value:.1f}"
    assert lines["ppo"][-1] == "1.5 |"  # minutes
    for name in ("curves", "profiles", "improvement"):
        assert f"(scores/small/{name}.svg)" in text
        image = (zoo.folder / "scores" / "small" / f"{name}.svg").read_bytes()
        assert image.startswith(b"<?xml")
        assert len(image) < 100_000


def test_a_second_field_has_columns_of_its_own(tmp_path):
    season = FIELD.replace("sweep, path: circle", "comb, path: circle")
    (tmp_path / "season-1.yml").write_text(season)
    zoo = make_zoo(tmp_path, f", {tmp_path / 'season-1.yml'}")
    make_agent(zoo.members()[0])
    add_missing_lines(zoo, zoo.views[0])
    text = page(zoo)
    heading = next(line for line in text.splitlines() if line.startswith("| player"))
    assert "on " in heading
    ppo = next(line for line in text.splitlines() if line.startswith("| **ppo**"))
    assert ppo.count("|") == heading.count("|")
    assert " - | - " not in ppo


def test_pictures_are_the_same_each_time(zoo):
    make_agent(zoo.members()[0])
    add_missing_lines(zoo, zoo.views[0])
    images = []
    for _ in range(2):
        write_page(zoo)
        images.append((zoo.folder / "scores" / "small" / "profiles.svg").read_bytes())
    assert images[0] == images[1]
