"""An ACP client connection over TCP or WebSocket: requests out, updates and questions in, in the order of the wire."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any

import orjson
from websockets.exceptions import InvalidStatus, WebSocketException

from backend import dial, wire


class LinkError(Exception):
    """The connection could not be made or was lost; the text is for people."""


class RefusedError(Exception):
    """The agent answered a request with an error; the text is its message, `data` what it says to programs."""

    def __init__(self, message: str, data: object = None) -> None:
        super().__init__(message)
        self.database_away = isinstance(data, dict) and data.get("unavailable") == "database"
        """Whether the agent cannot use its database of sessions now."""


Incoming = Callable[[dict[str, Any]], None]


class Link:
    """One connection. `incoming` is called with every notification and every request of the agent, in order.

    When the connection ends, every request that waits fails with `LinkError`, and `closed` is done.
    """

    def __init__(self, stream: dial.Stream, incoming: Incoming) -> None:
        self._stream = stream
        self._incoming = incoming
        self._asked = 0
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._reader = asyncio.create_task(self._read(), name="link")
        self.closed: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Done with the reason once the connection is gone."""

    async def request(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        """The answer of the agent to a request. Raises `RefusedError`, `LinkError`."""
        self._asked += 1
        request_id = self._asked
        answer = self._answers[request_id] = asyncio.get_running_loop().create_future()
        try:
            await self._send({"id": request_id, "method": method, "params": params})
            message = await answer
        finally:
            self._answers.pop(request_id, None)
        if "error" in message:
            raise RefusedError(message["error"].get("message", "refused"), message["error"].get("data"))
        return dict(message["result"] or {})

    async def notify(self, method: str, params: dict[str, Any]) -> None:
        """Send a notification. Raises `LinkError`."""
        await self._send({"method": method, "params": params})

    async def respond(self, request_id: Any, result: dict[str, Any]) -> None:
        """Answer a request of the agent. Raises `LinkError`."""
        await self._send({"id": request_id, "result": result})

    async def refuse(self, request_id: Any) -> None:
        """Answer a request of the agent that this client does not know. Raises `LinkError`."""
        error = {"code": wire.METHOD_NOT_FOUND, "message": "This client does not do that."}
        await self._send({"id": request_id, "error": error})

    async def round_trip(self) -> float:
        """Seconds until the agent has answered. Raises `LinkError`."""
        begun = time.monotonic()
        with contextlib.suppress(RefusedError):  # an agent that does not know the method answers as fast
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
            await self._stream.send(orjson.dumps({"jsonrpc": "2.0"} | message))
        except dial.Lost as lost:
            raise LinkError("The connection is lost.") from lost

    async def _read(self) -> None:
        reason = "The connection is lost."
        try:
            while True:
                message = wire.check(await self._stream.receive()).body
                answer = self._answers.get(message["id"]) if "method" not in message and "id" in message else None
                if answer is not None and not answer.done():
                    answer.set_result(message)
                elif "method" in message:
                    self._incoming(message)
        except dial.Lost as lost:
            reason = lost.reason or reason
        except wire.BadFrame:
            pass  # whatever this is, it is no agent
        finally:
            for answer in self._answers.values():
                if not answer.done():
                    answer.set_exception(LinkError(reason))
            if not self.closed.done():
                self.closed.set_result(reason)


async def open_link(address: str, token: str | None, incoming: Incoming) -> Link:
    """Connect to `tcp://HOST:PORT`, or to `ws://` or `wss://` with a login token. Raises `LinkError`."""
    try:
        return Link(await dial.dial(dial.Address.parse(address, token)), incoming)
    except InvalidStatus as error:
        if error.response.status_code in (401, 403):
            raise LinkError(
                "The robot did not accept this login. Make a token with `robot-acp token create`, and set "
                "ROBOT_ACP_TOKEN to it."
            ) from None
        raise LinkError(f"{address} answered with HTTP status {error.response.status_code}.") from None
    except (OSError, WebSocketException, TimeoutError):
        raise LinkError(f"Nothing answers at {address}. Is the robot running? Start it with `robot-acp up`.") from None
    except ValueError:
        raise LinkError(f"{address!r} is no address. Give tcp://HOST:PORT or ws://HOST:PORT/acp.") from None
