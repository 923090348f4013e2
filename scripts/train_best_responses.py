"""Train best responses to trained entries of the board, and make public suites of the strongest.

python scripts/train_best_responses.py [ally/ally-champion ...] [--n-jobs 2]     run it again to resume
python scripts/train_best_responses.py --table                           print the rows as tables

The search of an entry's scenario, SEARCH, finds responses to its first training seed: to an ally for what
it loses, to an opponent for what the response itself earns. One more response to each opponent is trained
for what the opponent loses ("spite"). Each has a row in leaderboard/results/best_responses.jsonl, with its
budget, seconds and the entry's return per step against it, and so has the strongest script. The strongest
response to an entry of TARGETS, spite aside, becomes an agent baselines/suites/responses-v2/<side>/<entry>
(of ``link``: responses-link-v1), and a rival in the suite of best responses of its track, such as
baselines/suites/ally-responses-v2.yml or ally-link-responses-v1.yml.

In ``standard`` the search is the full one of fpg-bench best-response. In ``link`` it is one of its four
calls, that of discrete PPO with eight frames from nothing, and no random scripts are tried. So a response
that is the strongest in ``link`` was looked for less. In ``standard`` this call finds the lowest return of
each entry among the calls from nothing; the pupil of the strongest response lowers that of the allies by
another 0.1 to 0.9 per step, and that of the opponents by up to 1.5.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.common.parallel import Job, check_all_done, run_jobs
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.players.agent import read_card, suites_folder
from fpg_bench.players.player import SIDES
from fpg_bench.products.leaderboard.folders import short_path, submission_folders
from fpg_bench.products.leaderboard.submission import load_submission
from fpg_bench.products.leaderboard.tracks import RESPONSES, TRACKS, Track
from fpg_bench.products.league.best_responses import (
    DISCRETE_PPO,
    FULL_SEARCH,
    RESPONSE_REWARDS,
    BestResponses,
    best_responses,
    response_folder,
    response_label,
)
from fpg_bench.products.league.config import BestResponseConfig

# The first trained entries of each table, at most five in standard and three in link, by what they earned
# among the unseen of season 2.
TARGETS = (
    "ally/ally-discrete-ppo-stack8",
    "ally/ally-champion",
    "ally/ally-population-ppo-stack8",
    "ally/ally-scripted-discrete-recurrent-ppo",
    "ally/ally-scripted-ppo-stack8",
    "opponent/opponent-champion-2-pursuit",
    "opponent/opponent-discrete-dqn-stack8",
    "opponent/opponent-discrete-ppo-stack8",
    "opponent/opponent-pursuit-ppo",
    "opponent/opponent-pursuit-td3",
    "opponent/opponent-champion-2",
    "opponent/opponent-champion",
    "opponent/opponent-learned-ppo",
    "ally/ally-link-population-ppo-stack8",
    "ally/ally-link-champion",
    "ally/ally-link-ppo-stack8",
    "opponent/opponent-link-population-dqn-stack8",
    "opponent/opponent-link-ppo-stack8",
    "opponent/opponent-link-strangers-ppo-stack8",
)
# Later champions: what a search finds against them is known by its rows, and is no rival in the suites.
ROWS_ALONE = ("ally/ally-champion-2", "ally/ally-champion-3")
# Calls of best_responses by the scenario of the entry.
SEARCH = {"standard": FULL_SEARCH, "link": (DISCRETE_PPO,)}
# One response to each opponent is paid for what the opponent loses, whatever that costs an ally.
SPITE: dict[str, Any] = {
    "algorithm": "ppo-stack8",
    "steps": 1_500_000,
    "actions": "discrete",
    "n_seeds": 1,
    "reward": "zero_sum",
}
MATCHES = 25  # per rival in the suites
_KIND = ("algorithm", "steps", "actions", "start", "reward")  # keys that tell kinds of responses apart
_ROW_KEYS = (*_KIND, "script", "training_seed", "seconds", "return", "earned")
SCRIPT = "script"  # algorithm in the row of the strongest script
PURSUIT = "pursuit"  # path of tracks without one
_HEAD = "# Best responses to single entries of the board. Made by: python scripts/train_best_responses.py\n"


@dataclass(frozen=True)
class Target:
    """First training seed of a trained entry.

    Attributes:
        track: its track.
        slug: its folder on the board.
        agent: its policy, as a player.
        sha256: hash of its policy.
    """

    track: Track
    slug: str
    agent: str
    sha256: str

    @property
    def side(self) -> str:
        """Its side."""
        return self.track.side

    @property
    def path(self) -> str:
        """Flight path of the opponent."""
        return self.track.path or PURSUIT

    @property
    def name(self) -> str:
        """Name of its job, and of the command's argument."""
        return f"{self.side}/{self.slug}"

    @property
    def response(self) -> str:
        """Name of the strongest response as a player; each scenario has a folder of its own."""
        scenario, version = self.track.scenario, self.track.public.rpartition("-v")[2]
        own = "" if scenario == "standard" else f"-{scenario}"
        return f"{RESPONSES}{own}-v{version}/{self.name}"

    @property
    def calls(self) -> list[dict[str, Any]]:
        """Arguments of the calls of best_responses that find responses to it."""
        search = SEARCH[self.track.scenario]
        spite = [SPITE] if self.side == "opponent" else []
        return [*({**call, "reward": RESPONSE_REWARDS[self.side]} for call in search), *spite]

    def rows(self, file: RowFile) -> list[Row]:
        """Return the rows of responses to this very policy."""
        own = {"track": self.track.key, "slug": self.slug, "policy_sha256": self.sha256, "protocol": PROTOCOL}
        return [row for row in file.read() if own.items() <= row.items()]

    def is_done(self, file: RowFile) -> bool:
        """Return True if there is a row for each response, and the strongest agent if it becomes a rival."""
        rows = Counter(kind_of(row) for row in self.rows(file))
        is_kept = self.name in ROWS_ALONE or (suites_folder() / self.response / "agent.json").is_file()
        return is_kept and all(rows[kind_of(call)] >= call["n_seeds"] for call in self.calls)


def targets(board: Path, names: Sequence[str]) -> Iterator[Target]:
    """Yield the targets of these entries of a board, or of all; scripts and planners are none."""
    for folder in submission_folders(board, names):
        if folder.parent.name in SIDES:
            entry = load_submission(folder, inspect_onnx=False)
            if entry.policies:
                yield Target(entry.board_track, entry.slug, entry.players[0], entry.policies[0].sha256)


def kind_of(response: Row) -> tuple[Any, ...]:
    """Return what tells a response, or the call that trains it, from those of other kinds."""
    return tuple(response.get(key, "nothing" if key == "start" else None) for key in _KIND)


def train_responses(target: Target, out: Path) -> list[Row]:
    """Train the missing responses to a target; return their results, and that of the strongest script."""
    results: dict[str, BestResponses] = {}
    game = {"scenario": target.track.scenario, "path": target.path}
    for call in target.calls:  # each result of a reward includes the former ones
        results[call["reward"]] = best_responses(
            BestResponseConfig(agent=target.agent, side=target.side, game=game, **call),
            out / call["reward"],
            progress=False,
        )
    reward = RESPONSE_REWARDS[target.side]
    scripts = results[reward]["scripts"]
    name = min(scripts, key=lambda name: scripts[name]["return"])
    strongest = {"algorithm": SCRIPT, "script": name, "reward": reward, **scripts[name]}
    return [strongest, *(response for result in results.values() for response in result["responses"])]


def keep(target: Target, file: RowFile, out: Path, responses: Sequence[Row]) -> None:
    """Replace the rows of these kinds of responses to a target, and copy the strongest to the suites.

    Those of ``ROWS_ALONE`` have no agent there.
    An agent that is there stays if it is a stronger response of another kind.
    """
    made = {kind_of(response) for response in responses}
    others = [row for row in target.rows(file) if kind_of(row) not in made]
    known = [row["return"] for row in others if _is_rival(row, target)]
    strongest = min((row for row in responses if _is_rival(row, target)), key=lambda row: row["return"])
    published = suites_folder() / target.response
    is_new = strongest["return"] <= min(known, default=math.inf) or not (published / "agent.json").is_file()
    if is_new and target.name not in ROWS_ALONE:
        agent = out / strongest["reward"] / response_folder(strongest) / "agent"
        card = read_card(agent)
        imitation = card.hyperparameters.get("imitate") or {}
        if Path(imitation.get("teacher", "")).is_absolute():  # another response, which is not published
            imitation["teacher"] = "/".join(Path(imitation["teacher"]).parts[-3:-1])
        command = f"python scripts/train_best_responses.py {target.name}"
        card.model_copy(update={"command": command}).write(published, (agent / "policy.onnx").read_bytes())
    own = (target.track.key, target.slug)
    rows = [row for row in file.read() if (row["track"], row["slug"]) != own or kind_of(row) not in made]
    for response in responses:
        rows.append(
            {
                "track": target.track.key,
                "slug": target.slug,
                "agent": target.agent,
                **{key: response[key] for key in _ROW_KEYS if key in response},
                "jammed": response["measures"]["jamming_success_rate"],
                "policy_sha256": target.sha256,
                "protocol": PROTOCOL,
            }
        )
    rows.sort(key=lambda row: (row["track"], row["slug"]))
    write_whole(file.path, "".join(json.dumps(row) + "\n" for row in rows))


def _is_rival(row: Row, target: Target) -> bool:
    """Return True for a trained response that may become a rival: no script, and no spite."""
    return row["reward"] == RESPONSE_REWARDS[target.side] and row["algorithm"] != SCRIPT


def write_suites(board: Path) -> Iterator[Path]:
    """Write the suite of each track that has responses to entries of the board; yields the paths."""
    answered = [target for target in targets(board, ()) if (suites_folder() / target.response).is_dir()]
    for track in TRACKS.values():
        if own := [target for target in answered if target.track == track]:
            public = load_suite(track.public)
            content = {
                "side": public.side,
                "scenario": track.scenario,
                "matches": MATCHES,
                "scale": {"zero": public.scale.zero, "top": public.scale.top},
                "rivals": [
                    {
                        "name": f"response to {target.slug}",
                        public.other_side: target.response,
                        "path": target.path,
                    }
                    for target in own
                ],
            }
            path = suites_folder() / f"{track.suite_name(RESPONSES)}.yml"
            write_whole(path, _HEAD + yaml.safe_dump(content, sort_keys=False, width=110))
            yield path


def tables(board: Path, file: RowFile) -> Iterator[str]:
    """Yield a table for each scenario and side with targets."""
    shown = list(targets(board, (*TARGETS, *ROWS_ALONE)))
    for of in product(SEARCH, SIDES):
        if own := [target for target in shown if (target.track.scenario, target.side) == of]:
            yield "\n".join(table(own, file))


def table(own: Sequence[Target], file: RowFile) -> Iterator[str]:
    """Yield the lines of a table of targets: the lowest return by kind of response and overall.

    All targets are of one scenario and side. In brackets are the script's name, or the minutes of the
    training. Kinds of responses that an earlier search has left have a column, too.
    """
    side, calls = own[0].side, own[0].calls
    found = {target.slug: target.rows(file) for target in own}
    trained = [row for rows in found.values() for row in rows if row["algorithm"] != SCRIPT]
    titles = {kind_of({"algorithm": SCRIPT, "reward": RESPONSE_REWARDS[side]}): "strongest script"}
    titles |= {kind_of(each): _title(each, side) for each in (*trained, *calls)}
    yield f"| entry | {' | '.join(titles.values())} | lowest known |"
    yield "| --- |" + " --- |" * (len(titles) + 1)
    for slug, rows in found.items():
        cells = [_cell([row for row in rows if kind_of(row) == kind]) for kind in titles]
        known = [row["return"] for row in rows if row["reward"] == RESPONSE_REWARDS[side]]
        lowest = f"**{min(known):.1f}**" if known else "-"
        yield f"| `{slug}` | {' | '.join(cells)} | {lowest} |"


def _title(call: Row, side: str) -> str:
    """Return the title of a kind of response to a side's entries."""
    paid = "" if call["reward"] == RESPONSE_REWARDS[side] else "paid for the loss: "
    label = response_label({"start": "nothing", **call, "training_seed": 0})
    return paid + label.removesuffix(", seed 0")


def _cell(rows: Sequence[Row]) -> str:
    """Return the lowest return of responses, with the script's name or the minutes of the training."""
    if not rows:
        return "-"
    lowest = min(rows, key=lambda row: row["return"])
    note = f"`{lowest['script']}`" if lowest["algorithm"] == SCRIPT else f"{lowest['seconds'] / 60:.1f}"
    return f"{lowest['return']:.1f} ({note})"


def main() -> int:
    """Train what is missing; returns 0 if all went well."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "entries",
        nargs="*",
        default=(*TARGETS, *ROWS_ALONE),
        help="default: the first of each table, later champions",
    )
    parser.add_argument("--n-jobs", type=int, default=2, help="entries at once, one thread each")
    parser.add_argument("--board", type=Path, default=Path("leaderboard"), help="the leaderboard's folder")
    parser.add_argument("--runs", type=Path, default=Path("runs/best_responses"), help="the runs' folders")
    parser.add_argument(
        "--table", action="store_true", help="print the tables of the rows, and train nothing"
    )
    options = parser.parse_args()
    file = RowFile(options.board / "results" / "best_responses.jsonl")
    if options.table:
        print("\n\n".join(tables(options.board, file)))
        return 0
    jobs = [
        Job(
            target.name,
            partial(train_responses, target, out),
            partial(keep, target, file, out),
            partial(target.is_done, file),
        )
        for target in targets(options.board, options.entries)
        for out in [(options.runs / target.name).absolute()]
    ]
    check_all_done(run_jobs(jobs, options.n_jobs))
    for path in write_suites(options.board):
        print(f"written: {short_path(path)}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"train_best_responses: {error}")
    except KeyboardInterrupt:
        sys.exit("train_best_responses: stopped; finished work is kept, run it again to resume")
