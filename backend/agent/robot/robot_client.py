"""The agent's client of the robot server beside MCP: the telemetry stream, the stop path and previews.

Only our robot server has these; with any other MCP server the state stays None and everything else works. It never
moves the robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, TypeVar
from urllib.parse import urlsplit

import httpx
import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from backend import telemetry

log = logging.getLogger(__name__)

RATE_HZ = 20.0
RETRY_S = 1.0
REST_TIMEOUT_S = 5.0
STALE_S = 2.0
"""States come twenty times a second: after so long without one the latest state is no longer valid."""
ASK_AGAIN_S = 0.1
"""A robot server that does not answer is asked again after so many seconds how the robot is."""
PREVIEW_TIMEOUT_S = 1.0

_CONNECTION_ERRORS = (OSError, WebSocketException, msgspec.DecodeError)
"""The errors with which a telemetry connection ends."""

_Answer = TypeVar("_Answer")
Watcher = Callable[["telemetry.State | None"], None]


class RobotError(Exception):
    """The robot server did not take a stop or a release; the text says what to do."""


class RobotClient:
    """The latest state of the robot. `state` is None while the robot server is unreachable or silent."""

    def __init__(
        self,
        mcp_url: str | None,
        bearer: str | None,
        *,
        stale_after: float = STALE_S,
        rest_timeout: float = REST_TIMEOUT_S,
    ) -> None:
        """`mcp_url` is that of our robot server; None for another one, which has neither telemetry nor a stop path.
        Times are in s."""
        self._stale_after = stale_after
        self._rest_timeout = rest_timeout
        self._base = f"http://{urlsplit(mcp_url).netloc}" if mcp_url else None
        self._headers = {"Authorization": f"Bearer {bearer}"} if bearer else {}
        self.state: telemetry.State | None = None
        self._news = asyncio.Condition()
        self._watchers: set[Watcher] = set()
        self._requests: set[asyncio.Task[Any]] = set()
        """Requests that go on although nobody waits for them any more."""

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        """Call `watcher` on each new state, and with None when the robot is lost; returns how to end that."""
        self._watchers.add(watcher)
        return lambda: self._watchers.discard(watcher)

    async def run(self) -> None:
        """Keep `state` up to date until cancelled; reconnect as often as needed."""
        if self._base is None:
            return
        while True:
            with contextlib.suppress(*_CONNECTION_ERRORS, TimeoutError):
                async with self._connection(self._base) as socket:
                    while True:
                        await self._take(await self._next(socket))
            if self.state is not None:
                log.warning("lost the robot's telemetry; trying again every %g s", RETRY_S)
            await self._set(None)
            await asyncio.sleep(RETRY_S)

    @contextlib.asynccontextmanager
    async def _connection(self, base: str) -> AsyncIterator[ClientConnection]:
        """A telemetry connection that is subscribed to states."""
        url = base.replace("http", "ws", 1) + "/telemetry"
        async with connect(url, additional_headers=self._headers, max_size=2**26) as socket:
            await socket.send(telemetry.encode(telemetry.Subscribe(["state"], RATE_HZ)))
            yield socket

    async def _next(self, socket: ClientConnection) -> telemetry.AnyMessage:
        """The next message, however long it takes. After `stale_after` s of silence the latest state is dropped."""
        try:
            async with asyncio.timeout(self._stale_after):
                return telemetry.decode(await socket.recv(decode=False))
        except TimeoutError:
            await self._fall_silent()
        return telemetry.decode(await socket.recv(decode=False))

    async def _take(self, message: telemetry.AnyMessage) -> None:
        if isinstance(message, telemetry.State):
            await self._set(message)

    async def _fall_silent(self) -> None:
        if self.state is not None:
            log.warning("the robot server has sent nothing for %g s; its connection is still open", self._stale_after)
        await self._set(None)

    async def _set(self, state: telemetry.State | None) -> None:
        self.state = state
        for watcher in list(self._watchers):
            watcher(state)
        async with self._news:
            self._news.notify_all()

    async def anew(self) -> telemetry.State | None:
        """The state of this moment; None when the robot server does not answer.

        The next message on the connection that `run` keeps can be older than this call: on a busy machine messages wait
        there. On a new connection none can.
        """
        with contextlib.suppress(*_CONNECTION_ERRORS, TimeoutError):
            if self._base is not None:
                async with asyncio.timeout(self._stale_after), self._connection(self._base) as socket:
                    while True:
                        message = telemetry.decode(await socket.recv(decode=False))
                        if isinstance(message, telemetry.State):
                            return message
        return None

    @property
    def reports_motion(self) -> bool:
        """Whether the robot says how it moves. A robot server of another make does not."""
        return self._base is not None or self.state is not None

    async def at_rest(self) -> bool:
        """Whether the robot stands still and follows no goal. Waits for it, `rest_timeout` s at most.

        A robot without telemetry does not count as at rest: it may be driving.
        """
        try:
            async with asyncio.timeout(self._rest_timeout):
                since = await self._now()
                async with self._news:
                    await self._news.wait()  # the present state is older than this call
                    await self._news.wait_for(lambda: self._resting(since))
                return True
        except TimeoutError:
            log.error("the robot is not known to be at rest %g s after the halt", self._rest_timeout)
            return False

    async def _now(self) -> float:
        """The time of this moment, in s of the robot's clock. Waits until the robot server answers."""
        while self._base is not None:
            if state := await self.anew():
                return state.time
            await asyncio.sleep(ASK_AGAIN_S)
        return -math.inf

    def _resting(self, since: float) -> bool:
        """Whether the robot is at rest in a state of `since` (s of its clock) or later."""
        state = self.state
        if state is None:
            return False
        return state.time >= since and state.motion is None and state.twist.linear == 0 and state.twist.angular == 0

    async def stop(self, by: str) -> dict[str, Any]:
        """Latch the stop in the robot server. Cancelling the caller does not cancel the request. Raises
        `RobotError`."""
        return await self._outlasting(self._post("/stop", by))

    async def release(self, by: str) -> dict[str, Any]:
        """Release the stop. Raises `RobotError`."""
        return await self._post("/release", by)

    async def forget_preview(self, own: str) -> None:
        """Withdraw the preview with this id. Cancelling the caller does not cancel the request. A failure is logged and
        not raised: a preview ends by itself, too."""
        if self._base is not None:
            await self._outlasting(self._delete(f"{self._base}/preview/{own}"))

    async def _outlasting(self, request: Coroutine[Any, Any, _Answer]) -> _Answer:
        """Wait for a request that goes on when the caller is cancelled.

        So a cancel of the caller is never lost, as it could be inside the HTTP client: anyio takes one that comes when
        the connection has just been made for its own.
        """
        task = asyncio.create_task(request)
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)
        return await asyncio.shield(task)

    async def _delete(self, url: str) -> None:
        try:
            async with httpx.AsyncClient(headers=self._headers, timeout=PREVIEW_TIMEOUT_S, trust_env=False) as client:
                await client.delete(url)
        except httpx.HTTPError as error:
            log.info("the preview could not be taken back: %s", type(error).__name__)

    async def _post(self, path: str, by: str) -> dict[str, Any]:
        if self._base is None:
            raise RobotError("This robot server has no stop path. Use the robot's own stop.")
        try:
            async with httpx.AsyncClient(headers=self._headers, timeout=3.0, trust_env=False) as client:
                response = await client.post(self._base + path, params={"by": by})
                response.raise_for_status()
                return dict(response.json())
        except (httpx.HTTPError, ValueError) as error:
            log.error("%s failed: %s", path, type(error).__name__)
            raise RobotError("The robot server did not take it. Use the robot's own stop button.") from error
