"""Wrong command lines of every verb: message and status of each are those of ``golden/messages.json``.

``python -m tests.test_golden_messages`` writes the file again.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

import pytest

from fpg_bench.cli import main as cli
from tests.attacks.test_command_lines import COMMAND, verbs

GOLDEN = Path(__file__).parent / "golden" / "messages.json"
# Each runs in an empty folder. Verbs that take no words of their own are given one too many.
LINES = (
    "play --ally experd",
    "train ppo FPG/AllyVsScripted-v9 --out run",
    "train ppo FPG/AllyVsScripted-v0 --opponent tonee --out run",
    "offline bc nowhere --out run",
    "evaluate experd --suite ally-v2",
    "evaluate expert --suite ally-v9",
    "table nowhere",
    "curves nowhere",
    "best-response experd --out out",
    "double-oracle --side both --out out",
    "tabular-self-play --games 0 --out out",
    "rule-search --budget 0 --out out",
    "rule-search --goal best --out out",
    "fictitious-self-play --out out",
    "export nowhere --out mine",
    "reproduce yang-2026 fig99",
    "envs FPG/AllyVsScripted-v9",
    "players surplus",
    "suites ally-v9",
    "zoo surplus",
    "scenario show lnk",
    "scenario check nowhere.yml",
    "tune run pppo FPG/AllyVsScripted-v0 --out study",
    "tune export nowhere best.yml",
    "play --planner hill-clim",
    "play --planner llm --transcript nowhere.jsonl",
    "play --planner llm --server nowhere",
    "plan compare circel --suite planner-v1",
    "dataset list surplus",
    "dataset make ally-randm-v0",
    "dataset check nowhere",
    "hub push nowhere me/mine",
    "hub pull mine --out mine",
    "submit check nowhere",
    "submit run nowhere",
    "leaderboard init /dev/null",
    "leaderboard verify --folder nowhere",
    "leaderboard break ally/idle agent --name Me --author Me --folder nowhere",
    "leaderboard build --folder nowhere",
    "leaderboard close-season 9 --work work --folder nowhere",
    "leaderboard season season-9 --folder nowhere",
    # Words of one's own that each verb refuses in its own way
    "trian",
    "play --sed 1",
    "play --seed -1",
    "play --scenario papr",
    "play --opponent suite:nope",
    "play --out round.xyz",
    "play --out /proc/there/round.html",
    "train ppo FPG/AllyVsScriptd-v0 --out x --steps 1e6",
    "train ppo FPG/AllyVsScripted-v0 --out x --steps 1e-6",
    "train ppo FPG/AllyVsScripted-v0 --out x --resume",
    "train ppo FPG/AllyVsScripted-v0 --out x --seeds 0-999999999",
    "train ppo FPG/AllyVsScripted-v0 --out x --seeds 4-0",
    "train ppo FPG/AllyVsScripted-v0 --out x --backend ray",
    "train ppo FPG/AllyVsScripted-v0 --out x --against suite:nope",
    "evaluate no/such/agent",
    "evaluate ally-scripted/sacc/seed_0",
    "evaluate .",
    "train a2c FPG/AllyVsScripted-v0 --out x",
    "train ppo FPG/AllyVsScripted-v0 --out x --allies 2",
    "train ppo FPG/AllyVsScripted-v0 --out x --formation convoy",
    "train ppo FPG/AllyVsScripted-v0 --out x --scenario link --suite ally-v2",
    "evaluate expert --matches 0",
    "reproduce yang-2026 fig7 --out /dev/null",
    "tune run ppo",
    "plan",
    "plan run --planner llm",
    "plan replay match.jsonl",
    "play --overwrite",
    "play --planner circle --prompt paper",
    "play --rounds 0",
    "plan compare llm",
    "leaderboard verify --sample 500%",
    "leaderboard verify --sample much",
    "leaderboard crossplay",
    "reproduce ali-2022 --out out",
    "reproduce ali-2023 fig3 --out out",
    "reproduce liu-2018 --scenario link --out out",
    "reproduce liu-2018 --budget paper --out out",
)


def message_of(line: str) -> str:
    """The last line that a wrong command line prints, after its status; it must fail and write nothing."""
    shown, status = io.StringIO(), 0
    words, home = ["fpg-bench", *line.split()], os.getcwd()
    models = {name: "" for name in os.environ if name.startswith("FPG_LLM_")}  # none is configured
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(shown):
        os.chdir(folder)
        try:
            with (
                contextlib.redirect_stdout(shown),
                patch.object(sys, "argv", words),
                patch.dict(os.environ, models),
            ):
                cli.main()
        except SystemExit as end:
            status = end.code
        finally:
            os.chdir(home)
        assert not os.listdir(folder), line
    assert status in (1, 2), line
    return f"{status} {shown.getvalue().splitlines()[-1]}"  # the kernel may say before that it is compiled


def test_each_verb_has_a_wrong_command_line():
    names = [" ".join(words) for words, _ in verbs()]
    assert names
    assert [name for name in names if not any(line.startswith(f"{name} ") for line in LINES)] == []


@pytest.mark.slow
@pytest.mark.parametrize("line", LINES)
def test_the_message_of_a_wrong_command_line(line, monkeypatch):
    monkeypatch.setattr(cli, "app", COMMAND)  # building it for each line would take a tenth of a second
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    golden = json.loads(GOLDEN.read_text())
    assert line in golden, "make its message: python -m tests.test_golden_messages"
    assert message_of(line) == golden[line]


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps({line: message_of(line) for line in LINES}, indent=1) + "\n")
