"""Settings shared by all tests."""

import re
from collections import Counter

from hypothesis import settings

# Derandomised: a test that fails for you fails for everybody. No deadlines: no test measures time.
settings.register_profile("fpg_bench", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("fpg_bench")


def pytest_collection_modifyitems(items):
    """Names of tests without addresses of objects, so that all workers collect the same ones."""
    seen = Counter()
    for item in items:
        name = re.sub(r" at 0x[0-9a-f]+", "", item.nodeid)
        seen[name] += 1
        item._nodeid = name if seen[name] == 1 else f"{name}#{seen[name]}"
