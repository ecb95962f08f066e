"""The `/telemetry` stream: the latest values, to each reader at the rate that it asked for and can read.

Each reader has one task and no queue: a message is made when the reader is ready for it. So a slow reader gets fewer
messages, and none that waited. Nothing here can delay the robot or another reader.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Awaitable, Callable
from weakref import WeakSet

import msgspec
import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from backend import telemetry
from backend.mcp_robot.http.camera_feed import CameraFeed
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.navigation.grid import FREE, KEEP_OUT, OccupancyGrid
from backend.mcp_robot.refusal import Refusal
from backend.telemetry import CHANNELS, Channel, Hello, Map, Path, Speech, Subscribe

MAX_RATE = 60.0
MIN_RATE = 0.1
MAX_PAUSE = 1.0
"""Seconds between two checks for another map, for a reader that wants neither states nor scans."""

EARLY = 0.02
"""A picture is sent up to so many seconds before it is due: the next one may be a fifth of a second away."""

Send = Callable[[bytes], Awaitable[None]]


class TelemetryStream:
    """All readers of one robot."""

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self._readers: WeakSet[_Reader] = WeakSet()
        self._map: tuple[OccupancyGrid, bytes] | None = None  # the grid encoded last: it is large and seldom changes
        self._camera = CameraFeed(pilot, self._changed)
        pilot.on_change = self._changed

    def _hello(self) -> Hello:
        has_camera = self._pilot.robot.capabilities.camera
        channels: list[str] = [channel for channel in CHANNELS if channel != "camera" or has_camera]
        return Hello(telemetry.VERSION, self._pilot.robot.name, channels)

    def _changed(self) -> None:
        for reader in self._readers:
            reader.wake.set()

    def _encoded_map(self) -> tuple[OccupancyGrid, bytes] | None:
        """The map, encoded; None while the robot has none."""
        try:
            grid = self._pilot.robot.grid
        except Refusal:
            return None
        if self._map is None or self._map[0] is not grid:
            self._map = grid, telemetry.encode(map_message(self._pilot))
        return self._map

    async def serve(self, websocket: WebSocket) -> None:
        """One reader's connection, from its acceptance to its end."""
        await websocket.accept()
        reader = _Reader(self._pilot, self._encoded_map, self._camera, websocket.send_bytes)
        self._readers.add(reader)
        with contextlib.suppress(WebSocketDisconnect, msgspec.MsgspecError):
            await websocket.send_bytes(telemetry.encode(self._hello()))
            try:
                async with asyncio.TaskGroup() as group:
                    sending = group.create_task(reader.run())
                    try:
                        while True:
                            reader.subscribe(telemetry.decode_subscribe(await websocket.receive_bytes()))
                    finally:
                        sending.cancel()
                        self._camera.unwatch(reader)
            except* (WebSocketDisconnect, KeyError):  # gone, or a text frame where bytes belong
                pass
            except* msgspec.MsgspecError:
                await websocket.close(1003, "Send a msgpack map of type subscribe.")


class _Reader:
    """One reader: the channels that it asked for, and the latest of each that it was sent."""

    def __init__(
        self,
        pilot: Pilot,
        encoded_map: Callable[[], tuple[OccupancyGrid, bytes] | None],
        camera: CameraFeed,
        send: Send,
    ) -> None:
        self._pilot = pilot
        self._camera = camera
        self._encoded_map = encoded_map
        self._send = send
        self._channels: frozenset[Channel] = frozenset()  # replaced by subscribe
        self._interval = 1.0  # wall seconds between states, replaced by subscribe
        self._due = 0.0  # monotonic time of the next state
        self._grid: OccupancyGrid | None = None  # the map sent last
        self._path: Path | None = None  # the path sent last
        self._speech: Speech | None = pilot.speech  # the sentence sent last; those from before are over
        self._picture: bytes | None = None  # the picture sent last
        self._picture_due = 0.0  # monotonic time of the next picture
        self.wake = asyncio.Event()  # set when there may be something to send before the next state

    def subscribe(self, asked: Subscribe) -> None:
        """Replace the channels and the rate that this reader wants."""
        has_camera = self._pilot.robot.capabilities.camera
        self._channels = frozenset(asked.channels) - (frozenset() if has_camera else {"camera"})
        (self._camera.watch if "camera" in self._channels else self._camera.unwatch)(self)
        rate = MIN_RATE if math.isnan(asked.rate) else asked.rate
        self._interval = 1.0 / min(max(rate, MIN_RATE), MAX_RATE)
        self._due = 0.0
        self._grid = None
        self._path = None
        self.wake.set()

    async def run(self) -> None:
        """Send until cancelled."""
        while True:
            self.wake.clear()  # before sending: a change meanwhile sets it again
            await self._send_changes()
            streaming = bool(self._channels & {"state", "scan"})
            if streaming and time.monotonic() >= self._due:
                self._due = max(self._due + self._interval, time.monotonic())  # what was missed is not made up for
                await self._send_latest()
            pause = max(0.0, self._due - time.monotonic()) if streaming else MAX_PAUSE
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await self.wake.wait()

    async def _send_changes(self) -> None:
        if "map" in self._channels and (latest := self._encoded_map()) and latest[0] is not self._grid:
            self._grid, frame = latest
            await self._send(frame)
        if "path" in self._channels and self._path is not self._pilot.path:
            self._path = self._pilot.path
            await self._send(telemetry.encode(self._path))
        if "speech" in self._channels and self._speech is not self._pilot.speech:
            self._speech = self._pilot.speech
            if self._speech:
                await self._send(telemetry.encode(self._speech))
        if "camera" in self._channels and time.monotonic() >= self._picture_due:
            picture = self._camera.latest
            if picture is not None and picture is not self._picture:
                self._picture = picture
                self._picture_due = time.monotonic() + self._interval - EARLY
                await self._send(picture)

    async def _send_latest(self) -> None:
        if "state" in self._channels:
            await self._send(telemetry.encode(self._pilot.state()))
        if "scan" in self._channels:
            await self._send(telemetry.encode(self._pilot.robot.scan()))


def map_message(pilot: Pilot) -> Map:
    """The robot's map, places and keep-out zones as telemetry."""
    robot = pilot.robot
    grid = robot.grid
    cells = np.where(grid.cells == KEEP_OUT, np.uint8(FREE), grid.cells)
    return Map(
        grid.resolution, grid.width, grid.height, grid.origin_x, grid.origin_y,
        cells.tobytes(), list(robot.places.places), list(pilot.zones),
    )  # fmt: skip
