"""Settings shared by all tests."""

import re
import signal
from pathlib import Path

from hypothesis import settings

HERE = Path(__file__).parent

# Derandomised: a test that fails for you fails for everybody. No deadlines: no test measures time.
settings.register_profile("fpg_bench", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("fpg_bench")

# A script's background job ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_make_parametrize_id(val):
    """Names of tests without addresses of objects, so that all workers collect the same ones."""
    name = str(val)
    return re.sub(r" at 0x[0-9a-f]+", "", name) if " at 0x" in name else None


def pytest_collection_modifyitems(items):
    """The files of this folder first, among them the longest: at the end two workers share short ones."""
    items.sort(key=lambda item: item.path.parent != HERE)
