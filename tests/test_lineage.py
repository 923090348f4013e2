"""The stages of the repository cover what is generated, their commands exist, and staleness is found."""

from __future__ import annotations

import ast
import re
import subprocess
from collections import Counter
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from lineage import Stage, check, files_of, hash_of, load_stages, main, record

from fpg_bench.common.errors import UserError
from tests.programs import ROOT
from tests.test_docs import command_of

STAGES = load_stages()
GENERATED = (
    *("baselines/agents/*", "baselines/scores/*", "baselines/suites/*/*"),
    *("baselines/suites/*-season-*.yml", "baselines/suites/*-responses-*.yml", "baselines/README.md"),
    *("leaderboard/results/*", "leaderboard/submissions/*", "results/*", "tests/golden/*"),
    *(f"docs/*.{form}" for form in ("csv", "gif", "png", "svg")),
)
SCRIPTS = ROOT / "scripts"
GONE = {  # stages whose script is gone, the revision that has it, and where
    "paper-interpretations": "8d94dd3:scripts/interpretations/__main__.py",
    "language-model": "cb2b58f:scripts/measure_language_model.py",
    "responses": "0b5a5ad1:scripts/train_best_responses.py",
}
WRITTEN = (  # by hand, among them, or drawn once
    *(
        f"docs/pictures/{name}.svg"
        for name in ("clones", "crossplay", "detection", "seasons", "system", "waterfall")
    ),
    "leaderboard/submissions/planner/*/submission.yaml",
    "leaderboard/submissions/ally/plain-torch/submission.yaml",
)
TABLES_OF_RULES = {  # kept by hand, and compared with the code by the tests of the documentation
    *("ally acts", "ally sees", "ally chooses"),
    *("opponent acts", "opponent sees", "opponent chooses"),
}


def committed() -> list[str]:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git repository")
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def matches(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def test_every_generated_file_that_is_committed_is_made_by_one_stage():
    made = Counter(
        path.relative_to(ROOT).as_posix()
        for stage in STAGES.values()
        for pattern in stage.makes
        if "#" not in pattern
        for path in files_of(pattern)
    )
    wanted = [name for name in committed() if matches(name, GENERATED) and not matches(name, WRITTEN)]
    assert len(wanted) > 1000
    assert [name for name in wanted if made[name] != 1] == []


def test_every_part_of_a_page_between_marks_is_made_by_a_stage_or_is_a_table_of_rules():
    made = {part for stage in STAGES.values() for part in stage.makes}
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for mark in set(re.findall(r"<!-- (.*?) -->", path.read_text())) - {"end"} - TABLES_OF_RULES:
            assert f"{path.relative_to(ROOT).as_posix()}#{mark}" in made


def test_a_number_of_results_in_prose_belongs_to_a_stage_or_to_a_revision():
    """Pages of results are read again when their data change; elsewhere, intervals name a revision."""
    read = {
        word.strip(",") for stage in STAGES.values() for word in stage.by.split() if stage.by[:5] == "read "
    }
    whole = [part for stage in STAGES.values() for part in stage.makes if "#" not in part]
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        name = path.relative_to(ROOT).as_posix()
        prose = re.sub(
            r"<!-- (?!end).*?-->.*?<!-- end -->|^```.*?^```|`[^`\n]*`|\(http.*?\)|^\|.*?$",
            "",
            path.read_text(),
            flags=re.DOTALL | re.MULTILINE,
        )
        results = name.startswith(("README", "docs/results/", "docs/benchmark/"))
        found = re.search(r"\d\.\d" if results else r"-?\d+\.\d \[-?\d.*?\]", prose)
        if found and name not in read and not matches(name, tuple(whole)):
            assert "revision" in prose, f"{name}: {found[0]}"


@pytest.mark.parametrize("name", sorted(STAGES.keys() - GONE.keys()))
def test_the_command_of_a_stage_exists_with_its_options(name):
    program, *words = STAGES[name].by.split()
    options = [word for word in words if word.startswith("--")]
    if program == "read":
        assert all(list(ROOT.glob(word.strip(","))) for word in words if word != "and")
    elif program == "fpg-bench":
        command = command_of(words)
        assert command.callback is not None
        assert set(options) <= {option for parameter in command.params for option in parameter.opts}
    else:
        assert program == "python"
        text = script_of(STAGES[name]).read_text()
        parameters = (f"    {option[2:].replace('-', '_')}:" for option in options)  # of main, or of a parser
        assert all(option in text or each in text for option, each in zip(options, parameters, strict=True))


@pytest.mark.parametrize("name", GONE)
def test_a_command_that_is_gone_is_in_the_revision_that_its_stage_names(name):
    revision = GONE[name].partition(":")[0]
    assert STAGES[name].revision == revision
    assert not script_of(STAGES[name]).exists()
    exists = ["git", "cat-file", "-e"]
    if subprocess.run([*exists, revision], cwd=ROOT, capture_output=True).returncode:
        pytest.skip("not a git repository with its history")
    assert subprocess.run([*exists, GONE[name]], cwd=ROOT).returncode == 0


def test_every_script_makes_something_or_helps_one_that_does():
    used = {script_of(stage) for stage in STAGES.values() if stage.by.startswith("python ")}
    used |= {SCRIPTS / name for name in re.findall(r"scripts/(\w+\.py)", (ROOT / "Makefile").read_text())}
    helpers = {SCRIPTS / f"{name}.py" for path in used if path.exists() for name in imported_by(path)}
    data = {path for stage in STAGES.values() for each in stage.made_from for path in files_of(each)}
    files = {path for path in SCRIPTS.iterdir() if path.is_file()}
    assert {path.name for path in files - used - helpers - data} == set()


def script_of(stage: Stage) -> Path:
    """Return the file of a stage's command that is Python's."""
    _, *words = stage.by.split()
    return ROOT / (f"{words[1].replace('.', '/')}.py" if words[0] == "-m" else words[0])


def imported_by(path: Path) -> set[str]:
    """Return the names of the modules that a script imports."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    modules = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return modules | {each.name for node in nodes if isinstance(node, ast.Import) for each in node.names}


def test_every_pattern_of_a_stage_has_files_and_parts():
    for stage in STAGES.values():
        for pattern in (*stage.makes, *stage.made_from):
            assert hash_of(pattern)


@pytest.fixture
def folder(tmp_path):
    """A repository of one stage that was just made."""
    texts = {
        "make.py": '"""Make it."""\n\nNAMES = {"a": 1, "b": 2}\nprint(1)  # loud\n',
        "rules.yml": "# Rules\ngroups: {a: {steps: 1, note: x}, b: {steps: 2}}\n",
        "agents/a.onnx": "a",
        "page.md": "Prose.\n<!-- table -->\n1\n<!-- end -->\n",
        "lineage.yml": """\
stages:
  table:
    makes: [page.md#table]
    by: python make.py
    from: [[make.py], "rules.yml#groups.*.steps", agents]
""",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    record(["table"], tmp_path)
    assert stale(tmp_path) == {}
    return tmp_path


def stale(folder):
    return check(folder)[0]


def change(folder, name, before, after):
    text = (folder / name).read_text()
    assert before in text
    (folder / name).write_text(text.replace(before, after))


@pytest.mark.parametrize(
    "edit",
    [
        ("make.py", "Make it.", "Make it well.\n\nAnd more."),
        ("make.py", "# loud", "# quiet"),
        ("rules.yml", "# Rules\n", "# The rules\n\n"),
        ("rules.yml", "note: x", "note: y"),
        ("page.md", "Prose", "Better prose"),
    ],
)
def test_a_stage_is_not_stale_for_what_cannot_change_its_result(folder, edit):
    change(folder, *edit)
    assert stale(folder) == {}


@pytest.mark.parametrize(
    "edit",
    [
        ("make.py", "print(1)", "print(2)"),
        ("rules.yml", "steps: 2", "steps: 3"),
        ("rules.yml", "b: {", "c: {"),
        ("agents/a.onnx", "a", "b"),
    ],
)
def test_a_stage_is_stale_once_what_it_is_made_from_changes_until_it_is_recorded(folder, edit):
    change(folder, *edit)
    (text,) = stale(folder).values()
    assert text.startswith(f"made from what has changed: {edit[0].split('/')[0]}")
    assert text.endswith("\n  made by: python make.py")
    record(["table"], folder)
    assert stale(folder) == {}


def test_a_new_file_makes_a_stage_stale_and_so_does_another_command_for_its_output(folder):
    change(folder, "page.md", "\n1\n", "\n2\n")
    assert stale(folder)["table"].startswith("changed by something else than its command: page.md#table")
    change(folder, "page.md", "\n2\n", "\n1\n")
    (folder / "agents/b.onnx").write_text("b")
    assert stale(folder)["table"].startswith("made from what has changed: agents")


def test_a_stage_that_waits_says_why_and_is_told_when_it_need_not(folder, monkeypatch, capsys):
    change(folder, "lineage.yml", "by:", "waits: for a new agent\n    by:")
    assert stale(folder) == {"table": "is not stale, so it waits for nothing: remove the key"}
    change(folder, "make.py", "print(1)", "print(2)")
    monkeypatch.setattr("sys.argv", ["lineage.py"])
    assert main(folder) == 0
    assert "waits: for a new agent\n1 stages, 0 stale, 1 that wait" in capsys.readouterr().out
    change(folder, "lineage.yml", "waits: for a new agent\n    ", "")
    assert main(folder) == 1


def test_what_is_not_there_is_named(folder):
    with pytest.raises(UserError, match=r"no stage 'tables' in lineage\.yml.*table"):
        record(["tables"], folder)
    for pattern, message in {
        "nobody.csv": "no file 'nobody.csv'",
        "page.md#tables": "page.md: no part 'tables'",
        "rules.yml#groups.*.seeds": "no part 'groups.*.seeds'",
        "make.py#NAMES.c": "no part 'NAMES.c'",
    }.items():
        with pytest.raises(UserError, match=re.escape(message)):
            hash_of(pattern, folder)
    (folder / "page.md").unlink()
    assert "no file 'page.md#table'" in stale(folder)["table"]


def test_a_name_of_python_is_a_part(folder):
    before = hash_of("make.py#NAMES.a", folder)
    change(folder, "make.py", '"b": 2', '"b": 3')
    assert hash_of("make.py#NAMES.a", folder) == before
    change(folder, "make.py", '"a": 1', '"a": 0')
    assert hash_of("make.py#NAMES.a", folder) != before
