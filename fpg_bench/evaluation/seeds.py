"""Ranges of seeds for training, tuning, evaluation and data sets, which never meet.

A training run of seed k takes [k * 10^6, (k + 1) * 10^6); tuning seeds begin at 2^40, evaluation seeds at
2^41, and those of data sets at 2^42, where data set k has 2^32 of them. The further
games of a batch that has one seed lie above all of these, from 3 * 2^61 on. Evaluation seeds follow from the
protocol version and a season key by a public hash, so they can be changed each season.
"""

from __future__ import annotations

import hashlib

from fpg_bench.common.errors import UserError

PROTOCOL = "1"
SEASON = "0"
TRAINING_STRIDE = 10**6
TUNING_START = 2**40
EVALUATION_START = 2**41
DATASET_START = 2**42
_BLOCK = 2**20
_DATASET_BLOCK = 2**32
_MOST_DATASETS = 2**30


def training_seed(k: int) -> int:
    """Return the first environment seed of training seed k.

    Raises:
        UserError: k is negative or so large that it would reach the tuning seeds.
    """
    seed = k * TRAINING_STRIDE
    if k < 0 or seed + TRAINING_STRIDE > TUNING_START:
        raise UserError(f"training seed: expected 0 to {TUNING_START // TRAINING_STRIDE - 1}, got {k}")
    return seed


def evaluation_seeds(count: int, season: str = SEASON) -> list[int]:
    """Return the first ``count`` evaluation seeds of a season of this protocol.

    Raises:
        UserError: more than a season has.
    """
    if not 0 <= count <= _BLOCK:
        raise UserError(f"evaluation seeds: a season has {_BLOCK}, asked for {count}")
    digest = hashlib.sha256(f"fpg-bench/{PROTOCOL}/{season}".encode()).digest()
    first = EVALUATION_START + int.from_bytes(digest[:8], "big") % _BLOCK * _BLOCK
    return list(range(first, first + count))


def tuning_seeds(count: int) -> list[int]:
    """Return the first ``count`` tuning seeds, on which a policy is scored while it is trained or tuned.

    Raises:
        UserError: more than there are.
    """
    if not 0 <= count <= EVALUATION_START - TUNING_START:
        raise UserError(f"tuning seeds: there are {EVALUATION_START - TUNING_START}, asked for {count}")
    return list(range(TUNING_START, TUNING_START + count))


def dataset_seed(k: int) -> int:
    """Return the first of the 2^32 environment seeds of data set k.

    Raises:
        UserError: k is negative, or 2^30 or more.
    """
    if not 0 <= k < _MOST_DATASETS:
        raise UserError(f"seed of a data set: expected 0 to {_MOST_DATASETS - 1}, got {k}")
    return DATASET_START + k * _DATASET_BLOCK
