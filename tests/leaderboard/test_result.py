import dataclasses
import hashlib
import json
import math
import os

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.leaderboard.playing import Part, matchups_of, part_records
from fpg_bench.leaderboard.result import (
    LARGEST,
    check_records,
    differing,
    failed_result,
    read_result,
    summary,
    verified_result,
    write_result,
)

PRINTED = {"version": "0", "protocol": PROTOCOL, "policies": {}}


@pytest.fixture
def suites(small_suites):
    """Two suites, as one track has them; the second meets others."""
    known = load_suite("ally-v1")
    return {"public": known, "shifted": dataclasses.replace(known, season="5eed")}


@pytest.fixture
def printed(suites):
    return PRINTED | {"suites": {role: [suite.name, suite.hash] for role, suite in suites.items()}}


@pytest.fixture
def good(suites, printed):
    records = list(part_records(Part("wise", None, "expert"), matchups_of(suites.values())))
    return verified_result("wise", "ally", printed, records, suites)


def path_of(folder):
    return folder / "ally" / "wise.jsonl"


def forge(path, good, change):
    """Write a result whose lines were changed by somebody who knows how to make the hash fit."""
    records = [json.loads(json.dumps(record.row())) for record in good.records]
    change(records)
    text = "".join(json.dumps(record, separators=(",", ":")) + "\n" for record in records)
    head = good.head | {"lines_sha256": hashlib.sha256(text.encode()).hexdigest()}
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(head, separators=(",", ":")) + "\n" + text)


def test_what_is_written_is_read(good, suites, tmp_path):
    write_result(path_of(tmp_path), good)
    assert read_result(path_of(tmp_path), suites) == good
    assert good.verified
    assert good.head["summary"]["scores"].keys() == suites.keys()


def test_a_failure_is_written_with_its_reason(suites, printed, tmp_path):
    write_result(path_of(tmp_path), failed_result("wise", "ally", printed, "died"))
    found = read_result(path_of(tmp_path), suites)
    assert (found.verified, found.head["reason"], found.records) == (False, "died", ())


def test_a_result_says_what_an_evaluation_says_to_the_digit(good, suites, tmp_path):
    (found,) = evaluate(["expert"], "ally-v1", tmp_path, say=lambda record: None)
    told = good.summaries(suites)["public"]
    assert (told.score, told.reward, told.by_rival, told.measures) == (
        found.score,
        found.reward,
        found.by_rival,
        found.measures,
    )
    for mine, other in zip(told.records, found.records, strict=True):
        assert dataclasses.replace(mine, entry=other.entry) == other


@pytest.mark.parametrize(
    "change",
    [
        lambda records: records[0].update(training_seed="0"),
        lambda records: records[0].update(training_seed=[0]),
        lambda records: records[0].update(rival={}),
        lambda records: records[0].update(suite_hash=3),
        lambda records: records[0].update(returns=[]),
        lambda records: records[0]["returns"].__setitem__(0, 10**20),
        lambda records: records[0]["returns"].__setitem__(0, True),
        lambda records: records[0]["returns"].__setitem__(0, "1"),
        lambda records: records[0]["tally"].pop("snr_db"),
        lambda records: records[0]["tally"].update(ally_return=None),
        lambda records: records[0]["tally"].update(steps=0),
        lambda records: records[0].update(tally=[]),
        lambda records: records[0].update(ally_points=[1]),
        lambda records: records[0].update(jam_points=[1.5] * 15),
        lambda records: records[0].update(lost=-1),
        lambda records: records[0].update(lost=5),
        lambda records: records[0].update(rounds_sha256="two\nlines"),
        lambda records: records[0].update(more=1),
        lambda records: records[0].pop("entry"),
    ],
)
def test_a_line_that_fits_its_hash_but_is_none_is_told(good, suites, tmp_path, change):
    forge(path_of(tmp_path), good, change)
    with pytest.raises(UserError, match=r"wise.jsonl: line 2: "):
        read_result(path_of(tmp_path), suites)


@pytest.mark.parametrize(
    "change",
    [
        lambda records: records.pop(),
        lambda records: records.append(records[0]),
        lambda records: records[1].update(rival=records[0]["rival"]),
        lambda records: records[0].update(training_seed=0),
        lambda records: records[0].update(entry="somebody-else"),
        lambda records: records[0].update(suite="another-name"),
        lambda records: records[0].update(suite_hash=records[-1]["suite_hash"]),
    ],
)
def test_lines_are_one_per_seed_and_rival(good, suites, tmp_path, change):
    forge(path_of(tmp_path), good, change)
    with pytest.raises(UserError, match="its lines are not one per training seed and rival"):
        read_result(path_of(tmp_path), suites)


@pytest.mark.parametrize(
    "change",
    [lambda records: records[0].update(suite_hash="0" * 16), lambda records: records[0]["returns"].pop()],
    ids=["another suite", "a round less"],
)
def test_a_line_of_another_suite_is_refused(good, suites, tmp_path, change):
    forge(path_of(tmp_path), good, change)
    with pytest.raises(UserError, match="holds a line of another suite, or of another number of rounds"):
        read_result(path_of(tmp_path), suites)


@pytest.mark.parametrize(
    "change",
    [
        lambda records: records[0]["returns"].__setitem__(0, 9e3),
        lambda records: records[0]["tally"].update(jammed=records[0]["tally"]["jammed"] + 1),
        lambda records: records[1].update(lost=1),
        lambda records: records[-1]["returns"].__setitem__(0, -9e3),
    ],
    ids=["return", "tally", "lost", "the worst"],
)
def test_a_summary_follows_from_the_lines(good, suites, tmp_path, change):
    forge(path_of(tmp_path), good, change)
    with pytest.raises(UserError, match="edited by hand: its summary does not follow from its lines"):
        read_result(path_of(tmp_path), suites)


@pytest.mark.parametrize("key", ["scores", "worst", "rounds", "lost", "measures", "training_seeds"])
def test_a_number_of_the_summary_that_was_edited_is_told(good, suites, tmp_path, key):
    told = json.loads(json.dumps(good.head["summary"]))
    at, last = told, key
    while isinstance(at[last], dict):
        at, last = at[last], "return" if "return" in at[last] else next(iter(at[last]))
    at[last] = (at[last] or 0) + 1
    edited = dataclasses.replace(good, head=good.head | {"summary": told})
    write_result(path_of(tmp_path), edited)
    with pytest.raises(UserError, match="edited by hand: its summary does not follow from its lines"):
        read_result(path_of(tmp_path), suites)


def test_the_hash_of_the_rounds_is_part_of_what_a_line_says(good, suites, tmp_path):
    write_result(path_of(tmp_path), good)
    text = path_of(tmp_path).read_text()
    digits = good.records[0].rounds_sha256
    path_of(tmp_path).write_text(text.replace(digits, digits[::-1], 1))
    with pytest.raises(UserError, match="its lines are not those it was written with"):
        read_result(path_of(tmp_path), suites)


def test_a_last_digit_that_another_machine_rounds_otherwise_is_no_edit(good, suites, tmp_path):
    def nudged(value):
        if isinstance(value, dict):
            return {key: nudged(of) for key, of in value.items()}
        return float(math.nextafter(value, math.inf)) if isinstance(value, float) else value

    other = dataclasses.replace(good, head=good.head | {"summary": nudged(good.head["summary"])})
    check_records(other, suites, tmp_path)


@pytest.mark.parametrize("older", [{"protocol": "0"}, {"suite": "ally-v1"}], ids=["older", "before suites"])
def test_a_result_of_an_older_protocol_is_named(good, suites, tmp_path, older):
    """Before its lines are read, which may be of another form."""
    printed = {key: of for key, of in good.fingerprint.items() if key != "suites"} | older
    path_of(tmp_path).parent.mkdir()
    path_of(tmp_path).write_text(json.dumps(good.head | {"fingerprint": printed}) + '\n{"entry": "tone"}\n')
    with pytest.raises(UserError, match=rf"of another protocol than this version's, '{PROTOCOL}'; play it"):
        read_result(path_of(tmp_path), suites)


def test_a_result_on_other_suites_is_read_for_what_it_says_of_itself(good, suites, tmp_path):
    """Who asks for it compares the fingerprints."""
    write_result(path_of(tmp_path), good)
    assert read_result(path_of(tmp_path), {"public": suites["public"]}) == good


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not lines of JSON"),
        ("[1]\n", "not lines of JSON"),
        ("{\n", "not lines of JSON"),
        ("[" * 100_000 + "\n", "not lines of JSON"),
        ("\udcff", "not lines of JSON"),
        ('{"kind": "result"}\n', "its first line is not that of a result"),
        (" " * (LARGEST + 1), "larger than"),
    ],
)
def test_what_is_no_result_is_one_line(suites, tmp_path, content, message):
    path = path_of(tmp_path)
    path.parent.mkdir()
    path.write_bytes(content.encode(errors="surrogateescape"))
    with pytest.raises(UserError, match=message) as raised:
        read_result(path, suites)
    assert "\n" not in str(raised.value)


def test_only_a_file_of_its_own_is_read(good, suites, tmp_path):
    write_result(tmp_path / "elsewhere", good)
    path_of(tmp_path).parent.mkdir()
    path_of(tmp_path).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UserError, match="not a file"):
        read_result(path_of(tmp_path), suites)
    path_of(tmp_path).unlink()
    os.mkfifo(path_of(tmp_path))
    with pytest.raises(UserError, match="not a file"):
        read_result(path_of(tmp_path), suites)


def test_the_worst_of_each_suite_is_told_with_whom_it_was_against(good, suites):
    for role, found in summary(good.records, suites)["worst"].items():
        records = {
            record.rival: record for record in good.records if record.suite_hash == suites[role].hash[:16]
        }
        means = {name: sum(record.returns) / len(record.returns) / 300 for name, record in records.items()}
        assert found["against"] == min(means, key=means.get)
        assert found["return"] == pytest.approx(min(means.values()), rel=1e-5)


def test_fingerprints_differ_by_name_and_not_by_version():
    one = {"version": "1", "protocol": "2", "suites": {}}
    assert differing(one, one | {"version": "2"}) == []
    assert differing(one, {"version": "1", "protocol": "3"}) == ["suites", "protocol"]
