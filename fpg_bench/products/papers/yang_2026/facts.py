"""Statements of the paper, from ``facts.yml``."""

from __future__ import annotations

from pathlib import Path

from fpg_bench.common.files import read_yaml
from fpg_bench.common.schema import Items, Strict, parse


class YangFacts(Strict):
    """The file.

    Attributes:
        claims: claims by their names.
        overlap: published overlap of both spectra by the stage of the training.
        figures: title and caption of each figure.
    """

    claims: dict[str, str]
    overlap: dict[str, str]
    figures: dict[str, Items[str]]


FACTS = parse(YangFacts, read_yaml(Path(__file__).with_suffix(".yml"), "paper"), "paper yang-2026")
