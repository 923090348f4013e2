"""How far changed rules move scores: scripts and shipped agents under each of them, as a table in Markdown.

python scripts/measure_shifted.py

Agents by their first training seed; the first line is the same players met under the standard rules.
"""

from __future__ import annotations

import dataclasses
import sys

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import Field, load_field
from fpg_bench.evaluation.play import play

SCRIPTS = {
    "ally-shifted-v1": ("random", "idle", "reactive", "expert", "expert-spread"),
    "opponent-shifted-v1": ("random", "tone", "comb", "adaptive"),
    "opponent-learned-shifted-v1": ("random", "tone", "comb", "adaptive"),
}
AGENTS = {
    "ally-shifted-v1": [f"ally-scripted/{name}" for name in ("ppo", "ppo-stack8", "recurrent-ppo", "sac")],
    "opponent-shifted-v1": [f"opponent-pursuit/{name}" for name in ("ppo", "sac", "td3")],
    "opponent-learned-shifted-v1": [f"opponent-learned/{name}" for name in ("ppo", "sac", "td3")],
}


def with_standard(field: Field) -> Field:
    """The field with its players met under the standard rules, too, before all others."""
    first = field.counterparts[0]
    path = first.scenario.opponent_path
    unchanged = dataclasses.replace(field.scenario, opponent_path=path)
    standard = dataclasses.replace(first, name="standard", scenario=unchanged)
    return dataclasses.replace(field, counterparts=(standard, *field.counterparts))


def scores(who: str, field: Field) -> list[float]:
    """A player's score against each counterpart."""
    entry = player_entry(who)
    lines = [play(entry, field, counterpart) for counterpart in field.counterparts]
    return [float(field.scale.score(field.rewards(line.returns).mean())) for line in lines]


def table(name: str) -> str:
    """The table of a field."""
    field = with_standard(load_field(name))
    players = {who: scores(who, field) for who in SCRIPTS[name]}
    players |= {agent.partition("/")[2]: scores(f"{agent}/seed_0", field) for agent in AGENTS[name]}
    lines = [["", *players], ["---"] * (len(players) + 1)]
    for k, counterpart in enumerate(field.counterparts):
        lines.append([counterpart.name, *(str(round(of[k])) for of in players.values())])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def main() -> int:
    """Print the table of each field."""
    for name in SCRIPTS:
        print(f"`{name}`:\n\n{table(name)}\n", flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"measure_shifted: {error}")
