"""The offer of games of teams to the core."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from fpg_bench.game.scenario import Scenario
from fpg_bench.products.teams.spec import TeamSpec

if TYPE_CHECKING:
    from fpg_bench.evaluation.rounds import MatchBatch
    from fpg_bench.evaluation.suite import Rival, Suite
    from fpg_bench.players.player import Player, PlayerSpec
    from fpg_bench.products.teams.pettingzoo_env import TeamParallelEnv
    from fpg_bench.products.teams.sb3_vec_env import TeamRows


class _Teams:
    """The :class:`fpg_bench.game.spec.GameProduct` of teams; each method imports what it needs."""

    spec = TeamSpec

    def make_core(self, game: TeamSpec, n_envs: int) -> TeamRows:
        from fpg_bench.products.teams.sb3_vec_env import TeamRows

        return TeamRows(game, n_envs)

    def make_env(self, render_mode: str | None = None, **options: Any) -> TeamParallelEnv:
        from fpg_bench.products.teams.pettingzoo_env import TeamParallelEnv

        return TeamParallelEnv(render_mode, **options)

    def make_player(self, spec: PlayerSpec, side: str, scenario: Scenario, game: TeamSpec) -> Player:
        from fpg_bench.products.teams.scripts import as_team_player

        return as_team_player(spec, side, scenario, game)

    def make_match(self, player: PlayerSpec, suite: Suite, rival: Rival, count: int) -> MatchBatch:
        from fpg_bench.products.teams.match import suite_match

        return suite_match(player, suite, rival, count)

    def watch(
        self,
        ally: PlayerSpec,
        opponent: PlayerSpec,
        out: str | Path | None,
        *,
        game: TeamSpec,
        **options: Any,
    ) -> dict[str, float | None]:
        from fpg_bench.products.rendering.watching import shown_measures
        from fpg_bench.products.teams.watching import print_team, watch_team

        options |= {"scenario": game.resolve(), "team": game.team}
        if out is None:
            return print_team([ally], [opponent], **options).measures
        recording = watch_team([ally], [opponent], out, **options)
        print(shown_measures(recording.measures), f"wrote {out}", sep="\n")
        return recording.measures


TEAMS = _Teams()
