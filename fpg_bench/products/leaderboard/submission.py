"""Submissions to the leaderboard: folders of data, which are read and checked without running any of it."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError, meant, nearest, shown
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import read_json, read_yaml
from fpg_bench.common.ids import NAMED
from fpg_bench.evaluation.entry import same_policies
from fpg_bench.evaluation.statistics import ENOUGH_SEEDS
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.card import AgentCard
from fpg_bench.players.planner import PLANNERS, asks_language_model
from fpg_bench.products.leaderboard.about import (
    SubmissionFile,
    Training,
    board_name,
    name_skeleton,
    read_about,
)
from fpg_bench.products.leaderboard.folders import (
    TRACK_FOLDERS,
    file_problem,
    folder_problem,
    list_names,
    short_path,
    stray_files,
)
from fpg_bench.products.leaderboard.tracks import PUBLIC, TRACKS, Track, TrackSuites, track_of
from fpg_bench.products.leaderboard.transcripts import FOLDER as TRANSCRIPTS
from fpg_bench.products.leaderboard.transcripts import check_transcripts
from fpg_bench.products.sandbox.client import AGENT_FILES, Policy, check_policies

require_extra("evaluate", "onnx", "scipy", "matplotlib", "joblib")

ABOUT = "submission.yaml"
MOST_TEXT_BYTES = AGENT_FILES["agent.json"]  # of submission.yaml, too
_SLUG = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
_RESERVED = re.compile(r"con|prn|aux|nul|com\d|lpt\d|index")
_SEED = re.compile(r"seed_(0|[1-9]\d{0,5})")
_OVERSHOOT = 1.05  # training ends with a whole rollout, a little after its budget


class Submission(SubmissionFile):
    """A submission that has passed all checks.

    Attributes:
        folder: its folder, whose name is unique in its track.
        policies: sorted by training seed; empty for a script or transcripts.
        transcripts: the files of a language model that plans, sorted.
    """

    folder: Path
    policies: tuple[Policy, ...] = ()
    transcripts: tuple[Path, ...] = ()

    @property
    def slug(self) -> str:
        """Name of the folder, unique in its track."""
        return self.folder.name

    @property
    def board_track(self) -> Track:
        """The track of the board that it enters, by its side, path and scenario."""
        return track_of(self.track, self.path, self.scenario)

    @property
    def players(self) -> tuple[str, ...]:
        """Names of its players: its script, else the policy of each training seed; none of transcripts."""
        if self.script is not None:
            return (self.script,)
        home = self.zoo or short_path(self.folder)
        return tuple(f"{home}/seed_{policy.seed}" for policy in self.policies)

    @property
    def is_search(self) -> bool:
        """True for tables found by search, which have a rank with any number of training seeds."""
        return bool(self.policies) and all(card.is_search for card in self.cards)

    @property
    def cards(self) -> list[AgentCard]:
        """The cards of its agents, as far as they can be read."""
        return [policy.card for policy in self.policies if policy.card is not None]

    @property
    def fingerprint(self) -> str:
        """SHA-256 of what was submitted: contents of ``submission.yaml``, policies and transcripts."""
        content = self.model_dump(include=set(SubmissionFile.model_fields))
        for key in ("runs", "scenario"):  # added later: without them, the fingerprints before stay valid
            if content[key] == SubmissionFile.model_fields[key].default:
                del content[key]
        content["policies"] = {policy.seed: policy.sha256 for policy in self.policies}
        content["transcripts"] = {
            path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in self.transcripts
        }
        text = json.dumps({"slug": self.slug, **content}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


# Folders of submissions


class Refusal(UserError):
    """A folder is no valid submission.

    Attributes:
        lines: all of its problems, one line each; the message has the first.
    """

    def __init__(self, folder: Path, lines: Sequence[str]) -> None:
        super().__init__(f"submission {folder}: {lines[0]}")
        self.lines = lines


def notes(submission: Submission, board: str | Path = "leaderboard") -> list[str]:
    """Return remarks on a submission without problems, one line each.

    Args:
        submission: the submission.
        board: the folder of the leaderboard that it is probably meant for, if there is one.
    """
    lines, count = [], len(submission.policies)
    if 0 < count < ENOUGH_SEEDS and not submission.is_search:
        lines.append(
            f"an algorithm of fewer than {ENOUGH_SEEDS} training seeds has no rank; this one has {count}"
        )
    board, home = Path(board), submission.folder.parent.parent
    if home.name != "submissions":
        place = "<leaderboard>/submissions/<track>/<name>"
        lines.append(f"is not inside a leaderboard folder; submit run expects {place}")
    elif (board / "submissions").is_dir() and home.parent.resolve() != board.resolve():
        written = f"{short_path(home.parent)}/results"
        lines.append(f"is not inside {board}/submissions; submit run writes its result to {written}")
    return lines


class Reader:
    """Reader of submissions, which reads each ``submission.yaml`` and each suite once.

    Args:
        precedence: key by which folders of submissions are sorted that have the same name; the first has it.
            None: nobody has it.

    Attributes:
        suites: the suites of the tracks.
    """

    def __init__(self, precedence: Callable[[Path], Any] | None = None) -> None:
        self.suites = TrackSuites()
        self.precedence = precedence
        self._abouts: dict[Path, tuple[SubmissionFile | None, list[str]]] = {}
        self._names: dict[Path, dict[tuple[str | None, ...], list[str]]] = {}

    def about(self, folder: Path) -> tuple[SubmissionFile | None, list[str]]:
        """Return the valid part of ``submission.yaml`` (None: it cannot be read), and its problems.

        Args:
            folder: the submission's folder, as an absolute path.
        """
        if folder not in self._abouts:
            self._abouts[folder] = _read_about_file(folder)
        return self._abouts[folder]

    def alike(self, track: Path, *keys: tuple[str | None, ...]) -> list[list[str]]:
        """Return for each key the names of the submissions in a track's folder that have it, by precedence.

        Keys are ``(slug,)`` without case, and ``(path, scenario, name)``, the latter a :func:`name_skeleton`.
        """
        if track not in self._names:
            known = self._names[track] = {}
            for name in os.listdir(track):  # all: no number of others hides one
                if folder_problem(track / name):
                    continue
                known.setdefault((name.casefold(),), []).append(name)
                about, _ = self.about(track / name)
                if about is not None and about.name:
                    for skeleton in {name_skeleton(about.name), name_skeleton(board_name(about, name))}:
                        known.setdefault((about.path, about.scenario, skeleton), []).append(name)
            for names in known.values():
                names.sort(key=lambda name: (self.precedence or str)(track / name))
        return [self._names[track].get(key, []) for key in keys]


def _read_about_file(folder: Path) -> tuple[SubmissionFile | None, list[str]]:
    if problem := file_problem(folder / ABOUT, MOST_TEXT_BYTES):
        return None, [f"{ABOUT}: {problem}"]
    try:
        about, lines = read_about(read_yaml(folder / ABOUT, ABOUT))
    except UserError as error:
        return None, [str(error).replace(f" {folder / ABOUT}: ", ": ", 1)]
    return about, [f"{ABOUT}: {line}" for line in lines]


def admit(folder: str | Path, reader: Reader | None = None, inspect_onnx: bool = True) -> Submission:
    """Check the submission of a folder, and return it; none of it is run.

    Args:
        folder: the submission's folder. On a board, ``submissions/<track>/<name>``, names of other entries
            that take precedence, or of any others for a reader without precedence, are problems.
        reader: reads each file once for many submissions; None: a new one.
        inspect_onnx: inspect each ONNX file in a sandboxed process; not needed if no policy is played.

    Raises:
        Refusal: it has problems.
    """
    given, folder, reader = Path(folder), Path(os.path.abspath(folder)), reader or Reader()
    if problem := folder_problem(folder):
        raise Refusal(given, [problem])
    about, lines = reader.about(folder)
    if about is None:
        raise Refusal(given, lines)
    lines = [*slug_problems(folder), *lines]
    lines += [f"{ABOUT}: {line}" for line in _location_problems(folder, about)]
    lines += [f"{ABOUT}: {line}" for line in _name_problems(folder, about)]
    policies, wrong = _read_own_policies(folder, about, inspect_onnx)
    lines += wrong
    if about.is_recorded:
        suite = reader.suites.of(TRACKS["planner"], transcripts=True)[PUBLIC]
        lines += check_transcripts(folder, suite)
    if lines:
        raise Refusal(given, lines)
    files = list_names(folder / TRANSCRIPTS) if about.is_recorded else []
    transcripts = tuple(folder / TRANSCRIPTS / name for name in files)
    entered = Submission.model_construct(
        folder=folder, policies=policies, transcripts=transcripts, **dict(about)
    )
    if lines := list(_name_conflicts(entered, reader)):
        raise Refusal(given, lines)
    return entered


def slug_problems(folder: Path) -> Iterator[str]:
    """Yield a problem if the name of a folder cannot be an address on the board, or a file anywhere."""
    if _RESERVED.fullmatch(folder.name):
        yield f"the folder's name {shown(folder.name)}: is taken by Windows or by a page of the board"
    if not _SLUG.fullmatch(folder.name):
        yield (
            f"the folder's name {shown(folder.name)}: expected at most 40 of a-z, 0-9 and -, "
            "a letter or digit first"
        )


def _location_problems(folder: Path, about: SubmissionFile) -> Iterator[str]:
    """Yield a problem if the submission is in the board's folder of another track."""
    parent, track = folder.parent.name, about.track
    stated = f"track: states {track}, but the folder is in"
    if not track or track == parent:
        return
    if parent in TRACK_FOLDERS:
        yield f"{stated} {parent}; move it to submissions/{track}, or write track: {parent}"
    elif folder.parent.parent.name == "submissions":
        yield f"{stated} {shown(parent)}, which is not a track; move it to submissions/{track}"


def _name_problems(folder: Path, about: SubmissionFile) -> Iterator[str]:
    """Yield a problem for each unknown script or zoo agent, and for each name that a script has already."""
    if not about.track:
        return
    scripts = _scripts(about.track)
    if about.script is not None and about.script not in scripts:
        yield f"script: unknown {shown(about.script)}{nearest(about.script, scripts)}"
    for key, name in (("name", about.name), ("the folder's name", folder.name)):
        if name_skeleton(name) in map(name_skeleton, scripts) and name.strip().casefold() != about.script:
            yield f"{key}: {shown(name)} is the name of a script of the package; choose another"
    if about.zoo is not None and about.zoo not in _zoo():
        hint = meant(about.zoo, _zoo())
        yield f"zoo: the package ships no agents {shown(about.zoo)}{hint} (fpg-bench zoo lists them)"


def _scripts(track: str) -> tuple[str, ...]:
    if track == "planner":
        return tuple(name for name in PLANNERS if not asks_language_model(name))
    return NAMED[track]


@functools.cache
def _zoo() -> tuple[str, ...]:
    """Return the package's agents, ``environment/algorithm`` each."""
    agents = baselines_folder() / "agents"
    names = {folder.parent.relative_to(agents).as_posix() for folder in agents.glob("*/*/seed_*")}
    return tuple(sorted(names))


def _read_own_policies(
    folder: Path, about: SubmissionFile, inspect_onnx: bool
) -> tuple[tuple[Policy, ...], list[str]]:
    """Return the policies of a submission, and problems with them and with the names in its folder."""
    home, expected = folder, [ABOUT]
    if about.is_recorded:
        expected.append(TRANSCRIPTS)
    has_own = about.script is None and about.zoo is None and about.track != "planner"
    if has_own:
        seeds = [path.name for path in seed_folders(folder).values()]
        expected += seeds or ["seed_0"]
        if not seeds:
            return (), [*stray_files(folder, expected), "has no folder seed_<k> with a policy"]
    lines = stray_files(folder, expected)
    if not has_own:
        if about.zoo not in _zoo():
            return (), lines
        home = baselines_folder() / "agents" / str(about.zoo)
    policies, wrong = read_policies(home, about.track if about.track in NAMED else None, inspect_onnx)
    lines += wrong
    if about.training is not None:
        wrong = list(_training_problems(about.training, seed_folders(home), policies))
        lines += [f"{ABOUT}: training: {line}" for line in wrong]
    return policies, lines


def _training_problems(
    training: Training, folders: Iterable[int], policies: Iterable[Policy]
) -> Iterator[str]:
    """Yield where the stated seeds and steps of training differ from those of the policies."""
    present, listed = set(folders), set(training.seeds)
    if missing := _folder_names(listed - present):
        yield f"seeds: listed but missing: {missing}; found: {_folder_names(present)}"
    if unlisted := _folder_names(present - listed):
        yield f"seeds: found but not listed: {unlisted}"
    cards = [policy.card for policy in policies if policy.card is not None]
    steps = [max(1, of) for card in cards for of in (card.training_steps, card.played_steps)]
    if steps and not min(steps) / _OVERSHOOT <= training.steps <= max(steps) * _OVERSHOOT:
        trained = f"{min(steps):,}" + (f" to {max(steps):,}" if min(steps) < max(steps) else "")
        yield f"steps: states {training.steps:,}, but agent.json has training_steps {trained}"


def _folder_names(seeds: Iterable[int]) -> str:
    return ", ".join(f"seed_{seed}" for seed in sorted(seeds))


def _name_conflicts(submission: Submission, reader: Reader) -> Iterator[str]:
    """Yield a line on each other submission whose name conflicts with this one's.

    A conflict is a name that looks the same in the same table of the board, or a folder's name in the same
    track that differs only in case.
    """
    if submission.folder.parent.name != submission.track:
        return
    own = (submission.path, submission.scenario, name_skeleton(submission.name))
    same_slug, same_name = reader.alike(submission.folder.parent, (submission.slug.casefold(),), own)
    for name in _others(same_slug, submission.slug, reader.precedence is not None):
        yield f"the folder's name: differs from {shown(name)} only in case"
    for name in _others(same_name, submission.slug, reader.precedence is not None):
        yield f"{ABOUT}: name: {shown(submission.name)} is the name of {shown(name)}, too; choose another"


def _others(names: Sequence[str], own: str, earlier: bool) -> Sequence[str]:
    place = names.index(own)
    return names[:place] if earlier else [*names[:place], *names[place + 1 :]]


# Folders of policies


def seed_folders(folder: Path) -> dict[int, Path]:
    """Return the folders ``seed_<k>`` in a folder, by training seed."""
    matches = [(match, folder / name) for name in list_names(folder) if (match := _SEED.fullmatch(name))]
    return dict(sorted((int(match[1]), path) for match, path in matches))


def read_policies(
    folder: Path, side: str | None, inspect_onnx: bool = True
) -> tuple[tuple[Policy, ...], list[str]]:
    """Return the policies of a folder by training seed, and one line per problem with them.

    Args:
        folder: contains folders ``seed_<k>``, each with ``agent.json`` and ``policy.onnx``.
        side: the side that they must play; None: either.
        inspect_onnx: inspect each ONNX file in a sandboxed process.
    """
    policies: list[Policy] = []
    lines: list[str] = []
    for seed, path in seed_folders(folder).items():
        policy, wrong = read_policy(path, seed, side)
        lines += [f"{path.name}{line}" for line in wrong]
        if policy is None:
            continue
        policies.append(policy)
    lines += same_policies({policy.seed: policy.sha256 for policy in policies})
    intact = [policy for policy in policies if _has_stated_hash(policy)] if inspect_onnx else []
    for policy, wrong in zip(intact, check_policies([policy.model for policy in intact]), strict=True):
        lines += [f"seed_{policy.seed}/policy.onnx: {line}" for line in wrong]
    return tuple(policies), lines


def _has_stated_hash(policy: Policy) -> bool:
    """Return True if ``agent.json`` has the hash of this policy, or could not be read."""
    return policy.card is None or policy.card.policy_sha256 == policy.sha256


def read_policy(
    path: Path, seed: int | None, side: str | None, files: Mapping[str, int] = AGENT_FILES
) -> tuple[Policy | None, list[str]]:
    """Return the policy of a folder, and the folder's problems; the ONNX file is not inspected.

    Args:
        path: contains ``agent.json`` and ``policy.onnx``.
        seed: the training seed that it must have; None: any or none.
        side: the side that it must play; None: either.
        files: all that it must contain, and their most bytes.
    """
    if problem := folder_problem(path):
        return None, [f": {problem}"]
    lines = [f"/{line}" for line in stray_files(path, files)]
    unreadable = [
        f"/{name}: {line}" for name, most in files.items() if (line := file_problem(path / name, most))
    ]
    if unreadable:
        return None, lines + unreadable
    card, wrong = _read_card(path / "agent.json", seed, side)
    model = (path / "policy.onnx").read_bytes()
    policy = Policy(seed or 0, card, model, hashlib.sha256(model).hexdigest())
    if not _has_stated_hash(policy):
        wrong.append("policy_sha256: does not match policy.onnx (truncated or modified file?)")
    return policy, lines + [f"/agent.json: {line}" for line in wrong]


def _read_card(path: Path, seed: int | None, side: str | None) -> tuple[AgentCard | None, list[str]]:
    """Return an agent's card, and its problems; None if it cannot be read."""
    try:
        card = AgentCard.parse(read_json(path, "agent"), "agent", side)
    except UserError as error:
        return None, [str(error).replace(f"agent {path}: ", "").removeprefix("agent: ")]
    if seed is not None and card.training_seed != seed:
        expected = f"expected {seed}, as in the folder's name"
        return card, [f"training_seed: {expected}, got {shown(card.training_seed)}"]
    return card, []
