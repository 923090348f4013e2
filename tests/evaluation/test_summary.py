import dataclasses

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.record import TALLIES, Record
from fpg_bench.evaluation.suite import Scale, load_suite
from fpg_bench.evaluation.summary import TrainingCost, summarise, summary_of

STEPS = 300


@pytest.fixture(scope="module")
def suite():
    whole = load_suite("ally-v2")
    return dataclasses.replace(whole, matches=4, rivals=whole.rivals[:3], scale=Scale(zero=-10.0, top=30.0))


def records_of(suite, entry, rewards, seed=None, **tally):
    """One line per rival; ``rewards`` are returns a step, a number or one per rival and match."""
    found = np.broadcast_to(rewards, (len(suite.rivals), suite.rounds)) * STEPS
    points = (0,) * suite.scenario.frequency_points
    sums = dict.fromkeys(TALLIES, 0.0) | {"steps": float(STEPS * suite.rounds)} | tally
    head = {"suite": suite.name, "suite_hash": suite.hash[:16], "entry": entry, "training_seed": seed}
    return [
        Record(
            **head,
            fingerprint=entry,
            rival=rival.name,
            returns=tuple(returns.tolist()),
            tally=sums,
            ally_points=points,
            jam_points=points,
            lost=0,
            rounds_sha256="",
        )
        for rival, returns in zip(suite.rivals, found, strict=True)
    ]


def test_the_score_is_the_mean_over_rivals_on_the_suites_scale(suite):
    (found,) = summarise(records_of(suite, "it", [[0.0] * 4, [10.0] * 4, [20.0] * 4]), suite)
    assert found.reward.value == pytest.approx(10)
    assert found.score.value == pytest.approx(50)  # halfway from -10 to 30
    assert [of.value for of in found.by_rival.values()] == pytest.approx([0, 10, 20])
    assert found.worst == suite.rivals[0].name


def test_training_seeds_are_one_entry_with_its_interval_over_matches(suite):
    of_matches = np.array([1.0, 3.0, 5.0, 7.0])
    records = [
        line
        for k in range(3)
        for line in records_of(suite, "ppo", of_matches + 2 + 4 * k, k)
        for k, reward in enumerate((2.0, 6.0, 10.0))
        for x in records_of(suite, "ppo", of_matches + reward, k)
    ]
    (found,) = summarise(records, suite)
    assert (found.training_seeds, found.score.over) == (3, "matches")
    assert found.samples.mean(axis=1).tolist() == pytest.approx([40, 50, 60])
    half = 3.182446 * np.std([1, 3, 5, 7], ddof=1) / 2 * 100 / 40  # the policies are fixed
    assert (found.score.value, found.score.half) == pytest.approx((50, half), rel=1e-5)
    assert found.by_rival[suite.rivals[0].name].half == pytest.approx(half * 40 / 100, rel=1e-5)
    assert found.seed_scores() == pytest.approx({0: 40, 1: 50, 2: 60})


def test_a_script_and_a_single_seed_vary_over_matches(suite):
    rewards = np.array([[1.0, 3.0, 5.0, 7.0]] * 3)  # what all rivals share does not average out
    for seed, seeds in ((None, 0), (5, 1)):
        (found,) = summarise(records_of(suite, "it", rewards, seed), suite)
        assert (found.training_seeds, found.score.over) == (seeds, "matches")
        half = 3.182446 * np.std([1, 3, 5, 7], ddof=1) / 2
        assert found.reward.half == pytest.approx(half, rel=1e-5)


def test_fewer_than_five_seeds_of_an_algorithm_have_no_rank(suite):
    for count in (1, 4, 5):
        records = [x for k in range(count) for x in records_of(suite, "ppo", 1.0, k)]
        (found,) = summarise(records, suite)
        assert found.has_rank == (count == 5)
        table = dataclasses.replace(found, training=TrainingCost(is_search=True))
        assert table.has_rank  # found by search: another one is no other sample
    (script,) = summarise(records_of(suite, "it", 1.0), suite)
    (oracle,) = summarise(records_of(suite, "oracle", 1.0), suite)
    assert (script.has_rank, oracle.has_rank) == (True, False)


def test_measures_are_pooled_over_all_lines(suite):
    calm = records_of(suite, "ppo", 0.0, 0, longest_outage=3.0, jammed=0.0)
    rough = records_of(suite, "ppo", 0.0, 1, longest_outage=18.0, jammed=600.0)
    (found,) = summarise([*calm, *rough], suite)
    assert found.measures["outage_longest_s"] == 18.0
    assert found.measures["jamming_success_rate"] == pytest.approx(600 / (2 * STEPS * suite.rounds))
    assert found.pooled.rounds == 2 * 3 * suite.rounds


def test_an_entry_without_all_its_lines_is_left_out(suite):
    records = records_of(suite, "ppo", 0.0, 0)[:-1] + records_of(suite, "ppo", 1.0, 1)
    (found,) = summarise(records, suite)
    assert found.training_seeds == 1
    assert summarise(records[:2], suite) == []
    with pytest.raises(UserError, match="suite ally-v2: records of ppo are missing"):
        summary_of(records[:2], suite)
    with pytest.raises(UserError, match="records are missing"):
        summary_of([], suite)


def test_lines_of_another_suite_are_passed_over(suite):
    other = dataclasses.replace(suite, season="1")
    assert summarise(records_of(other, "it", 0.0), suite) == []


def test_lines_with_too_few_rounds_or_other_points_are_no_records_of_the_suite(suite):
    short = [dataclasses.replace(x, returns=x.returns[:-1]) for x in records_of(suite, "it", 0.0)]
    with pytest.raises(UserError, match=r"the record of it against tone/pursuit has 3 rounds, expected 4"):
        summarise(short, suite)
    ragged = records_of(suite, "it", 0.0)
    ragged[1] = dataclasses.replace(ragged[1], ally_points=(1, 2), jam_points=(3, 4))
    with pytest.raises(UserError, match="evaluate again"):
        summarise(ragged, suite)


def test_only_the_rounds_that_count_make_the_score():
    whole = load_suite("planner-v1")
    scenario = dataclasses.replace(whole.scenario, rounds_per_match=4)
    suite = dataclasses.replace(whole, scenario=scenario, matches=2, last_rounds=2, rivals=whole.rivals[:1])
    (found,) = summarise(records_of(suite, "it", [[0.0, 0.0, 5.0, 7.0, 9.0, 9.0, 6.0, 8.0]]), suite)
    assert found.reward.value == pytest.approx(6.5)
    assert found.rewards[0, 0].tolist() == pytest.approx([6, 7])
