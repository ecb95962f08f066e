"""The bridge's one subscription to the robot's telemetry. It reconnects whenever the robot server comes back.

While nobody watches, it asks for few messages: enough to keep the scene current for the next viewer.
"""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Awaitable, Callable

import msgspec
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import WebSocketException

from backend import telemetry
from backend.bridge.first_completed import first_completed
from backend.robot_server import RobotServerClient

_WATCHED_RATE = 20.0
_CAMERA_RATE = 5.0
_UNWATCHED_RATE = 2.0
"""The most messages a second of each channel."""
_FIRST_DELAY = 0.25
_LONGEST_DELAY = 5.0
"""s between attempts to connect."""

log = logging.getLogger(__name__)


class TelemetryFeed:
    """Reads the robot's stream. Calls `on_message` for each message, and `on_disconnect` when the robot is lost."""

    def __init__(
        self,
        robot: RobotServerClient,
        on_message: Callable[[telemetry.AnyMessage], Awaitable[None]],
        on_disconnect: Callable[[], None],
    ) -> None:
        self._robot = robot
        self._on_message = on_message
        self._on_disconnect = on_disconnect
        self._subscription = _subscription(scene=False, camera=False)
        self._changed = asyncio.Event()  # set when the subscription has changed

    def set_watched(self, *, scene: bool, camera: bool) -> None:
        """Whether anybody watches the scene, and the robot's camera, from now on."""
        subscription = _subscription(scene=scene, camera=camera)
        if subscription != self._subscription:
            self._subscription = subscription
            self._changed.set()

    async def run(self) -> None:
        """Keep the subscription until cancelled. A robot without a stream counts as not connected."""
        if not self._robot.has_paths:
            self._on_disconnect()
            await asyncio.Event().wait()
        delay, last_error = _FIRST_DELAY, ""
        while True:
            try:
                async with self._robot.telemetry() as stream:
                    log.info("scene: the robot's telemetry is connected")
                    delay, last_error = _FIRST_DELAY, ""
                    await first_completed(self._read(stream), self._subscribe(stream))
            except (OSError, WebSocketException, TimeoutError) as error:
                if str(error) != last_error:  # logged once, not at each attempt
                    level = logging.INFO if isinstance(error, OSError) else logging.WARNING  # not running, or refusing
                    log.log(level, "scene: no telemetry from the robot: %s", error)
                last_error = str(error)
            self._on_disconnect()
            await asyncio.sleep(delay * random.uniform(0.8, 1.2))  # noqa: S311 - spreads load, no secret
            delay = min(delay * 2, _LONGEST_DELAY)

    async def _subscribe(self, stream: ClientConnection) -> None:
        while True:
            self._changed.clear()
            await stream.send(telemetry.encode(self._subscription))
            await self._changed.wait()

    async def _read(self, stream: ClientConnection) -> None:
        async for frame in stream:
            try:
                message = telemetry.decode(frame if isinstance(frame, bytes) else frame.encode())
            except (msgspec.ValidationError, msgspec.DecodeError) as error:
                log.warning("scene: dropped a telemetry message: %s", error)
                continue
            try:
                await self._on_message(message)
            except Exception:  # one message that cannot be drawn must not end the scene
                log.exception("scene: a %s message cannot be drawn", type(message).__name__)


def _subscription(*, scene: bool, camera: bool) -> telemetry.Subscribe:
    channels: list[telemetry.Channel] = ["state", "path", "map"]
    if scene:
        channels.append("scan")
    if camera:
        channels.append("camera")
    return telemetry.Subscribe(channels, _WATCHED_RATE if scene else _CAMERA_RATE if camera else _UNWATCHED_RATE)
