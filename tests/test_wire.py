"""What counts as a JSON-RPC message, what is answered to the rest, and how lines are read."""

from __future__ import annotations

import asyncio
import json

import orjson
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backend import wire
from backend.wire import (
    INVALID_PARAMS,
    INVALID_REQUEST,
    PARSE_ERROR,
    BadFrame,
    FrameTooLarge,
    check,
    read_line,
    with_identity,
)

calmly = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine is no failure."""

GOOD: list[tuple[bytes, str, str | None, wire.RequestId]] = [
    (b'{"jsonrpc":"2.0","id":1,"method":"x"}', "request", "x", 1),
    (b'{"jsonrpc":"2.0","id":0,"method":"x","params":{}}', "request", "x", 0),
    (b'{"jsonrpc":"2.0","id":-5,"method":"x","params":null}', "request", "x", -5),
    (b'{"jsonrpc":"2.0","id":"p1","method":"x"}', "request", "x", "p1"),
    (b'{"jsonrpc":"2.0","id":"","method":"x"}', "request", "x", ""),
    (b'{"jsonrpc":"2.0","id":null,"method":"x"}', "request", "x", None),
    (b'{"jsonrpc":"2.0","id":"' + b"a" * 256 + b'","method":"x"}', "request", "x", "a" * 256),
    (b'{"jsonrpc":"2.0","id":9007199254740993,"method":"x"}', "request", "x", 9007199254740993),
    (b'{"jsonrpc":"2.0","method":"$/ping"}', "notification", "$/ping", None),
    (b'{"jsonrpc":"2.0","method":"","params":{"a":[1,2]}}', "notification", "", None),
    (b'{"jsonrpc":"2.0","method":"x","extra":[[]]}', "notification", "x", None),
    (b'{"jsonrpc":"2.0","id":1,"result":null}', "response", None, 1),
    (b'{"jsonrpc":"2.0","id":"p1","result":[1]}', "response", None, "p1"),
    (b'{"jsonrpc":"2.0","id":1,"error":{"code":-1,"message":"no"}}', "response", None, 1),
    (b'{"jsonrpc":"2.0","id":null,"error":{}}', "response", None, None),
    (b'\n\t {"jsonrpc" : "2.0",\r\n "id":1, "method":"x"} \r\n', "request", "x", 1),
    (b'{"jsonrpc":"2.0","id":1,"meth\\u006fd":"x"}', "request", "x", 1),
    ('{"jsonrpc":"2.0","id":1,"method":"ü😀"}'.encode(), "request", "ü😀", 1),
    (b'{"jsonrpc":"2.0","id":1,"method":"a","method":"b"}', "request", "b", 1),  # the last one counts
    (b'{"jsonrpc":"2.0","method":"x","params":{"s":"' + b"[{" * 500 + b'"}}', "notification", "x", None),
    (b'{"jsonrpc":"2.0","method":"x","params":{"a":' + b"[" * 62 + b"]" * 62 + b"}}", "notification", "x", None),
    (b'{"jsonrpc":"2.0","method":"x","params":{"a":[' + b"{}," * 500 + b"{}]}}", "notification", "x", None),
]


@pytest.mark.parametrize(("raw", "kind", "method", "request_id"), GOOD)
def test_a_good_message_is_told_apart_and_kept_as_it_came(raw, kind, method, request_id):
    frame = check(raw)
    assert (frame.kind, frame.method, frame.id) == (kind, method, request_id)
    assert frame.raw is raw
    assert frame.body == orjson.loads(raw)


NO_ANSWER = Ellipsis
_CALL = b'{"jsonrpc":"2.0","id":7,"method":"x",'

# The frame, the code of the error, and the id in the answer.
HOSTILE: list[tuple[bytes, int, object]] = [
    # Not JSON, or not UTF-8.
    (b"", PARSE_ERROR, None),
    (b" ", PARSE_ERROR, None),
    (b"\n", PARSE_ERROR, None),
    (b"\x00", PARSE_ERROR, None),
    (b"{", PARSE_ERROR, None),
    (b"}", PARSE_ERROR, None),
    (b"[", PARSE_ERROR, None),
    (b"hello", PARSE_ERROR, None),
    (b"GET / HTTP/1.1", PARSE_ERROR, None),
    (b"Content-Length: 2\r\n\r\n{}", PARSE_ERROR, None),
    (b"undefined", PARSE_ERROR, None),
    (b"NaN", PARSE_ERROR, None),
    (b"Infinity", PARSE_ERROR, None),
    (b"'single'", PARSE_ERROR, None),
    (b"{'jsonrpc':'2.0'}", PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0",}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0" "id":1}', PARSE_ERROR, None),
    (b'{jsonrpc:"2.0"}', PARSE_ERROR, None),
    (b'// note\n{"jsonrpc":"2.0"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"x"}{"jsonrpc":"2.0","method":"y"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"x"}\n{"jsonrpc":"2.0","method":"y"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"x"}\x00', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"a\nb"}', PARSE_ERROR, None),  # a raw newline within a string
    (b'{"jsonrpc":"2.0","method":"a\rb"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"a\x01b"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"\xff"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"\xc0\xaf"}', PARSE_ERROR, None),  # an overlong slash
    (b'{"jsonrpc":"2.0","method":"\xed\xa0\x80"}', PARSE_ERROR, None),  # half of a surrogate pair
    (b'{"jsonrpc":"2.0","method":"\\ud800"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"\\x41"}', PARSE_ERROR, None),
    (b'{"jsonrpc":"2.0","method":"x', PARSE_ERROR, None),
    (b'\xef\xbb\xbf{"jsonrpc":"2.0","method":"x"}', PARSE_ERROR, None),  # a byte order mark
    ('{"jsonrpc":"2.0","method":"x"}'.encode("utf-16"), PARSE_ERROR, None),
    (_CALL + b'"params":{"a":NaN}}', PARSE_ERROR, None),
    (_CALL + b'"params":{"a":1e999}}', PARSE_ERROR, None),
    (_CALL + b'"params":{"a":01}}', PARSE_ERROR, None),
    (b"[" * 100_000, PARSE_ERROR, None),
    (b"[" * 100_000 + b"]" * 100_000, PARSE_ERROR, None),
    (b'{"a":' * 100_000 + b"1" + b"}" * 100_000, PARSE_ERROR, None),
    (b'"\\' + b'\\"' * 50_000, PARSE_ERROR, None),
    # JSON, but no message.
    (b"[]", INVALID_REQUEST, None),
    (b"[{}]", INVALID_REQUEST, None),
    (b'[{"jsonrpc":"2.0","id":1,"method":"x"}]', INVALID_REQUEST, None),  # a batch
    (b'"initialize"', INVALID_REQUEST, None),
    (b"1", INVALID_REQUEST, None),
    (b"null", INVALID_REQUEST, None),
    (b"true", INVALID_REQUEST, None),
    (b"{}", INVALID_REQUEST, None),
    (b'{"id":1,"method":"x"}', INVALID_REQUEST, 1),
    (b'{"jsonrpc":"1.0","id":1,"method":"x"}', INVALID_REQUEST, 1),
    (b'{"jsonrpc":2.0,"id":1,"method":"x"}', INVALID_REQUEST, 1),
    (b'{"jsonrpc":["2.0"],"id":"a","method":"x"}', INVALID_REQUEST, "a"),
    (b'{"jsonrpc":"2.0"}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":1}', INVALID_REQUEST, 1),
    (b'{"jsonrpc":"2.0","result":1}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":1,"result":1,"error":{}}', INVALID_REQUEST, 1),
    (b'{"jsonrpc":"2.0","params":{}}', INVALID_REQUEST, None),
    # Ids that cannot be answered.
    (b'{"jsonrpc":"2.0","id":true,"method":"x"}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":1.5,"method":"x"}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":[],"method":"x"}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":{"a":1},"method":"x"}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":99999999999999999999999,"method":"x"}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":"' + b"a" * 257 + b'","method":"x"}', INVALID_REQUEST, None),
    (b'{"jsonrpc":"2.0","id":false,"result":1}', INVALID_REQUEST, None),
    # Methods and params of the wrong kind.
    (b'{"jsonrpc":"2.0","id":7,"method":null}', INVALID_REQUEST, 7),
    (b'{"jsonrpc":"2.0","id":7,"method":5}', INVALID_REQUEST, 7),
    (b'{"jsonrpc":"2.0","id":7,"method":["x"]}', INVALID_REQUEST, 7),
    (b'{"jsonrpc":"2.0","id":7,"method":{"x":1}}', INVALID_REQUEST, 7),
    (_CALL + b'"params":[]}', INVALID_PARAMS, 7),
    (_CALL + b'"params":"x"}', INVALID_PARAMS, 7),
    (_CALL + b'"params":0}', INVALID_PARAMS, 7),
    (_CALL + b'"params":false}', INVALID_PARAMS, 7),
    (b'{"jsonrpc":"2.0","method":"x","params":[1]}', INVALID_PARAMS, NO_ANSWER),  # a notification
    (b'{"jsonrpc":"2.0","id":1,"error":"no"}', INVALID_REQUEST, NO_ANSWER),  # an answer to an answer: a loop
    (b'{"jsonrpc":"2.0","id":1,"error":null}', INVALID_REQUEST, NO_ANSWER),
    # Too deep.
    (b'{"jsonrpc":"2.0","method":"x","params":{"a":' + b"[" * 63 + b"]" * 63 + b"}}", INVALID_REQUEST, None),
    (_CALL + b'"params":' + b'{"a":' * 500 + b"1" + b"}" * 501, INVALID_REQUEST, None),
    (_CALL + b'"params":{"a":["]",' + b'["]",' * 70 + b"1" + b"]" * 71 + b"}}", INVALID_REQUEST, None),
    (b"[" * 1000 + b"]" * 1000, INVALID_REQUEST, None),
]


def test_the_table_is_long_enough_to_mean_something():
    assert len({raw for raw, _, _ in HOSTILE}) == len(HOSTILE) >= 60


@pytest.mark.parametrize(("raw", "code", "request_id"), HOSTILE, ids=lambda value: repr(value)[:40])
def test_a_hostile_frame_gets_the_error_that_json_rpc_asks_for(raw, code, request_id):
    with pytest.raises(BadFrame) as bad:
        check(raw)
    assert bad.value.code == code
    if request_id is NO_ANSWER:
        assert bad.value.reply is None
        return
    reply = json.loads(bad.value.reply)
    assert reply == {
        "jsonrpc": "2.0",
        "id": request_id,
        "error": {"code": code, "message": bad.value.message},
    }
    assert b"\n" not in bad.value.reply
    assert bad.value.message.endswith((".", '"2.0".'))


def test_a_frame_over_the_limit_is_not_even_parsed():
    with pytest.raises(FrameTooLarge) as bad:
        check(b"x" * 11, limit=10)
    assert json.loads(bad.value.reply)["error"]["message"] == "The message is larger than 10 bytes."
    with pytest.raises(BadFrame) as bad:
        check(b"x" * 10, limit=10)
    assert bad.value.code == PARSE_ERROR


@calmly
@given(st.binary(max_size=200))
def test_whatever_comes_is_a_message_or_a_bad_frame(raw):
    try:
        frame = check(raw)
    except BadFrame:
        return
    assert frame.body["jsonrpc"] == "2.0"


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
MEMBERS = st.fixed_dictionaries(
    {}, optional={"jsonrpc": st.just("2.0") | JSON} | dict.fromkeys(("id", "method", "params", "result", "error"), JSON)
)


@calmly
@given(MEMBERS)
def test_what_passes_is_exactly_what_json_rpc_allows(body):
    try:
        frame = check(json.dumps(body).encode())
    except BadFrame:
        return
    assert body["jsonrpc"] == "2.0"
    if frame.kind == "response":
        assert ("result" in body) != ("error" in body)
        assert "id" in body
    else:
        assert isinstance(body["method"], str)
        assert isinstance(body.get("params"), dict | None)
        assert (frame.kind == "request") == ("id" in body)


def depth(value) -> int:
    if isinstance(value, dict):
        return 1 + max(map(depth, value.values()), default=0)
    if isinstance(value, list):
        return 1 + max(map(depth, value), default=0)
    return 0


@calmly
@given(st.dictionaries(st.text(max_size=3), JSON, max_size=5), st.integers(1, 8))
def test_depth_is_counted_in_objects_and_arrays(body, limit):
    assert wire.is_deeper(body, limit) == (depth(body) > limit)


@pytest.mark.parametrize(
    "params",
    [
        None,
        {},
        {"_meta": None},
        {"_meta": "robot-acp/token"},
        {"_meta": {"robot-acp/token": "forged"}},
        {"_meta": {"robot-acp/token": "forged", "robot-acp/role": "supervisor", "robot-acp/": 1}},
        {"_meta": {"robot-acp/token": {"nested": "forged"}}},
    ],
)
def test_initialize_carries_the_verified_token_alone(params):
    body = {"jsonrpc": "2.0", "id": 1, "method": "initialize"} | ({} if params is None else {"params": params})
    line = with_identity(check(orjson.dumps(body)), "verified")
    assert orjson.loads(line) == body | {"params": {"_meta": {"robot-acp/token": "verified"}}}
    assert b"forged" not in line


def test_initialize_keeps_everything_else_that_the_client_sent():
    params = {
        "protocolVersion": 1,
        "clientCapabilities": {"_meta": {"robot-acp/telemetry": {"rate": 5}}},
        "_meta": {"other": [1, 2], "robot-acpx": 1},
    }
    body = {"jsonrpc": "2.0", "id": "a", "method": "initialize", "params": params}
    sent = orjson.loads(with_identity(check(orjson.dumps(body)), "t"))
    assert sent["params"]["clientCapabilities"] == params["clientCapabilities"]
    assert sent["params"]["_meta"] == {"other": [1, 2], "robot-acpx": 1, "robot-acp/token": "t"}
    assert body["params"]["_meta"] == {"other": [1, 2], "robot-acpx": 1}


def stream(*parts: bytes, limit: int = 100, end: bool = True) -> asyncio.StreamReader:
    reader = asyncio.StreamReader(limit=limit)
    for part in parts:
        reader.feed_data(part)
    if end:
        reader.feed_eof()
    return reader


async def test_lines_are_read_one_by_one_and_blank_ones_are_skipped():
    reader = stream(b"one\n\n  \r\n", b"tw", b"o\r\n\n", b"three\n")
    assert [await read_line(reader) for _ in range(4)] == [b"one", b"two", b"three", None]


async def test_a_last_line_without_its_newline_was_cut_off_and_is_no_message():
    reader = stream(b"one\n", b"tw")
    assert [await read_line(reader) for _ in range(2)] == [b"one", None]


async def test_a_line_of_exactly_the_limit_is_read_and_one_more_byte_is_too_much():
    reader = stream(b"a" * 100 + b"\n" + b"b" * 101 + b"\n" + b"after\n")
    assert await read_line(reader, 100) == b"a" * 100
    with pytest.raises(FrameTooLarge):
        await read_line(reader, 100)
    assert await read_line(reader, 100) == b"after"


@pytest.mark.parametrize("size", [101, 150, 200, 201, 5000, 100_000])
async def test_a_line_over_the_limit_is_skipped_and_the_stream_read_on(size):
    reader = stream(b"x" * size, b"\n", b"after\n")
    with pytest.raises(FrameTooLarge):
        await read_line(reader, 100)
    assert await read_line(reader, 100) == b"after"
    assert await read_line(reader, 100) is None


async def test_a_line_over_the_limit_that_never_ends_is_the_end_of_the_stream():
    reader = stream(b"x" * 5000)
    with pytest.raises(FrameTooLarge):
        await read_line(reader, 100)
    assert await read_line(reader, 100) is None


async def test_a_line_that_comes_in_pieces_is_waited_for():
    reader = stream(end=False)
    reading = asyncio.create_task(read_line(reader))
    for piece in (b"on", b"e", b"\n"):
        await asyncio.sleep(0)
        assert not reading.done()
        reader.feed_data(piece)
    assert await reading == b"one"


@pytest.mark.parametrize(
    ("head", "waits"),
    [
        (b'{"jsonrpc":"2.0","id":7,"result":{"a', ("response", 7)),
        (b'{"jsonrpc": "2.0", "id": "x\\u0041", "error": {"a', ("response", "xA")),
        (b'{"id":null,"jsonrpc":"2.0","result":', ("response", None)),
        (b'{"jsonrpc":"2.0","id":"p1","method":"session/request_permission"', ("request", "p1")),
        (b'{"jsonrpc":"2.0","method":"session/update","params":{"id":7,"result"', None),
        (b'{"jsonrpc":"2.0","result":{"id":7,"result":', None),
        (b'{"jsonrpc":"2.0","id":7.5,"result":', None),
        (b'{"jsonrpc":"2.0","id":"' + b"x" * 300 + b'","result":', None),
        (b'{"jsonrpc":"2.0","id":"\\q","result":', None),
        (b"", None),
        (b'{"id":' * 100_000, None),
        (b" " * 100_000, None),
    ],
)
def test_the_beginning_of_a_large_message_says_who_waits_for_it(head: bytes, waits: object) -> None:
    assert wire.who_waits(head) == waits
