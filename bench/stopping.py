"""How long the robot needs to stand still: after a cancel, after a stop, and after its agent was killed.

    python bench/stopping.py [--robot simulator|ros2] [--repetitions 200] [--kills 10]

A robot server in its own process, at the wall's own pace; for ROS 2 with the stand-in, which is the simulator behind
real nodes, in another. Each repetition drives; once the robot moves, the tool call
is cancelled, or stop is pressed. Time is that of the robot server, in its own telemetry at 50 states a second: from the
last state that knows nothing of the cancel or the stop to the first with zero velocity, so that each figure is up to 20
ms too long. The bound is two control periods and the braking time of the speed at that moment. Last, an agent that
drives for a prompt is killed with SIGKILL, and others stopped with SIGSTOP, in mid-motion: the wall's time until the
robot stands still.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

import httpx

from backend import config, telemetry
from backend.agent.robot.mcp_client import McpClient
from backend.mcp_robot.motion.guard import PERIOD

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.processes import Client, Robot, Watched, end, eventually

DRIVING = 0.55
"""m/s: it drives when it is this fast."""
ENDS = {"lab 2.3.9": (20.8, 4.0), "dock": (0.9, 3.1)}
TURN_BACK = 4.0
"""It drives from one to the other, and turns back so many m before: it never arrives, and seldom has to turn."""
DOMAIN = {"ROBOT_ACP_ROBOT__ROS2__DOMAIN_ID": "97", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
SETTINGS = {
    "ROBOT_ACP_ROBOT__LIMITS__MAX_MOTIONS_PER_MINUTE": "6000",
    "ROBOT_ACP_ROBOT__LIMITS__CLIENT_SILENCE": str(config.Limits().client_silence),
    "ROBOT_ACP_LOG_LEVEL": "error",
}
"""The rate limit is for people and models, not for two hundred halts in a row; tests are more patient with silence."""


@dataclass(frozen=True)
class Halt:
    """One halt: the speed at which it was asked for (m/s), the seconds until zero velocity, and its bound."""

    speed: float
    seconds: float
    bound: float


class Bench:
    """One robot server, and an agent's connection to it."""

    def __init__(self, robot: Robot, watched: Watched, limits: config.Limits) -> None:
        self.robot = robot
        self.watched = watched
        self.limits = limits
        url = f"http://127.0.0.1:{robot.robot_port}"
        self.tools = McpClient(url + "/mcp", robot.robot_headers, absent="The robot server is gone.")
        self._end = next(iter(ENDS))
        self.http = httpx.AsyncClient(base_url=url, headers=robot.robot_headers)

    async def cancelled(self) -> Halt:
        """Drive, and cancel the call."""
        async with self._driving() as driving:

            async def cancel() -> None:
                driving.cancel()

            return await self._timed(cancel, lambda state: state.motion is None)

    async def stopped(self) -> Halt:
        """Drive, and press stop."""
        async with self._driving():

            async def stop() -> None:
                await self.http.post("/stop", params={"by": "bench"})

            halt = await self._timed(stop, lambda state: state.stop is not None)
        await self.http.post("/release", params={"by": "bench"})
        return halt

    async def lost(self, number: signal.Signals) -> float:
        """Let an agent drive, and send it a signal; the wall's seconds until the robot stands still."""
        with self.robot.running("agent", port=self.robot.agent_port) as agent:
            client = await Client.open(f"tcp://127.0.0.1:{self.robot.agent_port}")
            await client.new()
            prompt = client.later(client.prompt(f"go to the {self._far()}"))
            try:
                await self._drives()
                begin = time.monotonic()
                agent.send_signal(number)
                await eventually(lambda: self.watched.state.motion is None and rests(self.watched.state), "rest")
                return time.monotonic() - begin
            finally:
                agent.kill()
                await asyncio.gather(prompt, return_exceptions=True)
                await client.close()

    @contextlib.asynccontextmanager
    async def _driving(self) -> AsyncIterator[asyncio.Task[object]]:
        task: asyncio.Task[object] = asyncio.create_task(self.tools.call("navigate_to_place", {"place": self._far()}))
        try:
            await self._drives()
            yield task
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    def _far(self) -> str:
        self._end = far_end(self.watched, self._end)
        return self._end

    async def _drives(self) -> None:
        await eventually(lambda: self.watched.state.motion and self.watched.speed > DRIVING, "the robot to drive")

    async def _timed(self, act: Callable[[], Awaitable[None]], known: Callable[..., bool]) -> Halt:
        return await timed(self.watched, self.limits, act, known)


def far_end(watched: Watched, end: str) -> str:
    """Where to drive next, on the way to `end`: there, or to the other end when it is near."""
    near = watched.distance_to(*ENDS[end]) < TURN_BACK
    return next(other for other in ENDS if other != end) if near else end


def rests(state: telemetry.State) -> bool:
    """Whether the robot stands still."""
    return state.twist == telemetry.Twist(0.0, 0.0)


async def timed(
    watched: Watched, limits: config.Limits, act: Callable[[], Awaitable[None]], known: Callable[..., bool]
) -> Halt:
    """Do what halts the robot, and take the time from the last state that does not know it to zero velocity."""
    seen = len(watched.states)
    await act()
    await eventually(lambda: known(watched.state) and rests(watched.state), "zero velocity")
    states = [state for _, state in watched.states[seen - 1 :]]
    first = next(i for i, state in enumerate(states) if known(state))
    before = states[max(first - 1, 0)]
    speed = abs(before.twist.linear)
    rest = next(state for state in states[first:] if rests(state))
    del watched.states[:-1]
    return Halt(speed, rest.time - before.time, 2 * PERIOD + speed / limits.braking)


def report(what: str, halts: list[Halt]) -> None:
    """One line of the table, and how many were over their bound."""
    times = sorted(halt.seconds * 1000 for halt in halts)
    p99 = times[min(len(times) - 1, int(0.99 * len(times)))]
    speeds = statistics.median(halt.speed for halt in halts)
    over = sum(halt.seconds > halt.bound for halt in halts)
    bound = statistics.median(halt.bound * 1000 for halt in halts)
    print(
        f"{what:28} p50 {statistics.median(times):4.0f} ms  p99 {p99:4.0f} ms  bound {bound:4.0f} ms "
        f"(median speed {speeds:.2f} m/s; {over} of {len(halts)} over their bound)"
    )


async def measure(robot: Robot, repetitions: int, kills: int) -> None:
    """All of it, against a robot server that runs."""
    limits = config.Limits()
    async with robot.watched() as watched:
        bench = Bench(robot, watched, limits)
        for what, halt in (("cancel to zero velocity", bench.cancelled), ("stop to zero velocity", bench.stopped)):
            report(what, [await halt() for _ in range(repetitions)])
        bound = 1000 * (limits.client_silence + 2 * PERIOD + limits.max_speed / limits.braking)
        for number in (signal.SIGKILL, signal.SIGSTOP):
            times = [await bench.lost(number) * 1000 for _ in range(kills)]
            print(
                f"the agent gets {number.name:13} p50 {statistics.median(times):4.0f} ms  max {max(times):4.0f} ms",
                end="",
            )
            print(f"  bound {bound:4.0f} ms")
        await bench.tools.close()
        await bench.http.aclose()


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--robot", default="simulator", choices=["simulator", "ros2"])
    arguments.add_argument("--repetitions", type=int, default=200)
    arguments.add_argument("--kills", type=int, default=10)
    asked = arguments.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, robot: {asked.robot}")
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as running:
        robot = Robot(Path(folder), dict(SETTINGS))
        command = ["robot"]
        if asked.robot == "ros2":
            command += ["--robot", "ros2", "--ros2-demo"]
            robot.environment.update(DOMAIN)
            stand_in = robot.spawn("ros2-demo", stdout=subprocess.PIPE)
            running.callback(end, stand_in)
            assert stand_in.stdout is not None
            while "on the domain" not in (line := stand_in.stdout.readline()):
                assert line, "the stand-in has ended"
        running.enter_context(robot.running(*command, port=robot.robot_port))
        asyncio.run(measure(robot, asked.repetitions, asked.kills))


if __name__ == "__main__":
    main()
