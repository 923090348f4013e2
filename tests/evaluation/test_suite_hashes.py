"""The suites that are committed stay what they are: results name them by their hash."""

from __future__ import annotations

import pytest

from fpg_bench.evaluation.suite import load_suite
from fpg_bench.players.agent import suites_folder

# A suite that changes is another suite, with a name of its own; a new one is added here.
HASHES = {
    "ally-paper-v1": "a7be5dd53db0a6f75a04c360701e2abcf13d926a628cace8b63e6322842c1216",
    "ally-planner-v1": "9542ff8bb4e492ff7b4f8fb7e1af000b7c1a4072183944a56703fef411a857bf",
    "ally-responses-v1": "925e5b7f5cf4358f40e731c5538c97b4de25e0efffa60b38fcbb00cbfe5066ac",
    "ally-season-1": "da468645b77eeceb515c26611e21e4f1687e0066e7a88aaf2275d9e04ba0359a",
    "ally-shifted-v1": "f4f4d87ca97c752544bb2e1b50fa2a01bdf7fb3aa47e8535bc2b1533cd87a804",
    "ally-v1": "1c8703d86b80810d5af185793ea1a4ccfa44f66e55727e7538d5bc7642466430",
    "opponent-learned-responses-v1": "146cc0428850323b4a1c28d527a783d1a0240ed07a6b019e52cfa9b358fb6f37",
    "opponent-learned-season-1": "eaf80a78d88790543cffb9c3a71fbb62583c9b0a574aca6f9de92b10a724dadb",
    "opponent-learned-shifted-v1": "343d70a64e57347bfbe7a00c5e05a3dcd59afd2581e7c12b3b097880eb4c904b",
    "opponent-learned-v1": "1d923106e265ed617fb5f990c9d2ec73e8e0052474d17189f8a366b835c42efb",
    "opponent-paper-v1": "de7ba4370ee1e78ed09d5c7e264f71a6195ba0dde2040b633caa18e050c7d81a",
    "opponent-responses-v1": "5678490f1303556f3f5ee85cbd003e52cde610896af53a205a917f5229405484",
    "opponent-season-1": "8e1fdce6ea0eb7739eaa881e80e02c7f7621c176850fab4af6aa47258ff8a2f2",
    "opponent-shifted-v1": "cda7571c9bbfe432dd2baf1ec7c890cbc08ea035f3c0549968a4f33636438ea8",
    "opponent-v1": "3a8daa473f345272e6a94cf477f557a78646c7bf780ca1a88827c6fa6636eaf1",
    "planner-season-1": "eaaf12cd0add25ad04bff2dd10f601c6cfd1040d57fc8a9473470d74ba477914",
    "planner-v1": "c73eed222cd62de8f0c73c1fd27d5f49f8d5bbace21c95f39b84d34540128a1b",
}


def test_every_committed_suite_is_pinned():
    assert {path.stem for path in suites_folder().glob("*.yml")} == set(HASHES)


@pytest.mark.parametrize(("name", "expected"), HASHES.items())
def test_the_hashes_of_the_suites_are_pinned(name, expected):
    assert load_suite(name).hash == expected
