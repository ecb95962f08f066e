"""The one subscription to the robot's telemetry: kept up through restarts of the robot, as slow as will do.

While nobody watches, the robot is asked for little, so that the scene is up to date the moment somebody comes.
"""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Awaitable, Callable

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from backend import telemetry
from backend.bridge.race import first_of

_WATCHED = 20.0
_CAMERA = 5.0
_UNWATCHED = 2.0
"""States, scans and pictures a second, at most."""
_FIRST_DELAY = 0.25
_LONGEST_DELAY = 5.0
_MAX_MESSAGE_BYTES = 64 * 1024 * 1024

log = logging.getLogger(__name__)


class Feed:
    """Reads the stream at `url` and hands each message to `show`; calls `lost` whenever the robot is gone."""

    def __init__(
        self,
        url: str,
        secret: bytes,
        show: Callable[[telemetry.AnyMessage], Awaitable[None]],
        lost: Callable[[], None],
    ) -> None:
        self._url = url
        self._headers = {"Authorization": f"Bearer {secret.decode()}"}
        self._show = show
        self._lost = lost
        self._wanted = _wanted(scene=False, camera=False)
        self._changed = asyncio.Event()  # set when something else is wanted

    def watch(self, *, scene: bool, camera: bool) -> None:
        """Whether anybody looks at the scene right now, and through the robot's camera."""
        wanted = _wanted(scene=scene, camera=camera)
        if wanted != self._wanted:
            self._wanted = wanted
            self._changed.set()

    async def run(self) -> None:
        """Keep the subscription until cancelled."""
        delay, trouble = _FIRST_DELAY, ""
        while True:
            try:
                async with connect(
                    self._url,
                    additional_headers=self._headers,
                    compression=None,
                    proxy=None,
                    max_size=_MAX_MESSAGE_BYTES,
                    ping_interval=5,
                    ping_timeout=5,
                ) as stream:
                    log.info("scene: the robot's telemetry is connected")
                    delay, trouble = _FIRST_DELAY, ""
                    await first_of(self._listen(stream), self._subscribe(stream))
            except (OSError, WebSocketException, TimeoutError) as error:
                if str(error) != trouble:  # said once, not at every try
                    level = logging.INFO if isinstance(error, OSError) else logging.WARNING  # not there, or refusing
                    log.log(level, "scene: no telemetry from the robot: %s", error)
                trouble = str(error)
            self._lost()
            await asyncio.sleep(delay * random.uniform(0.8, 1.2))  # noqa: S311 - spreads, hides nothing
            delay = min(delay * 2, _LONGEST_DELAY)

    async def _subscribe(self, stream: ClientConnection) -> None:
        while True:
            self._changed.clear()
            await stream.send(telemetry.encode(self._wanted))
            await self._changed.wait()

    async def _listen(self, stream: ClientConnection) -> None:
        async for frame in stream:
            try:
                message = telemetry.decode(frame if isinstance(frame, bytes) else frame.encode())
            except (msgspec.ValidationError, msgspec.DecodeError) as error:
                log.warning("scene: dropped a telemetry message: %s", error)
                continue
            try:
                await self._show(message)
            except Exception:  # another robot's map must not end the scene for good
                log.exception("scene: a %s message cannot be drawn", type(message).__name__)


def _wanted(*, scene: bool, camera: bool) -> telemetry.Subscribe:
    channels: list[telemetry.Channel] = ["state", "path", "map"]
    if scene:
        channels.append("scan")
    if camera:
        channels.append("camera")
    return telemetry.Subscribe(channels, _WATCHED if scene else _CAMERA if camera else _UNWATCHED)
