import pytest

from fpg_bench.errors import UserError
from fpg_bench.rows import RowFile


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


def test_one_process_at_a_time(tmp_path):
    file, other = RowFile(tmp_path / "rows.jsonl"), RowFile(tmp_path / "rows.jsonl")
    with file.locked(), pytest.raises(UserError, match="another process"), other.locked():
        pass
    with other.locked():
        other.append([{"a": 1}])
    assert file.read() == [{"a": 1}]


def test_a_broken_line_in_the_middle_is_an_error_that_names_it(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_bytes(b'{"a":1}\nnonsense\n{"a":2}\n')
    with pytest.raises(UserError, match="line 2"):
        RowFile(path).read()
