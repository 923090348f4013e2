"""Train best responses to the board's trained entries, and make public suites of the strongest.

python scripts/train_best_responses.py [--only ally/ally-scripted-ppo] [--jobs 2]     stopped, it goes on

Responses to each entry's first training seed are trained by several algorithms and budgets. A row for each
goes to leaderboard/results/best_responses.jsonl: how it was made, and the entry's return per step against it.
The strongest response to an entry becomes an agent folder baselines/suites/responses-v1/<side>/<entry>, and a
rival of the suites that all entries of the track meet, baselines/suites/ally-responses-v1.yml and so on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json, write_whole
from fpg_bench.common.parallel import Job, check_all_done, run_jobs
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.leaderboard.folders import brief, submission_folders
from fpg_bench.leaderboard.submission import load_submission
from fpg_bench.leaderboard.tracks import TRACKS, track_of
from fpg_bench.players.agent import suites_folder
from fpg_bench.players.player import SIDES
from fpg_bench.training.league import best_responses, response_folder

RECIPES = ("ppo:250000", "td3:40000", "sac:10000", "sac:40000")  # algorithm:steps
SEEDS = 1  # of each recipe
SCENARIO = "standard"  # of the board's tracks
MATCHES = 25  # of a rival in the suites
FOLDER = "responses-v1"
_FILES = ("policy.onnx", "agent.json")
_ROW_KEYS = ("algorithm", "steps", "start", "training_seed", "reward", "return", "earned")
_PATH = "pursuit"
_HEAD = "# Best responses to single entries of the board. Made by: python scripts/train_best_responses.py\n"


@dataclass(frozen=True)
class Target:
    """The first training seed of an entry.

    Attributes:
        track: key of its table.
        side, slug: its place on the board.
        agent: its policy, as a player.
        sha256: hash of its policy.
        path: flight path of the opponent in its track.
    """

    track: str
    side: str
    slug: str
    agent: str
    sha256: str
    path: str

    @property
    def name(self) -> str:
        """Name of its job, and value of ``--only``."""
        return f"{self.side}/{self.slug}"

    @property
    def response(self) -> str:
        """Name of the strongest response as a player."""
        return f"{FOLDER}/{self.side}/{self.slug}"

    def has_row(self, row: Row) -> bool:
        """Return True if a row is of a response to this very policy, under the present protocol."""
        own = (self.track, self.slug, self.sha256, PROTOCOL)
        return tuple(row.get(key) for key in ("track", "slug", "policy_sha256", "protocol")) == own


def targets(board: Path, only: str | None) -> list[Target]:
    """Return the trained entries of a board, of both sides, or one."""
    names = [] if only is None else [only]
    folders = [folder for folder in submission_folders(board, names) if folder.parent.name in SIDES]
    return [target for folder in folders if (target := _target(folder)) is not None]


def _target(folder: Path) -> Target | None:
    entry = load_submission(folder, contract=False)
    if not entry.policies:
        return None
    first = min(entry.policies, key=lambda policy: policy.seed)
    agent = f"{entry.zoo or brief(folder)}/seed_{first.seed}"
    key = track_of(entry.track, entry.path).key
    return Target(key, entry.track, entry.slug, agent, first.sha256, entry.path or _PATH)


def parse_recipe(text: str) -> tuple[str, int]:
    """Return algorithm and steps of ``ppo:500000``; raises UserError for any other text."""
    algorithm, _, steps = text.partition(":")
    if not steps.isdecimal():
        raise UserError(f"recipe {text!r}: expected algorithm:steps, as ppo:500000")
    return algorithm, int(steps)


def train_responses(target: Target, recipes: Sequence[tuple[str, int]], seeds: int, out: Path) -> Row:
    """Train the missing responses to an entry; returns the results of all of them."""
    result: Row = {}
    for algorithm, steps in recipes:
        result = best_responses(
            target.agent,
            out,
            algorithm=algorithm,
            steps=steps,
            seeds=seeds,
            side=target.side,
            scenario=SCENARIO,
            path=target.path,
            progress=False,
        )
    return result


def keep(target: Target, file: RowFile, out: Path, result: Row) -> None:
    """Replace an entry's rows, and copy its strongest response to the suites."""
    strongest = min(result["responses"], key=lambda response: response["return"])
    agent = out / response_folder(strongest) / "agent"
    for name in _FILES:
        write_whole(suites_folder() / target.response / name, (agent / name).read_bytes())
    rows = [row for row in file.read() if (row["track"], row["slug"]) != (target.track, target.slug)]
    rows += [
        {
            "track": target.track,
            "slug": target.slug,
            "agent": target.agent,
            **{key: response[key] for key in _ROW_KEYS},
            "jammed": response["measures"]["jamming_success_rate"],
            "policy_sha256": target.sha256,
            "protocol": PROTOCOL,
        }
        for response in result["responses"]
    ]
    rows.sort(key=lambda row: (row["track"], row["slug"]))
    write_whole(file.path, "".join(json.dumps(row) + "\n" for row in rows))


def is_done(target: Target, recipes: Sequence[tuple[str, int]], seeds: int, file: RowFile) -> bool:
    """Return True if an entry's rows and its strongest response are there."""
    made = [(row["algorithm"], row["steps"]) for row in file.read() if target.has_row(row)]
    has_rows = all(made.count(recipe) >= seeds for recipe in recipes)
    return has_rows and (suites_folder() / target.response / "agent.json").is_file()


def write_suites(every: Iterable[Target]) -> list[Path]:
    """Write the suite of each track that has responses to entries of the board; returns the paths."""
    every, paths = list(every), []
    for track in TRACKS.values():
        own = [t for t in every if t.track == track.key and (suites_folder() / t.response).is_dir()]
        if not own:
            continue
        public = load_suite(track.public)
        content = {
            "side": public.side,
            "scenario": SCENARIO,
            "matches": MATCHES,
            "scale": {"zero": public.scale.zero, "top": public.scale.top},
            "rivals": [_rival(target, public.other_side) for target in own],
        }
        path = suites_folder() / f"{track.public.removesuffix('-v1')}-{FOLDER}.yml"
        write_whole(path, _HEAD + yaml.safe_dump(content, sort_keys=False, width=110))
        paths.append(path)
    return paths


def _rival(target: Target, other_side: str) -> dict[str, str]:
    """Return a response as a rival, on the flight path of its training."""
    about = read_json(suites_folder() / target.response / "agent.json", "agent")
    path = (about.get("scenario_fields") or {}).get("opponent_path", _PATH)
    return {"name": f"response to {target.slug}", other_side: target.response, "path": path}


def main() -> int:
    """Train what is missing; returns 0 if all went well."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", help="one entry, as ally/ally-scripted-ppo")
    parser.add_argument("--recipe", action="append", help=f"algorithm:steps; default: {' '.join(RECIPES)}")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="responses of each recipe")
    parser.add_argument("--jobs", type=int, default=2, help="entries at once, one thread each")
    parser.add_argument("--board", type=Path, default=Path("leaderboard"), help="the leaderboard's folder")
    parser.add_argument("--runs", type=Path, default=Path("runs/best_responses"), help="the runs' folders")
    options = parser.parse_args()
    recipes = [parse_recipe(text) for text in options.recipe or RECIPES]
    file = RowFile(options.board / "results" / "best_responses.jsonl")
    jobs = []
    for target in targets(options.board, options.only):
        out = (options.runs / target.name).absolute()
        jobs.append(
            Job(
                target.name,
                partial(train_responses, target, recipes, options.seeds, out),
                partial(keep, target, file, out),
                partial(is_done, target, recipes, options.seeds, file),
            )
        )
    check_all_done(run_jobs(jobs, options.jobs, say=partial(print, flush=True)))
    for path in write_suites(targets(options.board, None)):
        print(f"written: {brief(path)}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"train_best_responses: {error}")
    except KeyboardInterrupt:
        sys.exit("train_best_responses: stopped; finished work is kept")
