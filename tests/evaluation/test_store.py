"""Stores of records: what is missing, filling after a kill and by workers, and what is refused."""

from __future__ import annotations

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation import store as storing
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.store import Pairing, Store, pairings
from fpg_bench.evaluation.suite import load_suite


def small(matches=1):
    """The first rivals of a suite, met in few matches."""
    suite = load_suite("ally-v2")
    return dataclasses.replace(suite, matches=matches, rivals=suite.rivals[:3])


def wanted(suite, *names):
    return pairings([player_entry(name) for name in names or ("expert", "idle")], suite)


@pytest.fixture(params=["file", "memory"])
def store(request, tmp_path):
    return Store(tmp_path / "deep" / "records.jsonl" if request.param == "file" else None)


def test_what_is_missing_is_played_once_and_told_in_the_order_that_was_asked_for(store, monkeypatch):
    every = wanted(small())
    assert store.missing(every) == every
    assert store.missing([*every, *every]) == every
    with pytest.raises(UserError, match="none of expert - tone/pursuit; play it first"):
        store.of(every)
    first = store.fill(every[2:4])
    assert store.missing(every) == [*every[:2], *every[4:]]
    records = store.fill(every)
    assert [record.key for record in records] == [pairing.key for pairing in every]
    assert records[2:4] == first
    assert records == [play(*pairing) for pairing in every]
    monkeypatch.setattr(storing, "play", None)  # nothing is played any more
    assert store.fill(every[::-1]) == records[::-1]
    assert len(store.records()) == len(every)


def test_progress_is_told_of_what_is_played_alone(store):
    every, told = wanted(small(), "expert"), []
    store.fill(every[:1])
    store.fill(every, progress=lambda entry, rival, *rounds: told.append((rival.name, *rounds)))
    n, total = small().rounds_per_match, small().rounds_per_match * (len(every) - 1)
    assert told == [
        (pairing.rival.name, number, n * k + number, total)
        for k, pairing in enumerate(every[1:])
        for number in range(n + 1)
    ]


def test_a_suite_its_matches_and_its_season_are_parts_of_the_key(store):
    suite = small()
    store.fill(wanted(suite))
    for other in (small(2), dataclasses.replace(suite, season="1")):
        assert store.missing(wanted(other)) == wanted(other)
    renamed = dataclasses.replace(suite, name="other")  # what is played is the same
    assert store.missing(wanted(renamed)) == []


def test_another_policy_of_the_same_name_is_missing_and_a_store_of_one_suite_refuses_it(store):
    store.fill(wanted(small()))
    impostor = dataclasses.replace(player_entry("expert"), fingerprint="another")
    changed = pairings([impostor], small())
    assert store.missing(changed) == changed
    with pytest.raises(UserError, match=r"holds records of another 'expert' .*choose another folder"):
        store.claim(changed)
    store.claim(wanted(small(), "always-hop"))  # another name is welcome


def test_a_pairing_that_fails_keeps_what_was_there(store):
    entry, suite, rival = wanted(small())[0]
    broken = Pairing(dataclasses.replace(entry, name="broken", make=lambda rival: "no-such"), suite, rival)
    with pytest.raises(UserError, match="no-such"):
        store.fill([Pairing(entry, suite, rival), broken])
    assert [record.entry for record in store.records()] == ["expert"]
