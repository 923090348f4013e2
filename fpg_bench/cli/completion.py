"""Shell completion of players, environment ids, suites and algorithms, without loading what plays them."""

from __future__ import annotations

from collections.abc import Iterable

from fpg_bench.common.ids import DUEL, NAMED, registered_ids
from fpg_bench.training.algorithms import ALGORITHMS, JOINT, OFFLINE


def complete_player(incomplete: str) -> list[str]:
    """Return the scripts and shipped agents with this prefix, groups of training seeds before their members.

    Folders are completed by the shell itself, where no name has the prefix.
    """
    from fpg_bench.players.agent import baselines_folder

    agents = baselines_folder() / "agents"
    groups = [path.relative_to(agents).as_posix() for path in agents.glob("*/*")]
    seeds = [f"{group}/{seed.name}" for group in groups for seed in (agents / group).glob("seed_*")]
    names = [*NAMED["ally"], *NAMED["opponent"], "oracle", "all-scripted"]
    begun = _beginning(incomplete, [*names, *groups, *seeds])
    return [name for name in begun if name.count("/") < 2] or begun


def complete_id(incomplete: str) -> list[str]:
    """Return the environment ids with this prefix."""
    return _beginning(incomplete, [DUEL, *registered_ids()])


def complete_suite(incomplete: str) -> list[str]:
    """Return the suites with this prefix."""
    return _beginning(incomplete, _shipped("suites"))


def complete_dataset(incomplete: str) -> list[str]:
    """Return the data sets with this prefix."""
    return _beginning(incomplete, _shipped("datasets"))


def complete_algorithm(incomplete: str) -> list[str]:
    """Return the algorithms with this prefix that learn by playing."""
    return _beginning(incomplete, (*ALGORITHMS, *JOINT))


def complete_offline(incomplete: str) -> list[str]:
    """Return the algorithms with this prefix that learn from data sets."""
    return _beginning(incomplete, OFFLINE)


def _shipped(folder: str) -> list[str]:
    """Return the names of the YAML files in a folder of the baselines."""
    from fpg_bench.players.agent import baselines_folder

    return [path.stem for path in (baselines_folder() / folder).glob("*.yml")]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return sorted({name for name in names if name.startswith(incomplete)})
