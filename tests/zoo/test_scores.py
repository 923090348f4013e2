import dataclasses

import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.field import load_field
from fpg_bench.evaluation.summary import summarise
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.zoo.scores import (
    add_missing_lines,
    check_member,
    differences,
    read_zoo_lines,
    score_file,
)
from tests.zoo.making import make_agent, make_zoo


@pytest.fixture(scope="module")
def zoo(tmp_path_factory):
    zoo = make_zoo(tmp_path_factory.mktemp("zoo"))
    for member in zoo.members():
        make_agent(member, seed=member.seed + 10 * (member.algorithm == "td3"))
    add_missing_lines(zoo, zoo.views[0])
    return zoo


@pytest.fixture(scope="module")
def field(zoo):
    return load_field(zoo.views[0].fields[0])


def lines_of(zoo, field, algorithm):
    return [line for line in read_zoo_lines(zoo, zoo.views[0], field) if line.entry == algorithm]


def test_everybody_has_lines_and_nobody_twice(zoo, field):
    lines = read_zoo_lines(zoo, zoo.views[0], field)
    assert len(lines) == 2 * (len(SCRIPTED["ally"]) + 6)
    size = score_file(zoo, zoo.views[0]).path.stat().st_size
    scored = []
    assert add_missing_lines(zoo, zoo.views[0], scored.append) == lines
    assert scored == []
    assert score_file(zoo, zoo.views[0]).path.stat().st_size == size


def test_the_zoos_numbers_are_those_of_evaluate_to_the_digit(zoo, field, tmp_path):
    agents = [str(member.folder) for member in zoo.members("small/ppo")]
    expected = evaluate([*agents, "expert", "idle"], zoo.views[0].fields[0], tmp_path)
    found = {s.entry: s for s in summarise(read_zoo_lines(zoo, zoo.views[0], field), field)}
    assert len(expected) == 3
    for summary in expected:
        mine = found[summary.entry]
        assert (mine.score, mine.reward, mine.measures) == (summary.score, summary.reward, summary.measures)
        assert mine.training_seeds == summary.training_seeds
        for one, other in zip(mine.lines, summary.lines, strict=True):
            assert one.same_as(other)


def test_scores_of_single_seeds(zoo, field):
    (found,) = summarise(lines_of(zoo, field, "td3"), field)
    scores = found.seed_scores()
    assert scores.keys() == {0, 1, 2}
    alone = [line for line in found.lines if line.training_seed == 1]
    assert scores[1] == pytest.approx(summarise(alone, field)[0].score.value)


def test_an_agent_that_is_replaced_is_scored_again(tmp_path):
    zoo = make_zoo(tmp_path)
    member, field = zoo.members()[0], load_field(zoo.views[0].fields[0])
    make_agent(member)
    add_missing_lines(zoo, member.view)
    before = lines_of(zoo, field, "ppo")
    assert check_member(zoo, member) == []
    for file in member.folder.iterdir():
        file.unlink()
    member.folder.rmdir()
    make_agent(member, seed=77)
    assert lines_of(zoo, field, "ppo") == []
    missing = ["small-v1, adaptive/pursuit: no line", "small-v1, sweep/circle: no line"]
    assert check_member(zoo, member) == missing
    scored = []
    add_missing_lines(zoo, member.view, scored.append)
    assert scored == ["small: ppo/seed_0 against small-v1"]
    after = lines_of(zoo, field, "ppo")
    assert differences(after, before) == [line.replace("no line", "other returns") for line in missing]


def test_a_policy_that_has_changed_is_refused(tmp_path):
    zoo = make_zoo(tmp_path)
    member = zoo.members()[0]
    make_agent(member)
    (member.folder / "policy.onnx").write_bytes(b"torn")
    with pytest.raises(UserError, match="sha256"):
        add_missing_lines(zoo, member.view)


def test_other_rounds_with_the_same_returns_are_told(zoo, field):
    line = lines_of(zoo, field, "ppo")[0]
    assert differences([line], [line]) == []
    other = dataclasses.replace(line, rounds_sha256="0")
    assert differences([line], [other]) == ["small-v1, adaptive/pursuit: the same returns, but other rounds"]
