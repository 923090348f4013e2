"""Enter all scripted players and shipped agents on the leaderboard: ``python scripts/enter_zoo.py``.

Writes new and changed submission.yaml files, and removes none. An algorithm is entered once all its training
seeds are shipped.
"""

from __future__ import annotations

from pathlib import Path

import yaml
from command import run

from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.ids import NAMED
from fpg_bench.players.agent import baselines_folder, read_card
from fpg_bench.products.leaderboard.submission import seed_folders
from fpg_bench.products.leaderboard.tracks import TRACKS, Track
from fpg_bench.products.zoo.zoo import load_zoo

AUTHORS = ["fpg-bench maintainers"]
TRACK_OF = {track.public: track for track in TRACKS.values()}  # other suites have no track
SAID = read_yaml(Path(__file__).with_name("entries.yml"), "entries")  # of each kind of entry, by its name


def entry(name: str, algorithm: str, track: Track, **others: object) -> str:
    """Return the text of a submission.yaml."""
    content = {"name": name, "authors": AUTHORS, "algorithm": algorithm, "reference": None, "licence": "MIT"}
    content |= {"track": track.side}
    content |= {} if track.path is None else {"path": track.path}
    content |= {} if track.scenario == "standard" else {"scenario": track.scenario}
    content |= others
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def scripts() -> dict[str, str]:
    """Return the submissions of all scripts by track and name; each is entered in all tracks of its side."""
    entries = {}
    for key, (end, remark) in SAID["script_tracks"].items():
        track = TRACKS[key]
        for script in filter(SAID["scripts"].__contains__, NAMED[track.side]):
            paper = SAID["papers"].get(script)
            saw = "it learns within a round" if paper else "it is a script, written by hand"
            unable = "It forgets what it learned when a round ends." if paper else "It does not learn."
            about = {"reference": paper, "training": None, "saw": f"Nothing: {saw}.", "unable": unable}
            about |= {
                "description": f"A scripted {track.side}: it {SAID['scripts'][script]}.",
                "script": script,
            }
            entries[f"{track.side}/{script}{end}"] = entry(f"{script}{remark}", "script", track, **about)
    return entries


def agents() -> dict[str, str]:
    """Return the submissions of all shipped algorithms by track and name."""
    zoo, entries = load_zoo(), {}
    for group in zoo.groups:
        for algorithm in group.steps:
            members = zoo.members(f"{group.name}/{algorithm}")
            track = TRACK_OF.get(group.suites[0].partition("@")[0])
            if track and all(member.shipped for member in members):
                folder = members[0].folder.parent
                command = f"python scripts/train_zoo.py --only {group.name}/{algorithm}"
                role, saw = SAID["groups"][group.name]
                text = trained(folder, track, role, saw, f"From the zoo; trained by {command}.")
                entries[f"{track.side}/{group.name}-{algorithm}"] = text
    return entries


def champions() -> dict[str, str]:
    """Return the submissions of all shipped champions by track and name."""
    entries = {}
    for slug, (name, role, saw, key) in SAID["champions"].items():
        track = TRACKS[key]
        for folder in sorted((baselines_folder() / "agents" / name).glob("*")):
            made = "Found" if folder.name == "rule" else "Made to be hard to beat; trained"
            text = f"{made} by python scripts/train_champions.py --only {name}."
            entries[f"{track.side}/{slug}"] = trained(folder, track, role, saw, text)
    return entries


def trained(folder: Path, track: Track, role: str, saw: str, description: str) -> str:
    """Return the submission of an algorithm, with the mean hours of a seed at the speed of its last stage."""
    title, paper, unable = SAID["algorithms"][folder.name]
    cards = [read_card(seed) for seed in seed_folders(folder).values()]
    steps = [card.training_steps for card in cards]
    hours = [(c.seconds or 0) / (c.steps_done or n) * n / 3600 for c, n in zip(cards, steps, strict=True)]
    seeds = [card.training_seed for card in cards]
    training = {"steps": max(steps), "hours": round(sum(hours) / len(hours), 3), "seeds": seeds}
    about = {"reference": paper and f"https://arxiv.org/abs/{paper}", "training": training}
    about |= {"saw": f"{saw[0].upper()}{saw[1:]}.", "unable": unable, "description": description}
    return entry(f"{title} ({role})", title, track, **about, zoo=f"{folder.parent.name}/{folder.name}")


def main(folder: Path = Path("leaderboard")) -> None:
    """Write the new and changed files into the leaderboard's folder."""
    for entry_name, text in (scripts() | agents() | champions()).items():
        name = f"submissions/{entry_name}/submission.yaml"
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            print(f"{'changed' if path.exists() else 'new'}: {name}")
            write_whole(path, text)


if __name__ == "__main__":
    run(main)
