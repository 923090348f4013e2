"""Processes of the package's own look for waste less often, and not as they end."""

import pytest

from tests.programs import python

ENDS = """
import atexit, gc
from fpg_bench.jobs.process import collect_less
gc.set_threshold(FIRST, 11, 12)
gc.unfreeze()
atexit.register(lambda: print(gc.get_freeze_count() > 10_000))  # the first to come is the last to go
collect_less()
print(*gc.get_threshold(), gc.get_freeze_count())
"""


@pytest.mark.process
@pytest.mark.parametrize(("first", "then"), [(700, 10_000), (20_000, 20_000), (0, 0)])
def test_it_looks_less_often_and_not_as_it_ends(first, then):
    found = python("-c", ENDS.replace("FIRST", str(first)))
    assert found.stdout.split() == [str(then), "11", "12", "0", "True"], found.stderr
