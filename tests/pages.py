"""Pages of the docs, done in a folder as a reader would, in their order.

A block of code whose first line is ``# NAME`` is a file, too. Commands play suites with few matches.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from pathlib import Path

import yaml

from fpg_bench.players.agent import baselines_folder
from tests.programs import ROOT, python

BUDGETS = (
    (r"(--steps |\bsteps: |steps\": |timesteps=|\.learn\()[\d_]+", r"\g<1>2000"),
    (r"(.*) --seeds 0-2 (.*)", r"\1 --seed 0 \2/seed_0\n\1 --seed 1 \2/seed_1\n\1 --seed 2 \2/seed_2"),
    (r"(fpg-bench offline .* --steps |RunConfig\.offline\(.* steps=)[\d_]+", r"\g<1>50"),
    (r"fpg-bench offline ", "fpg-bench offline --n-evals 0 "),
    (r"fpg-bench train ", "fpg-bench train --n-evals 0 "),
    (r"n_steps=\d+", "n_steps=32"),
    (r"--matches \d+", "--matches 1"),
    (r"matches=\d+", "matches=1"),
    (r" --pays\b", ""),  # a minute, in the golden file of verbs
    (r"tune run (?:ppo|dqn) .*", r"\g<0> --n-trials 2 --steps 2000 --rounds 2 --n-seeds 1"),
    (r"tune export .*", r"\g<0> --n-best 1 --n-seeds 1"),
    (r"reproduce yang-2026 fig\d", "reproduce yang-2026 tables"),
    (r"fpg-bench submit run .*", ""),  # which has tests of its own
)

_FPG_BENCH = """\
from pathlib import Path
from fpg_bench.players import agent
agent.baselines_folder = lambda: Path({baselines!r})
from fpg_bench.cli.main import main
main()
"""


def blocks(text: str) -> list[tuple[str, str]]:
    """The (language, code) of each block."""
    return re.findall(r"```(\w+)\n(.*?)```", text, re.DOTALL)


def small(text: str) -> str:
    """The same words with budgets that a test can bear."""
    for pattern, budget in BUDGETS:
        text = re.sub(pattern, budget, text)
    return text


def small_baselines(folder: Path) -> Path:
    """A folder like ``baselines``: a third of each suite's rivals, few matches, agents of two seeds."""
    whole = baselines_folder()
    for path in (*whole.iterdir(), *whole.glob("suites/*"), *whole.glob("agents/*/*/seed_[01]")):
        target = folder / path.relative_to(whole)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.match("suites/*.yml"):
            suite = yaml.safe_load(path.read_text())
            suite["matches"] = 1 if "rounds_per_match" in suite else 2
            suite["rivals"] = suite["rivals"][::3]
            target.write_text(yaml.safe_dump(suite))
        elif path.name not in ("suites", "agents"):
            target.symlink_to(path)
    return folder


class Reader:
    """Somebody who does what a page says.

    Args:
        folder: where.
        baselines: what is played in place of the package's own.
        variables: of the environment, whatever the page says of them.

    Attributes:
        ran: what was done: commands, and code in Python.
        said: what all of it printed.
    """

    def __init__(self, folder: Path, baselines: Path, **variables: str) -> None:
        folder.mkdir(exist_ok=True)
        models = ("FPG_LLM_", "OPENAI_")
        kept = {name: text for name, text in os.environ.items() if not name.startswith(models)}
        self._folder, self._given = folder, variables
        self._environment = kept | {"PYTHONPATH": str(ROOT)} | variables
        self._command = _FPG_BENCH.format(baselines=str(baselines))
        self.ran: list[str] = []
        self.said = ""

    def does(self, language: str, code: str) -> None:
        """Do what a block says."""
        if named := re.match(r"# ([\w/-]+\.(?:py|ya?ml))\n", code):
            self.writes(named[1], code)
        if language == "python":
            self._runs(code, python("-c", code, **self._where))
        for line in code.splitlines() if language == "bash" else ():
            if words := shlex.split(line, comments=True):
                self._enters(line, *words)

    def writes(self, name: str, text: str) -> None:
        """Write a file."""
        file = self._folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    @property
    def _where(self) -> dict[str, object]:
        return {"folder": self._folder, "environment": self._environment}

    def _enters(self, line: str, verb: str, *words: str) -> None:
        if verb == "export":
            name, _, value = words[0].partition("=")
            self._environment[name] = self._given.get(name, value)
        elif verb == "fpg-bench":
            self._runs(line, python("-c", self._command, *words, **self._where))
        elif verb not in (
            "make",
            ".",
        ):  # the targets of make have a test of their own; the environment is active
            where = {"cwd": self._folder, "env": self._environment}
            self._runs(line, subprocess.run(["sh", "-c", line], capture_output=True, text=True, **where))

    def _runs(self, what: str, done: subprocess.CompletedProcess[str]) -> None:
        assert done.returncode == 0, f"{what}\n{done.stdout}\n{done.stderr}"
        self.ran.append(what)
        self.said += done.stdout


def broken_links(file: Path) -> list[str]:
    """The links of a page that lead nowhere, in this repository."""
    return [
        link for link in re.findall(r"\]\(([^)]+)\)", file.read_text()) if not _leads_somewhere(link, file)
    ]


def _leads_somewhere(link: str, page: Path) -> bool:
    if link.startswith("https://") or "/generated/" in link:  # Sphinx, which makes these, says what it misses
        return True
    name, _, anchor = link.partition("#")
    target = page.parent / name if name else page
    if not target.exists() or not anchor:
        return target.exists()
    headings = re.findall(r"^#+ (.+)$", target.read_text(), re.MULTILINE)
    return anchor in [re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings]
