"""Members of a field: opponents that learned on different paths can be drawn in one game."""

from __future__ import annotations

import os
from typing import Any

from fpg_bench.players.agent import OnnxPlayer, load_agent


class FieldMember(OnnxPlayer):
    """An agent that flies as it was trained to: one that never learned to fly pursues the ally.

    Under the path ``learned`` such an opponent's rounds are those of the path ``pursuit``, to the bit. So
    opponents of both kinds can be drawn in one game.
    """

    @property
    def flies(self) -> str:
        """``learned`` where the opponent flew itself while it was trained, else ``pursuit``."""
        return flight_of(self.about)


def flight_of(about: dict[str, Any]) -> str:
    """How the opponent flew while an agent was trained, by its ``agent.json``: ``learned`` or ``pursuit``."""
    fields = about.get("scenario_fields")
    path = fields.get("opponent_path", "pursuit") if isinstance(fields, dict) else "pursuit"
    return "learned" if path == "learned" or (isinstance(path, list) and "learned" in path) else "pursuit"


def load_member(folder: str | os.PathLike[str], side: str | None = None) -> FieldMember:
    """A field's member from its agent folder; raises as :func:`fpg_bench.players.agent.load_agent` does."""
    agent = load_agent(folder, side)
    return FieldMember(agent.model, agent.about)
