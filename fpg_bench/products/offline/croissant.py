"""Croissant metadata of a data set."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from fpg_bench.common.strict_json import Json
from fpg_bench.products.croissant.description import file_object, metadata
from fpg_bench.products.offline.spec import DatasetSpec
from fpg_bench.version import __version__


def croissant(spec: DatasetSpec, folder: Path) -> Json:
    """Return the Croissant metadata of a data set that is finished today, as JSON-LD.

    Args:
        spec: its specification.
        folder: the folder that holds its ``data``, which is read for the hashes of the files.
    """
    players, rivals = (", ".join(dict.fromkeys(names)) for names in (spec.players, spec.rivals))
    paths = sorted((folder / "data").iterdir())
    return metadata(
        spec.name,
        f"{spec.description} {spec.episodes} rounds in Minari's format.",
        f"{spec.name.rpartition('-v')[2]}.0.0",
        f"The fpg-bench authors. fpg-bench {__version__}, data set {spec.name}.",
        ["offline reinforcement learning", "Minari"],
        [file_object(path.relative_to(folder).as_posix(), path.read_bytes()) for path in paths],
        rai={
            "dataCollection": (
                f"Made by fpg-bench {__version__} from the seeds {spec.first_seed} to "
                f"{spec.first_seed + spec.episodes - 1}: simulated rounds of the scenario {spec.scenario}, "
                f"in which the {spec.side} was played by {players} and the {spec.other_side} by {rivals}."
            ),
            "dataUseCases": ["Offline reinforcement learning and imitation in the frequency point game."],
            "dataBiases": [
                "States and actions are those of the players and rivals that are named; others are not "
                "covered."
            ],
            "personalSensitiveInformation": ["None: there are no people in the data."],
            "dataReleaseMaintenancePlan": (
                "The content of a version never changes; changed rules or players make another version."
            ),
        },
        datePublished=datetime.now(UTC).date().isoformat(),
    )
