"""Server profiles, and the endpoint that the environment names."""

from __future__ import annotations

import pickle
import traceback

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.language_models.servers import (
    SERVERS,
    Endpoint,
    endpoint_from_environment,
    load_server,
)

KEY = "sk-0123456789abcdef"
LOCAL = "http://127.0.0.1:8080/v1"


@pytest.fixture
def environment(monkeypatch):
    """Sets FPG_LLM_* variables by their last words."""

    def put(**values):
        for name, value in values.items():
            monkeypatch.setenv(f"FPG_LLM_{name}", value)

    return put


@pytest.mark.parametrize("name", SERVERS)
def test_every_profile_can_be_used_and_says_what_it_is(name):
    server = load_server(name)
    assert server.name == name
    assert server.about.endswith(".")


def test_a_profile_of_ones_own_is_read_from_a_file(tmp_path):
    path = tmp_path / "mine.yml"
    path.write_text("about: Mine.\nseed: true\ntemperature: 0\nrefusal_codes: [7, never]\nmodel: m\n")
    server = load_server(str(path))
    assert (server.name, server.seed, server.temperature, server.model) == ("mine", True, 0.0, "m")


def test_a_profile_that_is_not_there_is_refused():
    for name, message in (
        ("sprak", "did you mean 'spark'"),
        ("../spark", "unknown server"),
        ("no.yml", "be read"),
    ):
        with pytest.raises(UserError, match=message):
            load_server(name)


def test_variables_go_before_the_profile_and_an_argument_before_the_variable(environment):
    environment(SERVER="spark", BASE_URL=LOCAL, MODEL="m")
    assert endpoint_from_environment().base_url == LOCAL
    assert endpoint_from_environment().model == "m"
    assert endpoint_from_environment("vllm").server.name == "vllm"


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({}, ["BASE_URL", "MODEL", "API_KEY", "SERVER"]),
        ({"BASE_URL": "  "}, ["BASE_URL", "MODEL", "API_KEY", "SERVER"]),
        ({"BASE_URL": LOCAL}, ["MODEL"]),
        ({"BASE_URL": "https://host.example/v1", "MODEL": "m"}, ["API_KEY"]),
        ({"BASE_URL": "http://127.0.0.1.example/v1", "MODEL": "m"}, ["API_KEY"]),
        ({"MODEL": "m", "API_KEY": "k"}, ["BASE_URL", "SERVER"]),
        ({"SERVER": "spark"}, ["API_KEY"]),
        ({"SERVER": "openai", "API_KEY": "k"}, ["MODEL"]),
    ],
)
def test_what_is_missing_is_named_in_one_line_and_nothing_else(environment, values, named):
    environment(**values)
    with pytest.raises(UserError) as caught:
        endpoint_from_environment()
    message = str(caught.value)
    known = ("BASE_URL", "MODEL", "API_KEY", "SERVER")
    assert [name for name in known if f"FPG_LLM_{name}" in message] == named


@pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1",
        "localhost",
        "[::1]",
        "127.8.8.8",
        "0.0.0.0",
        "[::]",
        "[::ffff:127.0.0.1]",
        "[::ffff:0.0.0.0]",
    ],
)
def test_a_server_on_this_machine_needs_no_key(environment, host):
    environment(BASE_URL=f"http://{host}:8080/v1/chat/completions/", MODEL="m")
    endpoint = endpoint_from_environment()
    assert endpoint.key is None
    assert endpoint.base_url == f"http://{host}:8080/v1"  # without the path that the client adds


@pytest.mark.parametrize(
    "value",
    [
        KEY,
        f"ftp://{KEY}",
        f"http://user:{KEY}@host/v1",
        f"https://host/v1?key={KEY}",
        f"http://[{KEY}",
        f"http://host:{KEY}/v1",
        "file:///etc/passwd",
    ],
)
def test_what_is_no_address_is_refused_without_being_shown(environment, value):
    environment(BASE_URL=value, MODEL="m", API_KEY="k")
    with pytest.raises(UserError, match="FPG_LLM_BASE_URL: ") as caught:
        endpoint_from_environment()
    assert KEY not in shown(caught.value, variables=False)


@pytest.mark.parametrize("value", [f"{KEY}\nX-Evil: 1", f"{KEY} {KEY}", f"{KEY}\r", f"{KEY}é", f"{KEY}\x7f"])
def test_a_key_that_cannot_be_sent_is_refused_without_being_shown(environment, value):
    with pytest.raises(UserError, match="FPG_LLM_API_KEY: holds a space") as caught:
        Endpoint(LOCAL, "m", value)
    assert KEY not in str(caught.value)
    environment(BASE_URL=LOCAL, MODEL="m", API_KEY=f"x{value}x")
    with pytest.raises(UserError, match="FPG_LLM_API_KEY") as caught:
        endpoint_from_environment()
    assert KEY not in shown(caught.value, variables=True)


def test_the_key_is_in_no_repr_and_no_pickle(environment):
    endpoint = Endpoint(LOCAL, "m", KEY)
    assert KEY not in f"{endpoint!r}{endpoint}{[endpoint]}"
    assert KEY.encode() not in pickle.dumps(endpoint)
    assert pickle.loads(pickle.dumps(endpoint)).key is None
    environment(API_KEY="another-key")
    assert pickle.loads(pickle.dumps(endpoint)).key == "another-key"


def shown(error, variables):
    """The whole traceback; also with what stands in the variables of the package's own functions."""
    error_trace = traceback.TracebackException.from_exception(error, capture_locals=variables)
    frames = [frame for frame in error_trace.stack if "/fpg_bench/" in frame.filename]
    return "".join(traceback.format_exception(error)) + "".join(
        f"{frame.line}{frame.locals}" for frame in frames
    )
