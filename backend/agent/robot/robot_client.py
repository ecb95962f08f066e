"""The agent's view of the robot beside MCP: its latest state, the stop path and previews.

Our robot server has these paths. Another MCP server may have them; without them the state stays None and everything
else works. It never moves the robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, TypeVar

import httpx
import msgspec
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import InvalidHandshake, WebSocketException

from backend import telemetry
from backend.robot_server import RobotError as RobotError
from backend.robot_server import RobotServerClient

log = logging.getLogger(__name__)

RATE_HZ = 20.0
RETRY_S = 1.0
REST_TIMEOUT_S = 5.0
REFUSED_RETRY_S = 30.0
"""The same where a server of another make answers, but has no telemetry."""
STALE_S = 2.0
"""States come twenty times a second: after so long without one the latest state is no longer valid."""
ASK_AGAIN_S = 0.1
"""A robot server that does not answer is asked again after so many seconds how the robot is."""

_CONNECTION_ERRORS = (OSError, WebSocketException, msgspec.DecodeError)
"""The errors with which a telemetry connection ends."""

_Answer = TypeVar("_Answer")
Watcher = Callable[["telemetry.State | None"], None]


class RobotClient:
    """The latest state of the robot. `state` is None while the robot server is unreachable or silent."""

    def __init__(
        self,
        server: RobotServerClient,
        *,
        stale_after: float = STALE_S,
        rest_timeout: float = REST_TIMEOUT_S,
    ) -> None:
        """Times are in s. The server is closed by its owner."""
        self._server = server
        self._stale_after = stale_after
        self._rest_timeout = rest_timeout
        self.state: telemetry.State | None = None
        self._news = asyncio.Condition()
        self._watchers: set[Watcher] = set()
        self._requests: set[asyncio.Task[Any]] = set()
        """Requests that go on although nobody waits for them any more."""

    @property
    def keeps_a_stop(self) -> bool:
        """Whether the robot is known to refuse motion after a stop until somebody releases it. Only our robot server
        is."""
        return self._server.is_ours

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        """Call `watcher` on each new state, and with None when the robot is lost; returns how to end that."""
        self._watchers.add(watcher)
        return lambda: self._watchers.discard(watcher)

    async def run(self) -> None:
        """Keep `state` up to date until cancelled; reconnect as often as needed."""
        if not self._server.has_paths:
            return
        while True:
            pause = RETRY_S
            try:
                async with self._connection() as socket:
                    while True:
                        await self._take(await self._next(socket))
            except InvalidHandshake:
                pause = RETRY_S if self._server.is_ours else REFUSED_RETRY_S
            except (*_CONNECTION_ERRORS, TimeoutError):
                pass
            if self.state is not None:
                log.warning("lost the robot's telemetry; trying again every %g s", pause)
            await self._set(None)
            await asyncio.sleep(pause)

    @contextlib.asynccontextmanager
    async def _connection(self) -> AsyncIterator[ClientConnection]:
        """A telemetry connection that is subscribed to states."""
        async with self._server.telemetry() as socket:
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
            if self._server.has_paths:
                async with asyncio.timeout(self._stale_after), self._connection() as socket:
                    while True:
                        message = telemetry.decode(await socket.recv(decode=False))
                        if isinstance(message, telemetry.State):
                            return message
        return None

    @property
    def reports_motion(self) -> bool:
        """Whether the robot says how it moves. A robot server of another make does not."""
        return self._server.is_ours or self.state is not None

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
        while self._server.has_paths and self.reports_motion:
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
        """Stop the robot: `{"stopped": {by, at}}`. Cancelling the caller does not cancel the request. Raises
        `NotStopped`."""
        try:
            return await self._outlasting(self._server.stop(by))
        except RobotError as error:
            log.error("the robot has not confirmed a stop by %s: %s", by, error)
            raise

    async def release(self, by: str) -> dict[str, Any]:
        """Release the stop. Raises `RobotError`."""
        return await self._server.release(by)

    async def forget_preview(self, own: str) -> None:
        """Withdraw the preview with this id. Cancelling the caller does not cancel the request. A failure is logged and
        not raised: a preview ends by itself, too."""
        try:
            await self._outlasting(self._server.forget_preview(own))
        except (httpx.HTTPError, TimeoutError) as error:
            log.info("the preview could not be taken back: %s", type(error).__name__)

    async def _outlasting(self, request: Coroutine[Any, Any, _Answer]) -> _Answer:
        """Wait for a request that goes on when the caller is cancelled.

        So a cancel of the caller is never lost, as it could be inside the HTTP client: anyio takes one that comes when
        the connection has just been made for its own.
        """
        task = asyncio.create_task(request)
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)
        return await asyncio.shield(task)
