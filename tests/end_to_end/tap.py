"""What the bridge asks of the robot's telemetry, read off the wire between them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import ServerConnection, serve

from backend import telemetry
from tests.processes import Robot


@dataclass
class Tap:
    """The latest subscription that went by; `port` is the robot's, as the bridge knows it."""

    robot: Robot
    port: int = 0
    channels: list[str] = field(default_factory=list)

    async def pass_on(self, bridge: ServerConnection) -> None:
        url = f"ws://127.0.0.1:{self.robot.robot_port}/telemetry"
        async with connect(url, additional_headers=self.robot.robot_headers, max_size=None) as robot:
            await asyncio.gather(self._asked(bridge, robot), self._told(robot, bridge))

    async def _asked(self, bridge: ServerConnection, robot: ClientConnection) -> None:
        async for frame in bridge:
            assert isinstance(frame, bytes)
            self.channels = list(telemetry.decode_subscribe(frame).channels)
            await robot.send(frame)
        await robot.close()

    @staticmethod
    async def _told(robot: ClientConnection, bridge: ServerConnection) -> None:
        async for frame in robot:
            await bridge.send(frame)
        await bridge.close()


@contextlib.asynccontextmanager
async def tap_on(robot: Robot) -> AsyncIterator[Tap]:
    tap = Tap(robot)
    async with serve(tap.pass_on, "127.0.0.1", 0, max_size=None) as server:
        tap.port = server.sockets[0].getsockname()[1]
        yield tap
