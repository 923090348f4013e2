"""Names of interpretations."""

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import PAPER
from scripts.interpretations.interpretations import (
    AS_PRINTED,
    POINTS,
    all_interpretations,
    parse_interpretation,
)


def test_as_printed_is_the_preset_paper_in_matches_of_ten_rounds():
    assert parse_interpretation(AS_PRINTED).scenario() == dataclasses.replace(PAPER, rounds_per_match=10)


def test_every_setting_changes_the_scenario():
    printed = parse_interpretation(AS_PRINTED)
    for point, known in POINTS.items():
        for setting in list(known)[1:]:
            other = parse_interpretation(f"{point}={setting}")
            assert other.scenario() != printed.scenario(), (point, setting)
            assert printed.replace(**{point.replace("-", "_"): setting}) == other


def test_names_of_interpretations_are_unique_and_can_be_parsed():
    interpretations = list(all_interpretations())
    assert len({interpretation.name for interpretation in interpretations}) == len(interpretations) == 768
    assert [
        parse_interpretation(interpretation.name) for interpretation in interpretations
    ] == interpretations
    assert interpretations[0].name == AS_PRINTED


def test_interpretations_of_some_points():
    assert [interpretation.name for interpretation in all_interpretations(["k", "speed"])] == [
        "as-printed",
        "speed=fixed",
        "k=power",
        "k=power,speed=fixed",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("interferance=once", "unknown point 'interferance'; did you mean 'interference'"),
        ("interference=thrice", "interference: expected one of twice, once, got 'thrice'"),
        ("k=power,k=level", "k is resolved twice, power and level"),
        ("", "unknown point ''"),
    ],
)
def test_malformed_names_are_refused_in_one_line(text, message):
    with pytest.raises(UserError, match=message):
        parse_interpretation(text)
    with pytest.raises(UserError, match="unknown point 'speeed'; did you mean 'speed'"):
        list(all_interpretations(["speeed"]))
