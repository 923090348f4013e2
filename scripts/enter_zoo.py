"""Enter all scripted players and all shipped agents on the leaderboard: ``python scripts/enter_zoo.py``.

Writes a submission.yaml for each that is new or has changed, and removes nothing. An algorithm is entered
once all its training seeds are there.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json, write_whole
from fpg_bench.leaderboard.submission import seed_folders
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.training.zoo import load_zoo

AUTHORS = ["fpg-bench maintainers"]
MADE = "trained by python scripts/"
# By the public suite of a view: track and path. Agents of other scenarios are not entered.
TRACKS = {
    "ally-v1": ("ally", None),
    "ally-planner-v1": ("ally", None),
    "opponent-v1": ("opponent", "pursuit"),
    "opponent-learned-v1": ("opponent", "learned"),
}
ENVS = {
    "ally-scripted": (
        "ally",
        "seven scripted opponents, in pursuit and on the three patrols, drawn anew every round",
    ),
    "ally-planner": (
        "ally against planned paths",
        "the adaptive opponent, flown as the planner interceptor says",
    ),
    "ally-population": (
        "ally, of a population",
        "seven scripted opponents and those of the public population training-1, drawn anew every round",
    ),
    "opponent-pursuit": (
        "opponent",
        "four scripted allies (reactive, expert, expert-spread, always-hop), drawn anew every round",
    ),
    "opponent-population": (
        "opponent, of a population",
        "five scripted allies and those of the public population training-1, drawn anew every round",
    ),
    "opponent-learned": (
        "opponent that flies itself",
        "four scripted allies (reactive, expert, expert-spread, always-hop), and idle where PPO learned",
    ),
    "duel-ally": ("ally of a duel", "only the opponent that learned with it, from its first step on"),
    "duel-opponent": ("opponent of a duel", "only the ally that learned with it, from its first step on"),
}
# Champions by their folder: track and path.
CHAMPIONS = {"ally-champion": ("ally", None), "opponent-champion": ("opponent", "learned")}
# Title, paper on arXiv, and limitations.
ALGORITHMS = {
    "ppo": ("PPO", "1707.06347", "It has no memory: it acts on the present observation alone."),
    "ppo-stack8": ("PPO, 8 stacked frames", "1707.06347", "It remembers the last eight steps only."),
    "recurrent-ppo": (
        "Recurrent PPO",
        "1707.06347",
        "Its recurrent memory makes it slow to train, so its budget is smaller.",
    ),
    "sac": ("SAC", "1801.01290", "It has no memory, and its budget of steps is much smaller than PPO's."),
    "td3": ("TD3", "1802.09477", "It has no memory, and its budget of steps is much smaller than PPO's."),
    "maddpg": ("MADDPG", "1706.02275", "It has no memory, and met nobody but its own opponent."),
}
SCRIPTS = {
    "idle": "stays on its frequency and never spreads",
    "reactive": "hops to a point drawn at random once its link is broken",
    "expert": "hops where it is covered and its link is threatened, as the expert knowledge base says",
    "expert-spread": "hops as expert does, and spreads its signal for eight seconds after each hop",
    "always-hop": "hops in every step, to a point drawn at random",
    "tone": "always jams a single tone",
    "narrowband": "always jams a narrow band",
    "broadband": "always jams a broad band",
    "comb": "always jams a comb of tones",
    "sweep": "jams a narrow band that sweeps over all frequency points",
    "adaptive": "jams a tone after a check, later broadband from near, a comb from farther, else narrowband",
    "watchful": "jams a tone while the ally stays where it was found, else as adaptive does",
    "random": "draws every action at random",
}


def entry(name: str, algorithm: str, place: tuple[str, str | None], **other: object) -> str:
    """Return the text of a submission.yaml."""
    track, path = place
    content = {"name": name, "authors": AUTHORS, "algorithm": algorithm, "reference": None, "licence": "MIT"}
    content |= {"track": track} | ({} if path is None else {"path": path}) | other
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def scripts() -> dict[str, str]:
    """Return every scripted player's submission, by track and name; opponents stand in both tables."""
    entries = {}
    for track, path in (("ally", None), ("opponent", "pursuit"), ("opponent", "learned")):
        for script in SCRIPTED[track]:
            flies = path == "learned"
            entries[f"{track}/{script}{'-learned' if flies else ''}"] = entry(
                f"{script} (flies itself)" if flies else script,
                "script",
                (track, path),
                training=None,
                saw="Nothing: it is a script, written by hand.",
                unable="It does not learn.",
                description=f"A scripted {track}: it {SCRIPTS[script]}.",
                script=script,
            )
    return entries


def agents() -> dict[str, str]:
    """Return every shipped algorithm's submission, by track and name."""
    zoo, entries = load_zoo(), {}
    for view in zoo.groups:
        for algorithm in view.steps:
            members = zoo.members(f"{view.name}/{algorithm}")
            if view.suites[0] in TRACKS and all(member.shipped for member in members):
                place, made = TRACKS[view.suites[0]], f"train_zoo.py --only {view.name}/{algorithm}"
                text = trained(
                    members[0].folder.parent, place, *ENVS[view.name], f"From the zoo; {MADE}{made}."
                )
                entries[f"{place[0]}/{view.name}-{algorithm}"] = text
    return entries


def champions() -> dict[str, str]:
    """Return every shipped champion's submission, with the training seeds that are there."""
    entries = {}
    for name, place in CHAMPIONS.items():
        for folder in sorted((baselines_folder() / "agents" / name).glob("*")):
            made = f"Made to be hard to beat; {MADE}train_champions.py --only {name}."
            saw = "scripts, agents of the zoo, and those who had learned to beat it"
            entries[f"{place[0]}/{name}"] = trained(folder, place, f"{place[0]} champion", saw, made)
    return entries


def trained(folder: Path, place: tuple[str, str | None], role: str, saw: str, made: str) -> str:
    """Return the submission of shipped agents; hours are per seed, for all stages at the pace of the last."""
    title, paper, unable = ALGORITHMS[folder.name]
    every = [read_json(seed / "agent.json", "agent") for seed in seed_folders(folder).values()]
    hours = [of["seconds"] / of["steps_done"] * of["training_steps"] / 3600 for of in every]
    return entry(
        f"{title} ({role})",
        title,
        place,
        reference=f"https://arxiv.org/abs/{paper}",
        training={
            "steps": every[0]["training_steps"],
            "hours": round(sum(hours) / len(hours), 3),
            "seeds": [of["training_seed"] for of in every],
        },
        saw=f"{saw[0].upper()}{saw[1:]}.",
        unable=unable,
        description=made,
        zoo=f"{folder.parent.name}/{folder.name}",
    )


def main() -> int:
    """Write what is new or has changed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("leaderboard"), help="the leaderboard's folder")
    folder = parser.parse_args().folder
    every = scripts() | agents() | champions()
    entries = {f"submissions/{name}/submission.yaml": text for name, text in every.items()}
    for name, text in entries.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            print(f"{'changed' if path.exists() else 'new'}: {name}")
            write_whole(path, text)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"enter_zoo: {error}")
