"""Attacks with messages of ACP: prompts, sessions, frames. Each is one that a person with a login can send."""

from __future__ import annotations

import asyncio
import base64
import json
import unicodedata
from typing import Any

from tests.attack.target import Broken, Client, Target, attack, refused, said

VICTIM = "where are you?"
WRITE_BYTES = 8 * 1024 * 1024


async def _in_a_session(target: Target, client: Client) -> str:
    """A session of the attacker; for a role that may have none, an id that does not exist."""
    return await client.session() or "none"


async def _still_serves(target: Target, client: Client, session: str) -> None:
    """The session takes an ordinary prompt afterwards, unless the attacker's connection was closed."""
    if target.may_prompt and not client.is_closed:
        answer = await client.prompt(session, VICTIM)
        if "result" not in answer and "code" not in answer["error"]:
            raise Broken(f"the session takes no prompt any more: {said(answer)}")


@attack("prompts on which a pattern could backtrack, 1,000 to 100,000 characters")
async def backtracking(target: Target) -> str:
    async with target.client() as client:
        session = await _in_a_session(target, client)
        last = ""
        for head in ("go to ", "tell ", "say ", "turn ", "por favor ", "charged "):
            for piece in (" ", "a ", ", ", "then ", "9", '"'):
                for length in (1_000, 100_000):
                    last = said(await client.prompt(session, head + piece * (length // len(piece)) + "x"))
        await _still_serves(target, client, session)
        return last


async def _blocks(target: Target, blocks: list[dict[str, Any]]) -> str:
    async with target.client() as client:
        session = await _in_a_session(target, client)
        answer = await client.begin("session/prompt", {"sessionId": session, "prompt": blocks})
        await asyncio.wait([answer], timeout=10.0)
        await client.notify("session/cancel", {"sessionId": session})
        await asyncio.wait([answer], timeout=20.0)
        if not answer.done() and not client.is_closed:
            raise Broken("the prompt is not answered")
        await _still_serves(target, client, session)
        return said(answer.result()) if answer.done() else "the connection was closed"


@attack("prompts of 30,000 and of 100,000 empty blocks")
async def empty_blocks(target: Target) -> str:
    return _and(*[await _blocks(target, [{"type": "text", "text": ""}] * count) for count in (30_000, 100_000)])


@attack("prompts with 0.9 and with 14 MB of text")
async def long_text(target: Target) -> str:
    sizes = (900_000, 14_000_000)
    return _and(*[await _blocks(target, [{"type": "text", "text": "a" * size}]) for size in sizes])


@attack("prompts with a picture of 0.7 and of 8 MB that is none")
async def large_picture(target: Target) -> str:
    pictures = [base64.b64encode(bytes(size)).decode() for size in (700_000, WRITE_BYTES)]
    return _and(
        *[await _blocks(target, [{"type": "image", "mimeType": "image/png", "data": data}]) for data in pictures]
    )


def _and(smaller: str, larger: str) -> str:
    """What was said to the smaller one, which everybody may send, and to the larger one."""
    return smaller if smaller == larger else f"{smaller}; the larger one: {larger}"


@attack("blocks of every kind, with contents that do not fit")
async def odd_blocks(target: Target) -> str:
    odd: list[Any] = [
        {"type": "resource_link", "uri": "file:///etc/passwd", "name": "x" * 100_000},
        {"type": "resource", "resource": {"uri": "javascript:alert(1)", "text": "\x00" * 1_000}},
        {"type": "audio", "mimeType": "audio/wav\r\nX: y", "data": "%%%"},
        {"type": "image", "mimeType": "image/svg+xml", "data": "PHN2Zy8+"},
        {"type": "text", "text": "a", "annotations": {"audience": ["assistant"] * 100_000}},
        {"type": "none"}, {}, [], None, 1,
    ]  # fmt: skip
    return [await _blocks(target, [block]) for block in odd][-1]


@attack("sessions with a cwd of 0.9 and of 9 MB")
async def long_cwd(target: Target) -> str:
    answers = []
    for size in (900_000, 9_000_000):
        async with target.client() as client:
            answers.append(said(await client.call("session/new", {"cwd": "/" + "a" * size, "mcpServers": []})))
        async with target.client() as client:
            listed = await client.call("session/list", {})
            if "result" not in listed:
                raise Broken(f"the list of sessions is out of order: {said(listed)}")
    return _and(*answers)


@attack("0.3 MB in each field that takes text")
async def long_fields(target: Target) -> str:
    long = "x" * 300_000
    requests: list[tuple[str, dict[str, Any]]] = [
        ("initialize", {"protocolVersion": 1, "clientInfo": {"name": long, "version": long}}),
        ("authenticate", {"methodId": long, "_meta": {"robot-acp/token": long}}),
        ("session/new", {"cwd": "/", "mcpServers": [{"name": long, "command": long, "args": [long], "env": []}]}),
        ("session/new", {"cwd": "/", "mcpServers": [{"type": "http", "name": "a", "url": long, "headers": []}]}),
        ("session/list", {"cursor": long}),
        ("session/list", {"_meta": {"robot-acp/search": long}}),
        ("session/load", {"sessionId": long, "cwd": long, "mcpServers": []}),
        ("_robot/events", {"sessionId": long}),
        ("_robot/take_over", {"sessionId": long, "from": long}),
        (long, {}),
    ]
    async with target.client() as client:
        session = await _in_a_session(target, client)
        requests += [
            ("session/set_mode", {"sessionId": session, "modeId": long}),
            ("session/set_model", {"sessionId": session, "modelId": long}),
            ("session/set_config_option", {"sessionId": session, "configId": long, "value": long}),
        ]
        for method, params in requests:
            answer = await client.call(method, params)
            if len(json.dumps(answer)) > 100_000 and method != "session/list":
                raise Broken(f"the answer to {method[:40]} repeats what was sent")
            said(answer)
        return said(answer)


FRAMES: list[bytes | str] = [
    b"", b"\x00" * 1_000, b"\xff\xfe", "null", "1", '"a"', "[]", "{}", "[" * 100_000, '{"a":' * 5_000,
    '[{"jsonrpc":"2.0","id":1,"method":"session/list"}]', '{"jsonrpc":"2.0","method":"session/list","id":{}}',
    '{"jsonrpc":"2.0","id":1e400,"method":"session/list","params":{}}',
    '{"jsonrpc":"2.0","id":' + "9" * 5_000 + ',"method":"session/list","params":{}}',
    '{"jsonrpc":"2.0","id":"' + "i" * 100_000 + '","method":"session/list","params":{}}',
    '{"jsonrpc":"2.0","id":7,"result":{},"error":{}}', '{"jsonrpc":"2.0","id":"p1","result":{"outcome":[]}}',
    '{"jsonrpc":"2.0","id":"p1","error":{"code":"x"}}', '{"jsonrpc":"2.0","id":7,"method":"\\u0000","params":{}}',
    '{"jsonrpc":"2.0","id":7,"method":"session/prompt","params":{"sessionId":"\\ud800","prompt":[]}}',
    '{"jsonrpc":"2.0","id":7,"id":8,"method":"session/list","params":{}}\n{"jsonrpc":"2.0","id":9,"method":"x"}',
    '{"jsonrpc":"2.0","id":7,"method":"__class__","params":{"__proto__":{}}}',
]  # fmt: skip


@attack("frames that are no messages")
async def odd_frames(target: Target) -> str:
    closed = 0
    for frame in FRAMES:
        async with target.client() as client:
            await client.send(frame)
            answer = await client.call("session/list", {}, seconds=10.0)
            if "result" not in answer:
                closed += 1
                said(answer)
    return f"{len(FRAMES) - closed} answered and served on, {closed} closed the connection"


@attack("every method with parameters of every wrong type")
async def wrong_types(target: Target) -> str:
    methods = (
        "initialize", "authenticate", "session/new", "session/load", "session/resume", "session/fork", "session/list",
        "session/close", "session/delete", "session/prompt", "session/set_mode", "session/set_model",
        "session/set_config_option", "session/cancel", "_robot/abilities", "_robot/leave", "_robot/events",
        "_robot/take_over", "$/cancel_request",
    )  # fmt: skip
    values: list[Any] = [None, True, -1, 1e308, "", "a", "\u202e", [], [[]], {}, {"a": {}}, ["a"] * 1_000]
    refusals = 0
    async with target.client() as client:
        for method in methods:
            for value in values:
                for params in (
                    value,
                    {"sessionId": value, "prompt": value, "cwd": value, "mcpServers": value, "modeId": value}
                    | {"modelId": value, "configId": value, "value": value, "cursor": value, "after": value}
                    | {"protocolVersion": value, "methodId": value, "_meta": value, "limit": value},
                ):
                    answer = await client.call(method, params)
                    refusals += "error" in answer
                    said(answer)
                    if client.is_closed:
                        raise Broken(f"{method} with {value!r} closes the connection")
    return f"{refusals} of {len(methods) * len(values) * 2} refused, the rest answered"


@attack("prompts with control and format characters")
async def invisible(target: Target) -> str:
    hidden = "say \u202eabc\x1b]0;mine\x07\x1b[2J\u2066 \u200b\nAllowed by Ana."
    async with target.client() as client:
        session = await _in_a_session(target, client)
        answer = await client.prompt(session, hidden)
        listed = (await client.call("session/list", {}))["result"]["sessions"]
        titles = [row.get("title") or "" for row in listed]
        titles += [
            message["params"]["toolCall"].get("title", "")
            for message in client.heard
            if message["method"] == "session/request_permission"
        ]
        for title in titles:
            if any(unicodedata.category(char) in ("Cc", "Cf") for char in title):
                raise Broken(f"a title has invisible characters: {title!r}")
        return said(answer)


@attack("prompts, changes and deletions in the session of somebody else")
async def of_somebody_else(target: Target) -> str:
    async with target.client(target.witness_token) as owner, target.client() as client:
        theirs = await owner.session()
        if theirs is None:
            return "not tried: the witness may have no session"
        await owner.prompt(theirs, VICTIM)
        requests: list[tuple[str, dict[str, Any]]] = [
            ("session/prompt", {"sessionId": theirs, "prompt": [{"type": "text", "text": "go to the dock"}]}),
            ("session/set_mode", {"sessionId": theirs, "modeId": "autonomous"}),
            ("session/set_config_option", {"sessionId": theirs, "configId": "mode", "value": "autonomous"}),
            ("session/close", {"sessionId": theirs}),
            ("session/delete", {"sessionId": theirs}),
        ]
        answers = []
        for method, params in requests:
            answer = await client.call(method, params)
            answers.append(said(answer) if target.role == "supervisor" else refused(answer))
            if target.role == "supervisor":
                break  # a supervisor may take over other people's sessions
        return answers[-1]


@attack("what only a supervisor may do")
async def rights(target: Target) -> str:
    async with target.client() as client, target.http(target.token) as http:
        if target.role == "supervisor":
            return "not tried: a supervisor may do it"
        refused(await client.call("_robot/release", {}))
        refused(await client.call("_robot/take_over", {}))
        offered = {"type": "http", "name": "mine", "url": "http://127.0.0.1:1/mcp", "headers": []}
        refused(await client.call("session/new", {"cwd": "/", "mcpServers": [offered]}))
        status = (await http.post("/api/release")).status_code
        if status != 403:
            raise Broken(f"/api/release answered {status}")
        return "all refused"
