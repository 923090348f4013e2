"""Results that are played again: every field is compared, by its tolerance."""

import dataclasses

import pytest

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import TALLIES, Plans, Record
from fpg_bench.evaluation.store import pairings
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.products.leaderboard.verdicts import (
    EXACT,
    RECORD,
    Replayed,
    Tolerances,
    Within,
    fields_of,
    judge,
    replays_of,
)
from tests.evaluation.test_record import PLANS, record

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def suites():
    return {"public": load_suite("ally-v2")}


AGENT = "0123456789abcdef"  # the hash of a policy


@pytest.fixture(scope="module")
def between_scripts(suites):
    return records_of("expert-spread", suites["public"])


@pytest.fixture(scope="module")
def records(between_scripts):
    """Records as of an agent, whose rounds may differ in their last bits."""
    return [dataclasses.replace(record, fingerprint=AGENT) for record in between_scripts]


@pytest.fixture(scope="module")
def span(suites):
    """Return the span of a round's return from score 0 to 100."""
    scale = suites["public"].scale
    return (scale.top - scale.zero) * suites["public"].scenario.steps_per_round


def records_of(script, suite):
    return [play(*pairing) for pairing in pairings([player_entry(script)], suite)[:2]]


def changed(records, **values):
    return [dataclasses.replace(records[0], **values), *records[1:]]


def disagreements(played, kept, suites):
    return RECORD.of(replays_of(played, kept, suites.values()))


def count_identical(played, kept, suites):
    return sum(RECORD.is_same(each.now, each.then) for each in replays_of(played, kept, suites.values()))


def moved(line, **sums):
    return line.tally | {name: line.tally[name] + by for name, by in sums.items()}


def test_the_same_lines_and_those_of_another_machine_agree(records, suites):
    assert (disagreements(records, records, suites), count_identical(records, records, suites)) == ([], 2)
    kept = changed(records, rounds_sha256="other", returns=tuple(x + 0.01 for x in records[0].returns))
    assert (disagreements(records, kept, suites), count_identical(records, kept, suites)) == ([], 1)
    assert disagreements(records[1:], changed(records, lost=50), suites) == []  # only some are compared


@pytest.mark.parametrize(("count", "agrees"), [(2, True), (3, False)])
def test_one_round_of_a_hundred_may_be_another(records, suites, span, count, agrees):
    """Over all records that are compared, as long as the mean against the rival holds."""
    returns = list(records[0].returns)
    for k in range(count):
        returns[k] += 0.01 * span * (-1) ** k
    kept = changed(records, returns=tuple(returns), rounds_sha256="")
    differing = disagreements(records, kept, suites)
    assert differing == ([] if agrees else ["1.5 % of 200 rounds return something else"])


def test_other_means_sums_points_and_lost_rounds_are_told(records, suites, span):
    then, points = records[0], [0] * len(records[0].ally_points)
    where, steps, jammed = f"ally-v2, {then.rival}", then.tally["steps"], then.tally["jammed"]
    returns = (then.returns[0] + 2 * span, *then.returns[1:])
    (line,) = disagreements(records, changed(records, returns=returns, rounds_sha256="other"), suites)
    assert line.startswith(f"{where}: mean return ")
    kept = changed(records, tally=moved(then, jammed=0.01 * steps), ally_points=(1, *points[1:]), lost=9)
    assert disagreements(records, kept, suites) == [
        f"{where}: lost 0, the result says 9",
        f"{where}: jammed {jammed:g}, the result says {jammed + 0.01 * steps:g}",
        f"{where}: ally_points of point 1 {then.ally_points[0]}, the result says 1",
    ]


@pytest.mark.parametrize(
    ("name", "share"),
    [
        *(("comb", 0.002), ("opponent_return", 0.08), ("snr_db", 0.002), ("hop_bits", 0.002)),
        *(("capacity_mbit_s", -0.002), ("hops", 0.002), ("near", 0.002)),
    ],
)
def test_sums_are_compared_by_what_they_are_worth(records, suites, name, share):
    tally = records[0].tally
    unit = abs(tally[name]) if name in ("snr_db", "capacity_mbit_s", "hop_bits") else tally["steps"]
    for by, agrees in ((share / 4, True), (share, False)):
        kept = changed(
            records,
            tally=moved(records[0], **{name: by * unit}),
            rounds_sha256="other",
            returns=tuple(x + 0.01 for x in records[0].returns),
        )
        assert (disagreements(records, kept, suites) == []) is agrees


def test_rounds_that_return_the_same_have_the_same_sums_whatever_their_hash_is(records, suites):
    then = records[0]
    moved_points = list(then.ally_points)
    moved_points[0] += 1
    for values, name in (
        ({"tally": moved(then, longest_outage=1.0)}, "longest_outage"),
        ({"tally": moved(then, jammed=1.0)}, "jammed"),
        ({"lost": 1}, "lost 0, the result says 1"),
        ({"ally_points": tuple(moved_points)}, "ally_points of point 1 "),
    ):
        (line,) = disagreements(records, changed(records, rounds_sha256="other", **values), suites)
        assert name in line


def test_an_outage_is_no_longer_than_a_round_and_one_of_a_hundred_may_be_lost(records, suites):
    then, steps = records[0], suites["public"].scenario.steps_per_round
    returns = tuple(x + 0.01 for x in then.returns)
    for values, agrees in (
        ({"tally": moved(then, longest_outage=steps / 2)}, True),
        ({"tally": moved(then, longest_outage=2 * steps)}, False),
        ({"tally": moved(then, steps=1)}, False),
        ({"lost": 1}, True),
        ({"lost": 2}, False),
    ):
        kept = changed(records, rounds_sha256="other", returns=returns, **values)
        assert (disagreements(records, kept, suites) == []) is agrees


def test_a_record_of_another_player_is_told(records, suites):
    (line,) = disagreements(records, changed(records, fingerprint="another"), suites)
    assert line.endswith(f"fingerprint {AGENT!r}, the result says 'another'")


def test_rounds_between_scripts_are_the_same_to_the_bit(between_scripts, suites):
    assert disagreements(between_scripts, between_scripts, suites) == []
    for digest in ("", "other"):
        (line,) = disagreements(between_scripts, changed(between_scripts, rounds_sha256=digest), suites)
        assert "other rounds, though scripts play the same to the bit on every machine" in line


def test_records_of_two_suites_are_kept_apart(records, suites):
    other = dataclasses.replace(suites["public"], season="5eed", matches=2)
    both = suites | {"unseen": other}
    played = records_of("expert-spread", other)
    assert disagreements(played, [*records, *played], both) == []
    edited = changed(played, lost=2)
    assert len(disagreements(played, [*records, *edited], both)) == 1
    assert disagreements(records, [*records, *edited], both) == []


def test_every_field_of_a_record_has_a_tolerance_or_a_reason():
    """A new field that no comparison reads is refused when the table is made."""
    wider = dataclasses.make_dataclass("Wider", [("more", int, 0)], bases=(Record,), frozen=True)
    declared = dict.fromkeys(fields_of(Record), EXACT)
    Tolerances(Record, **declared)
    for kind, tolerances in ((wider, declared), (Record, declared | {"more": EXACT})):
        with pytest.raises(TypeError, match=r"how far these fields may differ .*: more"):
            Tolerances(kind, **tolerances)


def test_no_field_of_a_record_between_scripts_can_be_edited(between_scripts, suites):
    record = dataclasses.replace(between_scripts[0], plans=Plans({"plan": 3}, 5, 1.0, {"far": 1}))
    played = [record, between_scripts[1]]
    edits = {
        "returns": (record.returns[0] + 1e-3, *record.returns[1:]),
        "tally": [record.tally | {name: value * 1.00001 + 1e-5} for name, value in record.tally.items()],
        "ally_points": (1 + record.ally_points[0], *record.ally_points[1:]),
        "jam_points": (*record.jam_points, 0),
        "plans": [
            None,
            *(dataclasses.replace(record.plans, **{name: value}) for name, value in _OTHER_PLANS.items()),
        ],
    }
    looked_up = {"suite", "suite_hash", "training_seed", "rival"}  # by them a record is found
    for name in fields_of(Record) - looked_up:
        other = edits[name] if name in edits else _other(getattr(record, name))
        for edited in other if isinstance(other, list) else [other]:
            kept = changed(played, **{name: edited})
            assert disagreements(played, kept, suites), (name, edited)
            assert count_identical(played, kept, suites) == 1
    slower = dataclasses.replace(record.plans, seconds=2.0)
    assert disagreements(played, changed(played, plans=slower), suites) == []
    assert count_identical(played, changed(played, plans=slower), suites) == 2


def _other(value):
    return f"{value}x" if isinstance(value, str) else value + 1


_OTHER_PLANS = {"statuses": {"plan": 4}, "tokens": None, "useless": {"near": 1}}


@pytest.mark.parametrize("name", TALLIES)
def test_a_sum_that_only_one_of_two_records_has_is_told(records, suites, name):
    fewer = changed(records, tally={key: value for key, value in records[0].tally.items() if key != name})
    lines = disagreements(records, fewer, suites)
    assert any(f"{name} " in line and line.endswith("the result says None") for line in lines)
    assert count_identical(records, fewer, suites) == 1
    lines = disagreements(records, changed(records, tally=records[0].tally | {"new": 1.0}), suites)
    assert [line.endswith("new None, the result says 1") for line in lines] == [True]


def test_the_seconds_of_planning_do_not_make_another_line():
    slow = record(plans=dataclasses.replace(PLANS, seconds=9.0))
    assert RECORD.changed(slow, record(plans=PLANS)) == []
    assert RECORD.changed(slow, record(plans=dataclasses.replace(PLANS, tokens=41))) == ["plans"]
    assert RECORD.changed(record(), record(returns=(10.0, 20.001))) == ["returns"]


def test_rounds_that_are_dealt_out_move_a_number_further_than_the_mean():
    """Two numbers may be apart by twice the share where their mean is not; a mean further than it is told."""

    @dataclasses.dataclass
    class Row:
        rewards: tuple[float, ...]

    def lines(*rewards, dealt=True, is_same=False):
        replay = Replayed(Row(rewards), Row((10.0, 20.0)), {"ally": 100.0}, False, is_same)
        return list(Within(0.01, "ally", dealt=dealt).differences("rewards", [replay]))

    assert lines(11.9, 20.0) == []  # the mean moves by 0.95
    assert lines(11.9, 18.1) == []
    (line,) = lines(11.1, 21.1)
    assert line == "rewards 16.1, the result says 15"
    (line,) = lines(12.2, 17.9)
    assert line == "rewards of training seed 1 12.2, the result says 10"
    (line,) = lines(11.1, 20.0, dealt=False)
    assert line == "rewards of training seed 1 11.1, the result says 10"
    assert lines(10.00005, 20.0, is_same=True) == []  # a mean of the same rounds is rounded once more
    assert len(lines(10.0003, 20.0, is_same=True)) == 1


def test_a_verdict_counts_what_differs():
    assert judge(["a", "b", "c"], "text") == (False, "the result does not hold: a (and 2 more)")
    assert judge(["a"], "text") == (False, "the result does not hold: a")
    assert judge([], "text") == (True, "holds: text")
    assert judge(["a"], "text", update=True) == judge(None, "text") == (True, "verified: text")
