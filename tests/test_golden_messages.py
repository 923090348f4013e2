"""Wrong command lines of every verb: message and status of each are those of ``golden/messages.json``.

``python -m tests.test_golden_messages`` writes the file again; a new line is added to it with any message.
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
LINES = tuple(json.loads(GOLDEN.read_text()))


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
    assert message_of(line) == json.loads(GOLDEN.read_text())[line]


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps({line: message_of(line) for line in LINES}, indent=1) + "\n")
