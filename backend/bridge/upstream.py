"""Connections to the agent, one for each client: over TCP, or to a child process over its stdin and stdout.

Lines are sent and received by plain calls. A child process belongs to one client and must never outlive it.
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

from backend import addresses, wire
from backend.bridge.limits import Limits
from backend.bridge.line_splitter import LineSplitter
from backend.config import ConfigError

_CONNECT_SECONDS = 5.0
_PROBE_SECONDS = 2.0
_PROBE = b'{"jsonrpc":"2.0","id":1,"method":"%b","params":{}}\n' % wire.HEALTH.encode()
"""Every agent answers a request, if only with an error: a port that accepts connections does not prove that it runs."""
_LAST_OUTPUT_SECONDS = 0.5
"""After an agent on stdio has exited, its last output may still arrive for this long."""

log = logging.getLogger(__name__)


class AgentUnreachableError(Exception):
    """The agent cannot be reached; the text is for the person in front of a client."""


class UpstreamListener(Protocol):
    """Receives the agent's lines. Its methods are called from the event loop and must not block."""

    def agent_lines(self, lines: list[bytes]) -> None:
        """Whole lines have arrived; they are without their newlines."""

    def agent_congested(self, congested: bool) -> None:
        """The agent reads too slowly (True), or has caught up (False)."""

    def agent_closed(self) -> None:
        """The agent has closed the connection, or its process has exited. May be called twice."""


class Upstream(Protocol):
    """One open connection to the agent."""

    def send(self, line: bytes) -> None:
        """Send one line; the newline is added."""

    def unsent(self) -> int:
        """The bytes that wait for the agent to read them."""

    def pause_reading(self) -> None:
        """Stop reading, so that the agent has to wait."""

    def resume_reading(self) -> None:
        """Read again."""

    async def close(self) -> None:
        """Close the connection, and end the child process if there is one."""


class Agent(Protocol):
    """The agent at one address."""

    async def connect(self, listener: UpstreamListener, limit: int) -> Upstream:
        """A new connection for lines of at most `limit` bytes. Raises `AgentUnreachableError`."""

    async def probe(self) -> str | None:
        """None when the agent answers (over stdio: when its command exists), or else what is wrong, as a sentence."""


def agent_at(address: str, limits: Limits) -> Agent:
    """The agent at `tcp://HOST:PORT` or `stdio:COMMAND`. Raises `ConfigError` for anything else."""
    if address.startswith("stdio:"):
        try:
            command = shlex.split(address.removeprefix("stdio:"))
        except ValueError as error:
            raise ConfigError(f"bridge.agent: the command cannot be read: {error}.") from None
        if command:
            return _StdioAgent(command, limits.agent_exit_seconds)
    parts = urlsplit(address)
    with contextlib.suppress(ValueError):  # a port that is no number
        if parts.scheme == "tcp" and parts.hostname and parts.port:
            return _TcpAgent(parts.hostname, parts.port)
    raise ConfigError(f"bridge.agent: {address!r} is neither tcp://HOST:PORT nor stdio:COMMAND.")


class _TcpAgent:
    def __init__(self, host: str, port: int) -> None:
        self.host = host
        self.port = port

    async def connect(self, listener: UpstreamListener, limit: int) -> Upstream:
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(_CONNECT_SECONDS):
                _, connection = await loop.create_connection(
                    lambda: _TcpConnection(listener, limit), self.host, self.port
                )
        except (OSError, TimeoutError):
            raise AgentUnreachableError("The agent is not running.") from None
        return connection

    async def probe(self) -> str | None:
        where = addresses.authority(self.host, self.port)
        try:
            async with asyncio.timeout(_PROBE_SECONDS):
                reader, writer = await asyncio.open_connection(self.host, self.port)
        except (OSError, TimeoutError):
            return f"Nothing answers at {where}."
        try:
            writer.write(_PROBE)
            async with asyncio.timeout(_PROBE_SECONDS):
                answered = await reader.read(1)
        except (OSError, TimeoutError):
            answered = b""
        finally:
            writer.transport.abort()
        return None if answered else f"The agent at {where} accepts connections, but does not answer."


class _TcpConnection(asyncio.Protocol):
    def __init__(self, listener: UpstreamListener, limit: int) -> None:
        self._listener = listener
        self._lines = LineSplitter(limit)

    def send(self, line: bytes) -> None:
        self._transport.write(line + b"\n")

    def unsent(self) -> int:
        return self._transport.get_write_buffer_size()

    def pause_reading(self) -> None:
        self._transport.pause_reading()

    def resume_reading(self) -> None:
        self._transport.resume_reading()

    async def close(self) -> None:
        # A closing connection would stay open until the agent has read everything, which may be never.
        if self._transport.get_write_buffer_size():
            self._transport.abort()
        else:
            self._transport.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        connected: socket.socket = transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def data_received(self, data: bytes) -> None:
        self._listener.agent_lines(self._lines.feed(data))

    def pause_writing(self) -> None:
        self._listener.agent_congested(True)

    def resume_writing(self) -> None:
        self._listener.agent_congested(False)

    def connection_lost(self, exc: Exception | None) -> None:
        self._listener.agent_closed()


@dataclass(frozen=True)
class _StdioAgent:
    command: list[str]
    exit_seconds: float

    async def connect(self, listener: UpstreamListener, limit: int) -> Upstream:
        loop = asyncio.get_running_loop()
        try:
            _, child = await loop.subprocess_exec(
                lambda: _Child(listener, limit, self.exit_seconds),
                *self.command,
                stderr=None,  # the child logs to the bridge's own stderr
                start_new_session=True,  # a process group of its own, so that the processes that it starts end with it
            )
        except OSError as error:
            log.error("the agent command %s cannot be started: %s", self.command[0], error)
            raise AgentUnreachableError("The agent cannot be started.") from None
        return child

    async def probe(self) -> str | None:
        if shutil.which(self.command[0]):
            return None
        return f"The command {self.command[0]} does not exist."


class _Child(asyncio.SubprocessProtocol):
    def __init__(self, listener: UpstreamListener, limit: int, exit_seconds: float) -> None:
        self._exit_seconds = exit_seconds
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
        """Close its stdin, which asks it to exit; then send SIGTERM, then SIGKILL."""
        self._stdin.close()
        try:
            for number in (signal.SIGTERM, signal.SIGKILL):
                if await self._exits_in_time():
                    break
                self._send_signal(number)
            await self._exited.wait()
        finally:
            self._send_signal(signal.SIGKILL)  # ends the processes that it left in its group
            self._transport.close()

    async def _exits_in_time(self) -> bool:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._exit_seconds):
                return await self._exited.wait()
        return False

    def _send_signal(self, number: signal.Signals) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._pid, number)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.SubprocessTransport, transport)
        self._pid = self._transport.get_pid()
        self._stdin = cast(asyncio.WriteTransport, self._transport.get_pipe_transport(0))
        self._stdout = cast(asyncio.ReadTransport, self._transport.get_pipe_transport(1))

    def pipe_data_received(self, fd: int, data: bytes) -> None:
        self._listener.agent_lines(self._lines.feed(data))

    def pause_writing(self) -> None:
        self._listener.agent_congested(True)

    def resume_writing(self) -> None:
        self._listener.agent_congested(False)

    def pipe_connection_lost(self, fd: int, exc: Exception | None) -> None:
        self._listener.agent_closed()

    def process_exited(self) -> None:
        self._exited.set()
        # Its last output may not have been read yet, and its stdout may stay open in a process that it started.
        self._loop.call_later(_LAST_OUTPUT_SECONDS, self._listener.agent_closed)
