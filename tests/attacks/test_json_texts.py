"""One reader for all JSON from outside, which nothing gets past."""

import ast
import json
from pathlib import Path

import pytest

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json
from fpg_bench.common.rows import RowFile
from fpg_bench.common.strict_json import DEEPEST, read_object, read_plain
from tests.attacks import SCALE, SEED
from tests.attacks.json_texts import KINDS, hostile_texts

TEXTS = list(hostile_texts(200 * SCALE, seed=SEED))
PACKAGE = Path(fpg_bench.__file__).parent


@pytest.mark.parametrize("kind", KINDS)
def test_hostile_json_is_one_clear_error(kind):
    for text in (text for found, text in TEXTS if found == kind):
        with pytest.raises(ValueError, match=r".{5}") as error:
            read_object(text, most=1_000_000)
        assert type(error.value) in (ValueError, UnicodeDecodeError, json.JSONDecodeError)
        assert len(str(error.value)) < 300


@pytest.mark.parametrize("text", ['{"a": NaN}', '{"a": [1, -Infinity]}'])
def test_what_python_writes_of_nan_is_read_where_it_is_asked_for(text):
    with pytest.raises(ValueError, match="is not a valid number"):
        read_plain(text)
    assert read_plain(text, nan=True).keys() == {"a"}


def test_sound_json_is_read_as_it_is():
    content = {
        "a": [1, -2.5, 2**64, 1e-300, 1.7976931348623157e308, None, True],
        "b": {"c": "ü 😀 \n \\ud800 " + "9" * 500, "d": []},
        "deep": json.loads("[" * (DEEPEST - 2) + "]" * (DEEPEST - 2)),
    }
    for ascii_only in (True, False):
        assert read_plain(json.dumps(content, ensure_ascii=ascii_only)) == content


@pytest.mark.parametrize("kind", ["deep", "digits", "surrogate", "twice", "endless"])
def test_the_files_that_hold_json_are_read_by_it(kind, tmp_path):
    text = next(text for found, text in TEXTS if found == kind)
    path = tmp_path / "file.json"
    path.write_bytes(text + b"\n")
    with pytest.raises(UserError, match=r"file\.json"):
        read_json(path, "agent")
    with pytest.raises(UserError, match="line 1"):
        RowFile(path).read()


def readers(path):
    """Return the places where a module reads JSON by itself; what it has just written itself it may."""
    text = path.read_text(encoding="utf-8")
    for found in ast.walk(ast.parse(text if "json.load" in text else "")):
        reads = isinstance(found, ast.Call) and ast.unparse(found.func) in ("json.loads", "json.load")
        if reads and not ast.unparse(found.args[0]).startswith("json.dumps("):
            yield f"{path.relative_to(PACKAGE)}"


def test_nothing_else_reads_json():
    found = {line for path in PACKAGE.rglob("*.py") for line in readers(path)}
    # A language model's answer may be any text; the released rules are a file of the package itself.
    assert found <= {"common/strict_json.py", "products/language_models/answers.py", "game/scenario.py"}
