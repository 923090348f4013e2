"""Croissant metadata, with the fields of responsible AI, for search engines and hubs of data sets.

The vocabularies are those of https://docs.mlcommons.org/croissant/docs/croissant-spec.html and
https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

from fpg_bench.common.strict_json import Json

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
_FORMATS = {".csv": "text/csv", ".hdf5": "application/x-hdf5", ".json": "application/json"}


def metadata(
    name: str,
    description: str,
    version: str,
    cite_as: str,
    keywords: Sequence[str],
    files: Sequence[Json],
    rai: Json,
    **more: object,
) -> Json:
    """Return Croissant metadata as JSON-LD.

    Args:
        name: name of the data set.
        description: what it holds.
        version: three numbers.
        cite_as: how to cite it.
        keywords: for search engines.
        files: see :func:`file_object`.
        rai: properties of responsible AI, without their prefix.
        more: further properties.
    """
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": name,
        "description": description,
        "version": version,
        "license": "https://spdx.org/licenses/MIT.html",
        "creator": {"@type": "sc:Organization", "name": "the fpg-bench authors"},
        "keywords": ["anti-jamming", "UAV", *keywords],
        "citeAs": cite_as,
        "distribution": list(files),
        "rai:dataCollectionType": ["Software Collection"],
        "rai:dataLimitations": [
            "A simulation: nothing was measured on a radio, and the scenario's channel, flight and detection "
            "are models."
        ],
        "rai:dataSocialImpact": (
            "Jamming and its avoidance have civil and military uses; no number is that of a real system."
        ),
        **{f"rai:{key}": value for key, value in rai.items()},
        **more,
    }


def file_object(name: str, content: bytes) -> Json:
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


def record_set(name: str, file: str, columns: Mapping[str, tuple[str, str]]) -> Json:
    """Return the description of a table.

    Args:
        name: name of the table.
        file: name of the CSV file that holds it.
        columns: type (``sc:Text``, ``sc:Integer``, ``sc:Float``) and description of each column.
    """
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"{name}/{column}",
            "name": column,
            "description": description,
            "dataType": kind,
            "source": {"fileObject": {"@id": file}, "extract": {"column": column}},
        }
        for column, (kind, description) in columns.items()
    ]
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "field": fields}
