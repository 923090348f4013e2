"""Enter all scripted players and all shipped agents on the leaderboard: a submission.yaml each.

    python scripts/enter_zoo.py [--folder leaderboard]

Run it again whenever agents were shipped: it writes what is new or has changed, and takes nothing away. An
algorithm is entered once all its training seeds are there.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import yaml

from fpg_bench.errors import UserError
from fpg_bench.evaluation.zoo import Member, ZooView, load_zoo
from fpg_bench.files import read_json, write_whole
from fpg_bench.leaderboard.policies import seed_folders
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.scripted import SCRIPTED

AUTHORS = ["fpg-bench maintainers"]
# By the public field of a view: track and path. Agents of other scenarios are not entered.
TRACKS = {
    "ally-v1": ("ally", None),
    "ally-planner-v1": ("ally", None),
    "opponent-v1": ("opponent", "pursuit"),
    "opponent-learned-v1": ("opponent", "learned"),
}
VIEWS = {
    "ally-scripted": (
        "ally",
        "the seven scripted opponents, in pursuit and on the three patrols, drawn anew every round",
    ),
    "ally-planner": (
        "ally against planned paths",
        "the adaptive opponent, flown as the planner interceptor says",
    ),
    "ally-population": (
        "ally, of a population",
        "the seven scripted opponents and those of the public population training-1, drawn anew every round",
    ),
    "opponent-population": (
        "opponent, of a population",
        "five scripted allies and those of the public population training-1, drawn anew every round",
    ),
    "opponent-pursuit": (
        "opponent",
        "four scripted allies (reactive, expert, expert-spread, always-hop), drawn anew every round",
    ),
    "opponent-learned": (
        "opponent that flies itself",
        "four scripted allies (reactive, expert, expert-spread, always-hop), drawn anew every round",
    ),
    "duel-ally": ("ally of a duel", "only the opponent that learned with it, from its first step on"),
    "duel-opponent": ("opponent of a duel", "only the ally that learned with it, from its first step on"),
}
# Champions by their folder: track and path.
CHAMPIONS = {"ally-champion": ("ally", None), "opponent-champion": ("opponent", "learned")}
ALGORITHMS = {
    "ppo": (
        "PPO",
        "https://arxiv.org/abs/1707.06347",
        "It has no memory: it acts on the present observation alone.",
    ),
    "ppo-stack8": (
        "PPO, 8 stacked frames",
        "https://arxiv.org/abs/1707.06347",
        "It remembers the last eight steps only.",
    ),
    "recurrent-ppo": (
        "Recurrent PPO",
        "https://arxiv.org/abs/1707.06347",
        "Its recurrent memory makes it slow to train, so its budget is smaller.",
    ),
    "sac": (
        "SAC",
        "https://arxiv.org/abs/1801.01290",
        "It has no memory, and its budget of steps is much smaller than PPO's.",
    ),
    "td3": (
        "TD3",
        "https://arxiv.org/abs/1802.09477",
        "It has no memory, and its budget of steps is much smaller than PPO's.",
    ),
    "maddpg": (
        "MADDPG",
        "https://arxiv.org/abs/1706.02275",
        "It has no memory, and met nobody but its own opponent.",
    ),
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
    "adaptive": "jams broadband from near, a comb from farther off, narrowband from afar, else a tone",
    "random": "draws every action at random",
}


def entry(**fields: Any) -> str:
    """The text of a submission.yaml."""
    return yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, width=110)


def scripts() -> dict[str, str]:
    """Every scripted player's submission, by track and name; opponents stand in both tables."""
    found = {}
    for track, path in (("ally", None), ("opponent", "pursuit"), ("opponent", "learned")):
        for script in SCRIPTED[track]:
            slug = f"{script}-learned" if path == "learned" else script
            found[f"{track}/{slug}"] = entry(
                name=f"{script} (flies itself)" if path == "learned" else script,
                authors=AUTHORS,
                algorithm="script",
                reference=None,
                licence="MIT",
                track=track,
                **({} if path is None else {"path": path}),
                training=None,
                saw="Nothing: it is a script, written by hand.",
                unable="It does not learn.",
                description=f"A scripted {track}: it {SCRIPTS[script]}.",
                script=script,
            )
    return found


def agents() -> dict[str, str]:
    """Every shipped algorithm's submission, by track and name."""
    zoo, found = load_zoo(), {}
    for view in zoo.views:
        for algorithm in view.steps:
            members = zoo.members(f"{view.name}/{algorithm}")
            if view.fields[0] in TRACKS and all(member.shipped for member in members):
                track = TRACKS[view.fields[0]][0]
                found[f"{track}/{view.name}-{algorithm}"] = agent(view, algorithm, members)
    return found


def agent(view: ZooView, algorithm: str, members: list[Member]) -> str:
    """The submission of a zoo's algorithm on one view."""
    track, path = TRACKS[view.fields[0]]
    role, saw = VIEWS[view.name]
    title, reference, unable = ALGORITHMS[algorithm]
    seconds = [member.about()["seconds"] for member in members]
    return entry(
        name=f"{title} ({role})",
        authors=AUTHORS,
        algorithm=title,
        reference=reference,
        licence="MIT",
        track=track,
        **({} if path is None else {"path": path}),
        training={
            "steps": view.steps[algorithm],
            "hours": round(sum(seconds) / len(seconds) / 3600, 3),
            "seeds": [member.seed for member in members],
        },
        saw=f"{saw[0].upper()}{saw[1:]}.",
        unable=unable,
        description=f"From the zoo; trained by python scripts/train_zoo.py --only {view.name}/{algorithm}.",
        zoo=f"{view.name}/{algorithm}",
    )


def champions() -> dict[str, str]:
    """Every shipped champion's submission, with the training seeds that are there, by track and name."""
    folders = [
        folder
        for champion in CHAMPIONS
        for folder in sorted((baselines_folder() / "agents" / champion).glob("*"))
    ]
    return {f"{CHAMPIONS[of.parent.name][0]}/{of.parent.name}": champion(of) for of in folders}


def champion(folder: Path) -> str:
    """The submission of a champion's agents; the hours are those of all stages, at the pace of the last."""
    name, algorithm = folder.parent.name, folder.name
    track, path = CHAMPIONS[name]
    title, reference, unable = ALGORITHMS[algorithm]
    every = [read_json(seed / "agent.json", "agent") for seed in seed_folders(folder).values()]
    hours = [of["seconds"] / of["steps_done"] * of["training_steps"] / 3600 for of in every]
    return entry(
        name=f"Champion ({track}, {title})",
        authors=AUTHORS,
        algorithm=title,
        reference=reference,
        licence="MIT",
        track=track,
        **({} if path is None else {"path": path}),
        training={
            "steps": every[0]["training_steps"],
            "hours": round(sum(hours) / len(hours), 3),
            "seeds": [of["training_seed"] for of in every],
        },
        saw="Scripts, agents of the zoo, and those who had learned to beat it.",
        unable=unable,
        description=f"Made to be hard to beat; trained by python scripts/train_champions.py --only {name}.",
        zoo=f"{name}/{algorithm}",
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
