"""Budget of a run with a language model, and a circuit breaker for a server that fails."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Iterable

from fpg_bench.common.errors import UserError
from fpg_bench.products.language_models.transcript import UNANSWERED, Attempt

CALLS = 20_000  # two for each plan of a comparison, with some reserve
TOKENS = 200_000_000
SECONDS = 7 * 86_400.0
FAILURES_IN_A_ROW = 5

FAILURES = ("timeout", "http", "invalid")  # errors of a call that are the server's fault
_logger = logging.getLogger(__name__)


class CallBudget:
    """Caps on calls, tokens and time, and a circuit breaker that opens after five failures in a row.

    Once a cap is reached or the breaker is open, the rest of the run is flown without calls; this is logged
    once. Copies of a planner share one budget.

    Args:
        calls: largest number of calls.
        tokens: no call is made after this many, as the server counts them.
        seconds: no call is made after this much time in calls.

    Raises:
        UserError: a cap is not a positive number.
    """

    def __init__(self, calls: float = CALLS, tokens: float = TOKENS, seconds: float = SECONDS) -> None:
        self.caps = {"calls": calls, "tokens": tokens, "seconds": seconds}
        for name, cap in self.caps.items():
            if isinstance(cap, bool) or not isinstance(cap, int | float) or not 0 < cap <= math.inf:
                raise UserError(f"budget: {name} is {cap!r}; expected a positive number")
        self.spent: dict[str, float] = dict.fromkeys(self.caps, 0)
        self.failures = 0
        self._is_resumed = self._is_reported = False

    def __deepcopy__(self, memo: object) -> CallBudget:
        return self

    def resume(self, attempts: Iterable[Attempt], where: str) -> None:
        """Count the attempts of a resumed run; calls after the first do nothing.

        Consecutive failures are reset, since the server may have been repaired. Plans without an answer stay
        as they were flown; their number is logged.

        Args:
            attempts: all attempts of the transcript.
            where: name of the transcript in the log.
        """
        if self._is_resumed:
            return
        self._is_resumed = True
        lost = Counter[str]()
        for attempt in attempts:
            self.spend(attempt)
            if attempt.error in UNANSWERED:
                lost[attempt.error] += 1
        self.failures = 0
        if lost.total():
            why = ", ".join(f"{error} {count}" for error, count in sorted(lost.items()))
            stay = "they stay as they were flown; another file or folder asks anew"
            _logger.warning("%s: plans without an answer: %d (%s); %s", where, lost.total(), why, stay)

    def refusal(self, under_way: int = 0) -> str | None:
        """Return why no further call may be made, None if one may; log the first refusal.

        Args:
            under_way: calls that are planned but not counted yet.
        """
        why = self._why(under_way)
        if why is not None and not self._is_reported:
            self._is_reported = True
            _logger.warning("%s; the rest of the run is flown without calls", why)
        return why

    def _why(self, under_way: int) -> str | None:
        if self.failures >= FAILURES_IN_A_ROW:
            return f"the server failed {FAILURES_IN_A_ROW} times in a row"
        spent = {**self.spent, "calls": self.spent["calls"] + under_way}
        over = [name for name, cap in self.caps.items() if spent[name] >= cap]
        return f"the cap on {over[0]}, {self.caps[over[0]]:,}, is reached" if over else None

    def spend(self, attempt: Attempt) -> None:
        """Count an attempt; one that made no call costs nothing."""
        if attempt.error == "budget":
            return
        self.spent["calls"] += attempt.calls
        self.spent["tokens"] += attempt.tokens or 0
        self.spent["seconds"] += attempt.seconds
        if self.failures < FAILURES_IN_A_ROW:
            self.failures = self.failures + 1 if attempt.error in FAILURES else 0
