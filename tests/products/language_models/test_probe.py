"""The probe of endpoints: a real server, and servers that honour, ignore, refuse or fail."""

from __future__ import annotations

import json

import pytest

from fpg_bench.products.language_models.probe import probe
from fpg_bench.products.language_models.servers import Endpoint, load_server

from . import fault_server as faults
from .fault_server import FaultServer, completion, ok, status
from .playing import KEY


def by_name(endpoint, deadline_s=30.0):
    """A probe's findings by their subjects: (ok, detail)."""
    return {finding.subject: (finding.ok, finding.detail) for finding in probe(endpoint, deadline_s)}


def probed(behaviour, server="generic", deadline_s=30.0):
    with FaultServer([behaviour]) as fake:
        findings = by_name(Endpoint(fake.url, "some-model", KEY, load_server(server)), deadline_s)
        assert len(fake.requests) <= 12
    return findings


def honest(handler, body):
    """A server that honours everything, as a model of a few words would."""
    text = json.dumps({"number": 105}) if "response_format" in body else f"hello {body.get('seed')}"
    return handler.send(200, json.dumps(completion(text)))


def test_a_real_server_honours_schema_and_seed(llama_server):
    server = load_server("generic").model_copy(update={"max_tokens": 100})
    findings = by_name(Endpoint(llama_server.url, llama_server.model, KEY, server), 120)
    for name in ("answer", "tokens", "seed", "json_schema"):
        assert findings[name][0] is True, findings[name]
    assert findings["profile"][0] is None
    assert "llama.cpp" in findings["profile"][1]


def test_the_fitting_profile_is_confirmed():
    findings = probed(honest, "vllm")
    assert findings["profile"] == (True, "seed: true, response_format: json_schema, as vllm has it")
    assert all(good for good, _ in findings.values())


def test_a_server_that_ignores_everything_gets_another_profile():
    findings = probed(ok("hello"), "vllm")
    assert findings["seed"][0] is None
    assert findings["json_schema"][0] is False
    assert "ignored" in findings["json_schema"][1]
    assert "transformers-serve" in findings["profile"][1]


def test_a_seed_without_effect_differs_from_one_that_is_ignored():
    texts = iter(range(100))
    changing = faults.answer(lambda body: f"text {next(texts)}")
    assert probed(changing)["seed"] == (False, "ignored: the same seed gave two texts")
    assert probed(ok("the same"))["seed"][0] is None


@pytest.mark.parametrize(("name", "subject"), [("seed", "seed"), ("response_format", "json_schema")])
def test_a_refused_field_is_found(name, subject):
    assert probed(faults.reject_field(name, "hello"))[subject] == (False, "refused")


def test_a_schema_inside_json_object_is_found():
    def behaviour(handler, body):
        form = body.get("response_format", {})
        if form.get("type") == "json_schema":
            return status(400)(handler, body)
        return ok(json.dumps({"number": 101}) if "schema" in form else "hello")(handler, body)

    findings = probed(behaviour)
    assert findings["json_schema"] == (False, "refused")
    assert findings["json_object_with_schema"] == (True, "enforced")
    assert "json_object_with_schema" in findings["profile"][1]


@pytest.mark.parametrize("text", ["hello", "[]", '{"number": 7}', '{"number": 101.0}', "[" * 100_000])
def test_json_that_breaks_the_schema_is_not_enforced(text):
    assert probed(ok(text))["json_schema"][0] is False


def test_a_bare_server_counts_no_tokens():
    assert probed(ok("hello", usage=None))["tokens"] == (False, "not reported: a cap on tokens has no effect")


@pytest.mark.parametrize(
    ("behaviour", "detail", "deadline_s"),
    [
        (status(401, body={"error": {"message": f"wrong key {KEY}"}}), "FPG_LLM_API_KEY", 30.0),
        (faults.html(), "a web page", 30.0),
        (faults.late(30, "hello"), "timeout", 0.3),
        (faults.refusal(), "refused", 30.0),
    ],
)
def test_where_nothing_answers_that_is_the_only_finding(behaviour, detail, deadline_s):
    findings = probed(behaviour, deadline_s=deadline_s)
    assert list(findings) == ["answer"]
    is_ok, text = findings["answer"]
    assert is_ok is False
    assert detail in text
    assert KEY not in text
