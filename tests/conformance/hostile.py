"""Malformed and hostile frames, made from a few rules, and what the protocol says must come back.

A frame is bytes without a newline. `Expected.code` is the error code; None with `answered` is a result, and without it
the frame is ignored. `SESSION` in a frame stands for a session that exists.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

ID = 7
SESSION = "<session>"
PARSE_ERROR, INVALID_REQUEST, METHOD_NOT_FOUND, INVALID_PARAMS, AUTH_REQUIRED = -32700, -32600, -32601, -32602, -32000


@dataclass(frozen=True)
class Expected:
    """What must come back: an error under an id, a result, or nothing."""

    code: int | None = None
    id: Any = None
    answered: bool = True


RESULT = Expected(None, ID)
IGNORED = Expected(answered=False)
NO_JSON = Expected(PARSE_ERROR)
NO_MESSAGE = Expected(INVALID_REQUEST)


@dataclass(frozen=True)
class Hostile:
    """One frame, with a name for people."""

    name: str
    raw: bytes
    expected: Expected


def message(**members: Any) -> bytes:
    """A JSON-RPC message."""
    return json.dumps({"jsonrpc": "2.0"} | members).encode()


def request(method: str, params: Any, request_id: Any = ID) -> bytes:
    """A request."""
    return message(id=request_id, method=method, params=params)


LIST = request("session/list", {})

NOT_JSON: dict[str, bytes] = {
    "a brace": b"{",
    "two braces": b"{}}",
    "two messages": LIST + LIST,
    "half a message": LIST[:-9],
    "a word": b"hello",
    "HTTP": b"GET / HTTP/1.1",
    "a trailing comma": b'{"jsonrpc":"2.0","id":7,"method":"x",}',
    "single quotes": b"{'jsonrpc':'2.0'}",
    "a comment": b'{"jsonrpc":"2.0"/* */}',
    "NaN": b'{"jsonrpc":"2.0","id":NaN,"method":"x"}',
    "Infinity": b'{"jsonrpc":"2.0","id":7,"method":"x","params":{"a":Infinity}}',
    "a hexadecimal number": b'{"jsonrpc":"2.0","id":0x7,"method":"x"}',
    "a leading zero": b'{"jsonrpc":"2.0","id":07,"method":"x"}',
    "Python": b'{"jsonrpc":"2.0","id":None,"method":True}',
    "a NUL": b"\0",
    "many NULs": b"\0" * 4096,
    "a NUL before": b"\0" + LIST,
    "a NUL behind": LIST + b"\0",
    "a NUL within": LIST.replace(b"session/list", b"session\0list"),
    "a tab within a string": LIST.replace(b"session/list", b"session\tlist"),
    "an escape character": b"\x1b[2J" + LIST,
    "a byte order mark": b"\xef\xbb\xbf" + LIST,
    "UTF-16": LIST.decode().encode("utf-16-le"),
    "a byte that is no UTF-8": b"\xff",
    "UTF-8 cut short": b'{"jsonrpc":"2.0","id":7,"method":"\xe2\x82"}',
    "overlong UTF-8": b'{"jsonrpc":"2.0","id":7,"method":"\xc0\xaf"}',
    "a surrogate in UTF-8": b'{"jsonrpc":"2.0","id":7,"method":"\xed\xa0\x80"}',
    "half a surrogate pair": b'{"jsonrpc":"2.0","id":7,"method":"\\ud800"}',
    "an unknown escape": b'{"jsonrpc":"2.0","id":7,"method":"\\x41"}',
    "latin-1": '{"jsonrpc":"2.0","id":7,"method":"é"}'.encode("latin-1"),
    "random bytes": bytes((i * 151 + 7) % 256 for i in range(4096)).replace(b"\n", b"\0").replace(b"\r", b"\0"),
    "5000 brackets": b"[" * 5000,
    "100000 brackets": b"[" * 100_000 + b"]" * 100_000,
    "20000 objects": b'{"a":' * 20_000 + b"1" + b"}" * 20_000,
    # Within the grammar, and beyond what a parser can hold.
    "an id of 1000 digits": message(id=int("9" * 1000), method="session/list"),
    "a megabyte of nothing": b'"' + b"a" * 1_000_000,
}

NOT_A_MESSAGE: dict[str, bytes] = {
    "an empty list": b"[]",
    "a list of nothing": b"[null]",
    "a batch": b"[" + LIST + b"]",
    "a batch of two": b"[" + LIST + b"," + LIST + b"]",
    "a string": b'"hello"',
    "an empty string": b'""',
    "a number": b"42",
    "a fraction": b"-0.5",
    "true": b"true",
    "null": b"null",
    "an empty object": b"{}",
    "no version": b'{"method":"session/list"}',
    "100 brackets": b"[" * 100 + b"]" * 100,
    "an id that is a list": message(id=[], method="session/list"),
    "an id that is an object": message(id={}, method="session/list"),
    "an id that is true": message(id=True, method="session/list"),
    "an id that is a fraction": message(id=1.5, method="session/list"),
    "an id beyond 64 bits": message(id=10**30, method="session/list"),
    "an id far below 64 bits": message(id=-(10**40), method="session/list"),
    "an id of 300 characters": message(id="a" * 300, method="session/list"),
    "an id of a megabyte": message(id="a" * 1_000_000, method="session/list"),
    "a nested id": message(id=[[[[]]]], method="session/list"),
    "an id in an answer that is an object": message(id={}, result={}),
    "nothing but a version": message(),
    "params alone": message(params={}),
    "an error without an id": message(error={"code": 1, "message": "x"}),
    "a result without an id": message(result={}),
}

WITH_ITS_ID: dict[str, bytes] = {
    "version 1.0": message(jsonrpc="1.0", id=ID, method="session/list"),
    "version 2": message(jsonrpc=2, id=ID, method="session/list"),
    "no version at all": b'{"id":7,"method":"session/list"}',
    "version null": message(jsonrpc=None, id=ID, method="session/list"),
    "a version that is a list": message(jsonrpc=["2.0"], id=ID, method="session/list"),
    "a method that is a number": message(id=ID, method=5),
    "a method that is null": message(id=ID, method=None),
    "a method that is a list": message(id=ID, method=["session/list"]),
    "a method that is an object": message(id=ID, method={"name": "session/list"}),
    "a method that is true": message(id=ID, method=True),
    "an id alone": message(id=ID),
    "a result and an error": message(id=ID, result={}, error={"code": 1, "message": "x"}),
}

UNKNOWN_METHODS = (
    "$/cancel_request",
    *("", " ", "/", "session", "session/", "session/nonsense", "Session/List", "session/list ", "session//list"),
    *(
        "../session/list",
        "session/list\0",
        "\0",
        "initialize\n",
        "rpc.discover",
        "$/nonsense",
        "$/ping",
        "_",
        "__class__",
    ),
    *(
        "__init__",
        "_robot",
        "_robot/",
        "_robot/nonsense",
        "_robot/../stop",
        "_robot/stop/",
        "robot/stop",
        "robot/release",
    ),
    *(
        "new_session",
        "ext_method",
        "set_config_option",
        "router",
        "😀",
        "a" * 100_000,
        "%s%n",
        "{0.__class__}",
        "'; DROP TABLE",
    ),
    # A client's methods, and methods of the protocol that are notifications, are no requests to an agent.
    *("session/update", "session/request_permission", "session/cancel", "fs/read_text_file", "fs/write_text_file"),
    *(
        "terminal/create",
        "terminal/output",
        "elicitation/create",
        "elicitation/complete",
        "mcp/message",
    ),
)

IGNORED_FRAMES: dict[str, bytes] = {
    "an unknown notification": message(method="nonsense", params={}),
    "an unknown notification of nobody": message(method="_nonsense/x", params={}),
    "an unknown notification of ours": message(method="_robot/nonsense", params={}),
    "a notification with a list": message(method="session/cancel", params=[]),
    "a notification with a number": message(method="session/cancel", params=5),
    "a notification with a string": message(method="session/cancel", params="x"),
    "a request as a notification": message(method="session/new", params={"cwd": "/", "mcpServers": []}),
    "a prompt as a notification": message(method="session/prompt", params={"sessionId": SESSION, "prompt": []}),
    "initialize as a notification": message(method="initialize", params={"protocolVersion": 1}),
    "a stop as a notification": message(method="_robot/stop", params={}),
    "cancel without a session": message(method="session/cancel", params={}),
    "cancel of nothing": message(method="session/cancel"),
    "cancel of no session": message(method="session/cancel", params={"sessionId": "nonsense"}),
    "cancel of a list": message(method="session/cancel", params={"sessionId": [SESSION]}),
    "cancel of an idle session": message(method="session/cancel", params={"sessionId": SESSION}),
    "cancel_request of nothing": message(method="$/cancel_request"),
    "cancel_request without an id": message(method="$/cancel_request", params={}),
    "cancel_request of null": message(method="$/cancel_request", params={"requestId": None}),
    "cancel_request of a list": message(method="$/cancel_request", params={"requestId": []}),
    "cancel_request of an object": message(method="$/cancel_request", params={"requestId": {"a": [1]}}),
    "cancel_request of the past": message(method="$/cancel_request", params={"requestId": ID}),
    "cancel_request of a question": message(method="$/cancel_request", params={"requestId": "p1"}),
    "cancel_request with a list": message(method="$/cancel_request", params=[ID]),
    "an answer to nothing": message(id="p999", result={}),
    "an answer to null": message(id=None, result={}),
    "an answer to a number": message(id=1, result={"outcome": {"outcome": "selected", "optionId": "allow_once"}}),
    "an answer that is null": message(id="p1", result=None),
    "an error to nothing": message(id="p999", error={"code": -1, "message": "x"}),
    "an error that is a string": message(id="p1", error="x"),
    "an error that is a list": message(id="p1", error=[]),
    "an error without a code": message(id="p1", error={}),
}

_CWD: dict[str, Any] = {"cwd": "/"}
_IN: dict[str, Any] = {"sessionId": SESSION}
_TEXT = {"type": "text", "text": "where are you?"}

REQUIRED: dict[str, dict[str, Any]] = {
    "initialize": {"protocolVersion": 1},
    "authenticate": {"methodId": "token"},
    "session/new": _CWD | {"mcpServers": []},
    "session/load": _IN | _CWD | {"mcpServers": []},
    "session/resume": _IN | _CWD,
    "session/fork": _IN | _CWD,
    "session/close": _IN,
    "session/delete": _IN,
    "session/prompt": _IN | {"prompt": [_TEXT]},
    "session/set_mode": _IN | {"modeId": "supervised"},
    "session/set_config_option": _IN | {"configId": "mode", "value": "supervised"},
    "session/set_model": _IN | {"modelId": "offline/commands"},
}
"""Every method with the params that it cannot do without."""

WRONG_VALUES: dict[str, Any] = {"null": None, "a number": 3.5, "an object": {"a": 1}, "a list of lists": [[]]}

WRONG_PARAMS: dict[str, tuple[str, Any]] = {
    "a version that is negative": ("initialize", {"protocolVersion": -1}),
    "a version that is huge": ("initialize", {"protocolVersion": 10**12}),
    "an unknown way to authenticate": ("authenticate", {"methodId": "password"}),
    "authenticate without a token": ("authenticate", {"methodId": "token"}),
    "a token that is a number": ("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": 5}}),
    "a cursor that is a number": ("session/list", {"cursor": 5}),
    "a cursor that is a list": ("session/list", {"cursor": []}),
    "servers that are a string": ("session/new", _CWD | {"mcpServers": "x"}),
    "servers that are an object": ("session/new", _CWD | {"mcpServers": {}}),
    "a server that is a command": (
        "session/new",
        _CWD | {"mcpServers": [{"name": "x", "command": "/bin/sh", "args": ["-c", "id"], "env": []}]},
    ),
    "a server with a command on load": (
        "session/load",
        _IN | _CWD | {"mcpServers": [{"name": "x", "command": "/bin/sh", "args": [], "env": []}]},
    ),
    "a session that is not there": ("session/load", _CWD | {"sessionId": "nonsense", "mcpServers": []}),
    "a session that is a path": ("session/load", _CWD | {"sessionId": "../../etc/passwd", "mcpServers": []}),
    "a session that is SQL": ("session/load", _CWD | {"sessionId": "' OR '1'='1", "mcpServers": []}),
    "a session that is a NUL": ("session/load", _CWD | {"sessionId": "\0", "mcpServers": []}),
    "a session that is a megabyte": ("session/load", _CWD | {"sessionId": "a" * 1_000_000, "mcpServers": []}),
    "an empty session": ("session/close", {"sessionId": ""}),
    "a fork of nothing": ("session/fork", _CWD | {"sessionId": "nonsense"}),
    "a delete of nothing": ("session/delete", {"sessionId": "nonsense"}),
    "a prompt to nothing": ("session/prompt", {"sessionId": "nonsense", "prompt": [_TEXT]}),
    "a prompt of nothing": ("session/prompt", _IN | {"prompt": []}),
    "a prompt that is a string": ("session/prompt", _IN | {"prompt": "where are you?"}),
    "a prompt of strings": ("session/prompt", _IN | {"prompt": ["where are you?"]}),
    "a prompt of nulls": ("session/prompt", _IN | {"prompt": [None]}),
    "a block without a type": ("session/prompt", _IN | {"prompt": [{"text": "x"}]}),
    "a block of an unknown type": ("session/prompt", _IN | {"prompt": [{"type": "nonsense", "text": "x"}]}),
    "a block whose type is a list": ("session/prompt", _IN | {"prompt": [{"type": ["text"], "text": "x"}]}),
    "a text block without text": ("session/prompt", _IN | {"prompt": [{"type": "text"}]}),
    "a text block with a number": ("session/prompt", _IN | {"prompt": [{"type": "text", "text": 5}]}),
    "an image without data": ("session/prompt", _IN | {"prompt": [{"type": "image", "mimeType": "image/png"}]}),
    "an image that is a number": (
        "session/prompt",
        _IN | {"prompt": [{"type": "image", "mimeType": "image/png", "data": 5}]},
    ),
    "a resource that is nothing": ("session/prompt", _IN | {"prompt": [{"type": "resource"}]}),
    "a resource that is empty": ("session/prompt", _IN | {"prompt": [{"type": "resource", "resource": {}}]}),
    "a link without a name": ("session/prompt", _IN | {"prompt": [{"type": "resource_link", "uri": "x:y"}]}),
    "a good block and a bad one": ("session/prompt", _IN | {"prompt": [_TEXT, 5]}),
    "a mode that is not there": ("session/set_mode", _IN | {"modeId": "root"}),
    "a mode of another case": ("session/set_mode", _IN | {"modeId": "Autonomous"}),
    "a mode that is a megabyte": ("session/set_mode", _IN | {"modeId": "a" * 1_000_000}),
    "an option that is not there": ("session/set_config_option", _IN | {"configId": "owner", "value": "x"}),
    "an option that is private": ("session/set_config_option", _IN | {"configId": "__class__", "value": "x"}),
    "an option with a wrong value": ("session/set_config_option", _IN | {"configId": "mode", "value": "root"}),
    "a switch that is a word": ("session/set_config_option", _IN | {"configId": "thought", "value": "yes"}),
    "a choice that is a switch": (
        "session/set_config_option",
        _IN | {"configId": "mode", "type": "boolean", "value": True},
    ),
    "a model that is not there": ("session/set_model", _IN | {"modelId": "openai/gpt-4o"}),
    "an event that is negative": ("session/resume", _IN | _CWD | {"_meta": {"robot-acp/after": -1}}),
    "an event that is a word": ("session/resume", _IN | _CWD | {"_meta": {"robot-acp/after": "1"}}),
    "an event that is true": ("session/resume", _IN | _CWD | {"_meta": {"robot-acp/after": True}}),
}

SNEAKY: dict[str, Any] = {
    "our parameters": {
        "cwd": "/sneaky",
        "sessionId": "x",
        "session_id": "x",
        "modeId": "autonomous",
        "mode_id": "root",
    },
    "our arguments": {
        "self": 1,
        "meta": {"a": 1},
        "field_meta": {},
        "kwargs": {},
        "params": {},
        "method": "x",
        "args": [],
    },
    "other parameters": {
        "mcp_servers": [{"command": "/bin/sh"}],
        "config_id": "mode",
        "value": "autonomous",
        "prompt": [],
    },
    "a role": {
        "robot-acp/role": "supervisor",
        "robot-acp/name": "root",
        "role": "supervisor",
        "identity": {"name": "root"},
    },
    "a token": {"robot-acp/token": "eyJhbGciOiJub25lIn0.eyJyb2xlIjoic3VwZXJ2aXNvciJ9."},
    "a number of an event": {"robot-acp/seq": 10**9, "robot-acp/turn": {"state": "ended"}, "robot-acp/by": "root"},
    "Python": {"__class__": "x", "__init__": {}, "__dict__": {"a": 1}, "": None, "1": 2},
    "depth": {"a": {"b": {"c": {"d": [[[[[[[[{"e": {}}]]]]]]]]}}}},
    "three thousand keys": {f"k{i}": i for i in range(3_000)},
    "a number instead": 5,
    "a list instead": [],
    "a string instead": "robot-acp/token",
}
HARMLESS: dict[str, dict[str, Any]] = {
    "initialize": {"protocolVersion": 1},
    "session/new": _CWD | {"mcpServers": []},
    "session/list": {},
    "session/set_mode": _IN | {"modeId": "supervised"},
    "session/set_config_option": _IN | {"configId": "thought", "type": "boolean", "value": True},
}
"""Methods that answer with a result whatever `_meta` holds."""


def _wrong_types() -> Iterator[Hostile]:
    """Each required parameter of each method: left out, and of each wrong type.

    The official SDK is lenient in two places, and the agent with it: a version that is no number counts as the first
    one, because clients in the field send dates, and what is no MCP server is skipped.
    """
    expected = Expected(INVALID_PARAMS, ID)
    for method, good in REQUIRED.items():
        yield Hostile(f"{method} with a list", request(method, []), expected)
        yield Hostile(f"{method} with a string", request(method, "x"), expected)
        for name in good:
            rest = {key: value for key, value in good.items() if key != name}
            yield Hostile(f"{method} without {name}", request(method, rest), expected)
            for what, value in WRONG_VALUES.items():
                lenient = name == "protocolVersion" or (name, what) == ("mcpServers", "a list of lists")
                raw = request(method, rest | {name: value})
                yield Hostile(f"{method} with {what} as {name}", raw, RESULT if lenient else expected)


def frames() -> list[Hostile]:
    """All of them."""
    deep: Any = 1
    for _ in range(500):
        deep = {"a": deep}
    made = [
        *(Hostile(name, raw, NO_JSON) for name, raw in NOT_JSON.items()),
        *(Hostile(name, raw, NO_MESSAGE) for name, raw in NOT_A_MESSAGE.items()),
        *(Hostile(name, raw, Expected(INVALID_REQUEST, ID)) for name, raw in WITH_ITS_ID.items()),
        *(
            Hostile(f"the method {name[:30]!r}", request(name, {}), Expected(METHOD_NOT_FOUND, ID))
            for name in UNKNOWN_METHODS
        ),
        *(Hostile(name, raw, IGNORED) for name, raw in IGNORED_FRAMES.items()),
        *(
            Hostile(name, request(method, params), Expected(INVALID_PARAMS, ID))
            for name, (method, params) in WRONG_PARAMS.items()
        ),
        *_wrong_types(),
        *(
            Hostile(f"{method} whose _meta is {what}", request(method, params | {"_meta": meta}), RESULT)
            for method, params in HARMLESS.items()
            for what, meta in SNEAKY.items()
        ),
        Hostile("a forged token", request("authenticate", {"methodId": "token", "_meta": SNEAKY["a token"]}),
                Expected(AUTH_REQUIRED, ID)),
        Hostile("500 levels", request("session/list", deep), NO_MESSAGE),
        Hostile("a null id", request("session/list", {}, None), Expected(None, None)),
        Hostile("the largest id", request("session/list", {}, 2**63 - 1), Expected(None, 2**63 - 1)),
        Hostile("the smallest id", request("session/list", {}, -(2**63)), Expected(None, -(2**63))),
        Hostile("an id with a NUL", request("session/list", {}, "\0"), Expected(None, "\0")),
        Hostile("params that are null", request("session/list", None), RESULT),
        Hostile("members that nobody knows", message(id=ID, method="session/list", params={"x": 1}, y=[]), RESULT),
        Hostile("a cursor of nonsense", request("session/list", {"cursor": "%%%"}), RESULT),
        Hostile("take over from nobody", request("_robot/take_over", {"sessionId": [5]}), RESULT),
        Hostile("release with rubbish", request("_robot/release", {"by": "root", "self": 1}), RESULT),
    ]  # fmt: skip
    assert len({frame.name for frame in made}) == len(made)
    assert not any(b"\n" in frame.raw for frame in made)
    return made
