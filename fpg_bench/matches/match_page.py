"""A whole match as one page: its rounds to be watched, each with what its planner was asked and answered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from fpg_bench.matches.match import Round
from fpg_bench.pictures.replay import write_replay
from fpg_bench.planning.llm.attempt import Attempt


def write_match_replay(rounds: Sequence[Round], path: Path, title: str, ally: str, opponent: str) -> None:
    """Write the replay of a match as one HTML file, whole.

    Args:
        rounds: at least one.
        path: the file; it is replaced.
        title: the page's heading.
        ally, opponent: what the players are called.
    """
    talks = [
        {
            "status": played.row["status"],
            "talk": [{"who": who, "text": text} for each in played.talk for who, text in said_in(each)],
        }
        for played in rounds
    ]
    write_replay([played.recording for played in rounds], path, title, ally, opponent, talks)


def said_in(attempt: Attempt) -> Iterator[tuple[str, str]]:
    """Who said what in an attempt at a plan: the request's messages, then the answer or what went wrong."""
    for message in (attempt.request or {}).get("messages", []):
        yield str(message.get("role")), str(message.get("content"))
    cost = f"{attempt.status}, {attempt.seconds:.1f} s, {attempt.tokens_out or 0} tokens"
    yield f"{attempt.model or 'no answer'} ({cost})", attempt.text or attempt.detail
