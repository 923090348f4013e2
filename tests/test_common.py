"""Checks, errors and row files."""

import csv
import json

import numpy as np
import pytest

from fpg_bench.common.checks import check_keys, integer, mapping
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import install_command, require_extra
from fpg_bench.common.files import read_yaml
from fpg_bench.common.output import csv_text
from fpg_bench.common.rows import RowFile
from fpg_bench.common.strict_json import read_plain
from tests.programs import python


def test_whole_numbers_are_taken():
    assert [integer(value, "here") for value in (1, 7, np.int64(3))] == [1, 7, 3]
    assert integer(0, "here", least=0) == 0
    with pytest.raises(UserError, match="a whole number, 0 or more, got -1"):
        integer(-1, "here", least=0)


def test_csv_holds_no_formulas():
    cells = ["=cmd|' /C calc'!A0", "+1+2", "-2+3+cmd|x", "@SUM(A1)", " =1", "\t=1", "\uff1d1"]
    assert list(csv.reader([csv_text([cells]).strip("\n")])) == [[f"'{cell}" for cell in cells]]
    kept = ["-1.5", "+0.30", "-1.5 ± 0.2", "-1e-05", "-", "", "ppo", "1=1", "[-1, 2]"]
    assert list(csv.reader([csv_text([kept])])) == [kept]
    assert csv_text([[-1.5, None, -3]]) == "-1.5,,-3\n"


def test_other_kinds_are_refused():
    for value in (0, -1, 1.0, 1.5, "2", True, None, [1]):
        with pytest.raises(UserError, match=r"^here: expected a whole number above 0, got "):
            integer(value, "here")
    for check, value in ((mapping, [1]), (mapping, None)):
        with pytest.raises(UserError, match=r"^here: expected "):
            check(value, "here")


def test_an_unknown_key_is_told_with_the_nearest_and_a_lacking_one_by_its_name():
    check_keys({"a": 1, "b": 2}, {"a", "b", "c"}, "here", needed=["a"])
    with pytest.raises(UserError, match=r"^here: unknown key 'stesp'; did you mean 'steps'"):
        check_keys({"stesp": 1}, {"steps", "seeds"}, "here")
    with pytest.raises(UserError, match=r"^here: lacks steps, seeds$"):
        check_keys({"other": 1}, {"steps", "seeds", "other"}, "here", needed=["steps", "seeds"])


KNOWN = ["ally/tone", "ally/comb", "random"]


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("ally/ton", "; did you mean 'ally/tone'?"),
        ("aly/tone", "; did you mean 'ally/tone'?"),
        ("ally/x/tone", "; did you mean 'ally/tone'?"),
        ("randm", "; did you mean 'random'?"),
        ("RANDOM", "; did you mean 'random'?"),
        ("ally/zzz", "; known: ally/comb, ally/tone, random"),
        ("", "; known: ally/comb, ally/tone, random"),
    ],
)
def test_a_hint_names_what_is_near_in_all_parts_or_else_everything_once(word, hint):
    assert nearest(word, KNOWN * 2) == hint


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, 'pip install "fpg-bench[train]"'),
        ("{", 'pip install "fpg-bench[train]"'),
        (
            {"url": "file:///some/folder", "dir_info": {"editable": True}},
            'pip install -e "/some/folder[train]"',
        ),
        (
            {"url": "file:///some/fpg_bench-1-py3-none-any.whl", "archive_info": {}},
            'pip install "fpg-bench[train] @ file:///some/fpg_bench-1-py3-none-any.whl"',
        ),
        (
            {"url": "https://example.org/a.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}},
            'pip install "fpg-bench[train] @ git+https://example.org/a.git@abc"',
        ),
    ],
)
def test_a_missing_extra_is_installed_from_where_the_package_came(origin, command, monkeypatch):
    class Installed:
        def read_text(self, name):
            assert name == "direct_url.json"
            return json.dumps(origin) if isinstance(origin, dict) else origin

    monkeypatch.setattr("fpg_bench.common.extras.distribution", lambda name: Installed())
    assert install_command("train") == command
    with pytest.raises(UserError, match="no_such_package is not installed: pip install"):
        require_extra("train", "no_such_package")


def test_an_empty_file_is_called_empty(tmp_path):
    (tmp_path / "mine.yml").write_text("")
    with pytest.raises(UserError, match=r"scenario .*mine\.yml: is empty"):
        read_yaml(tmp_path / "mine.yml", "scenario")


def test_a_hint_names_no_more_than_a_line_can_bear():
    assert nearest("?", [f"{k:03}" for k in range(100)]).endswith(", 028, 029 and 70 more")


def test_rows_come_back_in_order_and_a_broken_one_is_named(tmp_path):
    file = RowFile(tmp_path / "deep" / "rows.jsonl")
    assert file.read() == []
    file.append([{"a": 1}, {"a": 2}])
    file.append([{"a": 3}])
    assert [row["a"] for row in file.read()] == [1, 2, 3]
    file.path.write_bytes(b'{"a":1}\nnonsense\n{"a":2}\n')
    with pytest.raises(UserError, match="line 2"):
        file.read()


@pytest.mark.parametrize("torn", [b'{"a": 3, "b', b'{"a": 3}'])
def test_a_torn_last_line_is_dropped_and_cut_off(tmp_path, torn):
    path = tmp_path / "rows.jsonl"
    path.write_bytes(b'{"a":1}\n{"a":2}\n' + torn)
    file = RowFile(path)
    assert [row["a"] for row in file.read()] == [1, 2]
    file.append([{"a": 4}])
    assert path.read_bytes() == b'{"a":1}\n{"a":2}\n{"a":4}\n'


OTHER = """
import sys
from pathlib import Path
from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.common.strict_json import read_plain
from tests.programs import python
file = RowFile(Path(sys.argv[1]))
try:
    with file.locked():
        file.append([{"a": 1}])
except UserError as error:
    print(error)
"""


def in_another_process(path):
    return python("-c", OTHER, path).stdout


@pytest.mark.process
def test_a_file_is_held_by_one_process_until_the_last_part_of_it_lets_go(tmp_path):
    first, second = RowFile(tmp_path / "rows.jsonl").locked(), RowFile(tmp_path / "rows.jsonl").locked()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert "another process" in in_another_process(tmp_path / "rows.jsonl")
    second.__exit__(None, None, None)
    assert in_another_process(tmp_path / "rows.jsonl") == ""
    assert RowFile(tmp_path / "rows.jsonl").read() == [{"a": 1}]


def test_json_may_begin_with_a_byte_order_mark():
    assert read_plain(b'\xef\xbb\xbf{"a": 1}') == read_plain('\ufeff{"a": 1}') == {"a": 1}
