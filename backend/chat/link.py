"""An ACP client connection over TCP or WebSocket: requests out, updates and questions in, in the order of the wire."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any, Protocol
from urllib.parse import urlsplit

import orjson
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from backend import wire


class LinkError(Exception):
    """The connection could not be made or was lost; the text says what to do."""


class RefusedError(Exception):
    """The agent answered a request with an error; the text is its message."""


class _Stream(Protocol):
    async def send(self, message: dict[str, Any]) -> None: ...
    async def receive(self) -> dict[str, Any] | None: ...
    async def close(self) -> None: ...


Incoming = Callable[[dict[str, Any]], None]


class Link:
    """One connection. `incoming` gets every notification and every request of the agent, in order.

    When the connection ends, every request that waits fails with `LinkError`, and `closed` is done.
    """

    def __init__(self, stream: _Stream, incoming: Incoming) -> None:
        self._stream = stream
        self._incoming = incoming
        self._asked = 0
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._reader = asyncio.create_task(self._read(), name="link")
        self.closed: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Done with the reason once the connection is gone."""

    async def request(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        """Ask the agent. Raises `RefusedError`, `LinkError`."""
        self._asked += 1
        request_id = self._asked
        answer = self._answers[request_id] = asyncio.get_running_loop().create_future()
        try:
            await self._send({"id": request_id, "method": method, "params": params})
            message = await answer
        finally:
            self._answers.pop(request_id, None)
        if "error" in message:
            raise RefusedError(message["error"].get("message", "refused"))
        return dict(message["result"] or {})

    async def notify(self, method: str, params: dict[str, Any]) -> None:
        """Tell the agent. Raises `LinkError`."""
        await self._send({"method": method, "params": params})

    async def respond(self, request_id: Any, result: dict[str, Any]) -> None:
        """Answer a request of the agent. Raises `LinkError`."""
        await self._send({"id": request_id, "result": result})

    async def refuse(self, request_id: Any) -> None:
        """Say that this client does not know a request of the agent. Raises `LinkError`."""
        error = {"code": wire.METHOD_NOT_FOUND, "message": "This client does not do that."}
        await self._send({"id": request_id, "error": error})

    async def round_trip(self) -> float:
        """Seconds until the agent has answered. Raises `LinkError`."""
        begun = time.monotonic()
        with contextlib.suppress(RefusedError):  # no agent has to know the method: "there is none" comes as fast
            await self.request("_robot/ping", {})
        return time.monotonic() - begun

    async def close(self) -> None:
        """Disconnect."""
        await self._stream.close()
        self._reader.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._reader

    async def _send(self, message: dict[str, Any]) -> None:
        try:
            await self._stream.send({"jsonrpc": "2.0"} | message)
        except (OSError, ConnectionClosed) as error:
            raise LinkError("The connection is lost.") from error

    async def _read(self) -> None:
        reason = "The connection is lost."
        try:
            while (message := await self._stream.receive()) is not None:
                answer = self._answers.get(message["id"]) if "method" not in message and "id" in message else None
                if answer is not None and not answer.done():
                    answer.set_result(message)
                elif "method" in message:
                    self._incoming(message)
        except ConnectionClosed as closed:
            reason = (closed.rcvd.reason if closed.rcvd else "") or reason
        except (OSError, wire.BadFrame):
            pass
        finally:
            for answer in self._answers.values():
                if not answer.done():
                    answer.set_exception(LinkError(reason))
            if not self.closed.done():
                self.closed.set_result(reason)


async def open_link(address: str, token: str | None, incoming: Incoming) -> Link:
    """Connect to `tcp://HOST:PORT`, or to `ws://` or `wss://` with a login token. Raises `LinkError`."""
    parts = urlsplit(address)
    try:
        if parts.scheme == "tcp" and parts.hostname and parts.port:
            reader, writer = await asyncio.open_connection(parts.hostname, parts.port, limit=wire.MAX_FRAME_BYTES + 1)
            return Link(_Lines(reader, writer), incoming)
        if parts.scheme in ("ws", "wss"):
            headers = {"Authorization": f"Bearer {token}"} if token else {}
            socket = await connect(address, additional_headers=headers, max_size=wire.MAX_FRAME_BYTES)
            return Link(_Frames(socket), incoming)
    except InvalidStatus as error:
        if error.response.status_code in (401, 403):
            raise LinkError(
                "The robot did not accept this login. Make a token with `robot-acp token create`, and set "
                "ROBOT_ACP_TOKEN to it."
            ) from None
        raise LinkError(f"{address} answered with HTTP status {error.response.status_code}.") from None
    except (OSError, WebSocketException, TimeoutError):
        raise LinkError(f"Nothing answers at {address}. Is the robot running? Start it with `robot-acp up`.") from None
    raise LinkError(f"{address!r} is no address. Give tcp://HOST:PORT or ws://HOST:PORT/acp.")


class _Lines:
    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    async def send(self, message: dict[str, Any]) -> None:
        self._writer.write(orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE))
        await self._writer.drain()

    async def receive(self) -> dict[str, Any] | None:
        line = await wire.read_line(self._reader)
        if line is None:
            self._writer.close()  # nobody reads what this half would still say
            return None
        return wire.check(line).body

    async def close(self) -> None:
        self._writer.close()
        with contextlib.suppress(OSError):
            await self._writer.wait_closed()


class _Frames:
    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket

    async def send(self, message: dict[str, Any]) -> None:
        await self._socket.send(orjson.dumps(message).decode())

    async def receive(self) -> dict[str, Any] | None:
        frame = await self._socket.recv()
        return wire.check(frame if isinstance(frame, bytes) else frame.encode()).body

    async def close(self) -> None:
        await self._socket.close()
