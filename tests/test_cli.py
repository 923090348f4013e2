import io
import os
import re
import shlex
import subprocess
import sys
from types import SimpleNamespace

import pytest
import typer

import fpg_bench.cli.main
from fpg_bench import __version__
from fpg_bench.cli import options, training
from fpg_bench.cli.main import app
from fpg_bench.cli.options import whole_number
from fpg_bench.common import output, starting
from fpg_bench.common.ids import ENVS, SCRIPTED
from fpg_bench.common.rows import RowFile
from fpg_bench.game.names import CHOSEN, OBSERVED, PATHS
from fpg_bench.players.agent import suites_folder
from fpg_bench.players.planner import PLANNERS
from tests.programs import ROOT, fpg, python
from tests.working import wait_for

TINY = """\
FPG/AllyVsScripted-v0:
  {policy: MlpPolicy, n_envs: 4, n_timesteps: 1200, n_steps: 300, batch_size: 300, n_epochs: 1}
"""
TRAIN = ("train", "ppo", "FPG/AllyVsScripted-v0", "--out", "x")


LISTS = (
    ("listed", "--help"),
    ("listed", "zoo"),
    ("listed", "suites"),
    ("listed", "players"),
    ("completed", "ally-scripted/"),
    ("completed", ""),
)
LIST = """
import sys
from fpg_bench.cli.main import main
from fpg_bench.cli.options import complete_algorithm, complete_id, complete_player, complete_suite
if sys.argv[1] == "completed":
    for complete in (complete_algorithm, complete_id, complete_player, complete_suite):
        complete(sys.argv[2])
else:
    del sys.argv[1]
    try:
        main()
    except SystemExit as end:
        assert not end.code
heavy = {"fpg_bench.game.step", "numba", "scipy", "torch", "matplotlib", "onnxruntime"} & set(sys.modules)
sys.exit(str(heavy) if heavy else 0)
"""


@pytest.mark.process
@pytest.mark.parametrize("words", LISTS, ids=" ".join)
def test_lists_and_completion_load_neither_the_kernel_nor_numba_nor_scipy(words):
    result = subprocess.run([sys.executable, "-c", LIST, *words], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def verbs(command, words=("fpg-bench",)):
    """All verbs below a command, with their words."""
    if not hasattr(command, "commands"):
        return [(" ".join(words), command)]
    below = command.commands.items()
    return [verb for name, each in below for verb in verbs(each, (*words, name))]


VERBS = dict(verbs(typer.main.get_command(app)))


@pytest.mark.parametrize(("words", "verb"), VERBS.items(), ids=str)
def test_help_of_every_verb_has_an_example_that_can_be_typed(words, verb):
    (example,) = re.findall(r"Example: (.*)", verb.help)
    assert example.startswith(words)
    verb.make_context(words, shlex.split(example.removeprefix(words)))


@pytest.mark.full
@pytest.mark.process
@pytest.mark.parametrize("words", ["train --help", "play --every 200"])
def test_verbs_need_no_docstrings(words):
    ran = subprocess.run([sys.executable, "-OO", "-m", "fpg_bench", *words.split()], capture_output=True)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.process
def test_without_compilation_one_line_says_what_to_do():
    words = [sys.executable, "-m", "fpg_bench", "play"]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    ran = subprocess.run(words, capture_output=True, text=True, env=environment)
    assert ran.returncode == 2
    assert ran.stderr == (
        "fpg-bench: NUMBA_DISABLE_JIT is set, but the game runs as compiled code alone; unset it\n"
    )


@pytest.mark.process
def test_a_shell_can_complete_verbs():
    asked = {"_FPG_BENCH_COMPLETE": "complete_bash", "COMP_WORDS": "fpg-bench pl", "COMP_CWORD": "1"}
    code = "import sys; sys.argv = ['fpg-bench']; from fpg_bench.cli.main import main; main()"
    names = subprocess.check_output([sys.executable, "-c", code], env=os.environ | asked, text=True)
    assert {"play", "players"} == set(names.split())


def test_a_shell_can_complete_what_can_be_named():
    assert options.complete_player("ally-scripted/s") == ["ally-scripted/sac"]
    assert options.complete_player("ally-scripted/sac/") == [f"ally-scripted/sac/seed_{k}" for k in range(5)]
    assert options.complete_player("expert") == ["expert", "expert-spread"]
    assert options.complete_player("runs/") == []  # the shell's own names of files
    assert options.complete_id("FPG/OpponentVsS") == [
        f"FPG/OpponentVsScripted{mode}-v0" for mode in ("", "Discrete", "MultiDiscrete")
    ]
    assert options.complete_id("FPG/d") == ["FPG/duel_v0"]
    assert options.complete_suite("planner-v") == ["planner-v1"]
    assert options.complete_algorithm("pp") == ["ppo", "ppo-fast", "ppo-memory", "ppo-stack8"]
    named = {
        option.name
        for verb in VERBS.values()
        for option in verb.params
        if option._custom_shell_complete is not None
    }
    assert {"players", "ally", "opponent", "suite", "env_id", "algorithm"} <= named


@pytest.mark.process
def test_lists_name_all_that_can_be_named():
    lists = {verb: fpg(verb) for verb in ("envs", "players", "suites")}
    assert [result.stderr for result in lists.values() if result.returncode] == []
    text = " ".join(lists["envs"].stdout.split())
    for named in (*OBSERVED.values(), *CHOSEN.values()):
        assert ", ".join(f"{index} {name}" for index, name in enumerate(named)) in text
    assert [env_id for env_id in ENVS if env_id not in text] == []
    single = fpg("envs", "FPG/OpponentVsScripted-v0").stdout
    head, actions = single.splitlines()[:4], single.splitlines()[4]
    assert "\n".join(["", *head, ""]) in lists["envs"].stdout
    assert "FPG/OpponentVsScriptedDiscrete-v0" in actions
    assert fpg("envs", "FPG/duel_v0").stdout in lists["envs"].stdout
    for plain in ([], ["FPG/OpponentVsScripted-v0"]):  # nothing that a path would change
        refused = fpg("envs", *plain, "--path", "circle")
        assert (refused.returncode, refused.stdout) == (2, "")
        assert "choices of an id" in refused.stderr
    text = lists["players"].stdout.replace(",", " ").replace(":", " ")
    assert {*SCRIPTED["ally"], *SCRIPTED["opponent"], *PLANNERS, *PATHS} <= set(text.split())
    assert "tier history" in text
    assert max(map(len, text.splitlines())) <= 90
    for path in suites_folder().glob("*.yml"):
        assert f"{path.stem}: measures the " in lists["suites"].stdout
    assert "adaptive/interceptor" in lists["suites"].stdout


@pytest.mark.process
def test_version():
    assert python("-m", "fpg_bench", "--version").stdout.strip() == __version__


def test_a_whole_number_may_be_written_with_an_exponent():
    numbers = {"1": 1, "1e6": 10**6, "1_000": 1000, "2.5E+3": 2500, "1e15": 10**15}
    assert {text: whole_number(text) for text in numbers} == numbers
    assert type(whole_number("1e6")) is int


@pytest.mark.parametrize("text", ["0", "-1", "1.5", "1e-6", "nan", "inf", "1e999999999", "1e16", "many", ""])
def test_what_is_no_whole_number_is_refused(text):
    with pytest.raises(typer.BadParameter, match="expected a whole number above 0"):
        whole_number(text)


def test_an_end_of_file_is_no_stop(monkeypatch, capsys):
    def ended(*words, **options):
        raise typer.Abort from EOFError("Ran out of input")

    monkeypatch.setattr("fpg_bench.cli.main.app", ended)
    with pytest.raises(SystemExit) as ending:
        fpg_bench.cli.main._run()
    assert ending.value.code == 1
    assert "EOFError: Ran out of input" in capsys.readouterr().err


EVALUATE = (sys.executable, "-m", "fpg_bench", "evaluate", "idle", "--suite", "ally-v2", "--matches", "1")


@pytest.mark.process
@pytest.mark.parametrize("encoding", ["gbk", "iso-8859-1"])
def test_a_letter_that_the_encoding_lacks_stops_nothing(tmp_path, encoding):
    environment = os.environ | {"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    named = ["\u0142=idle" if word == "idle" else word for word in EVALUATE]
    result = subprocess.run(named, env=environment, capture_output=True, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert re.search(rb"^\|\? ", result.stdout, re.MULTILINE)


@pytest.mark.process
@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&-"])
def test_closed_streams_stop_nothing(tmp_path, closed):
    line = f"{shlex.join(EVALUATE)}"
    result = subprocess.run(f"{line} {closed}", shell=True, capture_output=True, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert len(list(tmp_path.glob("results/**/table.md"))) == 1
    wrong = subprocess.run(f"{line} --wrong {closed}", shell=True, capture_output=True, cwd=tmp_path)
    assert (wrong.returncode, wrong.stdout) == (2, b"")


@pytest.mark.process
def test_debug_shows_the_traceback(tmp_path):
    assert "Traceback" in fpg("--debug", "table", "nowhere", folder=tmp_path).stderr


@pytest.mark.process
def test_a_file_that_cannot_grow_is_one_line_and_keeps_what_it_holds(tmp_path):
    words = ("evaluate", "idle", "--matches", "20", "--out", "results")
    limit = "(5_000, 5_000)"  # bytes a file may have: as a disk that is full in the middle of a line
    code = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, {limit})\n"
    code += "from fpg_bench.cli.main import main; main()"
    before = fpg("evaluate", "idle", "--matches", "1", "--out", "before", folder=tmp_path)
    assert before.returncode == 0, before.stderr  # all that it needs is compiled now
    result = python("-c", code, *words, folder=tmp_path)
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "File too large; what was finished is kept" in result.stderr
    kept = RowFile(tmp_path / "results" / "records.jsonl").read()
    assert 1 <= len(kept) < 15
    assert fpg(*words, folder=tmp_path).returncode == 0
    lines = RowFile(tmp_path / "results" / "records.jsonl").read()
    assert lines[: len(kept)] == kept
    assert len({line["rival"] for line in lines}) == len(lines) == 15


@pytest.mark.process
def test_ctrl_c_in_a_librarys_call_back_is_heard_all_the_same():
    """Loading of compiled code calls back through ctypes, which raises nothing."""
    code = (
        "import ctypes, sys, time\n"
        "from fpg_bench.cli.main import app, main\n"
        "@app.command()\n"
        "def loads():\n"
        "    @ctypes.CFUNCTYPE(None)\n"
        "    def back(): raise KeyboardInterrupt\n"
        "    back()\n"
        "    time.sleep(100)\n"
        "sys.argv = ['fpg-bench', 'loads']\n"
        "main()"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (result.returncode, result.stderr) == (130, "fpg-bench: stopped; what was finished is kept\n")


def test_where_no_bar_can_be_drawn_a_line_says_what_is_under_way(monkeypatch, capsys):
    now = iter(range(0, 1000, 20))
    monkeypatch.setattr(output, "time", SimpleNamespace(monotonic=lambda: next(now)))
    with output.shown_progress() as show:
        for k in range(4):
            show(f"meeting {k}", 1000 * k, 4000)
    assert capsys.readouterr().err.split("\n") == [
        "meeting 1: 1,000 of 4,000",
        "meeting 3: 3,000 of 4,000",
        "",
    ]


def test_a_bar_has_the_count_the_share_and_the_time_left_at_80_columns(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    for name, value in {"COLUMNS": "80", "TERM": "xterm", "NO_COLOR": "1"}.items():
        monkeypatch.setenv(name, value)
    with output.shown_progress() as show:
        show("ally-link-population/ppo-stack8 - narrowband/pursuit", 1000, 4000)
        wait_for(lambda: "4000" in terminal.getvalue())
    drawn = re.sub(r"\x1b\[[^A-Za-z]*[A-Za-z]", "", terminal.getvalue())
    (last,) = {line for line in re.split(r"[\r\n]+", drawn) if "1000/4000" in line}
    assert re.fullmatch(r"ally-link-pop.* 1000/4000 +25% (-|\d+):[-\d:]+ *", last)
    assert len(last) <= 80


def test_a_run_that_is_stopped_before_it_saved_says_so(monkeypatch, capsys, tmp_path):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("fpg_bench.training.train.train", stopped)
    for saved in (False, True):
        if saved:
            (tmp_path / "checkpoints" / "000000000100").mkdir(parents=True)
        with pytest.raises(KeyboardInterrupt):
            training.train(
                "ppo", "FPG/AllyVsScripted-v0", tmp_path, run={}, game={}, team={}, planner_options={}
            )
        assert ("no step is saved yet" in capsys.readouterr().err) == (not saved)


@pytest.mark.parametrize(
    "words", ["zoo", "zoo --all", "envs", "players", "suites", "leaderboard season season-4"]
)
def test_lists_fit_80_columns(words, capsys):
    app(words.split(), standalone_mode=False)
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if len(line) > 80 and str(ROOT) not in line] == []


@pytest.mark.parametrize(("option", "is_whole"), [("--help", False), ("--help-all", True)])
def test_details_of_many_options_are_shown_when_asked_for(option, is_whole, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    app(["train", option], standalone_mode=False)
    shown = capsys.readouterr().out
    assert [each in shown for each in ("--steps", "--opponent")] == [True] * 2
    assert [each in shown for each in ("--n-jobs", "--reward", "--tokens", "--allow")] == [is_whole] * 4
    assert is_whole or len(shown.splitlines()) < 80


def test_flags_have_no_type_in_the_help(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    app(["train", "--help"], standalone_mode=False)
    printed = capsys.readouterr().out
    assert "--resume" in printed
    assert "bool" not in printed


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (["train", "ppo", "--out", "/home/me/runs/a=b"], "fpg-bench train ppo --out a=b"),
        (["train", "ppo", "--out=/home/me/a", "--start", "/b"], "fpg-bench train ppo --out=a --start /b"),
        (["close-season", "6", "--work", "/tmp/w"], "fpg-bench close-season 6 --work w"),
        (["zoo", "--work"], "fpg-bench zoo --work"),
        ([], "fpg-bench"),
    ],
)
def test_the_command_that_agents_keep_names_no_folder_that_it_writes(words, kept, monkeypatch):
    monkeypatch.setenv(starting.COMMAND, "")
    starting.keep_command(words)
    assert os.environ[starting.COMMAND] == kept
