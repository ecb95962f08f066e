"""Every parser of a stranger's bytes, with valid inputs to begin with: from the wire, from headers, from files."""

from __future__ import annotations

import asyncio
import json
import tempfile
from pathlib import Path
from typing import Any

import msgspec
from acp.exceptions import RequestError
from acp.schema import NewSessionRequest, PromptRequest
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request

from backend import dial, telemetry, tokens, wire
from backend.agent.acp import content_limits, settings
from backend.agent.offline import grammar, places
from backend.agent.robot.server_addresses import Address, AllowList, ServerRefused
from backend.bridge.line_splitter import LineSplitter
from backend.bridge.login import Authenticator, LoginError
from backend.bridge.origin import OriginError, OriginPolicy
from backend.bridge.scene import control_socket, viser_internals
from backend.bridge.scene.ticket import SceneTickets
from backend.chat.question import Question
from backend.chat.status import Status
from backend.chat.view import View
from backend.config import Storage
from backend.identity import Role
from backend.lifetimes import lifetime
from backend.mcp_robot.http.access import Access
from backend.mcp_robot.http.name_in_body import name_in_body
from backend.tokens import Registry, RegistryError
from backend.visible import visible
from tests.fuzz.engine import Parser

_FOLDER = tempfile.TemporaryDirectory(prefix="robot-acp-fuzz-")
DATA = Path(_FOLDER.name)
TOKEN = tokens.create(DATA, "Ana", Role.VISITOR, 3600.0)
REGISTRY = Registry(DATA)
ACCESS = Access(Starlette(), b"t" * 40, "127.0.0.1")
ALLOWED = AllowList(["http://lab.example:8000/mcp"])
STORAGE = Storage()
AUTHENTICATOR = Authenticator(REGISTRY, OriginPolicy("127.0.0.1", ["https://robot.example"]))
TICKETS = SceneTickets(AUTHENTICATOR, DATA)
ANA = REGISTRY.verify(TOKEN)
SPLIT_LIMIT = 1_000


def _json(*values: Any) -> tuple[bytes, ...]:
    return tuple(json.dumps(value).encode() for value in values)


def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace")


def _frame(data: bytes) -> object:
    frame = wire.check(data)
    return wire.with_identity(frame, "token") if frame.method == "initialize" else frame


def _split(data: bytes) -> None:
    """Whatever the pieces are, the lines are the same, and nothing longer than the limit is kept."""
    whole, pieces = LineSplitter(SPLIT_LIMIT), LineSplitter(SPLIT_LIMIT)
    expected = whole.feed(data)
    size = 1 + (data[0] if data else 0)
    got = [line for at in range(0, len(data), size) for line in pieces.feed(data[at : at + size])]
    assert got == expected
    assert all(len(line) <= SPLIT_LIMIT + 1 for line in got)
    assert pieces.kept_bytes <= SPLIT_LIMIT + 1


def _read_line(data: bytes) -> None:
    async def read() -> None:
        reader = asyncio.StreamReader(limit=SPLIT_LIMIT + 1)
        reader.feed_data(data)
        reader.feed_eof()
        while True:
            try:
                if await wire.read_line(reader, SPLIT_LIMIT) is None:
                    return
            except wire.FrameTooLarge:
                continue

    asyncio.run(read())


def _headers(data: bytes) -> list[tuple[bytes, bytes]]:
    """Lines `name: value`, as an HTTP server hands them over: names in lower case, values without their ends."""
    pairs = (line.partition(b":") for line in data.split(b"\n"))
    return [(name.strip().lower(), value.strip()) for name, _, value in pairs]


def _connection(data: bytes) -> HTTPConnection:
    first, _, rest = data.partition(b"\n")
    path = _text(first)
    scope = {"type": "http", "method": "POST", "path": path, "raw_path": first, "query_string": b"", "scheme": "http"}
    scope |= {"headers": _headers(rest), "subprotocols": path.split(","), "server": ("127.0.0.1", 80)}
    return HTTPConnection(scope)


def _bridge_login(data: bytes) -> None:
    try:
        AUTHENTICATOR.admit(_connection(data))
    except (LoginError, OriginError):
        AUTHENTICATOR.authenticate(_connection(data))


def _robot_access(data: bytes) -> None:
    headers = Headers(raw=_headers(data))
    assert ACCESS._refusal(headers) is not None or b"t" * 40 in data


def _offers(data: bytes) -> None:
    request = NewSessionRequest.model_validate(json.loads(data))
    for offer in ALLOWED.read(request.mcp_servers, role="supervisor", may_offer=True):
        assert any(allowed.covers(Address.parse(offer.url)) for allowed in ALLOWED._allowed)


def _address(data: bytes) -> None:
    address = Address.parse(_text(data))
    assert Address.parse(str(address)) == address


def _prompt(data: bytes) -> None:
    PromptRequest.model_validate(json.loads(data))


def _view(data: bytes) -> None:
    view = View("Sancho")
    for line in data.split(b"\n"):
        update = wire.check(line).body.get("params")
        if isinstance(update, dict):
            view.apply(update)
    view.flush()


def _status(data: bytes) -> None:
    status = Status()
    status.apply(json.loads(data))
    assert status.line


def _question(data: bytes) -> None:
    question = Question.of(wire.check(data).body.get("params") or {})
    assert question.text("Sancho").count("\n") == 1
    for key in question.options:
        assert question.choices
        assert question.selected(key) is not None


def _limits(data: bytes) -> None:
    frame = wire.check(data)
    content_limits.check(frame.method or "", frame.body.get("params") or {}, STORAGE)


def _ticket(data: bytes) -> None:
    assert TICKETS._read(_connection(b"/scene/a"), _text(data), "a") == ANA


def _name_in_body(data: bytes) -> None:
    async def receive() -> dict[str, object]:
        return {"type": "http.request", "body": data, "more_body": False}

    name = asyncio.run(name_in_body(Request({"type": "http", "method": "POST"}, receive)))
    assert name is None or isinstance(name, str)


def _registry(data: bytes) -> None:
    folder = Path(tempfile.mkdtemp(dir=DATA))
    (folder / tokens.REGISTRY).write_bytes(data)
    try:
        for record in tokens.records(folder):
            assert record.state
    finally:
        (folder / tokens.REGISTRY).unlink()
        folder.rmdir()


def _visible(data: bytes) -> None:
    text = _text(data)
    assert visible(visible(text)) == visible(text)
    assert "\x1b" not in visible(text, lines=True)


UPDATES = (
    {"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": "Hi.\n"}},
    {"sessionUpdate": "tool_call", "toolCallId": "t", "title": "Drive", "status": "pending"},
    {"sessionUpdate": "tool_call_update", "toolCallId": "t", "status": "failed", "content": [
        {"type": "content", "content": {"type": "text", "text": "no"}}]},
    {"sessionUpdate": "plan", "entries": [{"content": "go", "status": "pending", "priority": "medium"}]},
    {"sessionUpdate": "user_message_chunk", "content": {"type": "text", "text": "go"},
     "_meta": {"robot-acp/by": "Ana"}},
    {"sessionUpdate": "session_info_update", "title": "a", "_meta": {"robot-acp/turn": {"state": "ended"}}},
    {"sessionUpdate": "current_mode_update", "currentModeId": "observe"},
)  # fmt: skip
NOTICES = [{"jsonrpc": "2.0", "method": "session/update", "params": update} for update in UPDATES]
STATE = {
    "robot": "Sancho", "online": True, "pose": {"x": 1.0, "y": 2.0, "yaw": 0.5}, "twist": {"linear": 0.1, "angular": 0},
    "battery": {"level": 0.9, "charging": False, "floor": 0.1}, "stop": {"by": "Ana", "at": 1.0}, "speaking": "Hi",
    "turn": {"by": "Ana"}, "motion": None, "halted": None,
}  # fmt: skip
REQUEST = b"/acp\nhost: 127.0.0.1:8080\norigin: http://127.0.0.1:8080\n"

PARSERS = [
    Parser(
        "frames (wire)",
        _frame,
        _json(
            {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": {"_meta": {"robot-acp/token": "a", "b": 1}}},
            {"jsonrpc": "2.0", "method": "session/cancel", "params": {"sessionId": "s"}},
            {"jsonrpc": "2.0", "id": "p1", "result": {}},
            {"jsonrpc": "2.0", "id": None, "error": {"code": -1, "message": "no"}},
        ),
        (wire.BadFrame,),
    ),
    Parser("lines of a stream (bridge)", _split, (b"\x03a\nb\n\n" + b"c" * 1_500 + b"\nd", b"\x00\r\n \n")),
    Parser("lines of a stream (agent)", _read_line, (b"a\nb\n\n" + b"c" * 1_500 + b"\nd", b"\r\n \n" * 10)),
    Parser(
        "logins, cookies, origins (bridge)",
        _bridge_login,
        (
            REQUEST + f"authorization: Bearer {TOKEN}".encode(),
            REQUEST + f'cookie: a=b; robot_acp={TOKEN}; c="d\\"'.encode(),
            f"/acp,bearer.{TOKEN}\nhost: localhost\norigin: null".encode(),
        ),
        (LoginError, OriginError, RegistryError),
    ),
    Parser(
        "access to the robot server",
        _robot_access,
        (b"host: localhost:8000\nauthorization: Bearer " + b"t" * 40, b"host: [::1]\norigin: http://a", b"host: a:b"),
    ),
    Parser(
        "MCP servers that a client offers",
        _offers,
        _json(
            {"cwd": "/", "mcpServers": [{"type": "http", "name": "a", "url": "http://lab.example:8000/mcp/a",
                                         "headers": [{"name": "X-Key", "value": "1"}]}]},
            {"cwd": "/", "mcpServers": [{"name": "a", "command": "sh", "args": [], "env": []}]},
        ),
        (ServerRefused, ValidationError, ValueError, RecursionError),
    ),
    Parser("addresses of MCP servers", _address, (b"http://lab.example:8/mcp/", b"https://[::1]/a//b"), (ValueError,)),
    Parser(
        "prompts",
        _prompt,
        _json({"sessionId": "s", "prompt": [
            {"type": "text", "text": "a"}, {"type": "image", "data": "", "mimeType": "a"},
            {"type": "resource_link", "uri": "a", "name": "b"}]}),
        (ValidationError, ValueError, RecursionError),
    ),
    Parser("words of a person (offline model)", lambda data: grammar.parse(_text(data)), (
        b"go to lab 2.3.7 and tell them that 'the meeting is at noon', then come back", b"ve a la cocina y di que hola",
        b"turn left by 30 degrees; drive to x 1.5 y -2e3",
    )),
    Parser(
        "the map of a tool (offline model)",
        lambda data: [places.find(node.name, [node]) for node in places.read_map(_text(data))],
        _json({"nodes": [{"id": "a", "name": "the desk", "type": "space", "position": {"x": 1, "y": 2, "yaw": 0}}]}),
    ),
    Parser("cursors", lambda data: settings.read_cursor(_text(data)), (b"MTIuNSBhYg==", b"", b"MQ=="), (RequestError,)),
    Parser(
        "telemetry of a robot server",
        telemetry.decode,
        (
            telemetry.encode(telemetry.Speech(1.0, "Hi.", True)),
            telemetry.encode(telemetry.Path(1.0, [(0.0, 0.0), (1.0, 1.0)], None)),
        ),
        (msgspec.MsgspecError,),
    ),
    Parser(
        "subscriptions to telemetry",
        telemetry.decode_subscribe,
        (telemetry.encode(telemetry.Subscribe(["state", "map"], rate=10.0)),),
        (msgspec.MsgspecError,),
    ),
    Parser("messages of a scene's page", viser_internals.decode, (
        msgspec.msgpack.encode({"type": "ViewerCameraMessage", "position": (1.0, 2.0, 3.0), "look_at": (0.0, 0.0, 0.0),
                                "image_width": 800, "image_height": 600}),
        msgspec.msgpack.encode({"type": "ScenePointerMessage", "event_type": "click", "ray_origin": (0.0, 0.0, 1.0),
                                "ray_direction": (0.0, 0.0, -1.0)}),
    )),
    Parser("requests to a scene", control_socket._parse, _json({"view": "follow"}, {"pick": True})),
    Parser("addresses of agents", lambda data: dial.Address.parse(_text(data), None), (
        b"tcp://127.0.0.1:9100", b"wss://[::1]:1/acp", b"ws://robot.example/a?b#c",
    ), (ValueError,)),
    Parser("times of tokens", lambda data: lifetime(_text(data)), (b"7d", b"30m", b"2099-01-31"), (ValueError,)),
    Parser("the list of tokens", _registry, (
        (DATA / tokens.REGISTRY).read_bytes(), b"[]",
    ), (RegistryError,)),
    Parser("updates in the terminal", _view, (
        *_json(*NOTICES), b"\n".join(_json(*NOTICES)),
    ), (wire.BadFrame,)),
    Parser("telemetry in the terminal", _status, _json(STATE, {"online": False}), (ValueError, RecursionError)),
    Parser("questions in the terminal", _question, _json(
        {"jsonrpc": "2.0", "id": "p1", "method": "session/request_permission", "params": {
            "toolCall": {"title": "Say “Hi.”"}, "_meta": {"robot-acp/timeout_s": 60},
            "options": [{"optionId": "a", "name": "Allow", "kind": "allow_once"},
                        {"optionId": "b", "name": "Never", "kind": "reject_always"}]}},
    ), (wire.BadFrame,)),
    Parser("limits of what is kept", _limits, _json(
        {"jsonrpc": "2.0", "id": 1, "method": "session/new", "params": {"cwd": "/", "mcpServers": []}},
        {"jsonrpc": "2.0", "id": 1, "method": "session/prompt", "params": {"sessionId": "s", "prompt": [
            {"type": "text", "text": "hi"}, {"type": "image", "data": "AAAA", "mimeType": "image/png"}]}},
        {"jsonrpc": "2.0", "id": 1, "method": "session/list", "params": {
            "cursor": "a", "_meta": {"robot-acp/search": "b"}}},
    ), (wire.BadFrame, RequestError)),
    Parser("tickets of the scene", _ticket, (TICKETS.make(ANA, "a").encode(),), (LoginError,)),
    Parser("the name of who stops", _name_in_body, (b'{"by": "Ana"}',)),
    Parser("texts in front of people", _visible, ("a\u202e\x1b[2J\r\n👩\u200d🔬".encode(), b"plain")),
]  # fmt: skip
