"""The two ends of a gateway: a client that speaks lines, and a remote that a test plays on a real WebSocket."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from tests.processes import PATIENCE_S, Robot

HELLO = {"protocolVersion": 1, "clientCapabilities": {}}


@dataclass
class Lines:
    """A client that writes and reads lines, and keeps the notifications and questions that it heard."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    heard: list[dict[str, Any]] = field(default_factory=list)

    async def send(self, *lines: bytes) -> None:
        self.writer.write(b"".join(line + b"\n" for line in lines))
        await self.writer.drain()

    async def line(self) -> bytes:
        async with asyncio.timeout(PATIENCE_S):
            return (await self.reader.readline()).removesuffix(b"\n")

    async def message(self) -> dict[str, Any]:
        line = await self.line()
        assert line, "the gateway closed"
        return dict(json.loads(line))

    async def rest(self) -> list[dict[str, Any]]:
        """What still comes until the gateway closes."""
        async with asyncio.timeout(PATIENCE_S):
            return [json.loads(line) for line in (await self.reader.read()).splitlines()]

    async def begin(self, request_id: int | str, method: str, **params: Any) -> None:
        await self.send(json.dumps({"jsonrpc": "2.0", "id": request_id, "method": method, "params": params}).encode())

    async def answer_to(self, request_id: int | str) -> dict[str, Any]:
        while "method" in (message := await self.message()):
            self.heard.append(message)
        assert message["id"] == request_id
        return message

    async def until(self, method: str) -> dict[str, Any]:
        while not self.heard or self.heard[-1]["method"] != method:
            self.heard.append(await self.message())
        return self.heard[-1]

    async def request(self, method: str, **params: Any) -> dict[str, Any]:
        await self.begin(method, method, **params)
        answer = await self.answer_to(method)
        assert "result" in answer, answer
        return dict(answer["result"])

    async def new_session(self) -> str:
        await self.request("initialize", **HELLO)
        return str((await self.request("session/new", cwd="/", mcpServers=[]))["sessionId"])

    async def prompt(self, session: str, text: str) -> str:
        blocks = [{"type": "text", "text": text}]
        return str((await self.request("session/prompt", sessionId=session, prompt=blocks))["stopReason"])

    @property
    def said(self) -> str:
        return said(self.heard)


def updates(heard: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [message["params"] for message in heard if message["method"] == "session/update"]


def said(heard: list[dict[str, Any]]) -> str:
    chunks = [params["update"] for params in updates(heard)]
    return "".join(u["content"]["text"] for u in chunks if u["sessionUpdate"] == "agent_message_chunk")


@dataclass
class Connect(Lines):
    """`robot-acp connect` in a process of its own."""

    process: Process = field(kw_only=True)

    async def ended(self) -> tuple[int, str]:
        """Its exit status and what it wrote to stderr."""
        assert self.process.stderr is not None
        async with asyncio.timeout(PATIENCE_S):
            words = await self.process.stderr.read()
            return await self.process.wait(), words.decode()

    async def leave(self) -> tuple[int, str]:
        self.writer.close()
        return await self.ended()


@contextlib.asynccontextmanager
async def connected(robot: Robot, *arguments: str) -> AsyncIterator[Connect]:
    process = await asyncio.create_subprocess_exec(
        *robot.command("connect", *arguments),
        env=robot.variables,
        stdin=PIPE,
        stdout=PIPE,
        stderr=PIPE,
        limit=2 * 1024 * 1024,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield Connect(process.stdout, process.stdin, process=process)
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGKILL)
        process.stdin.close()
        await process.communicate()


@dataclass
class Remote:
    """A WebSocket server that does what a test tells it to; one client."""

    url: str = ""
    headers: dict[str, str] = field(default_factory=dict)
    arrived: asyncio.Queue[ServerConnection] = field(default_factory=asyncio.Queue)

    async def client(self) -> ServerConnection:
        async with asyncio.timeout(PATIENCE_S):
            return await self.arrived.get()


@contextlib.asynccontextmanager
async def a_remote(*subprotocols: str) -> AsyncIterator[Remote]:
    remote = Remote()

    async def handle(connection: ServerConnection) -> None:
        assert connection.request is not None
        remote.headers = {name.lower(): value for name, value in connection.request.headers.raw_items()}
        remote.arrived.put_nowait(connection)
        await connection.wait_closed()

    offered = [Subprotocol(name) for name in subprotocols] or None
    async with serve(handle, "127.0.0.1", 0, subprotocols=offered) as server:
        remote.url = f"ws://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}/acp"
        yield remote
