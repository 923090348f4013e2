"""What a language model is asked: prompt profiles, which are data, filled in with a request."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from fpg_bench.common.checks import check_keys, whole
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml
from fpg_bench.planning.planner import Limits, Request

PROMPT_FOLDER = Path(__file__).with_name("prompts")
PROMPTS = ("brief", "paper", "standard")
CONTROLS = ("none", "shuffled-rewards", "no-history")

_REPLY_CHARS = 4000  # of a broken reply, its end is shown to the model again

# What each text of a profile may name
_SITUATION = ("box_x", "box_y", "box_z", "round_s", "part_s", "speed", "reach", "waypoints", "x", "y", "z")
_NAMES = {
    "system": (*_SITUATION, "history", "example"),
    "user": (*_SITUATION, "history", "example"),
    "history": ("rounds",),
    "heading": ("round", "mean_reward"),
    "row": ("second", "part", "x", "y", "z", "reward", "gain"),
    "example": (),
    "no_history": (),
}
_NEEDED = {"about", "user", "row", "rounds"}


@dataclass(frozen=True)
class Prompt:
    """A prompt profile: texts with ``$placeholders``, and which past rounds are shown.

    Attributes:
        name, about: what it is called, and what it is.
        user, system: the messages; an empty one is not sent.
        history, no_history: what stands where the history does, and in its place where there is none.
        heading, row: what stands above a past round, and a line of it; an empty heading is left out.
        first, best, latest: how many rounds are shown: the first, those of the highest mean reward, the
            latest.
        rows: how many lines of a past round are shown, those of the highest rewards; 0: all.
        example: of an answer; its points, in brackets, are not to be copied.
    """

    name: str
    about: str
    user: str
    row: str
    first: int
    best: int
    latest: int
    system: str = ""
    history: str = "$rounds"
    heading: str = ""
    no_history: str = ""
    rows: int = 0
    example: str = ""

    @property
    def hash(self) -> str:
        """SHA-256 of everything that decides what is asked, as 64 hexadecimal digits."""
        content = {key: value for key, value in asdict(self).items() if key not in ("name", "about")}
        for key in ("rows", "example"):  # profiles that lack them had their hashes before there were any
            if not content[key]:
                del content[key]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def messages(self, request: Request, control: str = "none") -> list[dict[str, str]]:
        """The chat messages of a request: the same for the same request, whose generator is left as it is.

        Args:
            request: what is asked; positions are written in whole metres, rewards with two decimals.
            control: ``shuffled-rewards`` deals the rewards out anew among all past positions,
                ``no-history`` shows none; ``none``: no control.

        Raises:
            UserError: no such control.
        """
        if control not in CONTROLS:
            raise UserError(f"unknown control {control!r}{nearest(control, CONTROLS)}")
        history = self._history(controlled(request, control), request.limits)
        words = {**_situation(request), "history": history, "example": self.example.strip()}
        texts = {"system": self.system, "user": self.user}
        return [
            {"role": role, "content": Template(text).substitute(words).strip()}
            for role, text in texts.items()
            if text
        ]

    def _history(self, history: np.ndarray, limits: Limits) -> str:
        if not len(history):
            return self.no_history.strip()
        means = [_reward(mean) for mean in history[..., 3].mean(axis=1)]
        usual = float(history[..., 3].mean())
        heading, row, lines = Template(self.heading), Template(self.row), []
        for k in self._shown(means):
            if self.heading:
                lines.append(heading.substitute(round=k + 1, mean_reward=means[k]))
            seconds = _middles_s(limits)
            for i in self._told(history[k]):
                place, reward = _place(history[k, i, :3]), float(history[k, i, 3])
                words = {"second": seconds[i], "part": i + 1, "reward": _reward(reward)}
                lines.append(row.substitute(place, **words, gain=_reward(reward - usual, "+")))
        return Template(self.history).substitute(rounds="\n".join(lines)).strip()

    def _told(self, parts: np.ndarray) -> list[int]:
        """Which parts of a round are told, in the order in which they were flown."""
        ranked = sorted(range(len(parts)), key=lambda i: -float(_reward(parts[i, 3])))
        return sorted(ranked[: self.rows or len(ranked)])

    def _shown(self, means: list[str]) -> list[int]:
        """The rounds that are shown, oldest first.

        The best are found by the means as they are written, so that their last bits decide nothing.
        """
        rounds = list(range(len(means)))
        ranked = sorted(rounds, key=lambda k: -float(means[k]))
        latest = rounds[max(len(rounds) - self.latest, 0) :]
        return sorted({*rounds[: self.first], *ranked[: self.best], *latest})


def reask(messages: list[dict[str, str]], reply_text: str, problem: str) -> list[dict[str, str]]:
    """The same talk with the broken reply and a message that names the rule it broke.

    Args:
        messages: what was asked.
        reply_text: the reply, of which at most the last 4000 characters are repeated.
        problem: the rule, as :class:`fpg_bench.planning.llm.answers.Answer` has it.
    """
    # Half a surrogate pair can be received, but not sent
    said = reply_text[-_REPLY_CHARS:].encode("utf-8", "replace").decode().strip()
    rule = f"That answer breaks a rule: {problem}. Answer again: the whole path, in the form asked for."
    return [
        *messages,
        {"role": "assistant", "content": said or "(nothing)"},
        {"role": "user", "content": rule},
    ]


def load_prompt(name: str | Path) -> Prompt:
    """A prompt profile by its name in ``PROMPTS``, or from a YAML file of the same form.

    Raises:
        UserError: no such profile or file, or a key, value or placeholder that cannot be used.
    """
    path = prompt_file(name)
    content = read_yaml(path, "prompt")
    check_keys(content, _NEEDED | set(_NAMES) | {"rows"}, f"prompt {path}", sorted(_NEEDED))
    rounds = content.pop("rounds")
    rows = whole(content.pop("rows", 0), f"prompt {path}: rows", 0)
    for key, text in content.items():
        _check_text(text, _NAMES.get(key), f"prompt {path}: {key}")
    return Prompt(path.stem, **(content | _rounds(rounds, path)), rows=rows)


def prompt_file(name: str | Path) -> Path:
    """The YAML file of a prompt profile, by its name or as it is; raises as :func:`load_prompt` does."""
    name = str(name)
    if name in PROMPTS:
        return PROMPT_FOLDER / f"{name}.yml"
    if not name.endswith((".yml", ".yaml")):
        raise UserError(f"prompt {name!r} is neither a profile nor a YAML file{nearest(name, PROMPTS)}")
    return Path(name)


# Checks of a profile


def _check_text(text: Any, names: tuple[str, ...] | None, where: str) -> None:
    if not isinstance(text, str):
        raise UserError(f"{where}: expected text, got {text!r}")
    if names is None:
        return
    if not Template(text).is_valid():
        raise UserError(f"{where}: a $ without a name behind it; write $$ for a dollar sign")
    for found in Template(text).get_identifiers():
        if found not in names:
            raise UserError(f"{where}: unknown placeholder ${found}{nearest(found, names)}")


def _rounds(content: Any, path: Path) -> dict[str, Any]:
    keys = ("first", "best", "latest")
    if not isinstance(content, dict) or set(content) != set(keys):
        raise UserError(f"prompt {path}: rounds: expected the keys {', '.join(keys)}, got {content!r}")
    for key, value in content.items():
        whole(value, f"prompt {path}: rounds: {key}", 0)
    return content


# What a request is in words


def controlled(request: Request, control: str) -> np.ndarray:
    """The history ``(rounds, n, 4)`` that a control shows; the request and its generator stay as they are."""
    if control == "no-history":
        return request.history[:0]
    history = request.history.copy()
    if control == "shuffled-rewards":
        rewards, rng = history[..., 3], copy.deepcopy(request.rng)
        history[..., 3] = rng.permutation(rewards.ravel()).reshape(rewards.shape)
    return history


def _situation(request: Request) -> dict[str, Any]:
    limits = request.limits
    part_s = limits.round_s / limits.waypoints
    box = {f"box_{axis}": math.floor(side) for axis, side in zip("xyz", limits.box_m, strict=True)}
    return (
        box
        | _place(request.current_position)
        | {
            "round_s": limits.round_s,
            "part_s": f"{part_s:g}",
            "speed": f"{limits.speed_m_s:g}",
            "reach": math.floor(limits.speed_m_s * part_s),
            "waypoints": limits.waypoints,
        }
    )


def _place(position: np.ndarray) -> dict[str, int]:
    """Whole metres, halves rounded down with some margin: a position's last bits must not decide."""
    return {axis: round(float(value) - 1e-6) for axis, value in zip("xyz", position, strict=True)}


def _reward(value: float, sign: str = "") -> str:
    return f"{round(float(value), 2) + 0.0:{sign}.2f}"  # + 0.0: never -0.00


def _middles_s(limits: Limits) -> list[int]:
    """The seconds at which the history's positions were taken, the middle of each part of the round."""
    edges = [-(-i * limits.round_s // limits.waypoints) for i in range(limits.waypoints + 1)]
    return [(start + end) // 2 + 1 for start, end in itertools.pairwise(edges)]
