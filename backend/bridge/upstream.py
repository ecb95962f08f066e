"""A connection of its own to the agent: TCP, or a child process that speaks over stdin and stdout.

Lines go in, lines come out, as calls. A child belongs to one client and must never outlive it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import shlex
import shutil
import signal
import socket
from dataclasses import dataclass
from typing import Protocol, cast
from urllib.parse import urlsplit

from backend.bridge.lines import LineSplitter
from backend.config import ConfigError

_CONNECT_SECONDS = 5.0
_PROBE_SECONDS = 1.0
_GRACE_SECONDS = 2.0
_LAST_WORDS_SECONDS = 0.5

log = logging.getLogger(__name__)


class AgentDownError(Exception):
    """The agent cannot be reached; the text is for the people in front of a client."""


class Listener(Protocol):
    """Who hears the agent. Its methods are called from the event loop and may not wait."""

    def agent_said(self, lines: list[bytes]) -> None:
        """Whole lines came, without their newlines."""

    def agent_slow(self, slow: bool) -> None:
        """The agent's side of the connection is full, or has room again."""

    def agent_gone(self) -> None:
        """The agent has closed, or its process has ended. May be called twice."""


class Upstream(Protocol):
    """One open connection to the agent."""

    def send(self, line: bytes) -> None:
        """Pass one line on; its newline is added."""

    def unsent(self) -> int:
        """Bytes that wait for the agent to read."""

    def pause_reading(self) -> None:
        """Read no more for now, so that the agent has to wait."""

    def resume_reading(self) -> None:
        """Read on."""

    async def close(self) -> None:
        """End the connection, and the child process with it."""


class Agent(Protocol):
    """Where the agent is."""

    async def connect(self, listener: Listener, limit: int) -> Upstream:
        """A new connection for lines of at most `limit` bytes. Raises `AgentDownError`."""

    async def probe(self) -> str | None:
        """None when the agent would answer, else what is wrong, in words for people."""


def agent_at(address: str) -> Agent:
    """The agent at `tcp://HOST:PORT` or `stdio:COMMAND`. Raises `ConfigError` for anything else."""
    if address.startswith("stdio:"):
        try:
            command = shlex.split(address.removeprefix("stdio:"))
        except ValueError as error:
            raise ConfigError(f"bridge.agent: the command cannot be read: {error}.") from None
        if command:
            return _StdioAgent(command)
    parts = urlsplit(address)
    with contextlib.suppress(ValueError):  # a port that is no number
        if parts.scheme == "tcp" and parts.hostname and parts.port:
            return _TcpAgent(parts.hostname, parts.port)
    raise ConfigError(f"bridge.agent: {address!r} is neither tcp://HOST:PORT nor stdio:COMMAND.")


class _TcpAgent:
    def __init__(self, host: str, port: int) -> None:
        self.host = host
        self.port = port
        self._open: set[_TcpConnection] = set()  # each adds and removes itself

    async def connect(self, listener: Listener, limit: int) -> Upstream:
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(_CONNECT_SECONDS):
                _, connection = await loop.create_connection(
                    lambda: _TcpConnection(listener, limit, self._open), self.host, self.port
                )
        except (OSError, TimeoutError):
            raise AgentDownError("The agent is not running.") from None
        return connection

    async def probe(self) -> str | None:
        if self._open:
            return None
        try:
            async with asyncio.timeout(_PROBE_SECONDS):
                _, writer = await asyncio.open_connection(self.host, self.port)
        except (OSError, TimeoutError):
            return f"Nothing answers at {self.host}:{self.port}."
        writer.close()
        return None


class _TcpConnection(asyncio.Protocol):
    def __init__(self, listener: Listener, limit: int, siblings: set[_TcpConnection]) -> None:
        self._listener = listener
        self._lines = LineSplitter(limit)
        self._siblings = siblings

    def send(self, line: bytes) -> None:
        self._transport.write(line + b"\n")

    def unsent(self) -> int:
        return self._transport.get_write_buffer_size()

    def pause_reading(self) -> None:
        self._transport.pause_reading()

    def resume_reading(self) -> None:
        self._transport.resume_reading()

    async def close(self) -> None:
        # What waits for an agent that does not read would keep a closing connection open for ever.
        if self._transport.get_write_buffer_size():
            self._transport.abort()
        else:
            self._transport.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        connected: socket.socket = transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._siblings.add(self)

    def data_received(self, data: bytes) -> None:
        self._listener.agent_said(self._lines.feed(data))

    def pause_writing(self) -> None:
        self._listener.agent_slow(True)

    def resume_writing(self) -> None:
        self._listener.agent_slow(False)

    def connection_lost(self, exc: Exception | None) -> None:
        self._siblings.discard(self)
        self._listener.agent_gone()


@dataclass(frozen=True)
class _StdioAgent:
    command: list[str]

    async def connect(self, listener: Listener, limit: int) -> Upstream:
        loop = asyncio.get_running_loop()
        try:
            _, child = await loop.subprocess_exec(
                lambda: _Child(listener, limit),
                *self.command,
                stderr=None,  # the child's own log goes where ours goes
                start_new_session=True,  # a group of its own, so that what it starts ends with it
            )
        except OSError as error:
            log.error("the agent command %s cannot be started: %s", self.command[0], error)
            raise AgentDownError("The agent cannot be started.") from None
        return child

    async def probe(self) -> str | None:
        if shutil.which(self.command[0]):
            return None
        return f"The command {self.command[0]} does not exist."


class _Child(asyncio.SubprocessProtocol):
    def __init__(self, listener: Listener, limit: int) -> None:
        self._listener = listener
        self._lines = LineSplitter(limit)
        self._loop = asyncio.get_running_loop()
        self._exited = asyncio.Event()

    def send(self, line: bytes) -> None:
        self._stdin.write(line + b"\n")

    def unsent(self) -> int:
        return self._stdin.get_write_buffer_size()

    def pause_reading(self) -> None:
        self._stdout.pause_reading()

    def resume_reading(self) -> None:
        self._stdout.resume_reading()

    async def close(self) -> None:
        """Ask it to end by closing its stdin, then tell it, then make it."""
        self._stdin.close()
        try:
            for sign in (signal.SIGTERM, signal.SIGKILL):
                if await self._ended_by_itself():
                    break
                self._signal(sign)
            await self._exited.wait()
        finally:
            self._signal(signal.SIGKILL)  # what it left behind in its group
            self._transport.close()

    async def _ended_by_itself(self) -> bool:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_GRACE_SECONDS):
                return await self._exited.wait()
        return False

    def _signal(self, sign: signal.Signals) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._pid, sign)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.SubprocessTransport, transport)
        self._pid = self._transport.get_pid()
        self._stdin = cast(asyncio.WriteTransport, self._transport.get_pipe_transport(0))
        self._stdout = cast(asyncio.ReadTransport, self._transport.get_pipe_transport(1))

    def pipe_data_received(self, fd: int, data: bytes) -> None:
        self._listener.agent_said(self._lines.feed(data))

    def pause_writing(self) -> None:
        self._listener.agent_slow(True)

    def resume_writing(self) -> None:
        self._listener.agent_slow(False)

    def pipe_connection_lost(self, fd: int, exc: Exception | None) -> None:
        self._listener.agent_gone()

    def process_exited(self) -> None:
        self._exited.set()
        # Its stdout may stay open in a process that it started; what it said last is still to be read.
        self._loop.call_later(_LAST_WORDS_SECONDS, self._listener.agent_gone)
