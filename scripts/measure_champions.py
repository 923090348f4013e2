"""What champions, and agents beside them, leave to whom: mean return a step, fresh responders included.

python scripts/measure_champions.py ally-champion                         the shipped champions of this recipe
python scripts/measure_champions.py ally-champion AGENT [AGENT ...]       other agents, by the same measure
python scripts/measure_champions.py ally-champion --no-fresh              without training responders

Each agent meets the scripts of the other side, the shipped agents of the views in ZOO, and the recipe's
responders, trained against this very agent with seeds that no champion was trained against. Rows go to a
file; what is there is not done again.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.training.league import Recipe, load_recipes, population_returns, train_responders

ZOO = {"opponent": "opponent-pursuit", "ally": "ally-scripted"}
FRESH_SEED = 1_090_000
ROUNDS = 100


def shipped(folder: Path) -> list[str]:
    """The agents below a folder of the shipped ones, by their names."""
    found = (baselines_folder() / "agents" / folder).rglob("agent.json")
    return sorted(str(file.parent.relative_to(baselines_folder() / "agents")) for file in found)


def rows_of(recipe: Recipe, agent: str, kind: str, others: list[str]) -> list[Row]:
    """One row for each of several rivals."""
    returns = population_returns(recipe, agent, others, ROUNDS)
    return [
        {"agent": agent, "kind": kind, "other": other, "return_a_step": round(found, 3)}
        for other, found in returns.items()
    ]


def measure(recipe: Recipe, agent: str, file: RowFile, runs: Path, fresh: bool) -> None:
    """Append what is missing of an agent."""
    done = {(row["agent"], row["kind"]) for row in file.read()}
    known = {"scripts": list(SCRIPTED[recipe.other_side]), "zoo": shipped(Path(ZOO[recipe.other_side]))}
    for kind, others in known.items():
        if (agent, kind) not in done:
            file.append(rows_of(recipe, agent, kind, others))
    if fresh and (agent, "fresh") not in done:
        folder = runs / recipe.name / agent.replace("/", "_")
        responders = train_responders(recipe, agent, folder, FRESH_SEED)
        file.append(rows_of(recipe, agent, "fresh", responders))


def record(agent: str, rows: list[Row]) -> str:
    """An agent's means, and its worst with who did it."""
    words: list[Any] = [agent]
    for kind in ("scripts", "zoo", "fresh"):
        found = [row["return_a_step"] for row in rows if (row["agent"], row["kind"]) == (agent, kind)]
        words.append(f"{kind} {sum(found) / len(found):.2f}" if found else f"{kind} -")
    worst = min((row for row in rows if row["agent"] == agent), key=lambda row: row["return_a_step"])
    return f"{'  '.join(words)}  worst {worst['return_a_step']:.2f} ({worst['other']})"


def main() -> None:
    """Do what the options say."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("recipe")
    parser.add_argument("agents", nargs="*")
    parser.add_argument("--file", type=Path, help="default: baselines/champions.yml")
    parser.add_argument("--runs", type=Path, default=Path("runs/fresh"), help="the responders' runs")
    parser.add_argument("--out", type=Path, default=Path("runs/fresh/rows.jsonl"))
    parser.add_argument("--no-fresh", action="store_true")
    options = parser.parse_args()
    recipes = load_recipes(options.file or baselines_folder() / "champions.yml")
    if options.recipe not in recipes:
        raise UserError(f"no champion {options.recipe!r}{nearest(options.recipe, recipes)}")
    file = RowFile(options.out)
    for agent in options.agents or shipped(Path(options.recipe)):
        measure(recipes[options.recipe], agent, file, options.runs, not options.no_fresh)
        print(record(agent, file.read()), flush=True)


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"measure_champions: {error}")
