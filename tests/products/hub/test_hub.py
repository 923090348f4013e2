"""``hub push``, ``hub pull`` and players called ``hf://owner/name``, against a Hub on loopback."""

import hashlib
import json
import os
import socket
import sys

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import fpg_bench
from fpg_bench.cli.main import app
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import agent_folder
from fpg_bench.players.remote import pinned
from fpg_bench.products.hub import download as names
from fpg_bench.products.hub import pull
from fpg_bench.products.hub import push as uploads
from fpg_bench.products.hub.download import client, resolve
from fpg_bench.products.sandbox import process
from fpg_bench.products.sandbox.agent import SandboxedAgent
from fpg_bench.training.config import RunConfig
from tests.logged import logged
from tests.policies import policy, through, write_seed
from tests.products.hub.conftest import point_at
from tests.products.hub.hub_server import READER, TOKEN
from tests.training.tiny import settings, train

SHIPPED, NAME = "ally-scripted/ppo/seed_0", "hf://me/mine"
CLOSED = "http://127.0.0.1:9"


def run(*words):
    return CliRunner().invoke(app, ["hub", *map(str, words)], catch_exceptions=False).output


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def agent(folder, seed=0, data=None, **changes):
    """The two files of an agent."""
    write_seed(folder, seed, data, **changes)
    return contents(folder)


@pytest.fixture
def first(hub, tmp_path):
    """The commit of a repository that holds an agent."""
    return hub.add("me/mine", agent(tmp_path / "first"))


@pytest.fixture
def finished(tmp_path):
    """Write the files of a finished run that are uploaded."""
    folder = tmp_path / "run"
    command = "fpg-bench train ppo FPG/AllyVsScripted-v0 --seed 3"
    write_seed(folder / "agent", 3, command=command, seconds=90.0)
    (folder / "run.json").write_text("{}")
    (folder / "curve.png").write_bytes(b"\x89PNG")
    return folder


def metadata(card):
    _, head, text = card.decode().split("---\n", 2)
    return yaml.safe_load(head), text


@pytest.mark.full
@pytest.mark.slow
def test_a_pushed_agent_is_pulled_with_the_same_bits_and_plays_the_same_rounds(hub, tmp_path):
    pushed = run("push", SHIPPED, "me/mine")
    commit = hub.repositories["me/mine"].branches["main"]
    assert f"pushed: {NAME}@{commit}\n" in pushed
    out = tmp_path / "agents" / "theirs"
    assert run("pull", "me/mine", "--out", out).endswith(f"pulled: {NAME}@{commit}\nagent: {out}\n")
    pulled, own = contents(out), contents(agent_folder(SHIPPED))
    origin = {"repository": "me/mine", "revision": "main", "commit": commit}
    assert json.loads(pulled.pop("hub.json")) == origin
    assert pulled == own
    players = {"own": SHIPPED, "pulled": str(out), "named": NAME}
    results = {each.entry: each for each in fpg_bench.evaluate(players, "ally-v2", matches=1)}
    rounds = {name: [record.rounds_sha256 for record in of.records] for name, of in results.items()}
    assert rounds["own"] == rounds["pulled"] == rounds["named"]
    assert results["own"].score.value == results["named"].score.value
    assert run("pull", "me/mine", "--out", out).startswith("already there")


def test_the_model_card_has_what_the_hub_reads_and_the_agent_s_own_results(hub):
    run("push", SHIPPED, "me/mine")
    files = hub.repositories["me/mine"].files()
    head, text = metadata(files["README.md"])
    assert head["library_name"] == "fpg-bench"
    assert {"reinforcement-learning", "fpg-bench", "FPG/AllyVsScripted-v0"} <= set(head["tags"])
    assert head["model_name"] == "mine"
    assert "model-index" not in head
    assert "| 47.2 | [45.5, 48.8]" in text
    about = json.loads(files["agent.json"])
    assert about["command"] in text
    assert "fpg-bench play --ally hf://me/mine" in text
    records = [json.loads(line) for line in files["records.jsonl"].splitlines()]
    assert {record["fingerprint"] for record in records} == {about["policy_sha256"][:16]}
    assert {record["suite"] for record in records} == {"ally-v2", "ally-season-5"}
    assert files.keys() == {".gitattributes", "README.md", "agent.json", "policy.onnx", "records.jsonl"}
    assert TOKEN.encode() not in b"".join(files.values())


def test_the_model_card_says_which_data_set_an_agent_learned_from(hub, tmp_path):
    agent(tmp_path / "own", 0, offline={"dataset": "fpg/ally-mixed-v0"})
    run("push", tmp_path / "own", "me/mine")
    _, text = metadata(hub.repositories["me/mine"].files()["README.md"])
    assert "1,000 steps of gradient descent on the data set `fpg/ally-mixed-v0`" in text


@pytest.mark.full
@pytest.mark.slow
def test_a_run_is_pushed_with_its_curve_and_results_and_again_without_them(hub, finished, tmp_path):
    own = finished / "agent"
    fpg_bench.evaluate([str(own), "expert"], "ally-v2", finished / "results", matches=1)
    run("push", finished, "me/mine", "--revision", "next")
    repository = hub.repositories["me/mine"]
    files = repository.files("next")
    assert repository.files("main").keys() == {".gitattributes"}
    _, text = metadata(files["README.md"])
    assert "](curve.png)" in text
    assert "training seed 3, 1,000 steps, 90 seconds." in text
    assert files["curve.png"] == b"\x89PNG"
    assert {json.loads(line)["entry"] for line in files["records.jsonl"].splitlines()} == {"linear"}
    (finished / "results").rename(tmp_path / "elsewhere")
    (finished / "curve.png").unlink()
    repository.branches["next"] = repository.commit("next", files | {"notes.txt": b"kept"})
    run("push", finished, "me/mine", "--revision", "next")
    assert repository.files("next").keys() == {
        ".gitattributes",
        "README.md",
        "agent.json",
        "notes.txt",
        "policy.onnx",
    }
    _, text = metadata(repository.files("next")["README.md"])
    assert "No records of an evaluation were uploaded." in text
    run("push", own, "me/mine", "--revision", "next", "--results", tmp_path / "elsewhere")
    assert "records.jsonl" in repository.files("next")
    run("pull", f"{NAME}@next", "--out", tmp_path / "out")
    assert json.loads((tmp_path / "out/hub.json").read_text())["revision"] == "next"
    with pytest.raises(UserError, match="hold no record of this agent's policy"):
        run("push", SHIPPED, "me/mine", "--results", tmp_path / "elsewhere")


def test_an_opponent_and_an_agent_of_no_training_seed_are_pushed_and_pulled(hub, tmp_path):
    write_seed(tmp_path / "agent", 0, id="FPG/OpponentVsScripted-v0", training_seed=None)
    run("push", tmp_path / "agent", "me/mine")
    _, text = metadata(hub.repositories["me/mine"].files()["README.md"])
    assert "fpg-bench play --opponent hf://me/mine --ally expert" in text
    run("pull", "me/mine", "--out", tmp_path / "out")
    assert (tmp_path / "out/policy.onnx").exists()


def test_a_private_repository_is_read_with_a_token_alone(hub, tmp_path, monkeypatch):
    run("push", SHIPPED, "me/mine", "--private")
    assert hub.repositories["me/mine"].private
    monkeypatch.delenv("HF_TOKEN")
    with pytest.raises(UserError, match=r"hf://me/mine: no such repository .* private one \(HF_TOKEN is not"):
        run("pull", "me/mine", "--out", tmp_path / "out")
    monkeypatch.setenv("HF_TOKEN", f"{READER}\n")  # as a file gives it
    run("pull", "me/mine", "--out", tmp_path / "out")
    assert (tmp_path / "out/policy.onnx").exists()


def test_nothing_is_uploaded_to_a_public_repository_that_should_be_private(hub, first):
    with pytest.raises(UserError, match="is already public"):
        run("push", SHIPPED, "me/mine", "--private")
    assert hub.repositories["me/mine"].branches["main"] == first


@pytest.mark.parametrize(
    ("words", "token", "message"),
    [
        (("pull", "me/mine"), "hf_unknown", "answers with status 401: HF_TOKEN is not valid"),
        (("pull", "me/mine"), "hf_um\u00fc", "HF_TOKEN: holds characters that no token has"),
        (("pull", "me/other"), TOKEN, "hf://me/other: no such repository .* that HF_TOKEN may not read"),
        (("pull", "me/mine", "--revision", "v9"), TOKEN, "hf://me/mine@v9: has no such revision"),
        (("pull", "me/mine/agent"), TOKEN, "expected owner/name"),
        (("pull", "me/mi--ne"), TOKEN, "hf://me/mi--ne: "),
        (("pull", f"{NAME}@main", "--revision", "main"), TOKEN, "names a revision, and so does"),
        (("push", SHIPPED, "me/mine"), READER, "status 403: HF_TOKEN does not allow this"),
        (("push", SHIPPED, "me/new"), "hf_unknown", "status 401: HF_TOKEN is not valid"),
        (("push", "ally-scripted/ppo", "me/mine"), TOKEN, "holds 5 training seeds; name one"),
    ],
)
def test_what_cannot_be_done_is_one_clear_line(hub, first, tmp_path, monkeypatch, words, token, message):
    monkeypatch.setenv("HF_TOKEN", token)
    out = ("--out", tmp_path / "out") if words[0] == "pull" else ()
    with pytest.raises(UserError, match=message) as raised:
        run(*words, *out)
    assert "hf_" not in str(raised.value)
    assert not (tmp_path / "out").exists()
    assert hub.repositories.keys() == {"me/mine"}
    assert hub.repositories["me/mine"].branches["main"] == first


@pytest.mark.parametrize(
    ("changes", "data", "message"),
    [
        ({}, through("RandomNormalLike"), r"policy.onnx: operator 'RandomNormalLike' is not played"),
        ({}, through("Abs", "Neg", "Log"), r"policy.onnx: loses rounds"),
        ({}, b"no network", r"policy.onnx: is not an ONNX file"),
        ({"policy_sha256": "0" * 64}, None, r"policy_sha256: does not match policy.onnx"),
        ({"id": "FPG/AllyVsScripted-v9"}, None, r"agent.json: .*which this version does not have"),
        ({"padding": "x" * 70_000}, None, r"agent.json:? holds 70,\d+ bytes, at most 64,000"),
    ],
)
def test_a_policy_that_fails_the_checks_is_not_kept(hub, tmp_path, changes, data, message):
    hub.add("me/mine", agent(tmp_path / "bad", 0, data, **changes))
    with pytest.raises(UserError, match=message):
        run("pull", "me/mine", "--out", tmp_path / "here" / "out")
    assert not (tmp_path / "here").exists() or not os.listdir(tmp_path / "here")
    commits = len(hub.repositories["me/mine"].commits)
    with pytest.raises(UserError, match=message):
        run("push", tmp_path / "bad", "me/mine")
    assert len(hub.repositories["me/mine"].commits) == commits


def test_a_policy_that_is_too_large_is_not_even_downloaded(hub, tmp_path):
    hub.add("me/mine", agent(tmp_path / "bad", 0, bytes(5_000_001)))
    with pytest.raises(UserError, match=r"policy.onnx holds 5,000,001 bytes, at most 5,000,000"):
        run("pull", "me/mine", "--out", tmp_path / "out")
    assert not [request for request in hub.requests if "resolve" in request]


@pytest.mark.parametrize("lacking", ["agent.json", "policy.onnx"])
def test_a_repository_without_an_agent(hub, tmp_path, lacking):
    files = agent(tmp_path / "half") | {"README.md": b"hello"}
    del files[lacking]
    hub.add("me/mine", files)
    with pytest.raises(UserError, match=f"holds no agent: {lacking} is missing"):
        run("pull", "me/mine", "--out", tmp_path / "out")


def test_a_pickle_beside_the_agent_is_left_where_it_is(hub, tmp_path):
    strangers = {"model.zip": b"pickled", "a/policy.pkl": b"pickled", "x\x1b.py": b"", "z.txt": b""}
    hub.add("me/mine", agent(tmp_path / "first") | strangers | {"README.md": b"hello"})
    with logged() as lines:
        run("pull", "me/mine", "--out", tmp_path / "out")
    (line,) = lines
    assert line.startswith("hf://me/mine: ignored a/policy.pkl, model.zip, x")
    assert line.endswith(" and 1 more; only agent.json and policy.onnx are read, no pickle")
    assert contents(tmp_path / "out").keys() == {"agent.json", "policy.onnx", "hub.json"}
    assert not [request for request in hub.requests if "pkl" in request or "zip" in request]
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.name in ("model.zip", "policy.pkl")]


@pytest.mark.parametrize("fault", ["cut", "short"])
def test_a_download_that_is_cut_short_leaves_nothing(hub, first, tmp_path, monkeypatch, fault):
    monkeypatch.setattr("time.sleep", lambda seconds: None)  # between the client's attempts
    getattr(hub, fault).add("policy.onnx")
    with pytest.raises(UserError, match=r"hf://me/mine: "):
        run("pull", "me/mine", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    getattr(hub, fault).clear()
    run("pull", "me/mine", "--out", tmp_path / "out")
    assert contents(tmp_path / "out")["policy.onnx"] == policy(0)


def test_without_a_hub_a_commit_plays_from_the_cache_and_all_else_is_one_line(
    hub, first, tmp_path, monkeypatch
):
    run("pull", "me/mine", "--out", tmp_path / "out")
    point_at(CLOSED, tmp_path / "cache", monkeypatch)
    for words in (("pull", "me/mine", "--out", tmp_path / "other"), ("push", SHIPPED, "me/mine")):
        with pytest.raises(UserError, match=f"hf://me/mine: {CLOSED} cannot be reached, or broke off: "):
            run(*words)
    assert not (tmp_path / "other").exists()
    assert isinstance(fpg_bench.load_agent(f"{NAME}@{first}", "ally"), SandboxedAgent)
    with pytest.raises(UserError, match="cannot be reached"):
        fpg_bench.load_agent(f"{NAME}@{first[::-1]}")


def test_a_server_that_never_answers(hub, tmp_path, monkeypatch):
    monkeypatch.setattr(names, "TIMEOUT_S", 0.2)
    monkeypatch.setattr(uploads, "TIMEOUT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        point_at(f"http://127.0.0.1:{silent.getsockname()[1]}", tmp_path / "cache", monkeypatch)
        for words in (("pull", "me/mine", "--out", tmp_path / "out"), ("push", SHIPPED, "me/mine")):
            with pytest.raises(UserError, match="cannot be reached, or broke off: timed out"):
                run(*words)


def test_a_revision_that_has_moved_is_noticed(hub, first, tmp_path):
    out = tmp_path / "out"
    run("pull", "me/mine", "--out", out)
    before = contents(out)
    second = hub.add("me/mine", agent(tmp_path / "second", 1))
    with pytest.raises(UserError, match=f"commit {first}, and main has moved to commit {second}"):
        run("pull", "me/mine", "--out", out)
    assert contents(out) == before
    resolve.cache_clear()
    third = hub.add("me/mine", agent(tmp_path / "third", 2))
    assert f"pulled: {NAME}@{third}" in run("pull", "me/mine", "--out", tmp_path / "other")
    assert contents(tmp_path / "other")["policy.onnx"] == policy(2)
    run("pull", "me/mine", "--revision", first, "--out", tmp_path / "pinned")
    assert contents(tmp_path / "pinned")["policy.onnx"] == policy(0)
    with pytest.raises(UserError, match=r"at main, commit .*; choose another folder"):
        run("pull", "me/mine", "--revision", first, "--out", out)


def test_a_repository_that_changes_during_the_download_gives_the_files_of_one_commit(hub, first, tmp_path):
    hub.meanwhile = lambda: hub.add("me/mine", agent(tmp_path / "second", 1))
    run("pull", "me/mine", "--out", tmp_path / "out")
    assert contents(tmp_path / "out")["policy.onnx"] == policy(0)
    assert json.loads(contents(tmp_path / "out")["hub.json"])["commit"] == first


def test_a_folder_with_other_files_is_left_alone(hub, first, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/thesis.tex").write_text("years")
    with pytest.raises(UserError, match="holds other files, but no agent of the Hub"):
        run("pull", "me/mine", "--out", tmp_path / "out")
    assert contents(tmp_path / "out") == {"thesis.tex": b"years"}


def test_a_name_stands_for_one_commit_and_is_recorded_with_it(hub, first, tmp_path):
    with logged() as lines:
        player = fpg_bench.load_agent(NAME, "ally")
    assert lines == [f"{NAME} is commit {first}"]
    assert isinstance(player, SandboxedAgent)
    hub.add("me/mine", agent(tmp_path / "second", 1))
    assert fpg_bench.load_agent(NAME).model == player.model
    assert pinned(["expert", NAME]) == ["expert", f"{NAME}@{first}"]
    config = RunConfig("ppo", GameSpec("FPG/OpponentVsPolicy-v0", ally=NAME))
    against = RunConfig("ppo", GameSpec.of("FPG/OpponentVsPolicy-v0", against=["expert", NAME]))
    assert config.spec.options() == {"ally": f"{NAME}@{first}"}
    assert against.spec.options() == {"ally": ("expert", f"{NAME}@{first}")}
    with pytest.raises(UserError, match=r"agent hf://me/mine: plays the ally .*, not the opponent"):
        fpg_bench.load_agent(NAME, "opponent")


@pytest.mark.slow
def test_a_run_against_an_agent_on_the_hub_records_its_commit_and_notices_when_it_moves(hub, first, tmp_path):
    def learn():
        given = {"hyperparams": settings("ppo"), "steps": 400, "ally": NAME}
        train("ppo", "FPG/OpponentVsPolicy-v0", tmp_path / "run", **given)
        return json.loads((tmp_path / "run/run.json").read_text())

    about = learn()
    assert about["policies"] == {f"{NAME}@{first}": hashlib.sha256(policy(0)).hexdigest()}
    assert about["game"]["ally"] == f"{NAME}@{first}"
    assert learn() == about
    hub.add("me/mine", agent(tmp_path / "second", 1))
    resolve.cache_clear()  # as in another program
    with pytest.raises(UserError, match="holds another run"):
        learn()


def test_a_rival_of_a_suite_may_be_an_agent_on_the_hub(hub, first, tmp_path):
    suite = {
        "side": "opponent",
        "scenario": "standard",
        "matches": 1,
        "scale": {"zero": 0.0, "top": 22.0},
        "rivals": [{"ally": NAME}],
    }
    hashes = []
    for seed in (1, 0):
        (tmp_path / "suite.yml").write_text(yaml.safe_dump(suite))
        hashes.append(load_suite(str(tmp_path / "suite.yml"), allow=[NAME]).hash)
        hub.add("me/mine", agent(tmp_path / f"next-{seed}", seed))
        resolve.cache_clear()
    assert hashes[0] != hashes[1]


def test_a_pulled_agent_plays_in_a_sandbox_from_its_folder(hub, first, tmp_path):
    run("pull", "me/mine", "--out", tmp_path / "out")
    player = fpg_bench.load_agent(tmp_path / "out")
    assert isinstance(player, SandboxedAgent)
    own = fpg_bench.load_agent(tmp_path / "first")
    seen = np.random.default_rng(0).uniform(-1, 1, (5, 15)).astype(np.float32)
    np.testing.assert_array_equal(player.predict(seen)[0], own.predict(seen)[0])


def test_a_player_on_the_hub_names_the_missing_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(UserError, match=r"huggingface_hub is not installed: pip install .*\[hub\]"):
        fpg_bench.load_agent(NAME)


def test_a_stranger_s_policy_is_checked_when_the_keys_are_forgotten(hub, first, monkeypatch, tmp_path):
    done = []
    monkeypatch.setattr(process, "forget_keys", lambda: done.append("forgotten"))
    monkeypatch.setattr(pull, "check_policy", lambda model: done.append("checked"))
    run("pull", "me/mine", "--out", tmp_path / "out")
    assert done == ["forgotten", "checked"]


def test_the_token_comes_from_the_environment_alone(hub, monkeypatch, tmp_path):
    (tmp_path / "token").write_text(TOKEN)
    monkeypatch.setattr("huggingface_hub.constants.HF_TOKEN_PATH", str(tmp_path / "token"))
    assert client().token == TOKEN
    monkeypatch.delenv("HF_TOKEN")
    assert client().token is False
