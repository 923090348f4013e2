"""Trying endpoints: a real server, and servers that ignore, refuse or fail."""

from __future__ import annotations

import json

import pytest

from fpg_bench.planning.llm.probe import FEW_TOKENS, LOWEST, probe
from fpg_bench.planning.llm.servers import Endpoint, load_server

from . import fault_server as faults
from .fault_server import FaultServer, completion, ok, status

KEY = "sk-0123456789abcdef"


def found(behaviour, server="generic", deadline_s=5.0):
    """What a probe finds, by name: (ok, detail)."""
    with FaultServer([behaviour]) as fake:
        endpoint = Endpoint(fake.url, "some-model", KEY, load_server(server))
        return by_name(probe(endpoint, deadline_s))


def by_name(findings):
    return {finding.what: (finding.ok, finding.detail) for finding in findings}


def honest(handler, body):
    """A server that honours everything, as a model of a few words would."""
    if body["model"] != "some-model":
        return status(404)(handler, body)
    text = f"hello {body.get('seed')} " * 30
    if body["max_tokens"] == FEW_TOKENS:
        text = "once upon a"
    if "response_format" in body:
        text = json.dumps({"number": LOWEST})
    return handler.send(200, json.dumps(completion(text, usage={"prompt_tokens": 9, "completion_tokens": 3})))


def test_a_real_server_honours_schema_seed_and_length(llama_server):
    endpoint = Endpoint(llama_server.url, llama_server.model, KEY, load_server("generic"))
    findings = by_name(probe(endpoint, 20))
    for name in ("answer", "model", "tokens", "max_tokens", "deadline", "seed", "json_schema"):
        assert findings[name][0] is True, findings[name]
    assert "no-such-model" not in findings["model"][1]
    assert findings["errors"] == (None, "a model that does not exist answers: check which one is served")
    assert findings["profile"][0] is None
    assert "llama.cpp" in findings["profile"][1]


def test_the_fitting_profile_is_confirmed():
    findings = found(honest, "vllm")
    assert findings["profile"] == (True, "seed: true, response_format: json_schema, as vllm has it")
    assert all(good for good, _ in findings.values())
    assert "HTTP 404" in findings["errors"][1]


def test_a_server_that_ignores_everything_is_found_out():
    findings = found(ok("hello " * 50, usage={"prompt_tokens": 9, "completion_tokens": 50}), "vllm")
    assert findings["max_tokens"] == (False, f"50 tokens written where {FEW_TOKENS} were allowed")
    assert findings["seed"][0] is None
    assert findings["json_schema"][0] is False
    assert "ignored" in findings["json_schema"][1]
    assert "transformers-serve" in findings["profile"][1]


@pytest.mark.parametrize(("count", "few"), [(FEW_TOKENS, ""), (7, "; servers count a few more or less")])
def test_a_length_that_is_about_kept_says_so(count, few):
    findings = found(ok("hello", usage={"prompt_tokens": 9, "completion_tokens": count}))
    seen = f"{count} tokens written where {FEW_TOKENS} were allowed{few}"
    assert findings["max_tokens"] == (True, seen)


def test_a_seed_without_effect_is_told_from_one_that_is_ignored():
    texts = iter(range(100))
    changing = faults.answer(lambda body: f"text {next(texts)}")
    assert found(changing)["seed"] == (False, "ignored: the same seed gave two texts")
    assert found(ok("the same"))["seed"][0] is None


@pytest.mark.parametrize(("name", "finding"), [("seed", "seed"), ("response_format", "json_schema")])
def test_what_a_server_refuses_is_told(name, finding):
    assert found(faults.reject_field(name, "hello"))[finding] == (False, "refused")


def test_a_schema_inside_json_object_is_found():
    def behaviour(handler, body):
        form = body.get("response_format", {})
        if form.get("type") == "json_schema":
            return status(500)(handler, body)
        return ok(json.dumps({"number": LOWEST}) if "schema" in form else "hello")(handler, body)

    findings = found(behaviour)
    assert findings["json_schema"] == (False, "refused")
    assert findings["json_object_with_schema"] == (True, "enforced")
    assert "json_object_with_schema" in findings["profile"][1]


@pytest.mark.parametrize(
    "text", ["hello", "[]", '{"number": 7}', '{"number": 101.0}', "[" * 100_000, "9" * 5000]
)
def test_json_that_breaks_the_schema_is_not_enforced(text):
    assert found(ok(text))["json_schema"][0] is False


def test_a_bare_server_is_found_to_name_no_model_and_count_no_tokens():
    findings = found(faults.bare("hello"), "spark")
    assert findings["model"][0] is None
    assert findings["tokens"] == (False, "not reported: a cap on tokens has no effect")
    assert findings["max_tokens"] == (True, f"1 words where {FEW_TOKENS} tokens were allowed")


@pytest.mark.parametrize(
    ("behaviour", "detail", "deadline_s"),
    [
        (status(401, body={"error": {"message": f"wrong key {KEY}"}}), "FPG_LLM_API_KEY", 5.0),
        (faults.html(), "a web page", 5.0),
        (faults.late(30, "hello"), "timeout", 0.3),
        (faults.refusal(), "refused", 5.0),
    ],
)
def test_where_nothing_answers_that_alone_is_found(behaviour, detail, deadline_s):
    findings = found(behaviour, deadline_s=deadline_s)
    assert list(findings) == ["answer"]
    good, said = findings["answer"]
    assert good is False
    assert detail in said
    assert KEY not in said


def test_a_slow_server_ends_at_the_deadline():
    findings = found(faults.late(0.1, "hello"))
    assert findings["deadline"][0] is True
    assert findings["deadline"][1].startswith("ended after")


def test_findings_are_told_as_they_come():
    seen = []
    with FaultServer([honest]) as fake:
        findings = probe(Endpoint(fake.url, "some-model"), 5, seen.append)
    assert seen == findings
    assert len(fake.requests) <= 10
