"""Responses of servers, read into one form: good ones, bare ones, errors, refusals and rubbish."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpg_bench.planning.llm.replies import ERRORS, LONGEST_BODY, Received, read_reply

from .fault_server import MODEL, completion

KEY = "sk-0123456789abcdef"
SPARK_CODES = (10013, 10014, 10019)


def read(body, status=200, codes=("content_filter", *SPARK_CODES)):
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    return read_reply(Received(status, data), KEY, codes)


def choice(**message):
    return [{"index": 0, "message": {"role": "assistant", **message}}]


def test_a_chat_completion_is_read_whole():
    reply = read(completion("Hello."))
    assert (reply.text, reply.error, reply.model) == ("Hello.", None, MODEL)
    assert (reply.tokens_in, reply.tokens_out) == (11, 7)
    assert reply.raw == completion("Hello.")


def test_a_completion_may_lack_everything_but_its_text():
    reply = read({"choices": choice(content="Hello.")})
    assert (reply.text, reply.error) == ("Hello.", None)
    assert (reply.model, reply.tokens_in, reply.tokens_out) == (None, None, None)


def test_the_parts_of_a_content_are_put_together():
    parts = [{"type": "text", "text": "Hel"}, {"type": "text", "text": "lo."}, "?"]
    assert read({"choices": choice(content=parts)}).text == "Hello."


@pytest.mark.parametrize(
    "usage", [7, [], {"prompt_tokens": "7"}, {"prompt_tokens": True}, {"prompt_tokens": -1}]
)
def test_counts_of_tokens_that_are_none_are_left_out(usage):
    reply = read(completion("Hello.", usage=usage))
    assert (reply.error, reply.tokens_in, reply.tokens_out) == (None, None, None)


@pytest.mark.parametrize(
    ("body", "detail"),
    [
        (b"", "empty"),
        (b"  ", "empty"),
        (b"<!doctype html><p>It works", "a web page"),
        (b'{"choices": [{"mess', "cut or broken JSON"),
        (b"\xff\xfe\x00", "cut or broken JSON"),
        (b"null", "other JSON"),
        (b"[1]", "other JSON"),
        (b"x" * LONGEST_BODY, "more than 1000000 bytes"),
        (b"[" * 100_000, "cut or broken JSON"),
        (b'{"a":' * 200 + b"1" + b"}" * 200, "cut or broken JSON"),
        (b'{"choices": ' + b"9" * 5000 + b"}", "cut or broken JSON"),
        (b'{"choices": NaN}', "cut or broken JSON"),
        (b'{"choices": 6E958}', "cut or broken JSON"),
        ({}, "no choices"),
        ({"choices": None}, "no choices"),
        ({"choices": []}, "no choices"),
        ({"choices": 7}, "no text"),
        ({"choices": [None]}, "no text"),
        ({"choices": [{"message": None}]}, "no text"),
        ({"choices": choice(content=None)}, "no text"),
        ({"choices": choice(content=" \n")}, "no text"),
        ({"choices": choice(content={"a": 1})}, "no text"),
        ({"choices": [{"finish_reason": "length", "message": {"content": ""}}]}, "cut off at max_tokens"),
    ],
)
def test_what_is_no_completion_is_invalid(body, detail):
    reply = read(body)
    assert (reply.text, reply.error) == (None, "invalid")
    assert detail in reply.detail


@pytest.mark.parametrize(
    ("body", "detail"),
    [
        ({"error": {"message": "out of quota", "code": "insufficient_quota"}}, "out of quota"),
        ({"error": "out of quota"}, "out of quota"),
        ({"error": {"reason": 7}}, '{"reason": 7}'),
        ({"code": 10007, "message": "traffic is limited", "sid": "cha"}, "traffic is limited"),
        ({"choices": None, "error": {"message": "out of\nquota"}}, "out of quota"),
    ],
)
def test_an_error_in_a_200_is_an_error_of_the_server(body, detail):
    reply = read(body)
    assert (reply.text, reply.error) == (None, "http")
    assert detail in reply.detail
    assert reply.raw == body


@pytest.mark.parametrize(
    ("status", "body", "detail"),
    [
        (401, {"error": {"message": "no"}}, "FPG_LLM_API_KEY"),
        (404, {"detail": "Not Found"}, "FPG_LLM_MODEL"),
        (422, {"detail": [{"loc": ["body", "seed"]}]}, "seed"),
        (307, b"", "HTTP 307"),
        (502, b"<html>Bad gateway</html>", "HTTP 502"),
        (500, b"Internal Server Error", "Internal Server Error"),
    ],
)
def test_a_status_is_an_error_with_what_the_server_says(status, body, detail):
    reply = read(body, status)
    assert (reply.text, reply.error) == (None, "http")
    assert detail in reply.detail
    assert "<html>" not in reply.detail


@pytest.mark.parametrize(
    ("status", "body"),
    [
        (200, completion(None, choices=choice(content=None, refusal="I can't help with that."))),
        (200, completion(None, choices=[{"message": {"content": ""}, "finish_reason": "content_filter"}])),
        (200, {"code": 10013, "message": "the question was held back"}),
        (200, {"error": {"code": "10014", "message": "the answer was held back"}}),
        (400, {"error": {"code": "content_filter", "message": "held back"}}),
    ],
)
def test_a_refusal_is_told_from_an_error(status, body):
    reply = read(body, status)
    assert (reply.text, reply.error) == (None, "refused")
    assert reply.detail


def test_details_are_one_short_line():
    reply = read({"error": {"message": "a\nb\r\n" * 1000}})
    assert len(reply.detail) <= 200
    assert "\n" not in reply.detail


@pytest.mark.parametrize(
    "body",
    [
        completion(f"Your key is {KEY}."),
        completion("Hello.", model=KEY, id=KEY),
        {"error": {"message": f"wrong key {KEY}"}},
        f"Unauthorized: {KEY}".encode(),
        b'{"error": "wrong key ' + "".join(f"\\u{ord(letter):04x}" for letter in KEY).encode() + b'"}',
    ],
)
@pytest.mark.parametrize("status", [200, 401])
def test_a_key_that_a_server_repeats_is_struck_out(body, status):
    reply = read(body, status)
    assert KEY not in repr(reply)
    assert "***" in repr(reply)


def test_a_key_that_is_a_common_word_does_not_change_the_answer():
    body = json.dumps(completion('{"waypoints": [{"x": 1}]}')).encode()
    assert read_reply(Received(200, body), "x", ()).text == '{"waypoints": [{"x": 1}]}'


def test_half_a_surrogate_pair_does_not_get_into_the_text():
    read(b'{"choices": [{"message": {"content": "a\\ud800b"}}]}').text.encode()


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner)
        | st.dictionaries(
            st.sampled_from(["choices", "message", "content", "error", "code", "usage", "refusal", "detail"]),
            inner,
        )
    ),
)


@given(st.binary() | json_values.map(lambda value: json.dumps(value).encode()), st.sampled_from([200, 400]))
def test_anything_at_all_becomes_a_reply(body, status):
    reply = read(body, status)
    assert (reply.error is None) == (reply.text is not None)
    assert reply.error is None or reply.error in ERRORS
    json.dumps(reply.raw, allow_nan=False)


@pytest.mark.parametrize(
    ("body", "status", "hopeless"),
    [
        *[({"error": {"message": "no"}}, status, True) for status in (301, 308, 401, 403, 404, 405)],
        *[({"error": {"message": "no"}}, status, False) for status in (400, 408, 422, 429, 500, 502, 503)],
        ({"error": {"code": "content_filter"}}, 403, False),
        (b"<html>It works", 200, True),
        (b"<html>Bad gateway", 502, False),
        (b'{"choices": [{"mess', 200, False),
        ({"error": {"message": "out of quota"}}, 200, False),
        ({"choices": []}, 200, False),
        (completion("Hello."), 200, False),
    ],
)
def test_what_asking_again_cannot_mend_is_told_apart(body, status, hopeless):
    assert read(body, status).hopeless is hopeless
