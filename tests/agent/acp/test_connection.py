"""The agent's edge: who may speak at all, and what happens to frames that are none."""

from __future__ import annotations

import asyncio
import json
import socket
from typing import Any

import pytest
from acp.router import MessageRouter

from backend.agent.acp.connection import ClientConnection
from tests.processes import PATIENCE_S, Robot, trusted

HELLO = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": {"protocolVersion": 1}}


class Raw:
    """Bytes on a socket, and the lines that come back."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    async def send(self, *lines: bytes) -> None:
        self.writer.write(b"".join(line + b"\n" for line in lines))
        await self.writer.drain()

    async def answer(self) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            line = await self.reader.readline()
        assert line, "the connection was closed"
        return dict(json.loads(line))


async def dial(robot: Robot) -> Raw:
    return Raw(*await asyncio.open_connection("127.0.0.1", robot.agent_port))


@pytest.mark.parametrize(
    "first",
    [
        b"POST / HTTP/1.1",
        b"{}",
        b'{"jsonrpc":"2.0","id":1,"method":"session/list","params":{}}',
        b'{"jsonrpc":"2.0","method":"initialize","params":{}}',
        b"\xff\xfe",
    ],
)
async def test_whoever_does_not_begin_with_initialize_is_cut_off(robot: Robot, first: bytes) -> None:
    raw = await dial(robot)
    await raw.send(first)
    async with asyncio.timeout(PATIENCE_S):
        assert await raw.reader.read() == b""
    raw.writer.close()


async def test_only_a_question_about_its_health_is_answered_before_initialize(robot: Robot) -> None:
    raw = await dial(robot)
    await raw.send(b'{"jsonrpc":"2.0","id":"h","method":"_robot/health","params":{}}', json.dumps(HELLO).encode())
    assert await raw.answer() == {"jsonrpc": "2.0", "id": "h", "result": {}}
    async with asyncio.timeout(PATIENCE_S):
        assert await raw.reader.read() == b""
    raw.writer.close()


@pytest.mark.parametrize(
    ("line", "code", "request_id"),
    [
        (b"{", -32700, None),
        (b"\xff", -32700, None),
        (b"[]", -32600, None),
        (b'"hello"', -32600, None),
        (b'{"jsonrpc":"1.0","id":7,"method":"x"}', -32600, 7),
        (b'{"jsonrpc":"2.0","id":7,"method":5}', -32600, 7),
        (b'{"jsonrpc":"2.0","id":7,"method":"session/list","params":[]}', -32602, 7),
        (b'{"jsonrpc":"2.0","id":7,"method":"session/nonsense","params":{}}', -32601, 7),
        (b'{"jsonrpc":"2.0","id":7,"method":"_robot/nonsense","params":{}}', -32601, 7),
        (b'{"jsonrpc":"2.0","id":7,"method":"session/prompt","params":{}}', -32602, 7),
        (b'{"jsonrpc":"2.0","id":7,"method":"session/prompt","params":{"sessionId":"x","prompt":[]}}', -32602, 7),
        (b"[" * 5000, -32700, None),
        (b"[" * 100 + b"]" * 100, -32600, None),
        (b'{"jsonrpc":"2.0","id":7,"method":"session/list","params":{"x":"' + b"a" * 17_000_000 + b'"}}', -32600, None),
    ],
)
async def test_a_bad_frame_gets_its_error_and_the_connection_lives(
    robot: Robot, line: bytes, code: int, request_id: int | None
) -> None:
    raw = await dial(robot)
    await raw.send(json.dumps(HELLO).encode(), line, json.dumps(HELLO | {"id": 2}).encode())
    answers = [await raw.answer() for _ in range(3)]
    (error,) = [a for a in answers if "error" in a]
    assert (error["id"], error["error"]["code"]) == (request_id, code)
    assert "Traceback" not in json.dumps(error)
    assert sorted(a["id"] for a in answers if "result" in a) == [1, 2]
    raw.writer.close()


async def test_what_is_said_in_one_breath_with_leaving_is_begun() -> None:
    ours, theirs = socket.socketpair()
    _, writer = await asyncio.open_connection(sock=ours)
    reader, router, begun = asyncio.StreamReader(), MessageRouter(), list[str]()

    async def begin(name: str, _: object) -> None:
        begun.append(name)

    router.handle_extension_notification(begin)
    said = [HELLO, *({"jsonrpc": "2.0", "method": f"_lab/{number}"} for number in range(3))]
    reader.feed_data(b"".join(json.dumps(message).encode() + b"\n" for message in said))
    reader.feed_eof()
    await ClientConnection(reader, writer, trusted=trusted, max_outbox_bytes=2**20).serve(router)
    assert begun == ["lab/0", "lab/1", "lab/2"]
    theirs.close()


async def test_meta_cannot_pose_as_a_parameter(robot: Robot) -> None:
    raw = await dial(robot)
    sneaky = {"cwd": "/sneaky", "session_id": "x", "robot-acp/role": "supervisor"}
    params = {"cwd": "/mine", "mcpServers": [], "_meta": sneaky}
    await raw.send(json.dumps(HELLO).encode())
    await raw.answer()
    await raw.send(json.dumps({"jsonrpc": "2.0", "id": 2, "method": "session/new", "params": params}).encode())
    assert "sessionId" in (await raw.answer())["result"]
    commands = await raw.answer()  # only now does the client know the session
    assert commands["params"]["update"]["sessionUpdate"] == "available_commands_update"
    raw.writer.close()


async def test_stdio_speaks_the_same(robot: Robot) -> None:
    database = f"sqlite:///{robot.data / 'stdio.db'}"  # the agent on TCP has the other one
    process = await asyncio.create_subprocess_exec(
        *robot.command("agent", "--stdio"),
        env=robot.variables | {"ROBOT_ACP_AGENT__DATABASE": database},
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(HELLO).encode() + b"\n")
    async with asyncio.timeout(PATIENCE_S):
        answer = json.loads(await process.stdout.readline())
    assert answer["result"]["agentInfo"]["name"] == "robot-acp"
    process.stdin.close()
    async with asyncio.timeout(PATIENCE_S):
        assert await process.wait() == 0
