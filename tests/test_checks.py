"""What users write is refused in one way, with one line that names the place."""

import numpy as np
import pytest

from fpg_bench.common.checks import check_keys, flag, mapping, whole
from fpg_bench.common.errors import UserError


@pytest.mark.parametrize("value", [1, 7, np.int64(3)])
def test_whole_numbers_are_taken(value):
    assert whole(value, "here") == value


@pytest.mark.parametrize("value", [0, -1, 1.0, 1.5, "2", True, None, [1]])
def test_what_is_no_whole_number_above_0_is_refused(value):
    with pytest.raises(UserError, match=r"^here: expected a whole number above 0, got "):
        whole(value, "here")


def test_0_is_a_number_where_it_may_be_one():
    assert whole(0, "here", least=0) == 0
    with pytest.raises(UserError, match="a whole number, 0 or more, got -1"):
        whole(-1, "here", least=0)


def test_an_unknown_key_is_told_with_the_nearest_and_a_lacking_one_by_its_name():
    check_keys({"a": 1, "b": 2}, {"a", "b", "c"}, "here", needed=["a"])
    with pytest.raises(UserError, match=r"^here: unknown key 'stesp'; did you mean 'steps'"):
        check_keys({"stesp": 1}, {"steps", "seeds"}, "here")
    with pytest.raises(UserError, match=r"^here: lacks steps, seeds$"):
        check_keys({"other": 1}, {"steps", "seeds", "other"}, "here", needed=["steps", "seeds"])


@pytest.mark.parametrize(("check", "value"), [(flag, 1), (flag, "true"), (mapping, [1]), (mapping, None)])
def test_other_kinds_are_refused(check, value):
    with pytest.raises(UserError, match=r"^here: expected "):
        check(value, "here")
