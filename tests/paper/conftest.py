"""Settings shared by the tests of the paper's experiments."""

import platformdirs
import pytest


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """A cache of one's own for what this process keeps; gives the folder of checkpoints."""
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    return tmp_path / "fpg_bench" / "reproduce"
