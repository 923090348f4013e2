"""Results: what is written is read, and whatever was edited or is no result ends in one clear line."""

import dataclasses
import hashlib
import json
import os

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.products.leaderboard.playing import Part, matchups_of, part_records
from fpg_bench.products.leaderboard.result import LARGEST, Fingerprint, Result, read_result, write_result
from tests.products.leaderboard.entering import SUITE


@pytest.fixture(scope="module")
def suites(tmp_path_factory):
    """Two suites, as a track has them; the second one is played on other seeds."""
    file = tmp_path_factory.mktemp("suites") / "ally-v2.yml"
    file.write_text(yaml.safe_dump(SUITE))
    public = load_suite(str(file))
    return {"public": public, "shifted": dataclasses.replace(public, season="5eed")}


@pytest.fixture(scope="module")
def good(suites):
    played = {role: [suite.name, suite.hash] for role, suite in suites.items()}
    printed = Fingerprint(version="0", protocol=PROTOCOL, suites=played, policies={}, submission="0")
    records = tuple(part_records(Part("wise", None, "expert"), matchups_of(suites.values())))
    return Result("wise", "ally", printed, records)


@pytest.fixture
def path(tmp_path):
    (tmp_path / "ally").mkdir()
    return tmp_path / "ally" / "wise.jsonl"


@pytest.fixture
def forge(path, good):
    """Write a result that was changed by somebody who knows how to make the hash fit."""

    def write(change=lambda records: None, **head):
        write_result(path, good)
        first, *records = map(json.loads, path.read_text().splitlines())
        change(records)
        del first["sha256"]
        first |= head
        texts = [json.dumps(row, separators=(",", ":")) + "\n" for row in (first, *records)]
        first["sha256"] = hashlib.sha256("".join(texts).encode()).hexdigest()
        texts[0] = json.dumps(first, separators=(",", ":")) + "\n"
        path.write_text("".join(texts))

    return write


@pytest.fixture
def refused(path, suites):
    """Read the result and return the error."""

    def read():
        with pytest.raises(UserError) as raised:
            read_result(path, suites)
        return str(raised.value)

    return read


def test_what_is_written_is_read(good, suites, path):
    write_result(path, good)
    assert read_result(path, suites) == good
    assert good.verified
    assert read_result(path, {"public": suites["public"]}) == good  # its caller compares the fingerprints
    failed = Result("wise", "ally", good.fingerprint, reason="died")
    write_result(path, failed)
    assert read_result(path, suites) == failed
    assert not failed.verified


NO_LINE = "wise.jsonl: line 2: "
NOT_ALL = "its records are not one per training seed and rival"
OTHER = "holds a record of another suite, or of another number of rounds"
OLDER = f"of another protocol than this version's, '{PROTOCOL}'"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda records: records[0].update(training_seed="0"), NO_LINE),
        (lambda records: records[0].update(more=1), NO_LINE),
        (lambda records: records.pop(), NOT_ALL),
        (lambda records: records.append(records[0]), NOT_ALL),
        (lambda records: records[1].update(rival=records[0]["rival"]), NOT_ALL),
        (lambda records: records[0].update(training_seed=0), NOT_ALL),
        (lambda records: records[0].update(entry="somebody-else"), NOT_ALL),
        (lambda records: records[0].update(suite_hash=records[-1]["suite_hash"]), NOT_ALL),
        (lambda records: records[0].update(suite_hash="0" * 16), OTHER),
        (lambda records: records[0]["returns"].pop(), OTHER),
    ],
)
def test_forged_lines_that_fit_their_hash_are_refused(forge, refused, change, message):
    forge(change)
    assert message in refused()


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ({"status": "not verified"}, "edited by hand: not verified, but with records or without a reason"),
        ({"reason": "x"}, "edited by hand: verified, but with a reason"),
        ({"status": "good"}, "line 1: status: expected verified or not verified, got 'good'"),
        ({"more": 1}, "line 1: unknown key 'more'"),
        ({"slug": "wiser"}, "is the result of ally/wiser"),
        ({"fingerprint": 3}, "its first line is not that of a result"),
        ({"fingerprint": {"protocol": "0", "suites": {}}}, OLDER),
        ({"fingerprint": {"protocol": PROTOCOL, "suite": "ally-v2"}}, OLDER),
        ({"fingerprint": {"protocol": PROTOCOL, "suites": {}}}, "lacks version, policies, submission"),
    ],
)
def test_a_head_that_was_edited_or_is_older_is_refused(forge, refused, head, message):
    forge(**head)
    assert message in refused()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not lines of JSON"),
        ("{\n", "not lines of JSON"),
        ("[" * 100_000 + "\n", "not lines of JSON"),
        ("\udcff", "not lines of JSON"),
        ('{"kind": "result"}\n', "its first line is not that of a result"),
        (" " * (LARGEST + 1), "is longer than"),
    ],
)
def test_what_is_no_result_is_one_line(path, refused, content, message):
    path.write_bytes(content.encode(errors="surrogateescape"))
    assert message in refused()


def test_only_a_file_of_its_own_is_read(good, path, refused, tmp_path):
    write_result(tmp_path / "elsewhere", good)
    path.symlink_to(tmp_path / "elsewhere")
    assert "not a file" in refused()
    path.unlink()
    os.mkfifo(path)
    assert "not a file" in refused()


def test_fingerprints_differ_by_name_and_not_by_version(good):
    def changed(**values):
        return good.fingerprint.differences(good.fingerprint.model_copy(update=values))

    assert changed(version="2") == []
    assert changed(protocol="3", suites={}) == ["protocol", "suites"]
