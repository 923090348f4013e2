"""Prompt profiles: YAML files with the texts that a language model is sent, filled in with a request."""

from __future__ import annotations

import copy
import hashlib
import json
import math
from pathlib import Path
from string import Template

from pydantic import ValidationInfo, field_validator

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml
from fpg_bench.common.schema import NonNegativeInt, Strict, parse
from fpg_bench.players.planner import Array, Limits, Request

PROMPT_FOLDER = Path(__file__).with_name("prompts")
PROMPTS = ("brief", "paper", "standard")
CONTROLS = ("none", "shuffled-rewards", "no-history")

_REPLY_CHARS = 4000  # of a broken reply, its end is shown to the model again

# Placeholders of each text
_SITUATION = ("box_x", "box_y", "box_z", "round_s", "part_s", "speed", "reach", "waypoints", "x", "y", "z")
_PLACEHOLDERS: dict[str | None, tuple[str, ...]] = {
    "system": (*_SITUATION, "history", "example"),
    "user": (*_SITUATION, "history", "example"),
    "history": ("rounds",),
    "heading": ("round", "mean_reward"),
    "row": ("second", "part", "x", "y", "z", "reward", "gain"),
    "example": (),
    "no_history": (),
}


class _Texts(Strict):
    about: str
    user: str
    row: str
    system: str = ""
    history: str = "$rounds"
    heading: str = ""
    no_history: str = ""
    rows: NonNegativeInt = 0
    example: str = ""

    @field_validator("system", "user", "history", "heading", "row", "example", "no_history")
    @classmethod
    def _check_placeholders(cls, text: str, info: ValidationInfo) -> str:
        if not Template(text).is_valid():
            raise UserError("a $ without a name behind it; write $$ for a dollar sign")
        known = _PLACEHOLDERS[info.field_name]
        for name in Template(text).get_identifiers():
            if name not in known:
                raise UserError(f"unknown placeholder ${name}{nearest(name, known)}")
        return text


class _Rounds(Strict):
    first: NonNegativeInt
    best: NonNegativeInt
    latest: NonNegativeInt


class _File(_Texts):
    rounds: _Rounds


class Prompt(_Texts, _Rounds):
    """A prompt profile: texts with ``$placeholders``, and the choice of past rounds.

    Attributes:
        name, about: its name and description.
        user, system: the messages; an empty one is not sent.
        history, no_history: the text in place of ``$history``, with and without past rounds.
        heading, row: the line above a past round (empty: none), and the line of one of its parts.
        first, best, latest: number of rounds shown: the first, those of the highest mean reward, the
            latest.
        rows: number of parts shown of a past round, those of the highest rewards; 0: all.
        example: of an answer; its points, in brackets, are not to be copied.
    """

    name: str

    @property
    def hash(self) -> str:
        """SHA-256 of everything that decides the messages, as 64 hexadecimal digits."""
        content = self.model_dump(exclude={"name", "about"})
        for key in ("rows", "example"):  # added later: profiles without them keep their hashes
            if not content[key]:
                del content[key]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def messages(self, request: Request, control: str = "none") -> list[dict[str, str]]:
        """Return the chat messages of a request, which is left unchanged; equal requests give equal messages.

        Args:
            request: positions are written in whole metres, rewards with two decimals.
            control: ``shuffled-rewards`` permutes the rewards among all past positions, ``no-history`` shows
                no past round; ``none``: no control.
        """
        history = self._history(controlled(request, control), request.limits)
        values = {**_situation(request), "history": history, "example": self.example.strip()}
        return [
            {"role": role, "content": Template(text).substitute(values).strip()}
            for role, text in (("system", self.system), ("user", self.user))
            if text
        ]

    def _history(self, history: Array, limits: Limits) -> str:
        if not len(history):
            return self.no_history.strip()
        means = [_reward(mean) for mean in history[..., 3].mean(axis=1)]
        usual, seconds = float(history[..., 3].mean()), limits.middles_s()
        heading, row, lines = Template(self.heading), Template(self.row), []
        for k in self._shown_rounds(means):
            if self.heading:
                lines.append(heading.substitute(round=k + 1, mean_reward=means[k]))
            for i in self._shown_parts(history[k]):
                reward = float(history[k, i, 3])
                values = {"second": seconds[i], "part": i + 1, "reward": _reward(reward)}
                gain = _reward(reward - usual, "+")
                lines.append(row.substitute(_place(history[k, i, :3]), **values, gain=gain))
        return Template(self.history).substitute(rounds="\n".join(lines)).strip()

    def _shown_parts(self, parts: Array) -> list[int]:
        """Return the parts of a round that are shown, in the order of flight."""
        ranked = sorted(range(len(parts)), key=lambda i: -float(_reward(parts[i, 3])))
        return sorted(ranked[: self.rows or len(ranked)])

    def _shown_rounds(self, means: list[str]) -> list[int]:
        """Return the rounds that are shown, oldest first.

        Rounds are ranked by their means as written, so that the last bits of a mean decide nothing.
        """
        rounds = list(range(len(means)))
        ranked = sorted(rounds, key=lambda k: -float(means[k]))
        latest = rounds[max(len(rounds) - self.latest, 0) :]
        return sorted({*rounds[: self.first], *ranked[: self.best], *latest})


def reask(messages: list[dict[str, str]], reply_text: str, problem: str) -> list[dict[str, str]]:
    """Return the same chat, with the broken reply and a message that names the rule it broke.

    Args:
        messages: of the first attempt.
        reply_text: the reply, of which at most the last 4000 characters are repeated.
        problem: the rule, from :class:`fpg_bench.products.language_models.answers.Answer`.
    """
    # Half a surrogate pair can be received, but not sent
    reply = reply_text[-_REPLY_CHARS:].encode("utf-8", "replace").decode().strip()
    rule = f"That answer breaks a rule: {problem}. Answer again: the whole path, in the form asked for."
    return [
        *messages,
        {"role": "assistant", "content": reply or "(nothing)"},
        {"role": "user", "content": rule},
    ]


def load_prompt(name: str | Path) -> Prompt:
    """Return a prompt profile by its name in ``PROMPTS``, or from a YAML file of the same form.

    Raises:
        UserError: no such profile or file, or a key, value or placeholder that cannot be used.
    """
    path = prompt_file(name)
    file = parse(_File, read_yaml(path, "prompt"), f"prompt {path}")
    texts, rounds = file.model_dump(exclude={"rounds"}), file.rounds.model_dump()
    return Prompt(name=path.stem, **texts, **rounds)


def prompt_file(name: str | Path) -> Path:
    """Return the YAML file of a prompt profile; raises as :func:`load_prompt` does."""
    name = str(name)
    if name in PROMPTS:
        return PROMPT_FOLDER / f"{name}.yml"
    if not name.endswith((".yml", ".yaml")):
        raise UserError(f"prompt {name!r} is neither a profile nor a YAML file{nearest(name, PROMPTS)}")
    return Path(name)


def controlled(request: Request, control: str) -> Array:
    """Return the history ``(rounds, n, 4)`` that a control shows; the request stays as it is."""
    if control == "no-history":
        return request.history[:0]
    history = request.history.copy()
    if control == "shuffled-rewards":
        rewards, rng = history[..., 3], copy.deepcopy(request.rng)
        history[..., 3] = rng.permutation(rewards.ravel()).reshape(rewards.shape)
    return history


def _situation(request: Request) -> dict[str, int | float | str]:
    limits = request.limits
    part_s = limits.round_s / limits.waypoints
    return {
        **{f"box_{axis}": math.floor(side) for axis, side in zip("xyz", limits.box_m, strict=True)},
        **_place(request.current_position),
        "round_s": limits.round_s,
        "part_s": f"{part_s:g}",
        "speed": f"{limits.speed_m_s:g}",
        "reach": math.floor(limits.speed_m_s * part_s),
        "waypoints": limits.waypoints,
    }


def _place(position: Array) -> dict[str, int]:
    """Return whole metres, halves rounded down with some margin: a position's last bits must not decide."""
    return {axis: round(float(value) - 1e-6) for axis, value in zip("xyz", position, strict=True)}


def _reward(value: float, sign: str = "") -> str:
    return f"{round(float(value), 2) + 0.0:{sign}.2f}"  # + 0.0: never -0.00
