"""Responses to entries: agents made to lower an ally's return, in folders of a board.

A response is an agent folder ``responses/ally/<entry>/<name>`` with a ``response.yaml``, which says who made
it. Anybody may add one. It is played against each training seed of the entry. The evaluation seeds follow
from both sides' policies, so neither can have learned them.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml
from fpg_bench.common.ids import other_side
from fpg_bench.common.schema import parse
from fpg_bench.evaluation.seeds import PROTOCOL, evaluation_seeds
from fpg_bench.products.leaderboard.about import ResponseFile
from fpg_bench.products.leaderboard.crossplay import CrossplayEntry
from fpg_bench.products.leaderboard.folders import RESPONSE_ABOUT
from fpg_bench.products.leaderboard.playing import Part
from fpg_bench.products.leaderboard.submission import MOST_TEXT_BYTES, read_policy, slug_problems
from fpg_bench.products.leaderboard.targets import Target
from fpg_bench.products.sandbox.client import AGENT_FILES, Policy, check_policies

FILES = {**AGENT_FILES, RESPONSE_ABOUT: MOST_TEXT_BYTES}  # of a response, and their most bytes
ROUNDS = 100  # of each training seed of an entry against a response


@dataclass(frozen=True)
class Response:
    """A response to an entry.

    Attributes:
        target: the entry.
        slug: its name among the responses to the entry.
        policy: its policy.
        about: who made it.
    """

    target: Target
    slug: str
    policy: Policy
    about: ResponseFile

    @property
    def name(self) -> str:
        """Its name on the board, ``track/entry/slug``."""
        return f"{self.target.name}/{self.slug}"

    @property
    def key(self) -> str:
        """Hash of all that decides its result, and of its budget; the evaluation seeds follow from it."""
        entry, card = self.target.entry, self.policy.card
        budget = None if card is None else [card.algorithm, card.training_steps]
        content: list[object] = [self.name, entry.identity, self.policy.sha256, budget]
        content += [entry.scenario_hash, PROTOCOL, ROUNDS]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    @property
    def seeds(self) -> Sequence[int]:
        """The evaluation seeds of its matches against each training seed of the entry."""
        return evaluation_seeds(ROUNDS, self.key)

    def as_entry(self) -> CrossplayEntry:
        """Return the response as a player, in the game of the entry."""
        part = Part(self.slug, self.policy.seed, self.policy)
        side = other_side(self.target.side)
        return dataclasses.replace(self.target.entry, slug=self.slug, side=side, parts=(part,))


def read_response(folder: Path, target: Target, inspect_onnx: bool = True) -> Response:
    """Read a response's folder; none of it is run.

    Args:
        folder: the folder.
        target: the entry that it answers.
        inspect_onnx: inspect the ONNX file in a sandboxed process; not needed if it is not played.

    Raises:
        UserError: its first problem.
    """
    where = f"response {target.name}/{folder.name}"
    for line in slug_problems(folder):
        raise UserError(f"{where}: {line}")
    policy, problems = read_policy(folder, None, other_side(target.side), FILES)
    if policy is not None and not problems and inspect_onnx:
        problems = [f"/policy.onnx: {line}" for line in check_policies([policy.model])[0]]
    if policy is None or policy.card is None or problems:
        raise UserError(f"{where}{problems[0]}")
    about = parse(ResponseFile, read_yaml(folder / RESPONSE_ABOUT, where), f"{where}/{RESPONSE_ABOUT}")
    return Response(target, folder.name, policy, about)
