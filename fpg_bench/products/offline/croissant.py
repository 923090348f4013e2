"""Croissant metadata of a data set, with the fields of responsible AI, for search engines and hubs.

The vocabularies are those of https://docs.mlcommons.org/croissant/docs/croissant-spec.html and
https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html.
"""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath

from fpg_bench.common.strict_json import Json
from fpg_bench.products.offline.spec import DatasetSpec
from fpg_bench.version import __version__

# Terms of the standard context, with those that are not used here.
_TERMS = "citeAs column equivalentProperty extract field fileProperty fileObject fileSet format includes"
_TERMS += " isLiveDataset jsonPath key md5 parentField path recordSet references regex repeated replace"
_TERMS += " samplingRate separator source subField transform"
_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{term: f"cr:{term}" for term in _TERMS.split()},
}
_FORMATS = {".hdf5": "application/x-hdf5", ".json": "application/json"}


def croissant(spec: DatasetSpec, folder: Path) -> Json:
    """Return the Croissant metadata of a data set that is finished today, as JSON-LD.

    Args:
        spec: its specification.
        folder: the folder that holds its ``data``, which is read for the hashes of the files.
    """
    players, rivals = (", ".join(dict.fromkeys(names)) for names in (spec.players, spec.rivals))
    paths = sorted((folder / "data").iterdir())
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": spec.name,
        "description": f"{spec.description} {spec.episodes} rounds in Minari's format.",
        "version": f"{spec.name.rpartition('-v')[2]}.0.0",
        "license": "https://spdx.org/licenses/MIT.html",
        "creator": {"@type": "sc:Organization", "name": "the fpg-bench authors"},
        "keywords": ["anti-jamming", "UAV", "offline reinforcement learning", "Minari"],
        "citeAs": f"The fpg-bench authors. fpg-bench {__version__}, data set {spec.name}.",
        "distribution": [
            _file_object(path.relative_to(folder).as_posix(), path.read_bytes()) for path in paths
        ],
        "rai:dataCollectionType": ["Software Collection"],
        "rai:dataLimitations": [
            "A simulation: nothing was measured on a radio, and the scenario's channel, flight and detection "
            "are models."
        ],
        "rai:dataSocialImpact": (
            "Jamming and its avoidance have civil and military uses; no number is that of a real system."
        ),
        "rai:dataCollection": (
            f"Made by fpg-bench {__version__} from the seeds {spec.first_seed} to "
            f"{spec.first_seed + spec.episodes - 1}: simulated rounds of the scenario {spec.scenario}, "
            f"in which the {spec.side} was played by {players} and the {spec.other_side} by {rivals}."
        ),
        "rai:dataUseCases": ["Offline reinforcement learning and imitation in the frequency point game."],
        "rai:dataBiases": [
            "States and actions are those of the players and rivals that are named; others are not covered."
        ],
        "rai:personalSensitiveInformation": ["None: there are no people in the data."],
        "rai:dataReleaseMaintenancePlan": (
            "The content of a version never changes; changed rules or players make another version."
        ),
        "datePublished": datetime.now(UTC).date().isoformat(),
    }


def _file_object(name: str, content: bytes) -> Json:
    """Return the description of a file.

    Args:
        name: its path from the metadata's file, with forward slashes.
        content: its content.
    """
    path = PurePosixPath(name)
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": path.name,
        "contentUrl": name,
        "contentSize": f"{len(content)} B",
        "encodingFormat": _FORMATS[path.suffix],
        "sha256": hashlib.sha256(content).hexdigest(),
    }
