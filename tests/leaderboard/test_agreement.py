import dataclasses

import pytest

from fpg_bench.evaluation.record import TALLIES
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.leaderboard.agreement import disagreements, same_to_the_bit
from fpg_bench.leaderboard.playing import Part, matchups_of, part_records


@pytest.fixture(scope="module")
def suites():
    return {"public": load_suite("ally-v1")}


@pytest.fixture(scope="module")
def records(suites):
    return list(part_records(Part("wise", None, "expert-spread"), matchups_of(suites.values())[:2]))


@pytest.fixture(scope="module")
def span(suites):
    """What a round's return spans from 0 to 100."""
    scale = suites["public"].scale
    return (scale.top - scale.zero) * suites["public"].scenario.steps_per_round


def changed(records, **values):
    return [dataclasses.replace(records[0], **values), *records[1:]]


def moved(record, **sums):
    return record.tally | {name: record.tally[name] + by for name, by in sums.items()}


def test_the_same_lines_agree(records, suites):
    assert disagreements(records, records, suites) == []
    assert same_to_the_bit(records, records) == 2


def test_what_another_machine_rounds_otherwise_agrees(records, suites):
    kept = changed(records, rounds_sha256="other", returns=tuple(x + 0.01 for x in records[0].returns))
    assert disagreements(records, kept, suites) == []
    assert same_to_the_bit(records, kept) == 1


@pytest.mark.parametrize(("count", "agrees"), [(2, True), (3, False)])
def test_one_round_of_a_hundred_may_be_another(records, suites, span, count, agrees):
    """Over all lines that are compared, and as long as the mean against the rival holds."""
    returns = list(records[0].returns)
    for k in range(count):
        returns[k] += 0.01 * span * (-1) ** k
    found = disagreements(records, changed(records, returns=tuple(returns)), suites)
    assert found == ([] if agrees else ["1.5 % of 200 rounds return something else"])


def test_one_round_that_moves_the_mean_is_told(records, suites, span):
    returns = (records[0].returns[0] + 2 * span, *records[0].returns[1:])
    (found,) = disagreements(records, changed(records, returns=returns), suites)
    assert found.startswith(f"ally-v1, {records[0].rival}: mean return ")


def test_other_sums_points_and_lost_rounds_are_told(records, suites):
    then, points = records[0], [0] * len(records[0].ally_points)
    steps = then.tally["steps"]
    kept = changed(records, tally=moved(then, jammed=0.01 * steps), ally_points=(1, *points[1:]), lost=9)
    where, jammed = f"ally-v1, {then.rival}", then.tally["jammed"]
    assert disagreements(records, kept, suites) == [
        f"{where}: 0 rounds lost, the result says 9",
        f"{where}: jammed {jammed:g}, the result says {jammed + 0.01 * steps:g}",
        f"{where}: other ally_points",
    ]


@pytest.mark.parametrize("name", TALLIES)
def test_other_sums_of_the_same_rounds_were_edited(records, suites, name):
    kept = changed(records, tally=moved(records[0], **{name: 10.0}))
    (found,) = disagreements(records, kept, suites)
    assert found.startswith(f"ally-v1, {records[0].rival}: {name} ")


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
def test_sums_are_compared_by_what_they_are_worth(records, suites, name, share):
    tally = records[0].tally
    whole = abs(tally[name]) if name in ("snr_db", "capacity_mbit_s") else tally["steps"]
    for by, agrees in ((share / 4, True), (share, False)):
        kept = changed(records, tally=moved(records[0], **{name: by * whole}), rounds_sha256="other")
        assert (disagreements(records, kept, suites) == []) is agrees


def test_some_of_the_lines_are_compared_with_those_that_they_are(records, suites):
    assert disagreements(records[1:], records, suites) == []
    assert disagreements(records[1:], changed(records, lost=50), suites) == []


def test_lines_of_two_suites_are_kept_apart(records, suites):
    """The same rival's name in another suite is another meeting."""
    other = dataclasses.replace(suites["public"], season="5eed", matches=2)
    both = suites | {"unseen": other}
    mine = list(part_records(Part("wise", None, "expert-spread"), matchups_of([other])[:2]))
    assert disagreements(mine, [*records, *mine], both) == []
    edited = changed(mine, lost=2)
    assert len(disagreements(mine, [*records, *edited], both)) == 1
    assert disagreements(records, [*records, *edited], both) == []
