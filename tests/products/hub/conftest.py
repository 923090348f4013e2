"""A Hub on loopback for each test, and an empty cache."""

import pytest
from huggingface_hub import constants

from fpg_bench.products.hub.download import resolve
from fpg_bench.products.sandbox import process
from tests.products.hub.hub_server import TOKEN, HubServer


def point_at(url, cache, patch):
    """Lead the client library, which reads its environment when it is imported, to a server."""
    patch.setattr(constants, "ENDPOINT", url)
    patch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", url + "/{repo_id}/resolve/{revision}/{filename}")
    patch.setattr(constants, "HF_HOME", str(cache))
    patch.setattr(constants, "HF_HUB_CACHE", str(cache / "hub"))
    registry = "huggingface_hub.utils._detect_agent._registry"  # else it asks the server for one
    patch.setattr(registry, {"standardEnvVars": [], "harnesses": {}}, raising=False)
    patch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    resolve.cache_clear()


@pytest.fixture
def hub(tmp_path, monkeypatch):
    with HubServer() as server:
        point_at(server.url, tmp_path / "cache", monkeypatch)
        monkeypatch.setenv("HF_TOKEN", TOKEN)
        monkeypatch.setattr(process, "forget_keys", list)  # those of the tests
        yield server
        resolve.cache_clear()
