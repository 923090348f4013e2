"""Settings shared by all tests."""

import gc
import logging
import os
import re
import signal
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

from tests.logged import logged

# Workers share the cores, and networks as small as ours only wait for a second thread.
os.environ.setdefault("OMP_NUM_THREADS", "1")

HERE = Path(__file__).parent
PRODUCTS = HERE.parent / "fpg_bench" / "products"
LONG = {"browser", "postgres", "ray", "slow"}
FULL = {"browser", "llama", "postgres", "ray"}  # what a user's machine may lack

# Derandomised: a test that fails for you fails for everybody. No deadlines: no test measures time.
settings.register_profile("fpg_bench", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("fpg_bench")

# A script's background job ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="module", autouse=True)
def own_data_folder(tmp_path_factory):
    """A data folder of the module's own: what one exports is no other's, nor this user's."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("data")))
        yield


def pytest_make_parametrize_id(val):
    """Names of tests without addresses of objects, so that all workers collect the same ones."""
    name = str(val)
    return re.sub(r" at 0x[0-9a-f]+", "", name) if " at 0x" in name else None


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Look for no waste among five thousand tests and what they import: all stays, and it takes seconds."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Skip a module of tests that imports a product which was deleted."""
    report = yield
    found = re.search(r"No module named '(?:\w+\.)?products(?:\.(\w+))?", str(report.longrepr or ""))
    if report.failed and found and not (PRODUCTS / (found[1] or "")).is_dir():
        report.outcome, report.result = "skipped", []
        report.longrepr = (str(collector.path), 0, f"made without the product {found[1] or ''}")
    return report


@pytest.hookimpl(tryfirst=True)  # before some are left out by their marks
def pytest_collection_modifyitems(items):
    """Mark who asks a real language model and what make test leaves out; the longest files come first.

    They are those of this folder, then those with most that trains or starts something large.
    """
    for item in items:
        if "llama_server" in getattr(item, "fixturenames", ()):
            item.add_marker("llama")
        if FULL & {mark.name for mark in item.iter_markers()}:
            item.add_marker("full")
    long = Counter(item.path for item in items if {mark.name for mark in item.iter_markers()} & LONG)
    items.sort(key=lambda item: (item.path.parent != HERE, -long[item.path]))


@pytest.fixture(autouse=True)
def no_handlers_left():
    """A command line called within a test prints messages during that test alone."""
    yield
    logging.getLogger("fpg_bench").handlers.clear()


@pytest.fixture
def messages():
    """The package's log messages during the test."""
    with logged() as messages:
        yield messages
