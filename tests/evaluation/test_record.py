import json

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.record import TALLIES, Plans, Record, pool, read_record

TALLY = dict.fromkeys(TALLIES, 0.0) | {"steps": 600.0, "ally_return": 30.0}


def record(**changes):
    head = {"suite": "mine", "suite_hash": "0123456789abcdef", "entry": "ppo", "training_seed": 0}
    rival = {"fingerprint": "fedcba9876543210", "rival": "tone/pursuit", "rounds_sha256": "ab" * 32}
    played = {"returns": (10.0, 20.0), "tally": TALLY, "lost": 0}
    points = {"ally_points": (400, 200), "jam_points": (0, 600)}
    return Record(**head | rival | played | points | changes)


PLANS = Plans({"ok": 3, "fallback-http": 1}, tokens=40, seconds=0.5)


@pytest.mark.parametrize("plans", [None, PLANS])
def test_a_record_is_read_as_it_was_written(plans):
    row = json.loads(json.dumps(record(plans=plans).row()))
    assert ("plans" in row) == (plans is not None)
    assert read_record(row, "lines") == record(plans=plans)


def test_pooled_are_sums_and_the_longest_outage_is_the_greatest():
    one = record(tally=TALLY | {"longest_outage": 4.0, "jammed": 60.0})
    other = record(
        training_seed=1,
        tally=TALLY | {"longest_outage": 18.0, "jammed": 0.0, "steps": 300.0},
        returns=(5.0,),
        lost=1,
    )
    found = pool([one, other])
    assert (found.rounds, found.lost) == (3, 1)
    assert found.measures["outage_longest_s"] == 18.0
    assert found.measures["jamming_success_rate"] == 60 / 900  # of all steps, no mean of shares
    assert found.measures["ally_return"] == 60 / 3
    assert found.histogram.tolist() == [[800, 400], [0, 1200]]
    assert found.plans is None


def test_the_order_of_lines_does_not_matter():
    rng = np.random.default_rng(1)
    records = [record(training_seed=k, tally=TALLY | {"snr_db": rng.normal() * 1e3}) for k in range(20)]
    assert pool(records).tally == pool(records[::-1]).tally


def test_plans_are_counted_together():
    found = pool([record(plans=PLANS), record(plans=Plans({"ok": 4}, tokens=20, seconds=1.0))]).plans
    assert found == Plans({"fallback-http": 1, "ok": 7}, tokens=60, seconds=1.5)
    signs = [Plans({"ok": 4}, 20, 1.0, useless) for useless in ({"still": 1}, {}, {"still": 2, "example": 1})]
    every = pool([record(plans=plans) for plans in signs]).plans
    assert (every.useless, every.valid_but_useless) == ({"example": 1, "still": 3}, 1 / 3)
    assert PLANS.valid_but_useless is None
    for plans in (PLANS, signs[0], signs[1]):
        assert read_record(json.loads(json.dumps(record(plans=plans).row())), "here").plans == plans
    assert found.valid == pytest.approx(7 / 8)


def test_only_language_models_have_a_valid_share():
    for statuses, tokens, valid in (
        ({"ok": 4}, 40, 1),
        ({"ok": 1, "fallback-http": 3}, 0, 0.25),
        ({"fallback-timeout": 2}, None, 0),
        ({"ok": 4}, None, None),
        ({}, None, None),
    ):
        assert Plans(statuses, tokens).valid == valid


def test_a_record_without_the_clean_rates_of_later_versions_is_read_and_is_the_same():
    rates = TALLY | {"capacity_mbit_s": 50.0}
    later, earlier = record(tally=rates | {"clean_mbit_s": 100.0}), record(tally=rates)
    assert read_record(json.loads(json.dumps(later.row())), "here") == later
    assert pool([later, later]).measures["survived_share"] == 0.5
    assert pool([later, earlier]).measures["survived_share"] is None


def test_a_measure_that_is_counted_later_leaves_older_records_as_they_are(monkeypatch):
    old = json.loads(json.dumps(record().row()))
    monkeypatch.setattr("fpg_bench.evaluation.record._NAMES", (*TALLIES, "clean_hits"))
    new = record(tally=TALLY | {"clean_hits": 3.0})
    assert read_record(json.loads(json.dumps(new.row())), "here") == new
    assert read_record(old, "here") == record()
    assert pool([new, new]).tally["clean_hits"] == 6.0
    assert "clean_hits" not in pool([new, record()]).tally
    assert pool([new, record()]).measures == pool([record(), record()]).measures


def test_a_tally_has_declared_names_in_any_order():
    turned = dict(reversed(TALLY.items()))
    assert read_record(record(tally=turned).row(), "here") == record()
    lacking = {name: TALLY[name] for name in TALLIES if name != "heard"}
    for tally, message in (
        (lacking, "^here: tally: lacks heard$"),
        (TALLY | {"hop_bit": 1.0}, "^here: tally: unknown key 'hop_bit'; did you mean 'hop_bits'"),
    ):
        with pytest.raises(UserError, match=message):
            read_record(record(tally=tally).row(), "here")
