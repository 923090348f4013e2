"""The wheel with the core alone plays; each extra does what it is for, and is named where it is missing.

Each environment holds what the wheel asks for and nothing else, see :mod:`tests.environments`.
"""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import fpg_bench
from tests.environments import ROOT, environment, install_wheel, run
from tests.test_cli import VERBS

pytestmark = [pytest.mark.process, pytest.mark.full]

AGENT = "ally-scripted/recurrent-ppo/seed_0"  # it has a memory
CORE = """
import pathlib, sys
import gymnasium, pettingzoo
import fpg_bench
from gymnasium.utils.env_checker import check_env
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.checkers import check_player

assert pathlib.Path(fpg_bench.__file__).is_relative_to(sys.prefix), fpg_bench.__file__
assert baselines_folder().is_relative_to(sys.prefix) and (baselines_folder() / "hyperparams/ppo.yml").exists()
assert (baselines_folder().parent / "constraints.txt").exists()
assert fpg_bench.preset("standard").knowledge_base
env = gymnasium.make("FPG/AllyVsScripted-v0")
env.reset(seed=1)
env.step(env.action_space.sample())
check_env(env.unwrapped)  # shows every mode that is named, and without the extra video none is
pettingzoo.make("parallel", "FPG/duel_v0").reset(seed=1)
check_player(fpg_bench.load_agent("ally-scripted/ppo/seed_0"), "ally")
"""
# Runs each line as a command or, where it has a bracket, as Python; prints the status and the output.
RUN = """
import contextlib, io, json, os, shlex, sys
import gymnasium
import fpg_bench.cli.main
os.environ |= {"FPG_LLM_BASE_URL": "http://127.0.0.1:9/v1", "FPG_LLM_MODEL": "none"}
results = []
for line in json.loads(sys.argv[1]):
    output, status = io.StringIO(), 0
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        try:
            if "(" in line:
                eval(line)
            else:
                sys.argv[1:] = shlex.split(line)
                fpg_bench.cli.main.main()
        except SystemExit as end:
            status = end.code or 0
        except fpg_bench.UserError as error:
            print(error)
            status = 2
    results.append((line, status, output.getvalue()))
print("\\n" + json.dumps(results))
"""


@dataclass(frozen=True)
class Extra:
    """An extra, and what it is for.

    Attributes:
        does: lines that work with it, each after those before it.
        tries: lines that load what they need, and then refuse what they are given.
        base: the extra that its lines need beside it, and with which alone they name it; None: the core.
    """

    does: tuple[str, ...] = ()
    tries: tuple[str, ...] = ()
    base: str | None = None


EXTRAS = {
    "evaluate": Extra(
        (
            f"evaluate expert {AGENT} --matches 1 --n-jobs 2 --out results",
            "table results",
            "evaluate circle --suite planner-v1 --matches 1 --out planners",
            f"submit check {ROOT}/leaderboard/submissions/opponent/adaptive",
        ),
        (
            "curves nowhere",
            "submit run nowhere",
            "leaderboard verify --folder nowhere",
            "leaderboard break ally/idle nowhere --name Me --author Me --folder nowhere",
            "fpg_bench.evaluate(['nobody'])",
            "fpg_bench.write_agent('nowhere', b'')",
        ),
    ),
    "datasets": Extra(("dataset make ally-random-v0 --steps 300 --out datasets", "dataset check datasets")),
    "offline": Extra(tries=("offline bc nowhere --out nowhere",)),
    "hub": Extra(tries=("hub push nowhere me/agent", "hub pull nowhere --out nowhere")),
    "leaderboard": Extra(("leaderboard build --folder board --out site",)),
    "video": Extra(
        (
            "play --every 100 --out round.gif",
            "play --every 100 --out round.mp4",
            "play --every 100 --out flown.svg",
            "gymnasium.make('FPG/AllyVsScripted-v0', render_mode='rgb_array').reset()",
        )
    ),
    "llm": Extra(tries=("play --planner llm",)),
    "fast": Extra(tries=("reproduce yang-2026 fig99 --learner jax",), base="train"),
    "train": Extra(
        (
            "leaderboard season season-4",
            "fpg_bench.make_sb3('FPG/AllyVsScripted-v0', n_envs=2).reset()",
            "train ppo FPG/AllyVsScripted-v0 --steps 2000 --n-evals 0 --out run",
            "export run --out exported/seed_0",
            "rule-search --side opponent --against idle --budget 0.01 --out rule",
            "tabular-self-play --iterations 1 --games 8 --out tables",
            "reproduce firouzbakht-2013 --n-seeds 1 --out reproduced",
        ),
        (
            "best-response nobody --out nowhere",
            "double-oracle --side nobody --out nowhere",
            "leaderboard close-season 5 --work nowhere --folder nowhere",
        ),
    ),
    "tune": Extra(
        ("tune run ppo FPG/AllyVsScripted-v0 --n-trials 1 --n-seeds 1 --steps 500 --rounds 2 --out study",),
        ("tune export nowhere mine.yml",),
    ),
    "supersuit": Extra(("fpg_bench.supersuit_vec_env(n_envs=2).reset()",), base="train"),
    "dataframe": Extra(("fpg_bench.evaluate(['random'], matches=1).dataframe()",), base="evaluate"),
    "ray": Extra(("evaluate expert --matches 1 --backend ray --out far",), base="evaluate"),
    "postgres": Extra(
        tries=(
            "tune run ppo FPG/AllyVsScripted-v0 --out study --storage postgresql+psycopg://me@127.0.0.1:9/a",
        ),
        base="tune",
    ),
}
PLAYS = (
    *(
        "envs",
        "dataset list",
        "players",
        "suites",
        "zoo",
        "play --every 100",
        "play --out round.html",
        "scenario show link",
    ),
    f"play --ally {AGENT} --opponent opponent-pursuit/ppo/seed_0 --planner hill-climb --every 300",
    "leaderboard init own",
)
REFUSES = ("scenario check nowhere.yml",)
COMMANDS = [verb.removeprefix("fpg-bench ") for verb in VERBS]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return install_wheel(tmp_path_factory.mktemp("wheel"))


def test_the_wheel_is_small_and_holds_the_agents(wheel):
    (file,) = wheel.parent.glob("*.whl")
    assert file.stat().st_size < 32_000_000  # a season of both scenarios brings 2 MB
    assert len(list((wheel / "fpg_bench" / "baselines").rglob("policy.onnx"))) > 50


def run_lines(python, folder, lines):
    """Run lines in an environment, and return each with its status and output."""
    done = run(python, "-c", RUN, json.dumps(lines), cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def check(python, folder, extra, base):
    """An extra's lines work, and those of extras that stand on ``base`` name what is missing; one program."""
    does, missing = [*extra.does, *extra.tries], missing_on(base)
    results = run_lines(python, folder, [*does, *(line for line, _ in missing)])
    for line, status, output in results[: len(does)]:
        assert status == 0 or (line in extra.tries and status == 2), (line, output)
        assert "not installed" not in output
        assert "a bug" not in output
    for (line, name), (_, status, output) in zip(missing, results[len(does) :], strict=True):
        assert status == 2, (line, output)
        assert len(output.splitlines()) == 1, (line, output)
        hint = rf'is not installed: pip install "fpg-bench\[{name}\] @ file://\S+\.whl"\n$'
        assert re.search(hint, output), (line, output)


def missing_on(base):
    """The lines that name an extra where ``base`` alone is installed, and that extra, each."""
    return [(line, name) for name, e in EXTRAS.items() if e.base == base for line in (*e.does, *e.tries)]


def test_every_command_is_tried():
    lines = [*PLAYS, *REFUSES, *(line for extra in EXTRAS.values() for line in (*extra.does, *extra.tries))]
    assert not [verb for verb in COMMANDS if not any(line.startswith(verb) for line in lines)]


def test_the_core_plays_and_names_the_extra_of_all_else(wheel, tmp_path):
    python = environment(tmp_path / "env", wheel)
    used = run(python, "-c", CORE, cwd=tmp_path)
    assert used.returncode == 0, used.stderr
    helped = tuple(f"{verb} --help" for verb in COMMANDS)
    assert missing_on(None)
    check(python, tmp_path, Extra((*PLAYS, *helped), REFUSES), None)


def extras_together():
    """Names of extras by environment: each has its own, but for those that need the same other one."""
    bases = {extra.base for extra in EXTRAS.values()} - {None}
    alone = [[name] for name, extra in EXTRAS.items() if extra.base is None]
    return alone + [[name for name in EXTRAS if EXTRAS[name].base == base] for base in sorted(bases)]


@pytest.mark.parametrize("names", extras_together(), ids="-".join)
def test_an_extra_does_what_it_is_for(wheel, tmp_path, names):
    extras = [EXTRAS[name] for name in names]
    python = environment(tmp_path / "env", wheel, {*names, extras[0].base} - {None})
    entry = Path("submissions/opponent/adaptive")
    shutil.copytree(ROOT / "leaderboard" / entry, tmp_path / "board" / entry)
    does, tries = (sum((getattr(extra, kind) for extra in extras), ()) for kind in ("does", "tries"))
    check(python, tmp_path, Extra(does, tries), names[0])


@pytest.mark.parametrize("agent", [AGENT, "ally-champion/ppo-stack8/seed_0"])
def test_agents_play_the_same_without_onnx(monkeypatch, agent):
    rng = np.random.default_rng(3)
    seen = rng.uniform(-1, 1, (5, 16, 15)).astype(np.float32)
    players = [fpg_bench.load_agent(agent)]
    monkeypatch.setattr("fpg_bench.players.agent.has", lambda package: False)
    players.append(fpg_bench.load_agent(agent))
    starts = np.zeros(16, bool)
    states = [None, None]
    for observations in seen:
        predictions = [
            player.predict(observations, state, starts) for player, state in zip(players, states, strict=True)
        ]
        assert predictions[0][0].tobytes() == predictions[1][0].tobytes()
        states = [state for _, state in predictions]
