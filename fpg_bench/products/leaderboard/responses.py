"""Responses to entries: agents made to lower an ally's return, in folders of a board, and their results.

A response is an agent folder ``responses/ally/<entry>/<name>`` with a ``response.yaml``, which says who made
it. Anybody may add one. It is played twice against each training seed of the entry. The seeds of the first
draw follow from what both policies hold; those of the second also from a number that is drawn when the
response is verified, which its author cannot have seen. The first one tells which training seed keeps least,
the second one how much.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import logging
import re
import secrets
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from annotated_types import Ge, Gt, Len, Lt

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.ids import other_side
from fpg_bench.common.schema import Items, NonNegativeInt, Strict, parse
from fpg_bench.evaluation.seeds import PROTOCOL, evaluation_seeds
from fpg_bench.evaluation.statistics import MATCHES, mean_interval
from fpg_bench.evaluation.store import StrictResult
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.about import ResponseFile
from fpg_bench.products.leaderboard.cases import verified_cases
from fpg_bench.products.leaderboard.crossplay import CrossplayEntry, play_rounds, rewards_of
from fpg_bench.products.leaderboard.encounters import Kind, Verification
from fpg_bench.products.leaderboard.folders import (
    ANSWERED,
    RESPONSE_ABOUT,
    exploited_file,
    remove,
    response_folders,
    submission_folders,
)
from fpg_bench.products.leaderboard.playing import Part
from fpg_bench.products.leaderboard.result import round_finite
from fpg_bench.products.leaderboard.submission import MOST_TEXT_BYTES, read_policy, slug_problems
from fpg_bench.products.leaderboard.verdicts import (
    EXACT,
    SHARE_OF_ROUNDS,
    WITHIN,
    Replayed,
    Tolerances,
    Verdict,
    Verdicts,
    Within,
)
from fpg_bench.products.sandbox.client import AGENT_FILES, Policy, check_policies

FILES = {**AGENT_FILES, RESPONSE_ABOUT: MOST_TEXT_BYTES}  # of a response, and their most bytes
ROUNDS = 100  # of each training seed of an entry against a response, in each draw
_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Response:
    """A response to an entry.

    Attributes:
        target: the entry.
        slug: its name among the responses to the entry.
        policy: its policy.
        about: who made it.
        files: hash of the files that say what it is and who made it.
        drawn: the number that its second draw follows from; None: one is drawn as it is played.
    """

    target: CrossplayEntry
    slug: str
    policy: Policy
    about: ResponseFile
    files: str
    drawn: str | None = None

    @property
    def name(self) -> str:
        """Its name on the board, ``track/entry/slug``."""
        return f"{self.target.name}/{self.slug}"

    @cached_property
    def content(self) -> str:
        """Hash of all that decides its matches; no name and no card is part of it."""
        content = [self.target.identity, self.policy.sha256, self.target.scenario_hash, PROTOCOL, ROUNDS]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    @property
    def key(self) -> str:
        """Hash of all that the board shows of it."""
        return hashlib.sha256(json.dumps([self.content, self.name, self.files]).encode()).hexdigest()[:32]

    def seeds(self, *drawn: str) -> Sequence[int]:
        """Return the evaluation seeds of its matches against each training seed of the entry, in a draw."""
        return evaluation_seeds(ROUNDS, "/".join([self.content, *drawn]))

    def as_entry(self) -> CrossplayEntry:
        """Return the response as a player, in the game of the entry."""
        part = Part(self.slug, self.policy.seed, self.policy)
        return dataclasses.replace(
            self.target, slug=self.slug, side=other_side(self.target.side), parts=(part,)
        )


class Draw(Strict):
    """Returns of an entry against a response in one draw of the evaluation seeds.

    Attributes:
        rewards: return per step of each training seed of the entry.
        half: half of its 95 % interval over matches, of each training seed.
        lost: number of rounds lost by an invalid answer, ``(the entry's, the response's)``.
    """

    rewards: Annotated[Items[Annotated[float, Gt(-1e6), Lt(1e6)]], Len(1)]
    half: Annotated[Items[Annotated[float, Ge(0), Lt(1e6)]], Len(1)]
    lost: Annotated[Items[NonNegativeInt], Len(2, 2)]


class ResponseResult(StrictResult):
    """Result of a response.

    Attributes:
        track, slug, response: names of the entry and of the response.
        key: see :attr:`Response.key`.
        content: see :attr:`Response.content`.
        drawn: the number that the second draw follows from.
        first, second: the two draws.
    """

    track: str
    slug: str
    response: str
    key: str
    content: str
    drawn: str
    first: Draw
    second: Draw

    @property
    def name(self) -> str:
        """The response's name on the board."""
        return f"{self.track}/{self.slug}/{self.response}"

    def is_of(self, response: Response) -> bool:
        """Return True if it is the result of a response, with as many training seeds as the entry has."""
        counts = {len(of) for draw in (self.first, self.second) for of in (draw.rewards, draw.half)}
        return (self.name, self.key, counts) == (response.name, response.key, {len(response.target.parts)})


# Reading


def read_response(folder: Path, target: CrossplayEntry, inspect_onnx: bool = True) -> Response:
    """Read a response's folder; none of it is run.

    Args:
        folder: the folder.
        target: the entry that it answers.
        inspect_onnx: inspect the ONNX file in a sandboxed process; not needed if it is not played.

    Raises:
        UserError: its first problem.
    """
    where = f"response {target.name}/{folder.name}"
    for line in slug_problems(folder):
        raise UserError(f"{where}: {line}")
    policy, problems = read_policy(folder, None, other_side(target.side), FILES)
    if policy is not None and not problems and inspect_onnx:
        problems = [f"/policy.onnx: {line}" for line in check_policies([policy.model])[0]]
    if policy is None or policy.card is None or problems:
        raise UserError(f"{where}{problems[0]}")
    about = parse(ResponseFile, read_yaml(folder / RESPONSE_ABOUT, where), f"{where}/{RESPONSE_ABOUT}")
    files = hashlib.sha256()
    for name in sorted(FILES):
        files.update(hashlib.sha256((folder / name).read_bytes()).digest())
    return Response(target, folder.name, policy, about, files.hexdigest())


def read_responses(
    board: Path, target: CrossplayEntry, earlier: Collection[str] = (), inspect_onnx: bool = True
) -> Iterator[tuple[str, Response | str]]:
    """Yield the names of the responses to an entry, each with the response or the first of its problems.

    A copy of another response is a problem.

    Args:
        board: the leaderboard's folder.
        target: the entry.
        earlier: names of responses that come before others with the same policy, which are copies.
        inspect_onnx: see :func:`read_response`.
    """
    first: dict[str, str] = {}
    folders = response_folders(board, target.name)
    for folder in sorted(folders, key=lambda each: (f"{target.name}/{each.name}" not in earlier, each.name)):
        name = f"{target.name}/{folder.name}"
        try:
            response = read_response(folder, target, inspect_onnx)
        except (UserError, OSError) as error:
            yield name, str(error)
            continue
        original = first.setdefault(response.policy.sha256, name)
        yield name, response if original == name else f"response {name}: is a copy of {original}"


# Playing


def play_response(response: Response) -> ResponseResult:
    """Play a response against each training seed of its entry, and return the result.

    Raises:
        PolicyFailed: a policy's process died or exceeded its limits.
        UserError: none of the response's answers is a valid action.
    """
    drawn = response.drawn or secrets.token_hex(16)
    return ResponseResult(
        track=response.target.side,
        slug=response.target.slug,
        response=response.slug,
        key=response.key,
        content=response.content,
        drawn=drawn,
        first=_play_draw(response, response.seeds()),
        second=_play_draw(response, response.seeds(drawn)),
    )


def _play_draw(response: Response, seeds: Sequence[int]) -> Draw:
    entry, answer = response.target, response.as_entry()
    n_parts = len(entry.parts)
    games = np.arange(len(seeds) * n_parts)
    runners = games % n_parts
    pair = [(entry, runners), (answer, np.zeros_like(games))][:: 1 if entry.side == "ally" else -1]
    duel, lost = play_rounds(*pair[0], *pair[1], np.repeat(seeds, n_parts).tolist())
    by_entry, by_response = (lost[SIDES.index(each.side)] for each in (entry, answer))
    if by_response.all():
        raise UserError("all of its rounds are lost by rule: its answers are not valid actions")
    rewards = rewards_of(duel, entry, by_entry)
    intervals = [mean_interval(rewards[runners == k], MATCHES) for k in range(n_parts)]
    return Draw(
        rewards=tuple(round_finite(interval.value) for interval in intervals),
        half=tuple(round_finite(interval.half) for interval in intervals),
        lost=(int(by_entry.sum()), int(by_response.sum())),
    )


_DRAW = Tolerances(
    Draw,
    rewards=Within(WITHIN, "return"),
    half=Within(WITHIN, "return"),
    lost=Within(1 - SHARE_OF_ROUNDS, "rounds", of=" by player"),
)
TOLERANCES = Tolerances(
    ResponseResult,
    **dict.fromkeys(("track", "slug", "response", "key", "content", "drawn"), EXACT),
    first=_DRAW,
    second=_DRAW,
)


def _compare(response: Response, now: ResponseResult, then: ResponseResult) -> list[str]:
    """Return what does not hold of a response's result."""
    scale, rounds = response.target.scale, ROUNDS * len(now.first.rewards)
    units = {"return": scale.top - scale.zero, "rounds": rounds}
    return TOLERANCES.of([Replayed(now, then, units, is_scripted=False, is_same=now == then)])


def _describe(response: Response, now: ResponseResult) -> str:
    """Return a result in words."""
    kept = now.second.rewards[int(np.argmin(now.first.rewards))]
    text = f"{response.target.name} keeps {kept:.2f} per step against {response.slug}"
    lost = np.add(now.first.lost, now.second.lost).tolist()
    invalid = zip(("entry", "response"), lost, strict=True)
    return text + "".join(f", {n:,} rounds lost by the {who}'s invalid answers" for who, n in invalid if n)


RESPONSES = Kind("responses", ResponseResult, exploited_file, play_response, _compare, _describe)


# Boards


def enter_response(board: str | Path, name: str, agent: Path, about: Mapping[str, object]) -> str:
    """Enter an agent as a response to an entry, and play it; nothing is left where that fails.

    Args:
        board: the leaderboard's folder.
        name: the entry, ``ally/name``, which must be verified.
        agent: the agent's folder.
        about: content of ``response.yaml``; ``seconds`` are by default those of the agent's card.

    Returns:
        What the entry keeps, in words.

    Raises:
        UserError: no such verified ally, or not an agent that can be entered against it.
    """
    board = Path(board)
    if name.partition("/")[0] != ANSWERED:
        raise UserError(f"{name}: only allies are answered; name one, {ANSWERED}/name")
    targets = [CrossplayEntry.of(case) for case in verified_cases(board, [name])]
    if not targets:
        raise UserError(f"{name}: has no verified result; fpg-bench leaderboard verify {name}")
    (target,) = targets
    policy, problems = read_policy(agent, None, other_side(ANSWERED))
    if policy is None or policy.card is None or problems:
        raise UserError(f"agent {agent}{problems[0]}")
    content = {"seconds": policy.card.seconds, **about}
    if content["seconds"] is None:
        raise UserError(f"agent {agent}: does not say its seconds; name the CPU seconds of the search")
    credit = parse(ResponseFile, content, "response")
    slug = re.sub("[^a-z0-9]+", "-", credit.name.lower()).strip("-")[:36]
    folders = {each.name: each for each in response_folders(board, name)}
    for each in folders.values():
        if (each / "policy.onnx").read_bytes() == policy.model:
            raise UserError(f"agent {agent}: is the response {name}/{each.name} already")
    number = next(k for k in count(1) if f"{slug}-{k}" not in folders)
    folder = board / "responses" / name / f"{slug}-{number}"
    try:
        policy.card.write(folder, policy.model)
        content = {"name": credit.name, "authors": [*credit.authors], "seconds": credit.seconds}
        write_whole(folder / RESPONSE_ABOUT, yaml.safe_dump(content, sort_keys=False))
        response = read_response(folder, target)
        result = play_response(response)
        there = [each for each in RESPONSES.read(board).values() if _is_there(board, each)]
        RESPONSES.write(board, sorted([*there, result], key=lambda each: (each.name, each.key)))
    except BaseException:
        remove(folder)
        with contextlib.suppress(OSError):
            folder.parent.rmdir()  # where it has no other response
        raise
    return _describe(response, result)


def _is_there(board: Path, result: ResponseResult) -> bool:
    return (board / "responses" / result.name).is_dir()


def verify_responses(board: str | Path, how: Verification = Verification()) -> list[Verdict]:  # noqa: B008
    """Play the responses to verified entries of a board, and compare with their results or write them.

    Args:
        board: the leaderboard's folder.
        how: which are played again.

    Returns:
        The verdicts, by name; none on responses to entries that are not verified.

    Raises:
        UserError: no such board or entry, or a revision that git does not know.
    """
    board, verdicts = Path(board), Verdicts()
    trusted = RESPONSES.trusted(board, how.since)
    drawn = {result.content: result.drawn for result in trusted}
    earlier = {result.name for result in trusted}
    wanted = list[Response]()
    for target in _answered(board, how.names, verdicts):
        for name, response in read_responses(board, target, earlier):
            if isinstance(response, str):
                verdicts.give(name, False, response)
            else:
                wanted.append(dataclasses.replace(response, drawn=drawn.get(response.content)))
    for result in trusted if how.since is not None else ():
        if not _is_there(board, result):
            verdicts.give(result.name, False, "was removed; ask its author, or restore it")
    keys = {response.name: response.key for response in wanted}

    def place(result: ResponseResult) -> tuple[str, str] | None:
        is_current = keys.get(result.name, result.key) == result.key
        is_refused = result.name in verdicts and result.name not in keys
        is_kept = is_current and not is_refused and _is_there(board, result)
        return (result.name, result.key) if is_kept else None

    RESPONSES.verify(board, wanted, verdicts, how, place)
    return verdicts.all()


def _answered(board: Path, names: Sequence[str], verdicts: Verdicts) -> Iterable[CrossplayEntry]:
    """Return the verified allies of a board that have responses; others get a bad verdict."""
    allies = [f"{folder.parent.name}/{folder.name}" for folder in submission_folders(board, names)]
    allies = [name for name in allies if name.startswith(f"{ANSWERED}/")]
    answered = {f"{path.parent.name}/{path.name}" for path in (board / "responses").glob("*/[!.]*")}
    for name in sorted(answered - set(allies)) if not names else ():
        verdicts.give(name, False, f"responses/{name}: no such ally")
    asked = [name for name in allies if name in answered]
    targets = {case.name: CrossplayEntry.of(case) for case in verified_cases(board, asked)} if asked else {}
    for name in asked:
        if name not in targets:
            _logger.info(f"{name}: left out: it has no verified result; fpg-bench leaderboard verify {name}")
    return targets.values()
