"""Readings of the paper: named, read back, refused where they cannot be."""

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import PAPER
from fpg_bench.paper.readings import LETTER, POINTS, as_reading, every_reading


def test_the_letter_is_the_preset_paper_in_matches_of_ten_rounds():
    assert as_reading(LETTER).scenario() == dataclasses.replace(PAPER, rounds_per_match=10)


def test_every_setting_changes_what_is_played():
    letter = as_reading(LETTER)
    for point, known in POINTS.items():
        for setting in list(known)[1:]:
            other = as_reading(f"{point}={setting}")
            assert other.scenario() != letter.scenario(), (point, setting)
            assert letter.but(**{point.replace("-", "_"): setting}) == other


def test_all_readings_have_names_of_their_own_that_give_them_back():
    found = list(every_reading())
    assert len({reading.name for reading in found}) == len(found) == 768
    assert [as_reading(reading.name) for reading in found] == found
    assert found[0].name == LETTER


def test_some_points_alone():
    assert [reading.name for reading in every_reading(["k", "speed"])] == [
        "letter",
        "speed=fixed",
        "k=power",
        "k=power,speed=fixed",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("interferance=once", "unknown point 'interferance'; did you mean 'interference'"),
        ("interference=thrice", "interference: expected one of twice, once, got 'thrice'"),
        ("k=power,k=level", "k is settled twice, power and level"),
        ("", "unknown point ''"),
    ],
)
def test_what_cannot_be_read_is_said_in_a_line(text, words):
    with pytest.raises(UserError, match=words):
        as_reading(text)
    with pytest.raises(UserError, match="unknown point 'speeed'; did you mean 'speed'"):
        list(every_reading(["speeed"]))
