"""What is wrong with a submission, line by line."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from fpg_bench.common.errors import UserError, meant, nearest
from fpg_bench.common.files import read_yaml
from fpg_bench.evaluation.statistics import FEW_SEEDS
from fpg_bench.leaderboard.folder import brief, file_problem, folder_problem, names, shown, strays
from fpg_bench.leaderboard.policies import MOST_TEXT_BYTES, Policy, read_policies, seed_folders
from fpg_bench.leaderboard.submission import Submission
from fpg_bench.leaderboard.submission_file import TRACKS, Training, plain, read_fields
from fpg_bench.planning import LLM_CONTROLS, PLANNERS
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.scripted import SCRIPTED

ABOUT, TRANSCRIPTS = "submission.yaml", "transcripts"
_SLUG = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
_OVER = 1.05  # training ends with a whole rollout, a little after its budget


def problems(folder: str | Path) -> list[str]:
    """All that is wrong with a submission's folder, one line each; none where it may be run.

    On a board (``submissions/<track>/<name>``) a name that another one of its track has is wrong, too.
    """
    folder = Path(os.path.abspath(folder))
    submission, found = examine(folder)
    return found if submission is None else found + [line for _, line in taken(submission)]


def notes(submission: Submission, board: str | Path = "leaderboard") -> list[str]:
    """What somebody should know of a submission that is sound, one line each.

    Args:
        submission: which :func:`problems` has found nothing wrong with.
        board: the leaderboard's folder that it is probably meant for, if there is one.
    """
    found, count = [], len(submission.policies)
    if 0 < count < FEW_SEEDS:
        found.append(f"the board marks fewer than {FEW_SEEDS} training seeds, this has {count}")
    board, home = Path(board), submission.folder.parent.parent
    if home.name != "submissions":
        found.append("lies on no leaderboard; submit run takes <leaderboard>/submissions/<track>/<name>")
    elif (board / "submissions").is_dir() and home.parent.resolve() != board.resolve():
        written = f"{brief(home.parent)}/results"
        found.append(f"does not lie in {board}/submissions; submit run writes its result to {written}")
    return found


def load_submission(folder: str | Path, contract: bool = True) -> Submission:
    """The submission of a folder, checked wholly; nothing of it is run.

    Args:
        folder: the submission's.
        contract: whether to check what its policies hold, too; needless where they are only told of.

    Raises:
        UserError: the first of its problems (see :func:`problems`).
    """
    submission, found = examine(Path(folder), contract)
    if submission is None or found:
        raise UserError(f"submission {folder}: {found[0]}")
    return submission


def examine(folder: Path, contract: bool = True) -> tuple[Submission | None, list[str]]:
    """The submission of a folder, None where it cannot be read, and all that is wrong with it alone.

    Args:
        folder: the submission's.
        contract: whether to check what the policies hold, too; needless where they are not played.
    """
    folder = Path(os.path.abspath(folder))
    problem = folder_problem(folder)
    if problem or (problem := file_problem(folder / ABOUT, MOST_TEXT_BYTES)):
        where = "" if folder_problem(folder) else f"{ABOUT}: "
        return None, [f"{where}{problem}"]
    try:
        content = read_yaml(folder / ABOUT, ABOUT)
    except UserError as error:
        return None, [str(error).replace(f" {folder / ABOUT}: ", ": ", 1)]
    suites, wrong = read_fields(content)
    found = [*_slug(folder), *(f"{ABOUT}: {line}" for line in wrong)]
    found += [f"{ABOUT}: {line}" for line in (*_place(folder, suites), *_named(folder, suites))]
    policies, wrong = _policies(folder, suites, contract)
    found += [*wrong, *_transcripts(folder, suites)]
    if found:
        return None, found
    told = {key: value for key, value in suites.items() if value is not None}
    optional = {"reference": None, "path": None, "training": None}
    recorded = names(folder / TRANSCRIPTS) if _records(suites) else []
    files = tuple(folder / TRANSCRIPTS / name for name in recorded)
    return Submission(folder=folder, policies=policies, transcripts=files, **(optional | told)), []


def _slug(folder: Path) -> Iterator[str]:
    if not _SLUG.fullmatch(folder.name):
        yield (
            f"the folder's name {shown(folder.name)}: expected at most 40 of a-z, 0-9 and -, "
            "a letter or digit first"
        )


def _place(folder: Path, suites: dict[str, Any]) -> Iterator[str]:
    """Whether the track is that of the board's folder."""
    around, track = folder.parent.name, suites.get("track")
    says = f"track: says {track}, but the folder lies in"
    if track is None or track == around:
        return
    if around in TRACKS:
        yield f"{says} {around}; move it to submissions/{track}, or write track: {around}"
    elif folder.parent.parent.name == "submissions":
        yield f"{says} {shown(around)}, which is no track; move it to submissions/{track}"


def _named(folder: Path, suites: dict[str, Any]) -> Iterator[str]:
    """Scripts and agents of the package: they must be there, and their names are nobody else's."""
    track, script = suites.get("track"), suites.get("script")
    if track is None:
        return
    if script is not None and script not in _scripts(track):
        yield f"script: unknown {shown(script)}{nearest(script, _scripts(track))}"
    for what, name in (("name", suites.get("name", "")), ("the folder's name", folder.name)):
        if plain(name) in map(plain, _scripts(track)) and name.strip().casefold() != script:
            yield f"{what}: {shown(name)} is what a script of the package is called; choose another"
    zoo = suites.get("zoo")
    if zoo is not None and zoo not in _zoo():
        yield f"zoo: the package ships no agents {shown(zoo)}{meant(zoo, _zoo())} (fpg-bench zoo lists them)"


def _scripts(track: str) -> tuple[str, ...]:
    if track == "planner":
        return tuple(name for name in PLANNERS if name not in LLM_CONTROLS)
    return SCRIPTED[track]


@functools.cache
def _zoo() -> tuple[str, ...]:
    """The package's agents, ``view/algorithm``."""
    agents = baselines_folder() / "agents"
    found = {folder.parent.relative_to(agents).as_posix() for folder in agents.glob("*/*/seed_*")}
    return tuple(sorted(found))


def _policies(folder: Path, suites: dict[str, Any], contract: bool) -> tuple[tuple[Policy, ...], list[str]]:
    """The policies of a submission, and what is wrong with them and with the names in its folder."""
    track, zoo, training = (suites.get(key) for key in ("track", "zoo", "training"))
    own = suites.get("script") is None and zoo is None and track != "planner"
    seeds = [path.name for path in seed_folders(folder).values()] if own else []
    wanted = (seeds or ["seed_0"]) if own else []
    known = [ABOUT, *wanted, *([TRANSCRIPTS] if _records(suites) else [])]
    found = strays(folder, known)
    if zoo is not None and zoo not in _zoo():
        return (), found
    home = folder if own else baselines_folder() / "agents" / str(zoo)
    if not own and zoo is None:
        return (), found
    if own and not seeds:
        return (), [*found, "holds no seed_<k>/: the policy of each training seed"]
    policies, wrong = read_policies(home, track if track in SCRIPTED else None, contract)
    found += wrong
    if training is not None:
        found += [f"{ABOUT}: training: {line}" for line in _trained(training, seed_folders(home), policies)]
    return policies, found


def _trained(training: Training, there: Iterable[int], policies: Iterable[Policy]) -> Iterator[str]:
    """Where the seeds and steps of training are not those of the policies."""
    there = set(there)
    lacking, more = (_folders(seeds) for seeds in (set(training.seeds) - there, there - set(training.seeds)))
    if lacking:
        yield f"seeds: no folder {lacking}; there are: {_folders(there)}"
    if more:
        yield f"seeds: does not name {more}, which is there"
    steps = [max(1, policy.steps) for policy in policies if policy.steps is not None]
    if steps and not min(steps) / _OVER <= training.steps <= max(steps) * _OVER:
        told = f"{min(steps):,}" + (f" to {max(steps):,}" if min(steps) < max(steps) else "")
        yield f"steps: says {training.steps:,}, but training_steps of agent.json {told}"


def _folders(seeds: Iterable[int]) -> str:
    return ", ".join(f"seed_{seed}" for seed in sorted(seeds))


def _records(suites: dict[str, Any]) -> bool:
    """Whether it is a language model's, which is entered by its transcripts."""
    return suites.get("track") == "planner" and suites.get("script") is None


def _transcripts(folder: Path, suites: dict[str, Any]) -> list[str]:
    if not _records(suites):
        return []
    from fpg_bench.leaderboard.transcripts import check_transcripts

    problem = folder_problem(folder / TRANSCRIPTS)
    return [f"{TRANSCRIPTS}: {problem}"] if problem else check_transcripts(folder)


def taken(submission: Submission) -> Iterator[tuple[str, str]]:
    """The other submissions of its track and table that have its name, and a line that says so, each."""
    if submission.folder.parent.name != submission.track:
        return
    mine = (submission.path, plain(submission.name))
    for name in sorted(os.listdir(submission.folder.parent)):  # all: no number of others hides one
        other = submission.folder.parent / name
        if name == submission.slug or folder_problem(other):
            continue
        if name.casefold() == submission.slug.casefold():
            yield name, f"the folder's name: {shown(name)} differs by case only"
        if _shown_as(other) == mine:
            yield (
                name,
                f"{ABOUT}: name: {shown(submission.name)} is that of {shown(name)}, too; choose another",
            )


def _shown_as(folder: Path) -> tuple[str | None, str] | None:
    """Under which name a submission stands in which table, None where that cannot be read."""
    try:
        stamp = (folder / ABOUT).lstat()
    except OSError:
        return None
    return _read_name(folder, stamp.st_mtime_ns, stamp.st_size)


@functools.lru_cache(maxsize=4096)
def _read_name(folder: Path, changed: int, size: int) -> tuple[str | None, str] | None:
    if file_problem(folder / ABOUT, MOST_TEXT_BYTES):
        return None
    try:
        suites, _ = read_fields(read_yaml(folder / ABOUT, ABOUT))
    except UserError:
        return None
    return (suites.get("path"), plain(suites["name"])) if "name" in suites else None
