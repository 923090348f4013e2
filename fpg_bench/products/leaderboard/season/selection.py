"""Selection of a season's members from its candidates, by the returns of the entries against them."""

from __future__ import annotations

import logging
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fpg_bench.common.errors import UserError

_logger = logging.getLogger(__name__)

PROBE = "probe"
# Groups of each side's candidates. Against the first, the first script of PROBES leads the second by more.
# Herders keep an ally hopping, so the best answer is to stay; aimers jam where it is, so it has to hop.
# Herdable allies hop into a jammer that alternates between both halves of the band; evasive ones do not.
GROUPS = {"opponent": ("herders", "aimers"), "ally": ("herdable", "evasive")}
PROBES = {"opponent": ("idle", "expert"), "ally": ("alternate", "tone")}
_DECILES = (0.1, 0.9)


@dataclass(frozen=True)
class Meeting:
    """Rounds of a player against a candidate.

    Attributes:
        entry: the player's entry, or ``PROBE``.
        player: the fingerprint of its policy, or a script's name.
        returns: per step, by side.
    """

    entry: str
    player: str
    returns: Mapping[str, float]


def entry_returns(profiles: Sequence[Sequence[Meeting]], side: str) -> np.ndarray:
    """Return what each entry earns against each candidate, ``(entries, candidates)``.

    Entries have one row each, the mean over their training seeds.

    Args:
        profiles: the meetings of each candidate.
        side: the side of the entries.
    """
    columns = []
    for meetings in profiles:
        by_entry: dict[str, list[float]] = {}
        for met in meetings:
            if met.entry != PROBE:
                by_entry.setdefault(met.entry, []).append(met.returns[side])
        columns.append([statistics.fmean(values) for _, values in sorted(by_entry.items())])
    return np.array(columns).T


def limit_influence(returns: np.ndarray) -> np.ndarray:
    """Return the returns with those against each candidate clipped to their first and last decile.

    An entry that loses its rounds against candidates of its choice would otherwise decide which are alike.
    """
    _check_finite(returns)
    low, high = np.quantile(returns, _DECILES, axis=0)
    limited: np.ndarray = np.clip(returns, low, high)
    return limited


def group_candidates(returns: np.ndarray, leads: np.ndarray, side: str) -> list[str]:
    """Cluster the candidates of a side into two groups by the returns against them, and name the groups.

    Ward's hierarchical clustering of the candidates' standardised profiles of returns. Their distance
    follows from their correlation, so it depends on which players do well, not on how well all do. The
    groups may differ in size.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``; see
            :func:`entry_returns`.
        leads: for each candidate, by how much the first script of :data:`PROBES` earns more than the second.
        side: the candidates' side.

    Returns:
        The name of each candidate's group; the group with the larger mean lead has the first name in
        :data:`GROUPS`.

    Raises:
        UserError: a return that is not finite.
    """
    from scipy.cluster.hierarchy import fcluster, linkage

    _check_finite(returns)
    spread = returns.std(axis=0)
    profiles = (returns - returns.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    labels = fcluster(linkage(profiles.T, "ward"), 2, "maxclust")
    order = sorted(set(labels), key=lambda label: -leads[labels == label].mean())
    return [GROUPS[side][order.index(label)] for label in labels]


def select_by_group(returns: np.ndarray, groups: Sequence[str], size: int) -> list[int]:
    """Select equally many candidates from each group, which represent it.

    The mean over the suite then gives the groups equal weight, whatever their shares of the candidates.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``; see
            :func:`entry_returns`.
        groups: the group of each candidate.
        size: number of candidates to select. Fewer are selected, with a warning, if the smallest group does
            not have enough candidates, or if the groups do not divide it.

    Returns:
        Their indices, group by group.

    Raises:
        UserError: see :func:`select_representative`.
    """
    by_group = {name: [i for i, group in enumerate(groups) if group == name] for name in sorted(set(groups))}
    per_group = min(size // len(by_group), *map(len, by_group.values()))
    if per_group * len(by_group) < size:
        counts = ", ".join(f"{len(members)} {name}" for name, members in by_group.items())
        _logger.warning(
            f"season: selected {per_group * len(by_group)} members instead of {size}, from {counts}"
        )
    return [
        members[index]
        for members in by_group.values()
        for index in select_representative(returns[:, members], per_group)
    ]


def select_representative(returns: np.ndarray, size: int) -> list[int]:
    """Select candidates against which players earn about what they earn against all candidates.

    Starts with the strongest candidate, against which players earn least. Each further one brings the mean
    returns against the selection nearest to those against all candidates.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``; see
            :func:`entry_returns`.
        size: number of candidates to select.

    Returns:
        Their indices in the order of selection.

    Raises:
        UserError: too few candidates, or returns that are not finite.
    """
    _check_selection(returns, size)
    selected = [_strongest(returns)]
    overall = returns.mean(axis=1)
    while len(selected) < size:
        sums = returns[:, selected].sum(axis=1)[:, None] + returns
        distances = np.linalg.norm(sums / (len(selected) + 1) - overall[:, None], axis=0)
        distances[selected] = np.inf
        selected.append(int(distances.argmin()))
    return selected


def select_diverse(returns: np.ndarray, size: int) -> list[int]:
    """Select a training population whose members differ in the returns against them.

    Starts with the strongest candidate. Each further one has the profile of returns that is farthest from
    all selected ones (greedy max-min distance). Arguments, result and errors are those of
    :func:`select_representative`.
    """
    _check_selection(returns, size)
    selected = [_strongest(returns)]
    distances = np.linalg.norm(returns[:, :, None] - returns[:, None, :], axis=0)
    while len(selected) < size:
        nearest = distances[:, selected].min(axis=1)
        nearest[selected] = -1.0
        selected.append(int(nearest.argmax()))
    return selected


def _check_selection(returns: np.ndarray, size: int) -> None:
    count = returns.shape[1]
    if size > count:
        raise UserError(f"season: cannot select {size} members from {count} candidates")
    _check_finite(returns)


def _strongest(returns: np.ndarray) -> int:
    """Return the index of the candidate against which players earn least."""
    return int(returns.mean(axis=0).argmin())


def _check_finite(returns: np.ndarray) -> None:
    if not np.isfinite(returns).all():
        raise UserError("season: an entry has a return that is not finite")
