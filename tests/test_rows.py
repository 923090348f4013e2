import subprocess
import sys

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile


def test_rows_come_back_in_order(tmp_path):
    file = RowFile(tmp_path / "deep" / "rows.jsonl")
    assert file.read() == []
    file.append([{"a": 1}, {"a": 2}])
    file.append([{"a": 3}])
    assert [row["a"] for row in file.read()] == [1, 2, 3]


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
file = RowFile(Path(sys.argv[1]))
try:
    with file.locked():
        file.append([{"a": 1}])
except UserError as error:
    print(error)
"""


def in_another_process(path):
    return subprocess.check_output([sys.executable, "-c", OTHER, str(path)], text=True)


@pytest.mark.process
def test_one_process_at_a_time(tmp_path):
    file, other = RowFile(tmp_path / "rows.jsonl"), RowFile(tmp_path / "rows.jsonl")
    with file.locked(), other.locked():
        assert "another process" in in_another_process(file.path)
    assert in_another_process(file.path) == ""
    assert file.read() == [{"a": 1}]


@pytest.mark.process
def test_a_file_stays_held_until_the_last_part_of_a_process_lets_go(tmp_path):
    first, second = RowFile(tmp_path / "rows.jsonl").locked(), RowFile(tmp_path / "rows.jsonl").locked()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert "another process" in in_another_process(tmp_path / "rows.jsonl")
    second.__exit__(None, None, None)
    assert in_another_process(tmp_path / "rows.jsonl") == ""


def test_a_broken_line_in_the_middle_is_an_error_that_names_it(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_bytes(b'{"a":1}\nnonsense\n{"a":2}\n')
    with pytest.raises(UserError, match="line 2"):
        RowFile(path).read()
