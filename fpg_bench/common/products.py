"""The line between the core and its products: what may be deleted, and what the core asks for by name.

The core imports no product. It asks :func:`load` for what a product offers, by a kind and a name, and only
then is the product imported. A product whose folders and files were deleted offers nothing, and neither do
the products that need it.
"""

from __future__ import annotations

import functools
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError

PACKAGE = Path(__file__).parents[1]


@dataclass(frozen=True)
class Product:
    """A part of the package that the core does not need.

    Attributes:
        paths: its folders and files in the package; all that is deleted with it.
        offers: what it offers the core, by kind and name, as ``module:object``.
        needs: the products that it imports.
    """

    paths: tuple[str, ...]
    offers: Mapping[str, Mapping[str, str]]
    needs: tuple[str, ...] = ()

    def is_there(self) -> bool:
        """Return True if nothing was deleted of it or of what it needs."""
        whole = all((PACKAGE / path).exists() for path in self.paths)
        return whole and all(PRODUCTS[name].is_there() for name in self.needs)


_LLM = "fpg_bench.products.language_models.comparison"
PRODUCTS = {
    "leaderboard": Product(
        ("leaderboard", "cli/leaderboard.py"),
        {
            "verb": {
                "submit": "fpg_bench.products.leaderboard.verbs:submit",
                "leaderboard": "fpg_bench.products.leaderboard.verbs:leaderboard",
            },
            "description": {"season": "fpg_bench.products.leaderboard.season.audit:describe_season"},
        },
        needs=("language models", "rendering", "sandbox"),
    ),
    "paper": Product(
        ("paper", "cli/reproduce.py"),
        {"verb": {"reproduce": "fpg_bench.products.paper.verbs:reproduce"}},
        needs=("language models", "maddpg"),
    ),
    "hub": Product(
        ("hub", "cli/hub.py"),
        {
            "verb": {"hub": "fpg_bench.products.hub.verbs:app"},
            "agents": {"hf://": "fpg_bench.products.hub.download:resolve"},
        },
        needs=("leaderboard", "rendering", "sandbox"),
    ),
    "sandbox": Product(
        ("players/sandbox",),
        {"player": {"sandbox": "fpg_bench.products.sandbox.agent:SandboxedAgent"}},
    ),
    "language models": Product(
        ("planning/llm", "evaluation/language_models.py", "training/language_model.py", "cli/llm.py"),
        {
            "verb": {"llm": "fpg_bench.products.language_models.verbs:app"},
            "verb of plan": {"probe": "fpg_bench.products.language_models.verbs:probe"},
            "planner": dict.fromkeys(
                ("llm", "llm-shuffled-rewards", "llm-no-history"),
                "fpg_bench.products.language_models.llm_planner:LLMPlanner",
            ),
            "language model": {
                "of a match": f"{_LLM}:match_planner",
                "of a match's file": f"{_LLM}:replayed_planner",
                "of a comparison": f"{_LLM}:recorded_entry",
                "of transcripts": f"{_LLM}:replayed_entries",
                "of a training": "fpg_bench.products.language_models.training:training_planner",
            },
        },
    ),
    "rendering": Product(
        ("rendering",),
        {
            "drawing": {
                "picture": "fpg_bench.products.rendering.picture:Picture",
                "team": "fpg_bench.products.teams.picture:TeamPicture",
                "match": "fpg_bench.products.rendering.match_picture:draw_match",
                "match's page": "fpg_bench.products.rendering.match_picture:write_match_replay",
            },
            "film": {
                ".html": "fpg_bench.products.rendering.replay:write_replay",
                ".gif": "fpg_bench.products.rendering.film:write_gif",
                ".mp4": "fpg_bench.products.rendering.film:write_mp4",
                "check of .mp4": "fpg_bench.products.rendering.film:check_mp4",
            },
        },
    ),
    "offline": Product(
        ("datasets", "training/offline.py", "cli/dataset.py"),
        {
            "verb": {
                "offline": "fpg_bench.products.offline.verbs:offline",
                "dataset": "fpg_bench.products.offline.verbs:app",
            },
            "offline algorithm": {
                "bc": "fpg_bench.products.offline.learning:BC",
                "td3-bc": "fpg_bench.products.offline.learning:TD3BC",
                "cql": "fpg_bench.products.offline.learning:CQL",
                "iql": "fpg_bench.products.offline.learning:IQL",
                "discrete-cql": "fpg_bench.products.offline.learning:DiscreteCQL",
            },
        },
    ),
    "maddpg": Product(
        ("training/maddpg",),
        {"joint algorithm": {"maddpg": "fpg_bench.products.maddpg:MADDPG"}},
    ),
    "league": Product(
        ("training/league", "cli/league.py"),
        {
            "verb": {
                "best-response": "fpg_bench.products.league.verbs:best_response",
                "double-oracle": "fpg_bench.products.league.verbs:double_oracle",
                "fictitious-self-play": "fpg_bench.products.league.verbs:fictitious_self_play",
                "self-play": "fpg_bench.products.league.verbs:self_play",
            }
        },
    ),
    "teams": Product(
        (
            "game/team_rules.py",
            "game/team_spec.py",
            "game/team_link.py",
            "game/team_step.py",
            "game/team_batch.py",
            "players/team_runner.py",
            "players/team_scripts.py",
            "evaluation/team_match.py",
            "evaluation/team_watching.py",
            "envs/team.py",
            "envs/team_pettingzoo.py",
            "envs/team_sb3.py",
        ),
        {
            "function": {
                "make_team": "fpg_bench.products.teams.core:make_team",
                "make_sb3_team": "fpg_bench.products.teams.sb3_vec_env:make_sb3_team",
                "watch_team": "fpg_bench.products.teams.watching:watch_team",
            },
            "game": {"FPG/team_v0": "fpg_bench.products.teams.spec:TeamSpec"},
            "suites": {"team-": "fpg_bench.products.teams.spec:TeamSpec"},
            "player of a seat": {"FPG/team_v0": "fpg_bench.products.teams.scripts:as_team_player"},
            "match": {"FPG/team_v0": "fpg_bench.products.teams.match:suite_match"},
            "core": {"FPG/team_v0": "fpg_bench.products.teams.sb3_vec_env:TeamRows"},
            "parallel environment": {"FPG/team_v0": "fpg_bench.products.teams.pettingzoo_env:parallel_env"},
            "aec environment": {"FPG/team_v0": "fpg_bench.products.teams.pettingzoo_env:aec_env"},
        },
    ),
    "tuning": Product(
        ("training/tuning", "cli/tune.py"),
        {"verb": {"tune": "fpg_bench.products.tuning.verbs:app"}},
    ),
}


@functools.cache
def offered(kind: str) -> Mapping[str, str]:
    """Return what products offer of a kind, by name, as ``module:object``; deleted products offer nothing."""
    there = [product for product in PRODUCTS.values() if product.is_there()]
    return {name: place for product in there for name, place in product.offers.get(kind, {}).items()}


def load(kind: str, name: str) -> Any:
    """Return what a product offers, and import it.

    Raises:
        UserError: the product was deleted; its name is in the message.
    """
    if name in offered(kind):
        return pkgutil.resolve_name(offered(kind)[name])
    owner = next(title for title, product in PRODUCTS.items() if name in product.offers.get(kind, {}))
    raise UserError(f"{kind} {name!r}: this copy of fpg-bench was made without {owner}")
