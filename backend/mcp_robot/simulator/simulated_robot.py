"""The simulator as a `Robot`: a thin asyncio loop around `Simulation`, its time N times as fast as the wall's.

Time is a count of steps against the wall's monotonic clock, so it neither drifts nor jumps. Planning and drawing run in
threads; the loop itself never waits for anything but the next tick. With `time_scale=math.inf` the clock is virtual:
time passes one step a round of the event loop, as fast as the machine is, planning takes none of it, and the same seed
and calls give the same states. That is for tests.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from backend.config import Limits, Simulator
from backend.mcp_robot import speech
from backend.mcp_robot.navigation import follower, planner
from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid
from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.robot import Capabilities, Fix, Picture, Remaining, Route, Sound, TopologicalMap, Velocity
from backend.mcp_robot.simulator import laser
from backend.mcp_robot.simulator.motions import Drive, Turn, Utterance
from backend.mcp_robot.simulator.rendering import renderer
from backend.mcp_robot.simulator.simulation import FOOTPRINT_RADIUS, STEP, Simulation
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Battery, Pose, Scan

TICK = 0.02
"""Wall seconds between rounds of steps."""
BURST = 0.02
"""Wall seconds that a round may take before others get their turn."""
LARGEST_LAG = 0.5
"""Wall seconds of delay that are caught up with; the rest of a longer delay is lost, and the log says so."""
COMPLAINT_INTERVAL = 10.0
"""Wall seconds between two such messages in the log."""

logger = logging.getLogger(__name__)


class SimulatedRobot:
    """A `Robot`. `running()` makes its time pass; without it, nothing moves.

    `floor` is the map that the robot plans in and may drive on, where that differs from the world's: keep-out zones are
    not free in it. `simulation` is the truth, for tests and demonstrations: people, doors, the true pose.
    """

    def __init__(
        self,
        world: World,
        limits: Limits,
        *,
        name: str = "Sancho",
        time_scale: float = 1.0,
        seed: int = 0,
        settings: Simulator | None = None,
        floor: OccupancyGrid | None = None,
    ) -> None:
        self.name = name
        self.footprint_radius = FOOTPRINT_RADIUS
        self.places: TopologicalMap = world.places
        settings = settings or Simulator()
        self.capabilities = Capabilities(camera=settings.camera, voice=settings.voice)
        self.simulation = Simulation(world, limits, seed=seed, settings=settings, floor=floor)
        self.grid: OccupancyGrid = self.simulation.floor
        self.on_reroute: Callable[[Floats], None] = lambda _: None  # called with the new way of a drive
        self.lost = 0.0  # wall seconds that the machine was too slow for, which simulated time did not follow
        self.simulation.on_reroute = lambda points: self.on_reroute(points)
        self._limits = limits
        self._time_scale = time_scale
        self._epoch = time.time()  # Unix seconds at which the simulation's time is 0
        self._noise = np.random.default_rng(seed)
        self._scan: Scan | None = None  # the latest, valid for its own time only
        self._stepped = asyncio.Event()  # set and replaced after every round of steps
        self._planning: set[asyncio.Task[None]] = set()  # searches for another path
        # A thread keeps the 30 MB that a picture once needed: so one thread draws, and not each of asyncio's.
        self._artist = ThreadPoolExecutor(max_workers=1, thread_name_prefix="camera")
        if not self._virtual:
            self.simulation.reroute = self._reroute_in_thread

    @property
    def _virtual(self) -> bool:
        return math.isinf(self._time_scale)

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Let the robot's time pass while inside. Should that fail, the task inside is cancelled: a robot whose time
        stands still would be busy for ever."""
        inside = asyncio.current_task()
        assert inside is not None  # noqa: S101 - a coroutine always runs in a task

        def ended(task: asyncio.Task[None]) -> None:
            if not task.cancelled() and (error := task.exception()):
                logger.critical("The simulator has failed.", exc_info=error)
                inside.cancel()

        task = asyncio.create_task(self._run_virtually() if self._virtual else self._run(), name="simulator")
        task.add_done_callback(ended)
        try:
            yield
        finally:
            for each in (task, *self._planning):
                each.cancel()
            await asyncio.gather(task, *self._planning, return_exceptions=True)

    async def _run_virtually(self) -> None:
        while True:
            self.simulation.step()
            self._tell_stepped()
            await asyncio.sleep(0)

    async def _run(self) -> None:
        begin, steps, complained = time.monotonic(), 0, -math.inf
        while True:
            now = time.monotonic()
            lag = now - begin - steps * STEP / self._time_scale
            if lag > LARGEST_LAG:
                begin, self.lost = begin + lag - LARGEST_LAG, self.lost + lag - LARGEST_LAG
                lag = LARGEST_LAG
                if now - complained > COMPLAINT_INTERVAL:
                    complained = now
                    logger.warning("The simulator cannot keep up: %.1f s of the wall's time lost so far.", self.lost)
            due = int(lag * self._time_scale / STEP)
            while due and time.monotonic() < now + BURST:
                self.simulation.step()
                steps, due = steps + 1, due - 1
            self._tell_stepped()
            await asyncio.sleep(0 if due else TICK)

    def _tell_stepped(self) -> None:
        stepped, self._stepped = self._stepped, asyncio.Event()
        stepped.set()

    def _reroute_in_thread(self, drive: Drive) -> None:
        task = asyncio.create_task(self._reroute(drive), name="another way")
        self._planning.add(task)
        task.add_done_callback(self._planning.discard)

    async def _reroute(self, drive: Drive) -> None:
        simulation = self.simulation
        goal, seen = drive.track.goal, simulation.obstacles.points
        try:
            points = await asyncio.to_thread(simulation.plan_around, simulation.believed, goal, seen)
        except planner.Unreachable:
            return
        if drive.outcome == "running":
            simulation.take_way(drive, points)

    def clock(self) -> float:
        """Unix seconds of the simulated clock."""
        return self._epoch + self.simulation.elapsed

    @property
    def fix(self) -> Fix:
        """Where the robot believes it is; without noise in the settings that is the true pose."""
        return Fix(self.simulation.believed, self.clock(), "simulator")

    @property
    def velocity(self) -> Velocity:
        """The velocity of this moment."""
        return Velocity(self.simulation.twist, self.clock())

    @property
    def battery(self) -> Battery:
        """The charge of the battery, and whether it is charging."""
        return Battery(self.simulation.battery.level, self.simulation.battery.charging)

    @property
    def remaining(self) -> Remaining | None:
        """What is left of the motion under way."""
        return self.simulation.remaining

    @property
    def odometer(self) -> float:
        """Metres driven."""
        return self.simulation.odometer

    def scan(self) -> Scan:
        """The scan of this moment, computed once however many ask for it."""
        now = self.clock()
        if self._scan is None or self._scan.time != now:
            scanner = self.simulation.environment.laser
            ranges = self.simulation.environment.scan(self.simulation.pose, self._noise)
            self._scan = Scan(
                now, self.simulation.believed, laser.ANGLE_MIN, scanner.increment, laser.RANGE,
                np.round(ranges, 3).tolist(),
            )  # fmt: skip
        return self._scan

    async def plan(self, goal: Pose, *, final_yaw: bool) -> Route:
        """A path to the goal, around what the laser saw lately. Raises `Refusal` (unreachable)."""
        simulation = self.simulation
        start, seen = simulation.believed, simulation.look()
        try:
            if self._virtual:
                points = simulation.plan(start, goal, seen)
            else:
                points = await asyncio.to_thread(simulation.plan, start, goal, seen)
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
        self.simulation.begin(motion)
        await self._end_of(motion)
        if motion.outcome == "blocked":
            pose = self.simulation.believed
            sentence = (
                f"Something is in the way at ({pose.x:.1f}, {pose.y:.1f}), and no other way was found. "
                "Take a photo to see what it is, and ask again when it is gone."
            )
            raise Refusal("blocked", sentence)

    async def _end_of(self, activity: Drive | Turn | Utterance) -> None:
        while activity.outcome == "running":
            await self._stepped.wait()
        if activity.outcome == "halted":
            raise Halted

    def halt(self) -> None:
        """Brake at once."""
        self.simulation.halt()

    def hold(self, held: bool) -> None:
        """Nothing to do: nobody else commands a simulated robot."""

    async def photo(self) -> Picture:
        """A picture from the camera, taken now."""
        truth, environment = self.simulation.pose, self.simulation.environment
        scene = environment.building, truth, tuple(environment.people.poses)
        jpeg = await asyncio.get_running_loop().run_in_executor(self._artist, renderer.photograph, *scene)
        return Picture(jpeg, renderer.WIDTH, renderer.HEIGHT, self.simulation.believed)

    async def synthesize(self, text: str) -> Sound:
        """The sound of a text."""
        return await speech.synthesize(text)

    async def say(self, text: str, sound: Sound) -> None:
        """Speak for as long as the sound lasts in the robot's time. Raises `Halted`."""
        await self._end_of(self.simulation.speak(sound.seconds))

    def hush(self) -> None:
        """Stop speaking at once."""
        self.simulation.hush()
