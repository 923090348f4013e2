"""Settings shared by all tests."""

import re

from hypothesis import settings

# Derandomised: a test that fails for you fails for everybody. No deadlines: no test measures time.
settings.register_profile("fpg_bench", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("fpg_bench")


def pytest_make_parametrize_id(val):
    """Names of tests without addresses of objects, so that all workers collect the same ones."""
    name = str(val)
    return re.sub(r" at 0x[0-9a-f]+", "", name) if " at 0x" in name else None
