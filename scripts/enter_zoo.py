"""Enter all scripted players and shipped agents on the leaderboard: ``python scripts/enter_zoo.py``.

Writes new and changed submission.yaml files, and removes none. An algorithm is entered once all its training
seeds are shipped.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.common.ids import NAMED
from fpg_bench.evaluation.zoo import load_zoo
from fpg_bench.players.agent import baselines_folder, read_card
from fpg_bench.products.leaderboard.submission import seed_folders
from fpg_bench.products.leaderboard.tracks import TRACKS, Track

AUTHORS = ["fpg-bench maintainers"]
TRACK_OF = {track.public: track for track in TRACKS.values()}  # other suites have no track
# What tells a script's entry from that in the first track of its side: end of the folder's name, and remark.
SCRIPT_TRACKS = {
    "ally": ("", ""),
    "opponent-pursuit": ("", ""),
    "opponent-learned": ("-learned", " (flies itself)"),
    "ally-link": ("-link", ""),
    "opponent-link": ("-link", ""),
}
# Role and training partners by the group's name.
GROUPS = {
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
        "four scripted allies (reactive, expert, expert-spread, always-hop), and idle where PPO learned",
    ),
    "opponent-learned": (
        "opponent that flies itself",
        "four scripted allies (reactive, expert, expert-spread, always-hop), and idle where PPO learned",
    ),
    "ally-scripted-discrete": (
        "ally, discrete actions",
        "seven scripted opponents, in pursuit and on the three patrols, drawn anew every round",
    ),
    "ally-discrete": (
        "ally of a population, discrete",
        "twelve scripted opponents and those of the public population training-1, drawn anew every round",
    ),
    "opponent-discrete": (
        "opponent, discrete actions",
        "five scripted allies, and every sixteenth round those of the public population training-1",
    ),
    "ally-link": ("ally on a radio link", "eleven scripted opponents, drawn anew every round"),
    "ally-link-waterfall": (
        "ally on a radio link that sees a waterfall",
        "eleven scripted opponents, drawn anew every round",
    ),
    "opponent-link": ("opponent on a radio link", "ten scripted allies, drawn anew every round"),
    "ally-link-population": (
        "ally on a link, of a population",
        "thirteen scripted opponents and those of the public population training-link-1; pupil of by-type",
    ),
    "opponent-link-population": (
        "opponent on a link, of a population",
        "ten scripted allies and those of the public population training-link-1; pupil of narrowband",
    ),
    "duel-ally": ("ally of a duel", "only the opponent that learned with it, from its first step on"),
    "duel-opponent": ("opponent of a duel", "only the ally that learned with it, from its first step on"),
}
STAGED = "scripts, agents of the zoo, and those who had learned to beat it"
# Champion, role, training partners and track by the entry's folder.
CHAMPIONS = {
    "ally-champion": ("ally-champion", "ally champion", STAGED, "ally"),
    "ally-champion-2": (
        "ally-champion-2",
        "second ally champion",
        "thirteen scripted opponents, and the responses to its stages",
        "ally",
    ),
    "ally-champion-3": (
        "ally-champion-3",
        "third ally champion",
        "thirteen scripted opponents, and mostly a rival that learned at the same time",
        "ally",
    ),
    "ally-champion-4": (
        "ally-champion-4",
        "fourth ally champion",
        "only opponents that learned at the same time",
        "ally",
    ),
    "ally-link-champion": (
        "ally-link-champion",
        "ally champion on a radio link",
        "fourteen scripted opponents, and the responses to its stages",
        "ally-link",
    ),
    "opponent-champion": ("opponent-champion", "opponent champion", STAGED, "opponent-learned"),
    "opponent-champion-2": ("opponent-champion-2", "second opponent champion", STAGED, "opponent-learned"),
    "opponent-champion-2-pursuit": (
        "opponent-champion-2",
        "second opponent champion, in pursuit",
        STAGED,
        "opponent-pursuit",
    ),
}
NO_MEMORY = "It has no memory: it acts on the present observation alone."
EIGHT_STEPS = "It remembers the last eight steps only."
SMALL_BUDGET = "It has no memory, and its budget of steps is much smaller than PPO's."
# Title, paper on arXiv, and limitations.
ALGORITHMS = {
    "ppo": ("PPO", "1707.06347", NO_MEMORY),
    "ppo-stack8": ("PPO, 8 stacked frames", "1707.06347", EIGHT_STEPS),
    "recurrent-ppo": (
        "Recurrent PPO",
        "1707.06347",
        "Its recurrent memory makes it slow to train, so its budget is smaller.",
    ),
    "maskable-ppo": ("MaskablePPO", "2006.14171", NO_MEMORY),
    "dqn": ("DQN", "1312.5602", SMALL_BUDGET),
    "dqn-stack8": ("DQN, 8 stacked frames", "1312.5602", EIGHT_STEPS),
    "dueling-ddqn": ("Dueling double DQN", "2307.06796", SMALL_BUDGET),
    "qr-dqn": ("QR-DQN", "1710.10044", SMALL_BUDGET),
    "sac": ("SAC", "1801.01290", SMALL_BUDGET),
    "td3": ("TD3", "1802.09477", SMALL_BUDGET),
    "tabular": ("Stochastic table", "2206.05825", "It knows six features, of `standard` alone."),
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
    "scan": "jams a narrow band at five places of the band in turn",
    "alternate": "jams a broad band in the lower and in the upper half of the band in turn",
    "guard": "jams a comb around the known frequency from near, and a narrow band beside it from afar",
    "herd": "jams as watchful does until the ally has moved twice, and then as alternate does",
    "sulk": "hops in an outage, but stays for half a minute after three hops that did not help",
    "evidence": "hops to a point drawn at random once the hits in a row are unlikely to be blind",
    "clock": "hops as evidence does, and spreads when the next check may come",
    "hunter": "jams a narrow band for two seconds where a check found the ally, else half the band at random",
    "by-type": "spreads its signal against a tone, and hops away from every other type",
    "range": "never hops: it spreads where jamming may be strong, and keeps its distance",
    "belief": "plans by point-based value iteration, as against a jammer that pursues its point",
    "bayes": "keeps a belief over the frequency points, and jams where the ally loses most by it",
    "random": "draws every action at random",
    "epsilon-greedy": "hops in an outage to the best point so far, or one time in ten to any",
    "ucb": "hops in an outage to the point with the highest upper confidence bound on its mean reward",
    "thompson": "hops in an outage to the point whose mean reward, drawn by Thompson sampling, is highest",
    "q-learning": "learns by a table when to stay, to spread, and to hop at random or by the knowledge base",
}
# Papers of the scripts that learn within a round.
PAPERS = {
    "epsilon-greedy": "https://mitpress.mit.edu/9780262039246/reinforcement-learning/",
    "ucb": "https://doi.org/10.1023/A:1013689704352",
    "thompson": "https://arxiv.org/abs/1209.3353",
    "q-learning": "https://researchportal.rma.ac.be/en/publications/jamming-mitigation-in-cognitive-radio-networks-using-a-modified-q",
}


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
    for key, (end, remark) in SCRIPT_TRACKS.items():
        track = TRACKS[key]
        for script in filter(SCRIPTS.__contains__, NAMED[track.side]):
            paper = PAPERS.get(script)
            entries[f"{track.side}/{script}{end}"] = entry(
                f"{script}{remark}",
                "script",
                track,
                reference=paper,
                training=None,
                saw="Nothing: it learns within a round."
                if paper
                else "Nothing: it is a script, written by hand.",
                unable="It forgets what it learned when a round ends." if paper else "It does not learn.",
                description=f"A scripted {track.side}: it {SCRIPTS[script]}.",
                script=script,
            )
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
                text = trained(folder, track, *GROUPS[group.name], f"From the zoo; trained by {command}.")
                entries[f"{track.side}/{group.name}-{algorithm}"] = text
    return entries


def champions() -> dict[str, str]:
    """Return the submissions of all shipped champions by track and name."""
    entries = {}
    for slug, (name, role, saw, key) in CHAMPIONS.items():
        track = TRACKS[key]
        for folder in sorted((baselines_folder() / "agents" / name).glob("*")):
            text = f"Made to be hard to beat; trained by python scripts/train_champions.py --only {name}."
            entries[f"{track.side}/{slug}"] = trained(folder, track, role, saw, text)
    return entries


def trained(folder: Path, track: Track, role: str, saw: str, description: str) -> str:
    """Return the submission of an algorithm, with the mean hours of a seed at the speed of its last stage."""
    title, paper, unable = ALGORITHMS[folder.name]
    cards = [read_card(seed) for seed in seed_folders(folder).values()]
    steps = [card.training_steps for card in cards]
    hours = [(c.seconds or 0) / (c.steps_done or n) * n / 3600 for c, n in zip(cards, steps, strict=True)]
    return entry(
        f"{title} ({role})",
        title,
        track,
        reference=f"https://arxiv.org/abs/{paper}",
        training={
            "steps": max(card.training_steps for card in cards),
            "hours": round(sum(hours) / len(hours), 3),
            "seeds": [card.training_seed for card in cards],
        },
        saw=f"{saw[0].upper()}{saw[1:]}.",
        unable=unable,
        description=description,
        zoo=f"{folder.parent.name}/{folder.name}",
    )


def main() -> int:
    """Write the new and changed files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("leaderboard"), help="the leaderboard's folder")
    folder = parser.parse_args().folder
    for entry_name, text in (scripts() | agents() | champions()).items():
        name = f"submissions/{entry_name}/submission.yaml"
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
