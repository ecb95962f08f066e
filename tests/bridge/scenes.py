"""The robot's end of `/telemetry` for tests of the scene, a small map, and what viser's page and server say."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import msgspec
import viser
import zstandard
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.server import ServerConnection, serve

from backend import telemetry
from backend.telemetry import Battery, Map, Place, Pose, State, Twist

PATIENCE = 30.0
"""Seconds after which a condition that is waited for has failed; met ones take milliseconds."""

SUBPROTOCOL = f"viser-v{viser.__version__}"

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (3.0, 3.0, 3.0),
    "fov": 0.7,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 500,
    "image_width": 600,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
POINTER = {
    "type": "ScenePointerMessage",
    "event_type": "click",
    "ray_origin": (0.0, 0.0, 0.0),
    "ray_direction": (0.0, 0.0, -1.0),
    "screen_pos": ((0.5, 0.5),),
    "modifier": None,
}


MAP = Map(
    resolution=0.5,
    width=8,
    height=6,
    origin_x=0.0,
    origin_y=0.0,
    cells=bytes([100] * 8 + [0] * 32 + [100] * 8),
    places=[Place("k", "kitchen", "space", Pose(1.0, 1.5, 0.0))],
)


def state(**changes) -> State:
    values = {
        "time": 1.0,
        "robot": "Sancho",
        "pose": Pose(1.0, 2.0, 1.5),
        "twist": Twist(0.0, 0.0),
        "battery": Battery(0.8, False),
        "motion": None,
        "stop": None,
        "speaking": None,
    }
    return State(**(values | changes))


async def told(page: ClientConnection, kind: str) -> dict[str, Any]:
    """The next message of a kind that a page is sent, by viser or by the bridge."""
    async with asyncio.timeout(PATIENCE):
        while True:
            frame = await page.recv()
            assert isinstance(frame, bytes)
            size, packed = (int.from_bytes(frame[at : at + 8], "little") for at in (0, 8))
            unpacked = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed])
            assert len(unpacked) == size
            for message in msgspec.msgpack.decode(unpacked)["messages"]:
                if message["type"] == kind and not message.get("initial"):
                    return message


class TelemetryPeer:
    """The robot's end of `/telemetry`: it tells what was asked of it, and sends what a test has it send."""

    def __init__(self) -> None:
        self.port = 0
        self.asked: list[telemetry.Subscribe] = []
        self.authorization = ""
        self.connections = 0
        self._connection: ServerConnection | None = None

    async def handle(self, connection: ServerConnection) -> None:
        self._connection = connection
        self.connections += 1
        self.authorization = connection.request.headers["Authorization"]
        async for frame in connection:
            self.asked.append(telemetry.decode_subscribe(frame))

    async def send(self, *messages: telemetry.AnyMessage) -> None:
        for message in messages:
            await self._connection.send(telemetry.encode(message))

    async def hang_up(self) -> None:
        await self._connection.close()


@asynccontextmanager
async def telemetry_peer() -> AsyncIterator[TelemetryPeer]:
    """A robot that listens."""
    peer = TelemetryPeer()
    async with serve(peer.handle, "127.0.0.1", 0, compression=None) as listening:
        peer.port = next(iter(listening.sockets)).getsockname()[1]
        yield peer
