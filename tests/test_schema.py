"""Validation of data from outside: types, defaults, and one clear line about the first problem."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Literal

import pytest
from pydantic import ConfigDict, Field, ValidationError, model_validator

from fpg_bench.common.errors import UserError
from fpg_bench.common.schema import Expected, Items, NonNegativeInt, PositiveInt, Strict, parse


class Noise(Strict):
    std: Annotated[float, Field(gt=0)] = 0.1
    kind: Literal["normal", "uniform"] = "normal"


class Search(Strict):
    steps: PositiveInt
    seed: NonNegativeInt = 0
    is_fast: bool = False
    noises: Items[Noise] = ()
    by_name: dict[str, Noise] = Field(default_factory=dict)
    rate: float | Literal["auto"] = "auto"
    rival: str | Noise | None = None

    @model_validator(mode="after")
    def _check(self) -> Search:
        if self.is_fast and self.steps > 10:
            raise UserError("a fast search has at most 10 steps")
        return self


@dataclasses.dataclass
class Plain:
    __pydantic_config__ = ConfigDict(extra="forbid")

    length: int
    width: int = 1


def test_valid_data_becomes_a_frozen_object_with_its_defaults():
    search = parse(Search, {"steps": 3, "noises": [{"std": 1}, {"kind": "uniform"}], "rate": 1}, "here")
    assert search == Search(steps=3, noises=(Noise(std=1.0), Noise(kind="uniform")), rate=1.0)
    with pytest.raises(ValidationError):
        search.steps = 4


def test_types_that_are_no_models_are_validated_too():
    assert parse(list[int], [1, 2], "here") == [1, 2]
    assert parse(int | None, None, "here") is None
    assert parse(Plain, {"length": 2}, "here") == Plain(2)
    with pytest.raises(UserError, match=r"^here: unknown key 'widht'; did you mean 'width'"):
        parse(Plain, {"length": 1, "widht": 2}, "here")
    with pytest.raises(UserError, match=r"^here: lacks length$"):
        parse(Plain, {}, "here")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (None, "here: expected a mapping, got None"),
        ({}, "here: lacks steps"),
        ({"stesp": 3}, "here: unknown key 'stesp'; did you mean 'steps'?"),
        ({"steps": 3, 7: 1}, "here: unknown key 7; known: by_name, is_fast"),
        ({"steps": 0}, "here: steps: expected a whole number above 0, got 0"),
        ({"steps": True}, "here: steps: expected a whole number above 0, got True"),
        ({"steps": 3.0}, "here: steps: expected a whole number above 0, got 3.0"),
        ({"steps": 3, "seed": -1}, "here: seed: expected a whole number, 0 or more, got -1"),
        ({"steps": 3, "is_fast": 1}, "here: is_fast: expected true or false, got 1"),
        (
            {"steps": 3, "noises": [{}, {"std": 0}]},
            r"here: noises\[1\].std: expected a number above 0, got 0",
        ),
        ({"steps": 3, "noises": [{"std": float("nan")}]}, r"here: noises\[0\].std: expected a finite number"),
        ({"steps": 3, "noises": [{"sdt": 1}]}, r"here: noises\[0\]: unknown key 'sdt'; did you mean 'std'?"),
        (
            {"steps": 3, "by_name": {"a": {"knd": 1}}},
            "here: by_name.a: unknown key 'knd'; did you mean 'kind'?",
        ),
        (
            {"steps": 3, "by_name": {"a": {"kind": "nomal"}}},
            "here: by_name.a.kind: expected normal or uniform, got 'nomal'; did you mean 'normal'?",
        ),
        (
            {"steps": 3, "rate": "aut"},
            "here: rate: expected a number or auto, got 'aut'; did you mean 'auto'?",
        ),
        ({"steps": 3, "rival": 5}, "here: rival: expected text or a mapping, got 5"),
        ({"steps": 3, "rival": {"std": -1}}, "here: rival.std: expected a number above 0, got -1"),
        ({"steps": 3, "rival": {"kidn": -1}}, "here: rival: unknown key 'kidn'; did you mean 'kind'?"),
        ({"steps": 11, "is_fast": True}, "here: a fast search has at most 10 steps"),
        ({"steps": ["x" * 500]}, r"here: steps: expected a whole number above 0, got \['x{75}\.\.\.$"),
    ],
)
def test_the_first_problem_is_told_in_one_line(data, message):
    with pytest.raises(UserError, match=f"^{message.replace('?', '[?]')}"):
        parse(Search, data, "here")


def test_a_type_words_what_it_expects():
    rate = Annotated[float, Field(gt=0, lt=1), Expected("a share between 0 and 1")]
    with pytest.raises(UserError, match=r"^share: expected a share between 0 and 1, got 2\.5$"):
        parse(rate, 2.5, "share")
