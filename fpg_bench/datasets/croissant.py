"""Croissant metadata of a data set, with the fields of responsible AI, for search engines and hubs.

The vocabularies are those of https://docs.mlcommons.org/croissant/docs/croissant-spec.html and
https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from fpg_bench.datasets.spec import DatasetSpec
from fpg_bench.version import __version__

_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "citeAs": "cr:citeAs",
    "conformsTo": "dct:conformsTo",
}
_FORMATS = {".hdf5": "application/x-hdf5", ".json": "application/json"}


def croissant(spec: DatasetSpec, folder: Path) -> dict[str, Any]:
    """Return the Croissant metadata of a data set as JSON-LD.

    Args:
        spec: its specification.
        folder: the folder that holds its ``data``, which is read for the hashes of the files.
    """
    players, rivals = (", ".join(dict.fromkeys(names)) for names in (spec.players, spec.rivals))
    files = [_file(path, folder) for path in sorted((folder / "data").iterdir())]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": spec.name,
        "description": f"{spec.description} {spec.episodes} rounds in Minari's format.",
        "version": f"{spec.name.rpartition('-v')[2]}.0.0",
        "license": "https://spdx.org/licenses/MIT.html",
        "creator": {"@type": "sc:Organization", "name": "the fpg-bench authors"},
        "keywords": ["offline reinforcement learning", "anti-jamming", "UAV", "Minari"],
        "citeAs": f"The fpg-bench authors. fpg-bench {__version__}, data set {spec.name}.",
        "distribution": files,
        "rai:dataCollectionType": ["Software Collection"],
        "rai:dataCollection": (
            f"Made by fpg-bench {__version__} from the seeds {spec.first_seed} to "
            f"{spec.first_seed + spec.episodes - 1}: simulated rounds of the scenario {spec.scenario}, in "
            f"which the {spec.side} was played by {players} and the {spec.other_side} by {rivals}."
        ),
        "rai:dataUseCases": ["Offline reinforcement learning and imitation in the frequency point game."],
        "rai:dataLimitations": [
            "A simulation: nothing was measured on a radio, and the scenario's channel, flight and detection "
            "are models."
        ],
        "rai:dataBiases": [
            "States and actions are those of the players and rivals that are named; others are not covered."
        ],
        "rai:personalSensitiveInformation": ["None: there are no people in the data."],
        "rai:dataSocialImpact": (
            "Jamming and its avoidance have civil and military uses; no number is that of a real system."
        ),
        "rai:dataReleaseMaintenancePlan": (
            "The content of a version never changes; changed rules or players make another version."
        ),
    }


def _file(path: Path, folder: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    name = path.relative_to(folder).as_posix()
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": path.name,
        "contentUrl": name,
        "contentSize": f"{path.stat().st_size} B",
        "encodingFormat": _FORMATS[path.suffix],
        "sha256": sha256,
    }
