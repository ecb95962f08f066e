"""What the simulator costs: planning, a scan, a picture, a step; the server's share of a core; how fast time runs.

Run `.venv/bin/python bench/simulator.py`. Times are CPU time of the process that does the work, so that other load
counts little; only the simulated seconds of a wall second need a machine that is free. It judges nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared._httpx_utils import create_mcp_http_client
from websockets.asyncio.client import connect

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from backend import telemetry  # noqa: E402
from backend.config import Limits, Simulator  # noqa: E402
from backend.mcp_robot.navigation import planner  # noqa: E402
from backend.mcp_robot.simulator import world  # noqa: E402
from backend.mcp_robot.simulator.laser import Laser  # noqa: E402
from backend.mcp_robot.simulator.rendering import renderer  # noqa: E402
from backend.mcp_robot.simulator.simulation import PLANNING_RADIUS, Simulation  # noqa: E402
from backend.mcp_robot.simulator.world import World  # noqa: E402
from backend.telemetry import Pose  # noqa: E402
from tests.processes import Robot, wait_until  # noqa: E402


def report(what: str, seconds: list[float]) -> None:
    """One line in ms of CPU time."""
    median, p95, most = np.percentile(np.array(seconds) * 1000, [50, 95, 100])
    print(f"{what:44} median {median:7.2f} ms   p95 {p95:7.2f} ms   max {most:7.2f} ms   n={len(seconds)}")


def free_points(building: World, generator: np.random.Generator, count: int) -> list[tuple[float, float]]:
    """Points anywhere on the floor where a robot can stand."""
    rows, columns = np.nonzero(building.grid.distance > PLANNING_RADIUS + 0.1)
    chosen = generator.choice(len(rows), count)
    grid = building.grid
    x = grid.origin_x + (columns[chosen] + 0.5) * grid.resolution
    y = grid.origin_y + (rows[chosen] + 0.5) * grid.resolution
    return list(zip(x.tolist(), y.tolist(), strict=True))


def planning(building: World, name: str, runs: int, obstacles: int = 0) -> None:
    """Ways between random points; with so many points in the way that the map does not know."""
    generator = np.random.default_rng(1)
    search = planner.search_grid(building.grid, PLANNING_RADIUS)
    took: list[float] = []
    starts, goals = free_points(building, generator, runs), free_points(building, generator, runs)
    for start, goal in zip(starts, goals, strict=True):
        seen = np.array(start) + generator.normal(0, 3.0, (obstacles, 2)) + (2.0, 2.0)
        began = time.process_time()
        with contextlib.suppress(planner.Unreachable):
            planner.plan(building.grid, search, start, goal, PLANNING_RADIUS, seen)
            took.append(time.process_time() - began)
    around = f", {obstacles} obstacles" if obstacles else ""
    report(f"planning, {name}, random pairs{around}", took)


def scanning(building: World, rays: int, runs: int) -> None:
    """Scans at random points."""
    generator = np.random.default_rng(2)
    laser = Laser(building.grid, rays)
    took: list[float] = []
    for x, y in free_points(building, generator, runs):
        began = time.process_time()
        laser.scan(Pose(x, y, 0.3), (), generator)
        took.append(time.process_time() - began)
    report(f"scan of {rays} rays, office", took)


def photographing(building: World, name: str, runs: int) -> None:
    """Pictures from random points, with four people about."""
    generator = np.random.default_rng(4)
    people = tuple(Pose(x, y, 0.0) for x, y in free_points(building, generator, 4))
    took: list[float] = []
    for x, y in free_points(building, generator, runs):
        began = time.process_time()
        renderer.photograph(building, Pose(x, y, generator.uniform(-np.pi, np.pi)), people)
        took.append(time.process_time() - began)
    report(f"picture, {name}", took)


def stepping(building: World, name: str, settings: Simulator) -> None:
    """A round of drives, planning not counted."""
    simulation = Simulation(building, Limits(), seed=3, settings=settings)
    spent, steps = 0.0, 0
    for place in building.places.places[:12]:
        with contextlib.suppress(planner.Unreachable):
            drive = simulation.drive_to(place.pose)
            began, before = time.process_time(), simulation.elapsed
            while drive.outcome == "running":
                simulation.step()
            spent += time.process_time() - began
            steps += round((simulation.elapsed - before) / 0.02)
    share = spent / steps / 0.02
    print(f"{'driving, ' + name:44} {spent / steps * 1e6:7.0f} us a step, {share:.2%} of a core at time scale 1")


@dataclass
class Session:
    """A robot server that drives to and fro, and its telemetry."""

    process: int
    states: list[tuple[float, float]]  # wall and robot time of each state

    def cpu(self) -> float:
        """Seconds of CPU that the server has used."""
        fields = Path(f"/proc/{self.process}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.asynccontextmanager
async def driving(rate: float, channels: list[telemetry.Channel], **settings: str) -> AsyncIterator[Session]:
    """A robot server that drives between two places, with one reader of its telemetry."""
    with tempfile.TemporaryDirectory() as folder:
        robot = Robot(Path(folder), {f"ROBOT_ACP_ROBOT__{name.upper()}": value for name, value in settings.items()})
        with robot.running("robot", port=robot.robot_port) as process:
            session = Session(process.pid, [])
            address = f"ws://127.0.0.1:{robot.robot_port}/telemetry"
            async with connect(address, additional_headers=robot.robot_headers) as wire, asyncio.TaskGroup() as group:
                await wire.send(telemetry.encode(telemetry.Subscribe(channels, rate)))
                tasks = [group.create_task(_listen(wire, session)), group.create_task(_drive(robot))]
                yield session
                for task in tasks:
                    task.cancel()


async def _listen(wire: Any, session: Session) -> None:
    async for frame in wire:
        message = telemetry.decode(frame)
        if isinstance(message, telemetry.State):
            session.states.append((time.monotonic(), message.time))


async def _drive(robot: Robot) -> None:
    url = f"http://127.0.0.1:{robot.robot_port}/mcp"
    async with (
        create_mcp_http_client(headers=robot.robot_headers) as http,
        Client(streamable_http_client(url, http_client=http)) as client,
    ):
        while True:
            for place in ("lab 2.3.5", "lab 2.3.6"):
                result = await client.call_tool("navigate_to_place", {"place": place})
                if result.is_error:
                    print(f"  {place}: {result.content[0].text}")
                    await asyncio.sleep(1.0)


async def share_of_a_core(rays: int, seconds: float, *more: telemetry.Channel) -> None:
    """CPU of the whole robot server, laser and state to one reader at 20 Hz."""
    async with driving(20.0, ["state", "scan", *more], simulator__laser_rays=str(rays)) as session:
        await asyncio.sleep(3.0)
        began, used, count = time.monotonic(), session.cpu(), len(session.states)
        await asyncio.sleep(seconds)
        wall = time.monotonic() - began
        rate = (len(session.states) - count) / wall
        also = "".join(f" and {channel}" for channel in more)
        print(f"robot server, office, {rays} rays{also} to a reader at {rate:.1f} Hz, driving: ", end="")
        print(f"{(session.cpu() - used) / wall:.1%} of a core")


async def time_scale(scale: float, seconds: float, people: int) -> None:
    """How many simulated seconds pass in a wall second."""
    settings = {"time_scale": str(scale), "simulator__people": str(people)}
    async with driving(10.0, ["state"], **settings) as session:
        await asyncio.to_thread(wait_until, lambda: len(session.states) > 30, "telemetry")
        used, first = session.cpu(), len(session.states)
        await asyncio.sleep(seconds)
        (wall0, robot0), (wall1, robot1) = session.states[first], session.states[-1]
        ratio = (robot1 - robot0) / (wall1 - wall0)
        print(f"--time-scale {scale:g}, {people} people: {ratio:.2f} simulated seconds a wall second, ", end="")
        print(f"{(session.cpu() - used) / seconds:.0%} of a core")


def main() -> None:
    """Parse the arguments and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=200, help="counted plans and scans (default: 200)")
    parser.add_argument("--seconds", type=float, default=15.0, help="wall seconds for each figure of the server")
    options = parser.parse_args()
    office, hospital = world.load("office"), world.load("hospital")
    planning(office, "office", options.n)
    planning(hospital, "hospital", options.n)
    planning(hospital, "hospital", options.n, obstacles=60)
    for rays in (360, 720):
        scanning(office, rays, options.n)
    photographing(office, "office", options.n)
    photographing(hospital, "hospital", options.n)
    stepping(office, "office", Simulator())
    stepping(office, "office, 4 people, noise and slip", Simulator(people=4, localisation_noise=0.03, wheel_slip=0.1))
    stepping(hospital, "hospital, 10 people", Simulator(people=10))
    asyncio.run(share_of_a_core(720, options.seconds))
    asyncio.run(share_of_a_core(720, options.seconds, "camera"))
    for people in (0, 4):
        asyncio.run(time_scale(20.0, options.seconds, people))


if __name__ == "__main__":
    main()
