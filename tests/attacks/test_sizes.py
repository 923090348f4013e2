"""Files of strangers are bounded before they are read, and a reader waits at no pipe."""

import dataclasses
import gzip
import hashlib
import io
import json
import multiprocessing
import os
import re
import resource
import shutil
import sys
import zipfile
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import onnx
import pytest
import torch
import yaml

from fpg_bench.cli import main as cli
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_bounded, read_json, read_yaml
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.suite import load_suite, read_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.evaluation.table import MOST_RANKED, standings
from fpg_bench.game.knowledge import load_knowledge
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.products.offline import make
from fpg_bench.products.offline.make import make_dataset
from fpg_bench.products.offline.read import iterate_rounds
from fpg_bench.products.offline.spec import load_spec
from fpg_bench.products.offline.storage import part_digests
from fpg_bench.products.rendering.scores import MOST_DRAWN, draw_scores
from fpg_bench.training.checkpoint import _read
from tests.evaluation.test_summary import records_of
from tests.products.offline.making import tiny
from tests.training.tiny import ALLY, settings, train_tiny

SUITE = {"side": "ally", "scenario": "standard", "matches": 1, "rivals": [{"opponent": "tone"}]}


@pytest.fixture
def pipe(tmp_path):
    file = tmp_path / "pipe.yml"
    os.mkfifo(file)
    return file


def test_no_reader_waits_at_a_pipe(pipe, tmp_path):
    for read in (read_yaml, read_json, lambda file, what: read_bounded(file, what, 9)):
        with pytest.raises(UserError, match=r"file .*pipe\.yml: cannot be read: is not a regular file"):
            read(pipe, "file")
    rows = RowFile(pipe)
    for use in (as_scenario, load_knowledge, load_suite, read_suite, load_spec, lambda file: rows.read()):
        with pytest.raises(UserError, match="is not a regular file"):
            use(str(pipe))
    for read in (part_digests, _read):
        with pytest.raises(OSError, match="is not a regular file"):
            read(pipe)
    os.mkfifo(tmp_path / "main_data.hdf5")
    with pytest.raises(UserError, match="is not a regular file"):
        next(iterate_rounds(tmp_path, load_spec("ally-expert-v0"), "", "data set"))


def test_an_agent_s_policy_may_be_no_pipe(tmp_path):
    shipped = baselines_folder() / "agents/ally-scripted/ppo/seed_0"
    (tmp_path / "agent").mkdir()
    (tmp_path / "agent/agent.json").write_bytes((shipped / "agent.json").read_bytes())
    os.mkfifo(tmp_path / "agent/policy.onnx")
    with pytest.raises(UserError, match="is not a regular file"):
        load_agent(tmp_path / "agent")


def test_a_yaml_file_is_measured_before_it_is_parsed(tmp_path, monkeypatch):
    monkeypatch.setattr("fpg_bench.common.files._CarefulLoader", lambda text: pytest.fail("was parsed"))
    file = tmp_path / "large.yml"
    for text in ("".join(f"k{k}: {k}\n" for k in range(60_000)), f"a: {'x' * 20_000_000}\n"):
        file.write_text(text)
        with pytest.raises(UserError, match=r"large\.yml: is longer than 200,000 bytes$"):
            read_yaml(file, "suite")


@pytest.mark.parametrize("opened", ["- ", "? "])
def test_a_yaml_file_nested_without_brackets_is_refused(opened, tmp_path):
    (tmp_path / "deep.yml").write_text(opened * 90_000)
    with pytest.raises(UserError, match=r"deep\.yml: not valid YAML: maximum recursion depth exceeded"):
        read_yaml(tmp_path / "deep.yml", "suite")


@pytest.mark.parametrize("number", ["7" * 5000, "0x" + "f" * 5000, "0b" + "1" * 1025, "1" + ":59" * 5000])
def test_a_number_that_no_text_can_show_is_too_large(number, tmp_path):
    (tmp_path / "mine.yml").write_text(f"hop_cost: {number}\n")
    for read in (as_scenario, load_suite):
        with pytest.raises(UserError, match=r"mine\.yml: not valid YAML: a number is too large"):
            read(str(tmp_path / "mine.yml"))


@pytest.mark.parametrize("changes", [{"matches": 10**12}, {"matches": 10**4, "rounds_per_match": 10**4}])
def test_a_suite_has_no_more_rounds_than_can_be_played(changes, tmp_path):
    file = tmp_path / "suite.yml"
    file.write_text(yaml.safe_dump(SUITE | changes))
    for read in (load_suite, read_suite):
        with pytest.raises(UserError, match="at most 1,000,000 rounds per rival are allowed"):
            read(str(file))


def test_a_table_of_many_entries_draws_the_first_and_ranks_none(tmp_path):
    suite = dataclasses.replace(load_suite("ally-v2"), matches=2, rivals=load_suite("ally-v2").rivals[:1])
    records = [
        record for k in range(MOST_RANKED + 1) for record in records_of(suite, f"entry {k}", [[k, k + 1.0]])
    ]
    many = summarise(records, suite)
    assert all(standing.rank is None for standing in standings(many).values())
    assert all(standing.rank is not None for standing in standings(many[:MOST_RANKED]).values())
    draw_scores(many, suite, tmp_path / "all.svg")
    drawn = (tmp_path / "all.svg").read_text()
    assert f"the first {MOST_DRAWN} of {len(many):,}" in drawn
    assert drawn.count("entry ") == MOST_DRAWN
    assert f"entry {MOST_RANKED}" in drawn


def _zipped(file, parts):
    """Pack parts by name; a number is so many zeros, which take a thousandth of it."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, part in parts.items():
            with archive.open(name, "w", force_zip64=True) as into:
                for block in [bytes(10**6)] * (part // 10**6) if isinstance(part, int) else [part]:
                    into.write(block)


def _tensors(**shapes):
    """Weights of a model: views of one number."""
    stored = io.BytesIO()
    torch.save({name: torch.zeros(1).expand(shape) for name, shape in shapes.items()}, stored)
    return stored.getvalue()


def _declared_array(shape):
    stored = io.BytesIO()
    np.lib.format.write_array_header_1_0(stored, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return stored.getvalue()


def _channel():
    as_scenario("link").to_yaml("mine.yml")
    Path("mine.yml").write_text(re.sub("channel: .*", "channel: diagonal.csv", Path("mine.yml").read_text()))
    rows = [f"{k},{k},{k},-50\n" for k in range(20_000)]
    Path("diagonal.csv").write_text("".join(["x,y,z,gain_db\n", *rows]))


def _aliases():
    lines = [f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 10)}]\n" for k in range(12)]
    Path("mine.yml").write_text("".join(["a0: &a0 [x]\n", *lines]))


def _rows():
    Path("out").mkdir()
    with open("out/ali-2023-quick.jsonl", "wb") as file:
        file.truncate(2**32)


def _packed():
    with gzip.open("asked.jsonl.gz", "wb", compresslevel=1) as file:
        for _ in range(120):
            file.write(b" " * 10**7)


def _agent(change):
    shutil.copytree(baselines_folder() / "agents/ally-scripted/ppo/seed_0", "mine")
    proto = onnx.load("mine/policy.onnx")
    change(proto.graph.initializer)
    onnx.save(proto, "mine/policy.onnx")
    card = json.loads(Path("mine/agent.json").read_text())
    digest = hashlib.sha256(Path("mine/policy.onnx").read_bytes()).hexdigest()
    Path("mine/agent.json").write_text(json.dumps(card | {"policy_sha256": digest}))


def _holds_less(tensors):
    tensors[0].dims[:], tensors[0].raw_data = [10**5, 10**5], b""


def _run(name, content):
    train_tiny("ppo", "mine")
    with zipfile.ZipFile(f"mine/{name}") as archive:
        parts = {each: archive.read(each) for each in archive.namelist()}
    _zipped(f"mine/{name}", parts | content())


def _packed_weights():
    _zipped("inner.pth", {"archive/data/0": 1_200_000_000})
    return {"policy.pth": Path("inner.pth").read_bytes()}


def _zip(content):
    _zipped("model.zip", {"data": b"{}"} | content)


def _dataset(change, name="part_00000.hdf5"):
    folder = make_dataset(tiny(2), Path("sets")) / "data"
    with h5py.File(folder / name, "r+") as file:
        change(file["episode_0"] if name != "main_data.hdf5" else file)


def _in_place(**how):
    def change(group):
        del group["rewards"]
        group.create_dataset("rewards", **how)

    return change


def _elsewhere(file):
    with h5py.File("other.bin", "w") as other:
        other.create_dataset("large/rewards", (10**9,), np.float32)
    del file["episode_0"]
    file["episode_0"] = h5py.ExternalLink(os.path.abspath("other.bin"), "/large")


def _arrow():
    folder = make_dataset(tiny(2), Path("sets")) / "data"
    about = json.loads((folder / "metadata.json").read_text())
    (folder / "metadata.json").write_text(json.dumps(about | {"data_format": "arrow"}))
    (folder / "0").mkdir()
    (folder / "0/0.parquet").write_bytes(b"PAR1")


def _begun():
    spec = load_spec("ally-random-v0").model_copy(update={"steps": 600})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(make, "_finish", lambda *how: 1 // 0)
        with pytest.raises(ZeroDivisionError):
            make_dataset(spec, Path("sets"))
    with h5py.File(next(Path("sets").rglob("part_*")), "r+") as file:
        del file["sha256"]
        file.create_dataset("sha256", (10**9, 32), np.uint8)


START = "train ppo FPG/AllyVsScripted-v0 --start mine --n-evals 0 --out new --hyperparams tiny.yml"
EXPORT = "export model.zip --out new --algo ppo --id FPG/AllyVsScripted-v0 --scenario standard --seed 0"
CHECK, EVALUATE = "dataset check sets", "evaluate mine --suite ally-v2 --matches 1 --out new"
NOT_HELD, FIRST = "and does not hold it", "mlp_extractor.policy_net.0.weight"
# What makes a file that declares more than it holds, the verb that reads it, and what it says.
DECLARED = {
    "channel": (_channel, "scenario show mine.yml", "no gain at"),
    "aliases": (_aliases, "evaluate idle --suite mine.yml --out new", "aliases stand for more than"),
    "rows": (_rows, "reproduce ali-2023 --out out", "is longer than"),
    "packed rows": (_packed, "play --planner llm --transcript asked.jsonl.gz --rounds 1", "longer than"),
    "initialiser": (partial(_agent, _holds_less), EVALUATE, "holds 0 numbers, its shape has 10000000000"),
    "statistics": (
        partial(_run, "normalize.npz", lambda: {"obs_mean.npy": _declared_array((10**12,))}),
        START,
        "Unable to allocate|cannot reshape|EOF",
    ),
    "zeros": (partial(_run, "normalize.npz", lambda: {"more": 1_200_000_000}), START, "unpacks to 1,2"),
    "weights": (partial(_run, "model.zip", _packed_weights), START, "unpacks to 1,2"),
    "text": (partial(_zip, {"data": 1_200_000_000}), EXPORT, "unpacks to 1,2"),
    "views": (
        partial(_zip, {"policy.pth": _tensors(**{FIRST: (10**5, 15)})}),
        EXPORT,
        "its tensors have more numbers than it holds",
    ),
    "layers": (
        partial(_zip, {"policy.pth": _tensors(**{FIRST: (10**9, 0)})}),
        f"{EXPORT} --not-normalized",
        "expected sizes of layers",
    ),
    "array": (partial(_dataset, _in_place(shape=(10**9,), dtype=np.float32)), CHECK, NOT_HELD),
    "letters": (partial(_dataset, _in_place(shape=(300,), dtype="S10000000")), CHECK, NOT_HELD),
    "chunks": (
        partial(_dataset, _in_place(shape=(300,), maxshape=(None,), chunks=(10**8,), dtype=np.float32)),
        CHECK,
        NOT_HELD,
    ),
    "raw": (
        partial(_dataset, _in_place(shape=(10**9,), dtype="f4", external=[("/dev/zero", 0, 4 * 10**9)])),
        CHECK,
        NOT_HELD,
    ),
    "nothing": (partial(_dataset, _in_place(data=h5py.Empty("f"))), CHECK, NOT_HELD),
    "another file": (partial(_dataset, _elsewhere, "main_data.hdf5"), CHECK, "is no part of it"),
    "hashes": (_begun, "dataset make ally-random-v0 --steps 600 --out sets", "is damaged; delete it"),
    "arrow": (_arrow, CHECK, "is not a regular file"),
}


def _read_within_a_gigabyte(words):
    """Run a verb that may take one gigabyte more than this process has."""
    held = re.search(r"VmData:\s+(\d+)", Path("/proc/self/status").read_text())
    resource.setrlimit(resource.RLIMIT_DATA, (int(held[1]) * 1024 + 10**9,) * 2)
    sys.argv = ["fpg-bench", *words.split()]
    with Path("said").open("w", buffering=1) as sys.stderr:
        cli.main()


@pytest.mark.process
@pytest.mark.parametrize("name", DECLARED)
def test_what_declares_more_than_it_holds_is_one_line_within_a_gigabyte(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make_file, words, said = DECLARED[name]
    make_file()
    Path("tiny.yml").write_text(yaml.safe_dump({ALLY: settings("ppo")}))
    reader = multiprocessing.get_context("fork").Process(target=_read_within_a_gigabyte, args=(words,))
    reader.start()
    reader.join()
    (line,) = Path("said").read_text().splitlines()
    assert reader.exitcode == 2, line
    assert re.search(rf"^fpg-bench: (?!a bug).*({said})", line), line
