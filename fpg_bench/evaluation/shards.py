"""An evaluation as a list of jobs: one per contestant and entry, whose rows come back here."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from itertools import chain
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel
from fpg_bench.evaluation.runner import Contestant, append_fresh, play_entry, rounds_known
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import run_jobs
from fpg_bench.players.naming import as_player
from fpg_bench.rows import Row, RowFile


def play_shards(
    contestants: Iterable[Contestant],
    panel: Panel,
    file: RowFile,
    *,
    workers: int,
    backend: str = "loky",
    address: str | None = None,
    say: Callable[[str], None] = print,
) -> None:
    """Play contestants against every entry of a panel whose rows are not there yet, several at once.

    Args:
        contestants: who plays; agents travel to the workers, code of the user's has to be there.
        panel: the pairings and how many rounds of each.
        file: where rows go as entries end, the same as by
            :func:`fpg_bench.evaluation.runner.play_panel`.
        workers: how many entries are played at once.
        backend: ``loky`` or ``ray``; see :func:`fpg_bench.jobs.run.run_jobs`.
        address: of a Ray cluster.
        say: told a line per entry that begins or ends.

    Raises:
        UserError: rows of another panel or player, a player that fails (the other entries are played), or no
            cluster.
    """
    heads: dict[str, Row] = {}
    jobs: dict[str, Job] = {}
    for who in contestants:
        spec = _portable(who, panel)
        for entry, head, known in rounds_known(who, panel, file):
            name = f"{_called(who)} - {entry.name}"
            if heads.setdefault(name, head) != head:
                raise UserError(f"{_called(who)}: is the name of two players; give one of them another")
            if len(known) < panel.rounds:
                keep = partial(append_fresh, file, head, known)
                jobs[name] = Job(name, partial(_rows, spec, panel, entry), keep)
    check_all_done(run_jobs(jobs.values(), workers, backend, address, say))


def _called(who: Contestant) -> str:
    return who.name if who.training_seed is None else f"{who.name}/seed_{who.training_seed}"


def _portable(who: Contestant, panel: Panel) -> Any:
    """What is sent to a worker: an agent itself, so that its files need not be there, else a name."""
    player = as_player(who.spec, panel.side, panel.scenario)
    return player if isinstance(getattr(player, "about", None), dict) else who.spec


def _rows(spec: Any, panel: Panel, entry: Entry) -> list[Row]:
    return list(chain.from_iterable(play_entry(spec, panel, entry, panel.rounds)))
