"""The simulator as a `Robot`: a thin asyncio loop around `Simulation`, its time N times as fast as the wall's.

Time comes from counting steps against the wall's monotonic clock, so it neither drifts nor jumps. Planning and drawing
run in threads; the loop itself never waits for anything but the next tick.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator

import numpy as np

from backend.config import Limits
from backend.mcp_robot import speech
from backend.mcp_robot.grid import OccupancyGrid
from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.robot import Fix, Picture, Remaining, Route, Sound, TopologicalMap
from backend.mcp_robot.simulator import camera, follower, laser, planner
from backend.mcp_robot.simulator.simulation import FOOTPRINT_RADIUS, STEP, Drive, Simulation, Turn, Utterance
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Battery, Pose, Scan, Twist

TICK = 0.02
"""Wall seconds between rounds of steps."""
LARGEST_LAG = 0.25
"""After a longer pause of the whole process, the robot's time goes on from where it was."""
PLANNING_RADIUS = FOOTPRINT_RADIUS + 0.05


class SimulatedRobot:
    """A `Robot`. `running()` makes its time pass; without it, nothing moves."""

    def __init__(
        self,
        world: World,
        limits: Limits,
        *,
        name: str = "Sancho",
        time_scale: float = 1.0,
        seed: int = 0,
        battery_level: float = 0.92,
    ) -> None:
        self.name = name
        self.footprint_radius = FOOTPRINT_RADIUS
        self.places: TopologicalMap = world.places
        self.grid: OccupancyGrid = world.grid
        self._world = world
        self._simulation = Simulation(world, limits, battery_level)
        self._limits = limits
        self._time_scale = time_scale
        self._epoch = time.time()  # Unix seconds at which the simulation's time is 0
        self._noise = np.random.default_rng(seed)
        self._search = planner.search_grid(world.grid, PLANNING_RADIUS)
        self._scan: Scan | None = None  # the latest, valid for its own time only
        self._stepped = asyncio.Event()  # set and replaced after every round of steps

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Let its time pass while inside."""
        task = asyncio.create_task(self._run(), name="simulator")
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _run(self) -> None:
        begin, steps = time.monotonic(), 0
        while True:
            lag = time.monotonic() - begin - steps * STEP / self._time_scale
            if lag > LARGEST_LAG:
                begin += lag
                lag = 0.0
            for _ in range(int(lag * self._time_scale / STEP)):
                self._simulation.step()
                steps += 1
            stepped, self._stepped = self._stepped, asyncio.Event()
            stepped.set()
            await asyncio.sleep(TICK)

    def clock(self) -> float:
        """Unix seconds of the simulated clock."""
        return self._epoch + self._simulation.elapsed

    @property
    def fix(self) -> Fix:
        """Where it is: a simulator knows."""
        return Fix(self._simulation.pose, self.clock(), "simulator")

    @property
    def twist(self) -> Twist:
        """How it moves."""
        return self._simulation.twist

    @property
    def battery(self) -> Battery:
        """How long it can."""
        return Battery(self._simulation.battery.level, self._simulation.battery.charging)

    @property
    def remaining(self) -> Remaining | None:
        """What is left of the motion."""
        return self._simulation.remaining

    @property
    def odometer(self) -> float:
        """Metres driven."""
        return self._simulation.odometer

    def scan(self) -> Scan:
        """The scan of this moment, computed once however many ask for it."""
        now, pose = self.clock(), self._simulation.pose
        if self._scan is None or self._scan.time != now:
            ranges = laser.scan(self.grid, pose, self._noise)
            self._scan = Scan(
                now, pose, laser.ANGLE_MIN, laser.ANGLE_INCREMENT, laser.RANGE, np.round(ranges, 3).tolist()
            )
        return self._scan

    async def plan(self, goal: Pose, *, final_yaw: bool) -> Route:
        """A way there. Raises `Refusal` (unreachable)."""
        start = self._simulation.pose
        try:
            points = await asyncio.to_thread(
                planner.plan, self.grid, self._search, (start.x, start.y), (goal.x, goal.y), PLANNING_RADIUS
            )
        except planner.Unreachable:
            sentence = f"There is no way from here to ({goal.x:.1f}, {goal.y:.1f}). Choose another goal."
            raise Refusal("unreachable", sentence) from None
        track = follower.track(points, goal, final_yaw, self._limits)
        left = follower.remaining(track, 0.0, start, self._limits)
        return Route(tuple((x, y) for x, y in points.tolist()), left.distance, left.seconds, goal, final_yaw)

    async def drive(self, route: Route) -> None:
        """Drive along a route. Raises `Refusal` (blocked) or `Halted`."""
        track = follower.track(np.array(route.points), route.goal, route.final_yaw, self._limits)
        await self._move(Drive(track))

    async def turn(self, angle: float) -> None:
        """Turn on the spot. Raises `Halted`."""
        await self._move(Turn(angle))

    async def _move(self, motion: Drive | Turn) -> None:
        self._simulation.begin(motion)
        await self._end_of(motion)
        if motion.outcome == "blocked":
            pose = self._simulation.pose
            sentence = f"Something is in the way at ({pose.x:.1f}, {pose.y:.1f}), and the robot has stopped before it."
            raise Refusal("blocked", sentence)

    async def _end_of(self, activity: Drive | Turn | Utterance) -> None:
        while activity.outcome == "running":
            await self._stepped.wait()
        if activity.outcome == "halted":
            raise Halted

    def halt(self) -> None:
        """Brake at once."""
        self._simulation.halt()

    async def photo(self) -> Picture:
        """What the camera sees."""
        pose = self._simulation.pose
        jpeg = await asyncio.to_thread(camera.photograph, self._world, pose)
        return Picture(jpeg, camera.WIDTH, camera.HEIGHT, pose)

    async def synthesize(self, text: str) -> Sound:
        """The sound of a text."""
        return await speech.synthesize(text)

    async def say(self, text: str, sound: Sound) -> None:
        """Speak for as long as the sound lasts in the robot's time. Raises `Halted`."""
        await self._end_of(self._simulation.speak(sound.seconds))

    def hush(self) -> None:
        """Stop speaking at once."""
        self._simulation.hush()
