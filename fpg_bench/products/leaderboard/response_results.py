"""Results of responses: what an entry keeps against each, played and verified."""

from __future__ import annotations

import contextlib
import random
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from annotated_types import Ge, Gt, Len, Lt

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.common.ids import other_side
from fpg_bench.common.parallel import Workers
from fpg_bench.common.schema import Items, NonNegativeInt, parse
from fpg_bench.evaluation.statistics import MATCHES, mean_interval
from fpg_bench.evaluation.store import EncounterStore, StrictResult
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.about import ResponseFile
from fpg_bench.products.leaderboard.changed_entries import rows_at
from fpg_bench.products.leaderboard.crossplay import play_rounds, rewards_of
from fpg_bench.products.leaderboard.folders import (
    ANSWERED,
    RESPONSE_ABOUT,
    exploited_file,
    remove,
    response_folders,
)
from fpg_bench.products.leaderboard.playing import work_store
from fpg_bench.products.leaderboard.responses import Response, read_response
from fpg_bench.products.leaderboard.result import round_finite
from fpg_bench.products.leaderboard.submission import read_policy
from fpg_bench.products.leaderboard.targets import answered_entries
from fpg_bench.products.leaderboard.verdicts import (
    EXACT,
    SHARE_OF_ROUNDS,
    WITHIN,
    Check,
    Replayed,
    Tolerances,
    Verdict,
    Verdicts,
    Within,
    check_share,
    draw,
)


class ResponseResult(StrictResult):
    """Result of a response: what the entry earned against it.

    Attributes:
        track, slug, response: names of the entry and of the response.
        key: see :attr:`Response.key`.
        rewards: return per step of each training seed of the entry.
        half: half of its 95 % interval over matches, of each training seed.
        lost: number of rounds lost by an invalid answer, ``(the entry's, the response's)``.
    """

    track: str
    slug: str
    response: str
    key: str
    rewards: Annotated[Items[Annotated[float, Gt(-1e6), Lt(1e6)]], Len(1)]
    half: Annotated[Items[Annotated[float, Ge(0), Lt(1e6)]], Len(1)]
    lost: Annotated[Items[NonNegativeInt], Len(2, 2)]

    @property
    def name(self) -> str:
        """The response's name on the board."""
        return f"{self.track}/{self.slug}/{self.response}"

    def is_of(self, response: Response) -> bool:
        """Return True if it is the result of a response, with as many training seeds as the entry has."""
        counts = {len(self.rewards), len(self.half), len(response.target.parts)}
        return (self.name, self.key, len(counts)) == (response.name, response.key, 1)


def result_store(board: Path) -> EncounterStore[Response, ResponseResult]:
    """Return the results of responses on a board."""
    return EncounterStore(ResponseResult, exploited_file(board))


def play_response(response: Response) -> ResponseResult:
    """Play a response against each training seed of its entry, and return the result.

    Raises:
        PolicyFailed: a policy's process died or exceeded its limits.
        UserError: none of the response's answers is a valid action.
    """
    entry, answer = response.target.entry, response.as_entry()
    seeds, n_parts = response.seeds, len(entry.parts)
    games = np.arange(len(seeds) * n_parts)
    runners = games % n_parts
    pair = [(entry, runners), (answer, np.zeros_like(games))][:: 1 if entry.side == "ally" else -1]
    duel, lost = play_rounds(*pair[0], *pair[1], np.repeat(seeds, n_parts).tolist())
    by_entry, by_response = (lost[SIDES.index(each.side)] for each in (entry, answer))
    if by_response.all():
        raise UserError("all of its rounds are lost by rule: its answers are not valid actions")
    rewards = rewards_of(duel, entry, by_entry)
    intervals = [mean_interval(rewards[runners == k], MATCHES) for k in range(n_parts)]
    return ResponseResult(
        track=entry.side,
        slug=entry.slug,
        response=response.slug,
        key=response.key,
        rewards=tuple(round_finite(interval.value) for interval in intervals),
        half=tuple(round_finite(interval.half) for interval in intervals),
        lost=(int(by_entry.sum()), int(by_response.sum())),
    )


TOLERANCES = Tolerances(
    ResponseResult,
    track=EXACT,
    slug=EXACT,
    response=EXACT,
    key=EXACT,
    rewards=Within(WITHIN, "return"),
    half=Within(WITHIN, "return"),
    lost=Within(1 - SHARE_OF_ROUNDS, "rounds", of=" by player"),
)


def _compare(response: Response, now: ResponseResult, then: ResponseResult) -> list[str]:
    """Return what does not hold of a response's result."""
    scale, rounds = response.target.entry.scale, len(response.seeds) * len(now.rewards)
    units = {"return": scale.top - scale.zero, "rounds": rounds}
    return TOLERANCES.of([Replayed(now, then, units, is_scripted=False, is_same=now.rewards == then.rewards)])


def _describe(response: Response, now: ResponseResult) -> str:
    """Return a result in words."""
    text = f"{response.target.name} keeps {min(now.rewards):.2f} per step against {response.slug}"
    invalid = zip(("entry", "response"), now.lost, strict=True)
    return text + "".join(f", {n:,} rounds lost by the {who}'s invalid answers" for who, n in invalid if n)


_CHECK = Check(play_response, _compare, _describe)


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
    targets = list(answered_entries(board, [name], every=True))
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
        _write(board, [*result_store(board).known().values(), result])
    except BaseException:
        remove(folder)
        with contextlib.suppress(OSError):
            folder.parent.rmdir()  # where it has no other response
        raise
    return _describe(response, result)


def verify_responses(
    board: str | Path,
    names: Sequence[str] = (),
    *,
    sample: float | None = None,
    sample_seed: int | None = None,
    since: str | None = None,
    update: bool = False,
    workers: Workers | int = 1,
) -> list[Verdict]:
    """Play the responses to verified entries of a board, and compare with their results or write them.

    Args:
        board: the leaderboard's folder.
        names: the entries, ``track/name`` each; empty: all.
        sample: of the responses with a trusted result, play only this share again, drawn at random.
        sample_seed: of the draw; None: a new one.
        since: a trusted git revision. Results that are not there are not trusted: they are played and
            replaced. Of the others only those of named entries, or a sample, are played.
        update: replace results that do not hold.
        workers: number of responses that are played at once, or :class:`fpg_bench.common.parallel.Workers`.

    Returns:
        The verdicts, by name; none on responses to entries that are not verified.

    Raises:
        UserError: no such board or entry, a share out of range, or a revision that git does not know.
    """
    if sample is not None:
        check_share(sample)
    board, verdicts, invalid = Path(board), Verdicts(), list[str]()
    with work_store(board, "responses", ResponseResult) as work:
        known = result_store(board).known(invalid.append)
        if invalid and not update:
            line = f"{len(invalid)} lines were no result of a response; replaced, commit this file"
            verdicts.give(exploited_file(board).name, False, line)
        trusted = None if since is None else _trusted(board, since, verdicts)
        responses = _read_responses(board, names, verdicts)
        stays = known.values() if trusted is None else trusted
        kept = [each for each in responses if each.key in known and known[each.key] in stays]
        is_drawn = since is None or bool(names)
        drawn = draw(kept, 1.0 if is_drawn and sample is None else sample or 0.0, random.Random(sample_seed))
        wanted = []
        for each in responses:
            if each in kept and each not in drawn:
                verdicts.give(each.name, True, "not played again")
            else:
                wanted.append(each)
        known |= _CHECK.verify(wanted, known, work, verdicts, trusted=trusted, update=update, workers=workers)
        keys = {response.name: response.key for response in responses}
        _write(board, (each for each in known.values() if keys.get(each.name, each.key) == each.key))
    return verdicts.all()


def _trusted(board: Path, revision: str, verdicts: Verdicts) -> set[ResponseResult]:
    """Return the results at a git revision; those whose response was removed get a bad verdict."""
    results = set()
    for row in rows_at(board, revision, exploited_file):
        with contextlib.suppress(UserError):
            results.add(parse(ResponseResult, row, "response"))
    for result in results:
        if not (board / "responses" / result.name).is_dir():
            verdicts.give(result.name, False, "was removed; ask its author, or restore it")
    return results


def _read_responses(board: Path, names: Sequence[str], verdicts: Verdicts) -> list[Response]:
    """Return the responses to verified entries; those with problems get a bad verdict."""
    responses = []
    for target in answered_entries(board, names, verdicts):
        for folder in response_folders(board, target.name):
            try:
                responses.append(read_response(folder, target))
            except (UserError, OSError) as error:
                verdicts.give(f"{target.name}/{folder.name}", False, str(error))
    return responses


def _write(board: Path, results: Iterable[ResponseResult]) -> None:
    """Write results by name, without those of responses that are gone."""
    left = [each for each in results if (board / "responses" / each.name).is_dir()]
    if left or exploited_file(board).exists():
        result_store(board).write(sorted(left, key=lambda each: (each.name, each.key)))
