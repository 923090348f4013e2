"""Champions, which a double oracle or self-play makes hard to beat, and rules, which a search finds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.checks import check_keys, integer, mapping, one_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml
from fpg_bench.common.imports import check_allowed
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.players.agent import load_agent
from fpg_bench.products.league.config import DoubleOracleConfig, RuleSearchConfig, TabularSelfPlayConfig
from fpg_bench.products.league.double_oracle import double_oracle
from fpg_bench.products.league.rule_search import rule_search
from fpg_bench.products.league.tabular_self_play import tabular_self_play

Search = DoubleOracleConfig | RuleSearchConfig | TabularSelfPlayConfig
SEARCHES: Mapping[str, tuple[type[Search], Callable[..., object]]] = {
    DoubleOracleConfig.verb: (DoubleOracleConfig, double_oracle),
    RuleSearchConfig.verb: (RuleSearchConfig, rule_search),
    TabularSelfPlayConfig.verb: (TabularSelfPlayConfig, tabular_self_play),
}


@dataclass(frozen=True)
class Champion:
    """A champion, an entry of ``baselines/champions.yml``.

    Attributes:
        name: folder of the agents.
        config: the search, without its seed.
        recipe: the name and the entry without ``seeds``: ``verb`` names the search, the rest are its options.
        seeds: number of training seeds.
    """

    name: str
    config: Search
    recipe: JsonObject
    seeds: int

    @classmethod
    def parse(cls, name: str, content: Mapping[str, Any], where: str) -> Champion:
        """Return the champion of an entry; raises UserError for an invalid one."""
        options = dict(content)
        verb, seeds = one_of(options.pop("verb", None), f"{where}: verb", SEARCHES), options.pop("seeds", 3)
        kind = SEARCHES[verb][0]
        check_keys(options, [each.name for each in dataclasses.fields(kind)], where)
        try:
            config = kind(**options)
            return cls(name, config, {"name": name, "verb": verb, **options}, integer(seeds, "seeds"))
        except UserError as error:
            raise UserError(f"{where}: {error}") from error

    def train(self, seed: int, folder: Path, *, progress: bool = False) -> Path:
        """Train it in a folder with a training seed, and return the folder of its agent.

        A stopped training is resumed, and finished runs are not repeated.

        Raises:
            UserError: something unknown or out of range, or a folder that holds another run.
            KeyboardInterrupt: stopped by the user.
        """
        search = SEARCHES[self.config.verb][1]
        search(dataclasses.replace(self.config, seed=seed), folder, progress=progress)
        return folder / "agent"

    def ship(self, agent: Path, folder: Path, seed: int, command: str) -> None:
        """Copy a trained agent to its shipped folder; its ``agent.json`` describes the whole training.

        Args:
            agent: the folder of the agent.
            folder: the folder of the shipped agent.
            seed: its training seed.
            command: the command that reproduces it.

        Raises:
            UserError: the agent is incomplete.
        """
        trained = load_agent(agent, self.config.side)
        assert trained.card is not None
        found = trained.card.recipe if self.config.algorithm == "rule" else None
        update = {"command": command, "training_seed": seed, "recipe": self.recipe | (found or {})}
        trained.card.model_copy(update=update).write(folder, trained.model)


def load_champions(file: Path) -> dict[str, Champion | str]:
    """Load the champions of a YAML file, by name; of those that are trained no more, the revision that did.

    Raises:
        UserError: the file cannot be read, or a key is missing, unknown or invalid.
    """
    champions: dict[str, Champion | str] = {}
    for name, content in read_yaml(file, "champions").items():
        where = f"champions {file}: {name}"
        if isinstance(content, str):
            champions[name] = content
        else:
            check_allowed(content, (), where)
            champions[name] = Champion.parse(name, mapping(content, where), where)
    return champions
