"""The planner that asks a large language model behind any OpenAI-compatible server."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.planner import BatchPlanner, Limits, Patrol, Plan, Request
from fpg_bench.products.language_models.answers import answer_schema, points_in, read_answer, uselessness
from fpg_bench.products.language_models.budget import CALLS, SECONDS, TOKENS, CallBudget
from fpg_bench.products.language_models.client import Client, Reply, response_format
from fpg_bench.products.language_models.prompts import CONTROLS, Prompt, load_prompt, reask
from fpg_bench.products.language_models.servers import (
    RESPONSE_FORMATS,
    TOKEN_FIELDS,
    Endpoint,
    endpoint_from_environment,
)
from fpg_bench.products.language_models.transcript import (
    FIRST,
    LAST,
    Attempt,
    Body,
    Header,
    Transcript,
    Where,
    judge,
    place_of,
)
from fpg_bench.version import __version__

_RAW_CHARS = 10_000
LLM_CONTROLS = {"llm" if control == "none" else f"llm-{control}": control for control in CONTROLS}


class LLMPlanner(BatchPlanner):
    """Asks a language model for each path; without a valid answer, the last valid path is flown again.

    An answer that breaks a rule is sent back once, with the rule. After that, or where the call fails, the
    match's last valid path is held, or the circle before there is any. A plan's status is ``ok``;
    ``repaired`` (surplus points, or points just outside the box); ``reasked`` (valid at the second attempt);
    or ``fallback-`` and the reason: ``invalid``, ``refused``, ``timeout``, ``http``, or ``budget``: no call
    was made, since the budget is spent or the server failed five times in a row. A wrong key or address,
    which asking again cannot mend, ends the run with an error while no call has been answered.

    The planner can be copied and pickled. A pickle holds no key: it is read from the environment again.

    Args:
        scenario: what is played.
        endpoint: the server and the model; None: from the environment. A replay needs none.
        prompt: a prompt profile, its name or a YAML file of one; None: the server's, in a replay the
            transcript's.
        control: ``none``, or what is withheld from the model: ``shuffled-rewards``, ``no-history``;
            None: that of the class.
        transcript: the file of requests and answers. Each match in it needs its own seed.
        mode: ``live`` (no transcript), ``record`` (attempts in the transcript are used, all others are made
            and added) or ``replay`` (from the transcript alone, without a server); None: ``record`` where
            there is a transcript.
        calls, tokens, seconds: caps on the complete run; see
            :class:`fpg_bench.products.language_models.budget.CallBudget`.
        deadline_s: time for each call; None: 30 s.
        concurrency: number of games asked for at once. Calls under way may exceed the caps.
        temperature: sampling temperature; None: that of the server's profile.
        sampling_seed: determines the seeds that are sent to the server.

    Raises:
        UserError: no endpoint, an unknown prompt, control or mode, a cap or deadline that is not a
            positive number, a temperature that the server does not take; while planning: a transcript that
            holds other requests, or in a replay lacks one, or a server that cannot be reached, knows no such
            address or refuses the key.
    """

    tier = "history"
    asks_language_model = True
    control = "none"

    def __init__(
        self,
        scenario: Scenario,
        endpoint: Endpoint | None = None,
        *,
        prompt: str | Prompt | None = None,
        control: str | None = None,
        transcript: str | Path | None = None,
        mode: str | None = None,
        calls: float = CALLS,
        tokens: float = TOKENS,
        seconds: float = SECONDS,
        deadline_s: float | None = None,
        concurrency: int = 1,
        temperature: float | None = None,
        sampling_seed: int = 0,
    ) -> None:
        control = control or self.control
        if control not in CONTROLS:
            raise UserError(f"unknown control {control!r}{nearest(control, CONTROLS)}")
        if concurrency < 1:
            raise UserError(f"concurrency is {concurrency}; expected 1 or more")
        if deadline_s is not None and not 0 < deadline_s < math.inf:
            raise UserError(f"deadline: {deadline_s:g} s; expected a number above 0")
        self.scenario = scenario
        self.name = "llm" if control == "none" else f"llm-{control}"
        self.control = control
        mode = mode or ("live" if transcript is None else "record")
        self.transcript = Transcript(transcript, mode)
        self.budget = CallBudget(calls, tokens, seconds)
        self.concurrency, self.sampling_seed = concurrency, integer(sampling_seed, "sampling_seed", 0)
        self._circle = Patrol("circle", scenario)
        self._is_answered = False  # any call of this planner
        self._client: Client | None = None
        if self.transcript.mode != "replay":
            asked = endpoint or endpoint_from_environment()
            asked = replace(asked, server=asked.server.at_temperature(temperature))
            self._client = Client(asked, deadline_s)
            prompt = prompt or asked.server.prompt
        prompt = prompt or self.transcript.first_prompt()
        self.prompt = prompt if isinstance(prompt, Prompt) else load_prompt(prompt)

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the plans of some games; an answer's plan does not depend on ``concurrency``.

        Raises:
            UserError: the transcript does not fit, or the server cannot be used; see above.
            OSError: the transcript cannot be written.
        """
        if self.transcript.mode == "record":
            self.budget.resume(self.transcript.attempts(), f"transcript {self.transcript.path}")
        plans: list[Plan] = []
        for start in range(0, len(requests), self.concurrency):
            talks = [_Talk(request) for request in requests[start : start + self.concurrency]]
            self._ask(talks, FIRST)
            self._ask([talk for talk in talks if talk.attempts[FIRST].asks_again], LAST)
            plans += [self._plan(talk) for talk in talks]
        return plans

    def _ask(self, talks: Sequence[_Talk], number: int) -> None:
        """Make an attempt for each talk: from the transcript, by a call, or without one (budget spent)."""
        bodies: dict[int, Body] = {}
        for index, talk in enumerate(talks):
            body = self._body(talk, number)
            recorded = self.transcript.find((*place_of(talk.request), number), body)
            if recorded is not None:
                talk.attempts.append(self._checked(recorded, talk.request.limits))
            elif refusal := self.budget.refusal(len(bodies)):
                skipped = Reply(error="budget", detail=refusal, calls=0)
                talk.attempts.append(self._add(talk, number, skipped))
            else:
                bodies[index] = body
        self._call([(talks[index], body) for index, body in bodies.items()], number)

    def _call(self, talks: Sequence[tuple[_Talk, Body]], number: int) -> None:
        """Call the server, and keep each reply as soon as it arrives: a run may be killed at any time."""
        if self._client is None or not talks:
            return
        made: dict[int, Attempt] = {}
        failed: dict[int, Reply] = {}

        def keep(index: int, reply: Reply) -> None:
            self._is_answered |= reply.error is None
            if reply.is_permanent and not self._is_answered:
                failed[index] = reply
                return
            made[index] = self._add(talks[index][0], number, reply)

        self._client.complete_all([body for _, body in talks], self.concurrency, keep)
        for index, reply in failed.items():
            if not self._is_answered:  # nothing is kept, so that the same run can go on once it is mended
                mend = "mend the server or the FPG_LLM_ variables"
                raise UserError(f"planner {self.name}: {reply.detail}; {mend}")
            keep(index, reply)
        for index, (talk, _) in enumerate(talks):
            self.budget.spend(made[index])
            talk.attempts.append(made[index])

    def _body(self, talk: _Talk, number: int) -> Body:
        messages = self.prompt.messages(talk.request, self.control)
        if number == LAST:
            first = talk.attempts[FIRST]
            problem = read_answer(first.text or "", talk.request.limits).problem
            messages = reask(messages, first.text or "", problem or "no valid path")
        if self._client is None:
            return {"messages": messages}
        seed = server_seed((*place_of(talk.request), number), self.sampling_seed)
        return self._client.request_body(messages, seed, answer_schema(talk.request.limits))

    def _add(self, talk: _Talk, number: int, reply: Reply) -> Attempt:
        """Add an attempt to the transcript, with fields for readers that a replay does not need."""
        assert self._client is not None
        request, prompt = talk.request, self.prompt
        judged = judge(reply.text, reply.error, request.limits)
        attempt = Attempt(
            seed=request.seed,
            match=request.match,
            round=request.round,
            attempt=number,
            request=dict(reply.sent) or None,
            text=reply.text,
            error=reply.error,
            detail=reply.detail,
            **judged._asdict(),
            prompt=prompt.name,
            prompt_hash=prompt.hash,
            control=self.control,
            calls=reply.calls,
            seconds=reply.seconds,
            tokens_in=reply.tokens_in,
            tokens_out=reply.tokens_out,
            model=reply.model,
        )
        raw = reply.raw if len(text := _text(reply.raw)) <= _RAW_CHARS else text[:_RAW_CHARS]
        server = self._client.endpoint.server.name
        extra = {"planner": self.name, "server": server, "versions": _versions(), "raw": raw}
        return self.transcript.add(attempt, extra)

    def _checked(self, attempt: Attempt, limits: Limits) -> Attempt:
        """Return an attempt of the transcript whose fields still follow from its text."""
        judged = judge(attempt.text, attempt.error, limits)
        for name, value in judged._asdict().items():
            if getattr(attempt, name) != value:
                problem = f"is changed: its {name} are not what its text says"
                raise UserError(self.transcript.complaint(attempt.where, problem))
        return attempt

    def _plan(self, talk: _Talk) -> Plan:
        # Earlier paths come from the transcript, so that a resumed run and a replay hold the same
        request, last, earlier = talk.request, talk.attempts[-1], self.transcript.valid_before(talk.request)
        if last.waypoints is not None:
            status, path = "reasked" if last.attempt == LAST else last.status, np.array(last.waypoints)
            past = [np.array(attempt.waypoints) for attempt in earlier]
            useless = uselessness(path, request, points_in(self.prompt.example), past)
            return Plan(path, "llm", status, talk.tokens, talk.seconds, useless)
        if earlier:
            source, path = "held", np.array(self._checked(earlier[-1], request.limits).waypoints)
        else:
            source, path = "circle", self._circle.plan_batch([request])[0].waypoints
        answer = None if last.text is None else read_answer(last.text, request.limits)
        problem = (answer and answer.problem) or last.detail or last.status
        return Plan(path, source, f"fallback-{last.status}", talk.tokens, talk.seconds, problem=problem)


class LLMShuffledRewards(LLMPlanner):
    """Asks with the rewards shuffled among all past positions."""

    control = "shuffled-rewards"


class LLMNoHistory(LLMPlanner):
    """Asks without any past round."""

    control = "no-history"


@dataclass
class _Talk:
    """A request, and the attempts at its plan so far."""

    request: Request
    attempts: list[Attempt] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        return sum(attempt.seconds for attempt in self.attempts)

    @property
    def tokens(self) -> int | None:
        """All tokens; None: calls were made, but the server counted none."""
        counts = [attempt.tokens for attempt in self.attempts if attempt.error != "budget"]
        reported = [count for count in counts if count is not None]
        return sum(reported) if reported or not counts else None


def server_seed(where: Where, sampling_seed: int = 0) -> int:
    """Return the seed of 31 bits that is sent to a server with an attempt."""
    numbers = (*where, sampling_seed) if sampling_seed else where
    digest = hashlib.sha256(" ".join(map(str, numbers)).encode()).digest()
    return int.from_bytes(digest[:4], "big") >> 1


def request_problem(attempt: Attempt, header: Header, limits: Limits) -> str | None:
    """Return what in a recorded request this planner would not have sent, None if it could have sent all.

    Args:
        attempt: the attempt; one without a request has no problem.
        header: the run's description.
        limits: of the plan that was asked for.
    """
    request = attempt.request or {}
    expected: dict[str, list[Any]] = {
        "seed": [server_seed(attempt.where, header.sampling_seed)],
        "temperature": [request.get("temperature") if header.temperature is None else header.temperature],
        "response_format": [response_format(form, answer_schema(limits)) for form in RESPONSE_FORMATS],
    }
    if set(TOKEN_FIELDS) <= request.keys():
        return f"holds both {' and '.join(TOKEN_FIELDS)}"
    for name, value in request.items():
        if name not in ("model", "messages", *TOKEN_FIELDS, *expected):
            return f"holds {name!r:.40}, which the planner does not send"
        if name in expected and _text(value) not in map(_text, expected[name]):
            return f"was asked with another {name} than the run's"
    return None


def _text(raw: object) -> str:
    return raw if isinstance(raw, str) else json.dumps(raw)


def check_asked(asks: bool, options: Iterable[str]) -> None:
    """Raise UserError for options of language models where no planner asks one."""
    if not asks and (given := next(iter(options), None)):
        raise UserError(f"{given}: is for the planners {', '.join(LLM_CONTROLS)}; name one of them")


@cache
def _versions() -> dict[str, str]:
    return {"fpg_bench": __version__, "openai": version("openai")}
