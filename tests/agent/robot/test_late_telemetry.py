"""What an agent on a busy machine hears late is no news: neither of a robot at rest, nor of its stop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from websockets.asyncio.server import ServerConnection, serve

from backend import telemetry
from backend.agent.robot.robot_client import RobotClient
from backend.robot_server import RobotServerClient
from backend.telemetry import Battery, Pose, State, Stop, Twist
from tests.processes import PATIENCE_S, eventually


def at(time: float, speed: float = 0.0, stop: Stop | None = None) -> State:
    pose, battery = Pose(0.0, 0.0, 0.0), Battery(1.0, False)
    return State(time, "Sancho", pose, Twist(0.0, speed), battery, None, stop, None)


@dataclass
class Line:
    """The robot's end of `/telemetry`. Its first reader is told what a test says, whoever comes later how it is now."""

    now: State
    readers: list[ServerConnection] = field(default_factory=list)

    async def serve(self, reader: ServerConnection) -> None:
        self.readers.append(reader)
        async for _ in reader:  # it subscribes
            await reader.send(telemetry.encode(self.now))

    async def tell(self, state: State) -> None:
        await self.readers[0].send(telemetry.encode(state))


@asynccontextmanager
async def linked(line: Line) -> AsyncIterator[RobotClient]:
    """The agent's link, which has heard how the robot was at first."""
    async with serve(line.serve, "127.0.0.1", 0) as server:
        url = f"http://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}"
        # A slow test is no silent robot.
        link = RobotClient(RobotServerClient(url), stale_after=PATIENCE_S, rest_timeout=PATIENCE_S)
        following = asyncio.create_task(link.run())
        await eventually(lambda: link.state, "the robot")
        yield link
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)


async def heard(link: RobotClient, line: Line, state: State) -> None:
    await line.tell(state)
    await eventually(lambda: link.state and link.state.time == state.time, "the next state")


async def test_a_robot_that_drives_is_not_at_rest_because_it_was() -> None:
    line = Line(at(1.0))
    async with linked(line) as link:
        line.now = at(9.0, speed=0.5)
        rest = asyncio.create_task(link.at_rest())
        await eventually(lambda: len(line.readers) == 2, "the robot to be asked how it is now")
        for late in (2.0, 3.0, 8.0):
            await heard(link, line, at(late))
        assert not rest.done()
        await heard(link, line, at(9.5, speed=0.5))
        assert not rest.done()
        await heard(link, line, at(10.0))
        await rest


async def test_a_stop_that_was_is_none_that_is() -> None:
    line = Line(at(1.0, stop=Stop("Ana", 1.0)))
    async with linked(line) as link:
        line.now = at(9.0)
        asked = asyncio.create_task(link.anew())
        await eventually(lambda: len(line.readers) == 2, "the robot to be asked how it is now")
        for late in (2.0, 3.0):
            await line.tell(at(late, stop=Stop("Ana", 1.0)))
        state = await asked
        assert state is not None
        assert state.stop is None
