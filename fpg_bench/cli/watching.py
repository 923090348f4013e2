"""Progress of a match: a moving line on a terminal, else a line now and then."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from fpg_bench.evaluation.match import Round

_MOVES_S = 0.5
_TOLD_S = 10.0  # where there is no terminal


@contextlib.contextmanager
def watched(
    rounds: int, come: Callable[[int, Round | None], Any]
) -> Iterator[Callable[[int, Round | None], None]]:
    """Show how a match goes, also while a plan is waited for.

    Args:
        rounds: of the match.
        come: told each round before it is planned and after it.

    Yields:
        The match's ``progress``.
    """
    from rich.console import Console

    console, planning, over = Console(), _Planning(rounds), threading.Event()
    with console.status("") if console.is_terminal else contextlib.nullcontext() as moving:
        every = _TOLD_S if moving is None else _MOVES_S
        show: Callable[[str], Any] = typer.echo if moving is None else moving.update

        def tick() -> None:
            while not over.wait(every):
                if (line := planning.line()) is not None:
                    show(line)

        def progress(index: int, played: Round | None) -> None:
            planning.begin(index, played)
            if played is None and moving is not None:
                moving.update(planning.line() or "")
            if played is not None and moving is None:
                typer.echo(planning.last)
            come(index, played)

        ticking = threading.Thread(target=tick, daemon=True)
        ticking.start()
        try:
            yield progress
        finally:
            over.set()
            ticking.join()


class _Planning:
    """The plan that is waited for, and the round before it."""

    def __init__(self, rounds: int) -> None:
        self.last = ""
        self._rounds, self._index, self._since = rounds, 0, time.monotonic()
        self._waiting = False

    def begin(self, index: int, played: Round | None) -> None:
        """A round is planned now, or was played."""
        self._index, self._since, self._waiting = index, time.monotonic(), played is None
        if played is not None:
            self.last = f"round {index}: {played.reward_per_step:+.2f} a step, {played.row['status']}"

    def line(self) -> str | None:
        """Return the progress line; None if nothing is awaited."""
        from fpg_bench.planning.llm.local_server import tokens_under_way

        if not self._waiting:
            return None
        seconds, tokens = time.monotonic() - self._since, tokens_under_way()
        said = f"planning round {self._index} of {self._rounds}, {seconds:.0f} s"
        if tokens is not None:
            said += f", {tokens} tokens written" if tokens else ", reading the prompt"
        return f"{said}  {self.last}"
