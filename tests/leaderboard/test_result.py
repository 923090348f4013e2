import dataclasses
import json
import os

import pytest
from fpg_bench.evaluation.panel import load_panel

from fpg_bench.errors import UserError
from fpg_bench.leaderboard.playing import Part, part_lines
from fpg_bench.leaderboard.result import (
    LARGEST,
    differing,
    failed_result,
    read_result,
    verified_result,
    write_result,
)

PRINTED = {"version": "0", "policies": {}}


@pytest.fixture
def panel(small_panels):
    return load_panel(small_panels["ally", None])


@pytest.fixture
def good(panel):
    lines = list(part_lines(Part(None, "expert"), panel, panel.entries))
    return verified_result("wise", "ally", PRINTED | {"panel_hash": panel.hash}, lines, panel)


def path_of(folder):
    return folder / "ally" / "wise.jsonl"


def forged(good, change):
    """A result whose lines were changed by somebody who knows how to make the hash and the first row fit."""
    lines = json.loads(json.dumps(good.lines))
    change(lines)
    result = failed_result("wise", "ally", good.fingerprint, "")
    return dataclasses.replace(result, head=good.head | {"lines_sha256": _hash_of(lines)}, lines=lines)


def _hash_of(lines):
    import hashlib

    text = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)
    return hashlib.sha256(text.encode()).hexdigest()


def test_what_is_written_is_read(good, panel, tmp_path):
    write_result(path_of(tmp_path), good)
    assert read_result(path_of(tmp_path), panel) == good
    assert good.verified
    assert good.head["summary"]["score"]["value"] == 100


def test_a_failure_is_written_with_its_reason(panel, tmp_path):
    result = failed_result("wise", "ally", PRINTED | {"panel_hash": panel.hash}, "died")
    write_result(path_of(tmp_path), result)
    found = read_result(path_of(tmp_path), panel)
    assert (found.verified, found.head["reason"], found.lines) == (False, "died", [])


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: lines[0].update(training_seed="0"),
        lambda lines: lines[0].update(training_seed=[0]),
        lambda lines: lines[0].update(entry={}),
        lambda lines: lines[0].update(n=3),
        lambda lines: lines[0]["returns"].pop(),
        lambda lines: lines[0]["returns"].__setitem__(0, 10**30),
        lambda lines: lines[0]["returns"].__setitem__(0, True),
        lambda lines: lines[0]["returns"].__setitem__(0, "1"),
        lambda lines: lines[0]["mean"].pop("snr_db"),
        lambda lines: lines[0]["mean"].update(ally_return=None),
        lambda lines: lines[0].update(mean=[]),
        lambda lines: lines[0].update(ally_points=[1]),
        lambda lines: lines[0].update(lost=-1),
        lambda lines: lines[0].update(lost=5),
        lambda lines: lines[0].update(more=1),
    ],
)
def test_a_line_that_fits_its_hash_but_is_none_is_told(good, panel, tmp_path, change):
    write_result(path_of(tmp_path), forged(good, change))
    with pytest.raises(UserError, match=r"wise.jsonl: line 2 is not that of an entry of ally-None"):
        read_result(path_of(tmp_path), panel)


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: lines.pop(),
        lambda lines: lines.append(lines[0]),
        lambda lines: lines[1].update(entry=lines[0]["entry"]),
        lambda lines: lines[0].update(training_seed=0),
    ],
)
def test_lines_are_one_per_seed_and_entry(good, panel, tmp_path, change):
    write_result(path_of(tmp_path), forged(good, change))
    with pytest.raises(UserError, match="its lines are not one per training seed and entry"):
        read_result(path_of(tmp_path), panel)


def test_a_summary_follows_from_the_lines(good, panel, tmp_path):
    write_result(path_of(tmp_path), forged(good, lambda lines: lines[0]["returns"].__setitem__(0, 9e3)))
    with pytest.raises(UserError, match="edited by hand: its summary does not follow from its lines"):
        read_result(path_of(tmp_path), panel)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not lines of JSON: Expecting value"),
        ("[1]\n", "not lines of JSON: expected an object"),
        ("{\n", "not lines of JSON"),
        ("[" * 100_000 + "\n", "not lines of JSON"),
        ("\udcff", "not lines of JSON"),
        ('{"kind": "result"}\n', "its first line is not that of a result"),
        (" " * (LARGEST + 1), "larger than"),
    ],
)
def test_what_is_no_result_is_one_line(panel, tmp_path, content, message):
    path = path_of(tmp_path)
    path.parent.mkdir()
    path.write_bytes(content.encode(errors="surrogateescape"))
    with pytest.raises(UserError, match=message) as raised:
        read_result(path, panel)
    assert "\n" not in str(raised.value)


def test_only_a_file_of_its_own_is_read(good, panel, tmp_path):
    write_result(tmp_path / "elsewhere", good)
    path_of(tmp_path).parent.mkdir()
    path_of(tmp_path).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UserError, match="not a file"):
        read_result(path_of(tmp_path), panel)
    path_of(tmp_path).unlink()
    os.mkfifo(path_of(tmp_path))
    with pytest.raises(UserError, match="not a file"):
        read_result(path_of(tmp_path), panel)


def test_fingerprints_differ_by_name_and_not_by_version():
    one = {"version": "1", "season": "0", "rounds": 4}
    assert differing(one, one | {"version": "2"}) == []
    assert differing(one, {"version": "1", "season": "1"}) == ["rounds", "season"]
