"""Ways to an agent for bytes that are one message each: TCP, stdio, the bridge's WebSocket. Nothing here reads them."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from typing import Protocol

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from backend.identity import Role
from tests.processes import PATIENCE_S, Robot

TRANSPORTS = {"tcp": "TCP", "stdio": "stdio", "bridge": "WebSocket of the bridge"}
LARGEST = 32 * 1024 * 1024
_NUMBERS = itertools.count(1)


class Channel(Protocol):
    """Whole messages out and in."""

    async def send(self, message: bytes) -> None: ...

    async def receive(self) -> bytes | None:
        """The next message; None at the end."""

    async def close(self) -> None: ...


async def open_channel(robot: Robot, transport: str) -> Channel:
    """A new connection to the robot's agent; on stdio, a new agent."""
    match transport:
        case "tcp":
            return Lines(*await asyncio.open_connection("127.0.0.1", robot.agent_port, limit=LARGEST))
        case "stdio":
            return await Child.start(robot)
        case _:
            return await Frames.dial(robot, robot.token("Ana", Role.SUPERVISOR))


class Lines:
    """One message a line."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    async def send(self, message: bytes) -> None:
        self._writer.write(message + b"\n")
        await self._writer.drain()

    async def receive(self) -> bytes | None:
        return await self._reader.readline() or None

    async def close(self) -> None:
        self._writer.close()
        with contextlib.suppress(OSError):
            await self._writer.wait_closed()


class Child(Lines):
    """`robot-acp agent --stdio`: closing its stdin ends it."""

    process: asyncio.subprocess.Process

    @classmethod
    async def start(cls, robot: Robot) -> Child:
        # A database of its own: one agent has one, and another process may be on stdio at the same time.
        database = f"sqlite:///{robot.data / f'stdio-{next(_NUMBERS)}.db'}"
        process = await asyncio.create_subprocess_exec(
            *robot.command("agent", "--stdio"),
            env=robot.variables | {"ROBOT_ACP_AGENT__DATABASE": database},
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=LARGEST,
        )
        assert process.stdout is not None
        assert process.stdin is not None
        child = cls(process.stdout, process.stdin)
        child.process = process
        return child

    async def close(self) -> None:
        await super().close()
        async with asyncio.timeout(PATIENCE_S):
            assert await self.process.wait() == 0


class Frames:
    """One message a WebSocket frame: text, or binary where the bytes are no UTF-8."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket

    @classmethod
    async def dial(cls, robot: Robot, token: str) -> Frames:
        address = f"ws://127.0.0.1:{robot.bridge_port}/acp"
        headers = {"Authorization": f"Bearer {token}"}
        return cls(await connect(address, additional_headers=headers, max_size=LARGEST, compression=None))

    async def send(self, message: bytes) -> None:
        try:
            await self.socket.send(message.decode())
        except UnicodeDecodeError:
            await self.socket.send(message)

    async def receive(self) -> bytes | None:
        try:
            frame = await self.socket.recv()
        except ConnectionClosed:
            return None
        return frame if isinstance(frame, bytes) else frame.encode()

    async def close(self) -> None:
        await self.socket.close()
