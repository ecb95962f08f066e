"""The robot's end of `/telemetry` for tests of the scene, and small maps, states and scans."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from websockets.asyncio.client import ClientConnection
from websockets.asyncio.server import ServerConnection, serve

from backend import telemetry
from backend.telemetry import Battery, Map, Place, Pose, Scan, State, Twist
from tests.bridge.viser_page import messages_in

PATIENCE = 30.0
"""Seconds after which a condition that is waited for has failed; met ones take milliseconds."""

MAP = Map(
    resolution=0.5,
    width=8,
    height=6,
    origin_x=0.0,
    origin_y=0.0,
    cells=bytes([100] * 8 + [0] * 32 + [100] * 8),
    places=[Place("k", "kitchen", "space", Pose(1.0, 1.5, 0.0))],
)
HALL = Map(0.1, 100, 100, 0.0, 0.0, bytes(10000), [])
TOO_SHORT = Map(0.5, 8, 6, 0.0, 0.0, b"too short", [])
"""A map that cannot be drawn."""


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


async def received(page: ClientConnection, kind: str) -> dict[str, Any]:
    """The next message of a type that a page receives, from viser or from the bridge."""
    async with asyncio.timeout(PATIENCE):
        while True:
            for message in messages_in(await page.recv()):
                if message["type"] == kind and not message.get("initial"):
                    return message


def person(x: float) -> Scan:
    """What the laser at (5, 5) measures of somebody who stands at (x, 5)."""
    return Scan(1.0, Pose(5.0, 5.0, 0.0), -0.06, 0.03, 10.0, [x - 5.2] * 5)


class TelemetryPeer:
    """The robot's end of `/telemetry`: it records what it is asked for, and sends what a test tells it to."""

    def __init__(self) -> None:
        self.port = 0
        self.subscriptions: list[telemetry.Subscribe] = []
        self.authorization = ""
        self.connections = 0
        self._connection: ServerConnection | None = None

    async def handle(self, connection: ServerConnection) -> None:
        self._connection = connection
        self.connections += 1
        self.authorization = connection.request.headers["Authorization"]
        async for frame in connection:
            self.subscriptions.append(telemetry.decode_subscribe(frame))

    async def send(self, *messages: telemetry.AnyMessage) -> None:
        for message in messages:
            await self._connection.send(telemetry.encode(message))

    async def send_bytes(self, frame: bytes) -> None:
        await self._connection.send(frame)

    async def hang_up(self) -> None:
        await self._connection.close()


@asynccontextmanager
async def telemetry_peer() -> AsyncIterator[TelemetryPeer]:
    """A robot that listens."""
    peer = TelemetryPeer()
    async with serve(peer.handle, "127.0.0.1", 0, compression=None) as listening:
        peer.port = next(iter(listening.sockets)).getsockname()[1]
        yield peer
