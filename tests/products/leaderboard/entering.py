"""Small boards for tests: submissions on small suites, closed seasons, and policies that misbehave."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fpg_bench.common.rows import SEAL, sealed
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.players.agent import OnnxPlayer, baselines_folder
from fpg_bench.products.leaderboard.cases import Case, board_reader, make_case
from fpg_bench.products.leaderboard.crossplay import verify_pairs
from fpg_bench.products.leaderboard.encounters import Verification
from fpg_bench.products.leaderboard.result import Result, write_result
from fpg_bench.products.leaderboard.season_keys import seed_from
from fpg_bench.products.leaderboard.submission import Reader, admit
from fpg_bench.products.leaderboard.verification import verify
from fpg_bench.products.sandbox.client import PolicyFailed
from tests.policies import write_seed
from tests.products.leaderboard.making import write_submission
from tests.products.leaderboard.recording import PLANNER_SUITE

SUITE = {
    "side": "ally",
    "scenario": "standard",
    "matches": 4,
    "scale": {"zero": -5.66, "top": 22.0},
    "rivals": [{"opponent": "adaptive", "path": "pursuit"}, {"opponent": "sweep", "path": "circle"}],
}
_OPPONENTS = SUITE | {"side": "opponent", "scale": {"zero": 17.76, "top": 33.73}}


def _meets(path: str) -> list[dict[str, str]]:
    return [{"ally": "idle", "path": path}, {"ally": "expert", "path": path}]


SUITES = {
    "ally-v2": SUITE,
    "opponent-v2": _OPPONENTS | {"rivals": _meets("pursuit")},
    "opponent-learned-v2": _OPPONENTS | {"rivals": _meets("learned")},
    "planner-v1": yaml.safe_load(PLANNER_SUITE),
}
FIRST_SUITES = {name.replace("v2", "v1"): content for name, content in SUITES.items() if "v2" in name}
LINK_SUITES = {
    "ally-link-v1": SUITE | {"scenario": "link"},
    "opponent-link-v1": _OPPONENTS | {"scenario": "link", "rivals": _meets("pursuit")},
}


def make_suites(folder: Path) -> Path:
    """A folder in place of the package's ``baselines``, whose public suites are small."""
    folder.mkdir(parents=True)
    for name in ("agents", "hyperparams"):
        (folder / name).symlink_to(baselines_folder() / name)
    for name, content in (SUITES | FIRST_SUITES | LINK_SUITES).items():
        write_suite(folder, name, content)
    return folder


def write_suite(baselines: Path, name: str, content: dict[str, Any]) -> None:
    """Write a suite's file."""
    file = baselines / "suites" / f"{name}.yml"
    file.parent.mkdir(exist_ok=True)
    file.write_text(yaml.safe_dump(content, sort_keys=False))


def close_season(baselines: Path, number: int = 1, **suites: dict[str, Any]) -> str:
    """Close a season and give its seed; ``ally={"matches": 2}`` says how a track's unseen suite differs from
    the public one.
    """
    folder = baselines / "suites" / f"season-{number}"
    folder.mkdir()
    season = {"number": number, "protocol": PROTOCOL, "seed": seed_from(PROTOCOL, number, ()), "entries": {}}
    (folder / "season.yml").write_text(yaml.safe_dump(season))
    for public, content in SUITES.items():
        content = content | {"season": season["seed"]}
        track = public.rpartition("-v")[0]
        write_suite(baselines, f"{track}-season-{number}", content | suites.get(track.replace("-", "_"), {}))
    return season["seed"]


def enter(board: Path, track: str, slug: str, **other: Any) -> Path:
    """Write a submission of a script, or of linear policies where ``seeds`` says which."""
    seeds = other.pop("seeds", ())
    training = {"steps": 1000, "hours": 0.1, "seeds": list(seeds)} if seeds else None
    path = {"path": "pursuit"} if track == "opponent" else {}
    about = {"name": slug.title(), "track": track, "training": training} | path | other
    folder = write_submission(board / "submissions" / track / slug, (), **about)
    env_id = "FPG/AllyVsScripted-v0" if track == "ally" else "FPG/OpponentVsScripted-v0"
    for seed in seeds:
        write_seed(folder / f"seed_{seed}", seed, id=env_id)
    return folder


def verdicts_of(board: Path, *names: str, **options: Any) -> dict[str, tuple[bool, str]]:
    """Verify a board and return its verdicts by name: whether good, and the line."""
    return {v.name: (v.is_good, v.line) for v in verify(board, Verification(names, **options))}


def case_of(board: Path, folder: Path, reader: Reader | None = None) -> Case:
    """Return the case of a submission's folder, fully checked."""
    reader = reader or board_reader(board)
    return make_case(board, admit(folder, reader), reader.suites)


def bad_pairs(board: Path, *names: str, **how: Any) -> dict[str, str]:
    """Verify the pairs of a board, and return the lines of bad verdicts by name."""
    verdicts = verify_pairs(board, Verification(names, **how))
    return {each.name: each.line for each in verdicts if not each.is_good and each.name != "cross-play"}


def resealed(*rows: dict[str, Any]) -> str:
    """Return rows as text, each with the hash of what it says now."""
    return "".join(json.dumps(sealed({k: v for k, v in row.items() if k != SEAL})) + "\n" for row in rows)


def write_verified(case: Case, lines: Iterable[Record]) -> None:
    """Write these records as the verified result of a case."""
    lines = tuple(lines)
    slug, track = case.submission.slug, case.submission.track
    write_result(case.path, Result(slug, track, case.fingerprint, lines))


class InProcess:
    """A PolicyClient that starts no process; ``loses`` games' rounds, and fails at once where ``fails``."""

    loses: tuple[int, ...] = ()
    fails = False

    def __init__(self, policy: Any, limits: Any = None) -> None:
        self._player = OnnxPlayer(policy.model, policy.card)
        self.invalid = np.zeros(0, bool)

    def __enter__(self) -> InProcess:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        pass

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        self._player.reset(mask, seeds)
        self.invalid = np.isin(np.arange(len(mask)), self.loses)

    def predict(self, *seen: Any) -> Any:
        if self.fails:
            raise PolicyFailed("took longer than it may")
        actions, memory = self._player.predict(*seen)
        actions = np.where(self.invalid[:, None], np.float32(0), actions)
        return actions, memory
