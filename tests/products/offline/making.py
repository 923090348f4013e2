"""Small data sets for tests."""

from __future__ import annotations

import json
from pathlib import Path

from fpg_bench.common.schema import parse
from fpg_bench.products.offline.make import METADATA, RECIPE
from fpg_bench.products.offline.spec import DatasetSpec

AGENT = "ally-scripted/td3/seed_0"
ALLIES, OPPONENTS = ("random", "expert", "always-hop"), ("tone", "adaptive", "random")


def tiny(rounds: int = 5, **changes: object) -> DatasetSpec:
    """Return a specification of a few rounds."""
    content = {
        "name": "tiny-v0",
        "description": "For tests.",
        "side": "ally",
        "behaviour": "mixed",
        "players": ALLIES,
        "rivals": OPPONENTS,
        "best": "expert",
        "steps": 300 * rounds,
        "seed": 99,
    }
    return parse(DatasetSpec, content | changes, "tiny")


def metadata(folder: Path) -> dict:
    """Return the metadata of a data set."""
    return json.loads((folder / "data" / METADATA).read_text())


def sha256(folder: Path) -> str:
    """Return the hash of a data set's content, as its metadata say it."""
    return metadata(folder)[RECIPE]["content_sha256"]


def rewrite(folder: Path, **changes: object) -> None:
    """Change what the metadata say of the making of a data set."""
    content = metadata(folder)
    content[RECIPE] |= changes
    (folder / "data" / METADATA).write_text(json.dumps(content))
