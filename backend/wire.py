"""Checks JSON-RPC frames from outside. Nothing may use such a frame before it has passed `check`.

Plain functions over bytes, without sockets or a clock. A checked frame is one JSON-RPC 2.0 message of bounded size and
depth. `Frame.raw` is passed on as it arrived and must never be serialised again.
"""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import orjson

from backend import meta as keys

MAX_FRAME_BYTES = 16 * 1024 * 1024
MAX_SHORT_FRAME_BYTES = 1024 * 1024
"""Of a login that may not approve, such as a visitor's. A message of 16 MB keeps everybody waiting for 0.1 s."""
MAX_DEPTH = 64
MAX_ID_CHARS = 256

PARSE_ERROR = -32700
INVALID_REQUEST = -32600
METHOD_NOT_FOUND = -32601
INVALID_PARAMS = -32602
INTERNAL_ERROR = -32603
AUTH_REQUIRED = -32000
NOT_ALLOWED = -32001
LIMIT_EXCEEDED = -32005
CANCELLED = -32800

HEALTH = "_robot/health"
"""The one request that the agent answers before `initialize`: its event loop runs, and it reads what it is sent."""

UNREADABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
"""What msgspec raises for bytes that it cannot decode: text that is no UTF-8 and deep nesting have their own errors."""

RequestId = str | int | None
Kind = Literal["request", "notification", "response"]


class BadFrame(Exception):
    """The frame is no JSON-RPC message; `reply` is the error response to it, None where it gets no answer."""

    def __init__(self, code: int, message: str, request_id: RequestId = None, *, answer: bool = True) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.reply = error_frame(request_id, code, message) if answer else None


class FrameTooLarge(BadFrame):
    """The frame exceeds the limit. In a stream it was skipped, and the next frame can be read."""

    def __init__(self, limit: int) -> None:
        super().__init__(INVALID_REQUEST, f"The message is larger than {limit} bytes.")


@dataclass(frozen=True, slots=True)
class Frame:
    """A checked message. `method` is None for a response; `body` is the parsed object, `raw` its bytes."""

    kind: Kind
    method: str | None
    id: RequestId
    body: dict[str, Any]
    raw: bytes


_HEAD = re.compile(
    rb'\s{0,8}\{\s{0,8}(?:"jsonrpc"\s{0,8}:\s{0,8}"2\.0"\s{0,8},\s{0,8})?"id"\s{0,8}:\s{0,8}'
    rb'("(?:[^"\\]|\\.){0,256}"|-?[0-9]{1,19}|null)\s{0,8},\s{0,8}'
    rb'(?:"jsonrpc"\s{0,8}:\s{0,8}"2\.0"\s{0,8},\s{0,8})?"(result|error|method)"'
)


def who_waits(head: bytes) -> tuple[Kind, RequestId] | None:
    """Whether the beginning of a message that is too large is that of a request or of a response, and its id, so that
    whoever waits for it can be sent an error. None where the beginning does not say so."""
    found = _HEAD.match(head[:2048])
    if found is None:
        return None
    try:
        request_id = orjson.loads(found[1])
    except orjson.JSONDecodeError:
        return None
    return ("request" if found[2] == b"method" else "response", request_id) if valid_id(request_id) else None


def error_frame(request_id: RequestId, code: int, message: str) -> bytes:
    """A JSON-RPC error response, without a newline."""
    return orjson.dumps({"jsonrpc": "2.0", "id": request_id, "error": {"code": code, "message": message}})


def check(raw: bytes, limit: int = MAX_FRAME_BYTES) -> Frame:
    """Check one message of at most `limit` bytes. Raises `BadFrame` with the error that JSON-RPC 2.0 requires."""
    if len(raw) > limit:
        raise FrameTooLarge(limit)
    try:
        body = orjson.loads(raw)
    except orjson.JSONDecodeError:  # also raised for more than 1024 levels, which orjson refuses
        raise BadFrame(PARSE_ERROR, "The message is not valid JSON in UTF-8.") from None
    if not isinstance(body, dict):
        raise BadFrame(INVALID_REQUEST, "A message must be one JSON object; batches are not supported.")
    if raw.count(b"[") + raw.count(b"{") > MAX_DEPTH and is_deeper(body, MAX_DEPTH):
        raise BadFrame(INVALID_REQUEST, f"The message is nested deeper than {MAX_DEPTH} levels.")
    return _shape(body, raw)


def _shape(body: dict[str, Any], raw: bytes) -> Frame:
    request_id = body.get("id")
    known_id = request_id if valid_id(request_id) else None
    if body.get("jsonrpc") != "2.0":
        raise BadFrame(INVALID_REQUEST, 'A message must say "jsonrpc": "2.0".', known_id)
    if "id" in body and not valid_id(request_id):
        raise BadFrame(INVALID_REQUEST, "An id must be a string, an integer or null.")
    if "method" in body:
        method = body["method"]
        if not isinstance(method, str):
            raise BadFrame(INVALID_REQUEST, "The method must be a string.", known_id)
        params = body.get("params")
        if params is not None and not isinstance(params, dict):
            is_request = "id" in body
            raise BadFrame(INVALID_PARAMS, "The params must be an object.", known_id, answer=is_request)
        return Frame("request" if "id" in body else "notification", method, request_id, body, raw)
    if "id" in body and ("result" in body) != ("error" in body):
        if "error" in body and not isinstance(body["error"], dict):
            raise BadFrame(INVALID_REQUEST, "The error must be an object.", answer=False)
        return Frame("response", None, request_id, body, raw)
    raise BadFrame(INVALID_REQUEST, "A message must have a method, or an id with a result or an error.", known_id)


def valid_id(value: object) -> bool:
    """Whether this is a valid request id: null, an integer, or a string of at most `MAX_ID_CHARS` characters."""
    if isinstance(value, bool):
        return False
    return value is None or isinstance(value, int) or (isinstance(value, str) and len(value) <= MAX_ID_CHARS)


def is_deeper(body: dict[str, Any], limit: int) -> bool:
    """Whether objects and arrays nest deeper than `limit`, one level at a time."""
    level: list[Any] = [body]
    for _ in range(limit):
        level = [
            value
            for container in level
            for value in (container.values() if type(container) is dict else container)
            if type(value) is dict or type(value) is list
        ]
        if not level:
            return False
    return True


def with_identity(frame: Frame, token: str) -> bytes:
    """An `initialize` frame with the verified token in `_meta`. Other `robot-acp/` keys of the client are removed."""
    params = dict(frame.body.get("params") or {})
    meta = params.get("_meta")
    kept = {k: v for k, v in meta.items() if not k.startswith(keys.PREFIX)} if isinstance(meta, dict) else {}
    params["_meta"] = kept | {keys.TOKEN: token}
    return orjson.dumps(frame.body | {"params": params})


async def read_line(reader: asyncio.StreamReader, limit: int = MAX_FRAME_BYTES, *, skip: bool = True) -> bytes | None:
    """The next line of an NDJSON stream without its newline; None at its end. Empty lines are skipped.

    Raises `FrameTooLarge` for a line of more than `limit` bytes, after skipping it: the next call reads the next line.
    Without `skip` it is raised at once, and the stream cannot be read any further. The reader's own limit may be
    smaller: it says how much of a line is read at a time.
    """
    while True:
        line = await _read_line(reader, limit, skip)
        if line is None or (line := line.strip()):
            return line


async def _read_line(reader: asyncio.StreamReader, limit: int, skip: bool) -> bytes | None:
    """The next line with its newline; None at the end. Of one that is too long, no more than `limit` bytes are kept."""
    pieces: list[bytes] = []
    size = 0
    while True:
        try:
            piece = await reader.readuntil(b"\n")
        except asyncio.IncompleteReadError:
            if size > limit:
                raise FrameTooLarge(limit) from None
            return None  # a last line without a newline is incomplete
        except asyncio.LimitOverrunError as overrun:
            piece = await reader.readexactly(max(overrun.consumed, 1))  # there already
        size += len(piece)
        is_whole = piece.endswith(b"\n")
        if size - is_whole > limit:
            pieces.clear()
            if is_whole or not skip:
                raise FrameTooLarge(limit)
            continue
        pieces.append(piece)
        if is_whole:
            return pieces[0] if len(pieces) == 1 else b"".join(pieces)
