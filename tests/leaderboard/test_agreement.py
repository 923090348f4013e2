import dataclasses

import pytest

from fpg_bench.evaluation.field import load_field
from fpg_bench.evaluation.line import TALLIES
from fpg_bench.leaderboard.agreement import disagreements, same_to_the_bit
from fpg_bench.leaderboard.playing import Part, meetings_of, part_lines


@pytest.fixture(scope="module")
def fields():
    return {"known": load_field("ally-v1")}


@pytest.fixture(scope="module")
def lines(fields):
    return list(part_lines(Part("wise", None, "expert-spread"), meetings_of(fields.values())[:2]))


@pytest.fixture(scope="module")
def span(fields):
    """What a round's return spans from 0 to 100."""
    scale = fields["known"].scale
    return (scale.top - scale.zero) * fields["known"].scenario.steps_per_round


def changed(lines, **values):
    return [dataclasses.replace(lines[0], **values), *lines[1:]]


def moved(line, **sums):
    return line.tally | {name: line.tally[name] + by for name, by in sums.items()}


def test_the_same_lines_agree(lines, fields):
    assert disagreements(lines, lines, fields) == []
    assert same_to_the_bit(lines, lines) == 2


def test_what_another_machine_rounds_otherwise_agrees(lines, fields):
    kept = changed(lines, rounds_sha256="other", returns=tuple(x + 0.01 for x in lines[0].returns))
    assert disagreements(lines, kept, fields) == []
    assert same_to_the_bit(lines, kept) == 1


@pytest.mark.parametrize(("count", "agrees"), [(2, True), (3, False)])
def test_one_round_of_a_hundred_may_be_another(lines, fields, span, count, agrees):
    """Over all lines that are compared, and as long as the mean against the counterpart holds."""
    returns = list(lines[0].returns)
    for k in range(count):
        returns[k] += 0.01 * span * (-1) ** k
    found = disagreements(lines, changed(lines, returns=tuple(returns)), fields)
    assert found == ([] if agrees else ["1.5 % of 200 rounds return something else"])


def test_one_round_that_moves_the_mean_is_told(lines, fields, span):
    returns = (lines[0].returns[0] + 2 * span, *lines[0].returns[1:])
    (found,) = disagreements(lines, changed(lines, returns=returns), fields)
    assert found.startswith(f"ally-v1, {lines[0].counterpart}: mean return ")


def test_other_sums_points_and_lost_rounds_are_told(lines, fields):
    then, points = lines[0], [0] * len(lines[0].ally_points)
    steps = then.tally["steps"]
    kept = changed(lines, tally=moved(then, jammed=0.01 * steps), ally_points=(1, *points[1:]), lost=9)
    where, jammed = f"ally-v1, {then.counterpart}", then.tally["jammed"]
    assert disagreements(lines, kept, fields) == [
        f"{where}: 0 rounds lost, the result says 9",
        f"{where}: jammed {jammed:g}, the result says {jammed + 0.01 * steps:g}",
        f"{where}: other ally_points",
    ]


@pytest.mark.parametrize("name", TALLIES)
def test_other_sums_of_the_same_rounds_were_edited(lines, fields, name):
    kept = changed(lines, tally=moved(lines[0], **{name: 10.0}))
    (found,) = disagreements(lines, kept, fields)
    assert found.startswith(f"ally-v1, {lines[0].counterpart}: {name} ")


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("comb", 0.01),
        ("opponent_return", 0.4),
        ("snr_db", 0.01),
        ("capacity_mbit_s", -0.01),
        ("hops", 0.01),
        ("near", 0.01),
    ],
)
def test_sums_are_compared_by_what_they_are_worth(lines, fields, name, share):
    tally = lines[0].tally
    whole = abs(tally[name]) if name in ("snr_db", "capacity_mbit_s") else tally["steps"]
    for by, agrees in ((share / 4, True), (share, False)):
        kept = changed(lines, tally=moved(lines[0], **{name: by * whole}), rounds_sha256="other")
        assert (disagreements(lines, kept, fields) == []) is agrees


def test_some_of_the_lines_are_compared_with_those_that_they_are(lines, fields):
    assert disagreements(lines[1:], lines, fields) == []
    assert disagreements(lines[1:], changed(lines, lost=50), fields) == []


def test_lines_of_two_fields_are_kept_apart(lines, fields):
    """The same counterpart's name in another field is another meeting."""
    other = dataclasses.replace(fields["known"], season="5eed", matches=2)
    both = fields | {"unseen": other}
    mine = list(part_lines(Part("wise", None, "expert-spread"), meetings_of([other])[:2]))
    assert disagreements(mine, [*lines, *mine], both) == []
    edited = changed(mine, lost=2)
    assert len(disagreements(mine, [*lines, *edited], both)) == 1
    assert disagreements(lines, [*lines, *edited], both) == []
