"""A robot that runs ROS 2 and Nav2, as a `Robot`: topics to properties, actions to motions, failures to refusals.

ROS runs in a thread of its own (ros_thread.py); nothing here blocks the event loop, and every wait has a limit. A
motion begins only while a fresh pose in the map is known. Nav2 and its collision monitor keep their own safety
functions: nothing is published past them.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Any

import numpy as np
from nav2_msgs.action import ComputePathToPose, NavigateToPose, Spin
from rclpy.action import ActionClient

from backend.config import Limits, Ros2
from backend.mcp_robot import speech
from backend.mcp_robot.motion import safety
from backend.mcp_robot.navigation import follower, planner
from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid
from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.robot import Capabilities, Fix, Picture, Remaining, Route, Sound, TopologicalMap, Velocity
from backend.mcp_robot.ros2 import convert, failures
from backend.mcp_robot.ros2.brake import Brake
from backend.mcp_robot.ros2.camera import Camera
from backend.mcp_robot.ros2.goals import ABORTED, CANCELED, SUCCEEDED, Goal
from backend.mcp_robot.ros2.ros_thread import RosThread
from backend.mcp_robot.ros2.senses import Senses
from backend.mcp_robot.ros2.voice import voice
from backend.mcp_robot.ros2.waiting import Waits, until
from backend.telemetry import Battery, Pose, Scan, Twist, Zone

logger = logging.getLogger(__name__)

PLAN_TRIES = 3
"""How often a path is asked for whose planning another client ends."""
PLANNING_MARGIN = 0.05
"""m that a path planned here stays farther from walls than the footprint needs."""


class Ros2Robot:
    """A `Robot`. `running()` joins the ROS graph; before and after, nothing answers."""

    def __init__(
        self,
        settings: Ros2,
        limits: Limits,
        *,
        name: str,
        places: TopologicalMap,
        zones: Sequence[Zone] = (),
        waits: Waits | None = None,
    ) -> None:
        self.name = name
        self.footprint_radius = settings.footprint_radius
        self.places = places
        self.capabilities = Capabilities(
            camera=bool(settings.image),
            voice=bool(settings.speech or settings.speech_action),
            laser=bool(settings.scan),
        )
        self.on_reroute: Callable[[Floats], None] = lambda _: None  # called with the new way of a drive
        self._settings = settings
        self._waits = waits or Waits()
        self._zones = tuple(zones)
        self._limits = limits
        self._ros = RosThread("robot_acp", settings.domain_id)
        self._goal: Goal | None = None  # the motion under way
        self._remaining: Remaining | None = None  # what is left of it
        self._starting = True  # until the robot's parts are there
        self._halts = 0  # how often `halt` was called: a motion that was asked for before must not go on after it
        self._planning = asyncio.Lock()  # held while Nav2's planner works for us
        self._misplaced: set[str] = set()  # ids of the places of which the log says that they do not fit the map
        self._search: tuple[OccupancyGrid, planner.SearchGrid] | None = None  # for the map that it was made of
        self._join()  # the ROS thread does not run yet

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Be part of the ROS graph while inside."""
        self._ros.open()
        try:
            await self._wait_for_the_robot()
            yield
        finally:
            with contextlib.suppress(Refusal):  # the brake has logged it
                await self._brake.let_go()  # the last cancel has to be sent
            await asyncio.to_thread(self._ros.close)

    def _join(self) -> None:
        node, s = self._ros.node, self._settings
        self._senses = Senses(node, s, self._limits.pose_timeout, self._zones)
        self._senses.on_grid = self._check_places
        self._camera = Camera(self._ros, s, self._senses)
        self._navigate = ActionClient(node, NavigateToPose, s.navigate)
        self._spin = ActionClient(node, Spin, s.spin)
        self._compute_path = ActionClient(node, ComputePathToPose, s.compute_path) if s.compute_path else None
        self._voice = voice(self._ros, s, self._senses.clock)
        # After the clients: other nodes discover these in order, so that a server that answers a cancel knows the rest,
        # too.
        self._brake = Brake(self._ros, s, self._senses.clock, self._may_move, patience=self._waits.halted_goal)

    async def _wait_for_the_robot(self) -> None:
        loop = asyncio.get_running_loop()

        def rerouted(points: Floats) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._rerouted, points)

        self._senses.on_plan = rerouted
        # A robot server that was killed has left its motion to Nav2: that motion ends now.
        self._brake.halt()
        await until(lambda: not self._absent(), self._waits.start)
        self._starting = False
        if self._senses.odometry:
            await self._at_rest()
        await self._brake.let_go()
        if absent := self._absent():
            logger.error("Not there yet: %s. `robot-acp doctor` tells more.", ", ".join(absent))

    def _check_places(self, grid: OccupancyGrid) -> None:
        """Log, once for each place, that nobody can drive to it in this map. On the thread that prepares maps."""
        for place in self.places.places:
            mistake = safety.misplaced(grid, place.pose.x, place.pose.y, self.footprint_radius)
            if mistake and place.id not in self._misplaced:
                self._misplaced.add(place.id)
                logger.error("%s %s Is places.yaml of this map?", place.name, mistake)

    def _may_move(self) -> bool:
        """Whether the robot moves, or may move because its nodes have not been discovered yet."""
        return self._starting or self._senses.velocity.twist != Twist(0.0, 0.0)

    def _absent(self) -> list[str]:
        """The parts of the robot that a motion needs and that are not there yet."""
        senses, s = self._senses, self._settings
        present = {
            f"the map ({s.map})": senses.grid is not None,
            "the robot's pose": senses.lost is None,
            f"odometry ({s.odom})": senses.odometry is not None,
            f"the battery ({s.battery})": senses.battery is not None or not s.battery,
            f"the laser and its transform ({s.scan})": bool(senses.scan().ranges) or not s.scan,
            f"the action {s.navigate}": self._navigate.server_is_ready() and self._brake.reaches(s.navigate),
            f"the action {s.spin}": self._spin.server_is_ready() and self._brake.reaches(s.spin),
        }
        return [name for name, is_there in present.items() if not is_there]

    def clock(self) -> float:
        """The robot's time, in Unix seconds."""
        return self._senses.clock()

    @property
    def fix(self) -> Fix:
        """Where it is, and which topic says so; `NOWHERE` until one does."""
        return self._senses.fix

    @property
    def velocity(self) -> Velocity:
        """The velocity that odometry reports."""
        return self._senses.velocity

    @property
    def battery(self) -> Battery:
        """The charge of the battery: empty while its topic is silent, full where no topic is set for it."""
        if not self._settings.battery:
            return Battery(1.0, False)
        charge = self._senses.battery if self._senses.age("battery") <= self._waits.battery else None
        return charge or Battery(0.0, False)

    @property
    def grid(self) -> OccupancyGrid:
        """The map. Raises `Refusal` (no_map) until one has come."""
        if self._senses.grid is None:
            raise Refusal("no_map", f"No map has come on the topic {self._settings.map}. Is the map server running?")
        return self._senses.grid

    @property
    def remaining(self) -> Remaining | None:
        """What is left of the motion, as Nav2 reports."""
        return self._remaining

    @property
    def odometer(self) -> float:
        """Metres driven since this process began to listen."""
        return self._senses.odometer

    def scan(self) -> Scan:
        """The latest laser scan."""
        return self._senses.scan()

    async def plan(self, goal: Pose, *, final_yaw: bool) -> Route:
        """A path to the goal: by Nav2's planner while nothing moves, else by our own planner. Raises `Refusal`."""
        points = await self._planned_by_nav2(goal)
        if points is None:
            points = await self._planned_here(goal)
        start = self._located().pose
        track = follower.track(points, goal, final_yaw, self._limits)
        left = follower.remaining(track, 0.0, start, self._limits)
        return Route(tuple((x, y) for x, y in points.tolist()), left.distance, left.seconds, goal, final_yaw)

    async def _planned_by_nav2(self, goal: Pose) -> Floats | None:
        """The path of Nav2's planner, None when a path has to be planned here. Raises `Refusal`.

        That planner serves one goal at a time, and a newer one ends the older without a reason. So our plans wait for
        each other, one that another client ended is asked for again, and none while the planner steers a drive.
        """
        name = self._settings.compute_path
        async with self._planning:
            for _ in range(PLAN_TRIES):
                client, start = self._compute_path, self._located().pose
                if client is None or self._goal is not None or not client.server_is_ready():
                    return None
                message = ComputePathToPose.Goal(use_start=False)
                self._address(message.goal, goal)
                asked = Goal(self._ros, client, name, self._settings.answer_timeout)
                status, result = await asked.run(message, silence=self._waits.silence)
                if status == SUCCEEDED:
                    return self._joined(start, convert.path(result.path), goal)
                if status != CANCELED and not failures.without_reason(result):
                    raise failures.aborted(name, result)
        logger.warning("%s gave up %d times without a reason: the path is planned here.", name, PLAN_TRIES)
        return None

    def _joined(self, start: Pose, points: Floats, goal: Pose) -> Floats:
        """Nav2's path, with the robot's pose as its first point. Raises `Refusal` (unreachable) for an empty one."""
        if not len(points):
            raise Refusal("unreachable", f"No path leads to ({goal.x:.1f}, {goal.y:.1f}). Choose another goal.")
        return planner.resample(np.concatenate([[(start.x, start.y)], points]), planner.SPACING)

    async def _planned_here(self, goal: Pose) -> Floats:
        start = self._located().pose
        grid, radius = self.grid, self.footprint_radius + PLANNING_MARGIN

        def plan() -> Floats:
            if self._search is None or self._search[0] is not grid:
                self._search = (grid, planner.search_grid(grid, radius))
            return planner.plan(grid, self._search[1], (start.x, start.y), (goal.x, goal.y), radius)

        try:
            return await asyncio.to_thread(plan)
        except planner.Unreachable:
            sentence = f"There is no way from here to ({goal.x:.1f}, {goal.y:.1f}). Choose another goal."
            raise Refusal("unreachable", sentence) from None

    async def drive(self, route: Route) -> None:
        """Let Nav2 drive to the route's goal. Raises `Refusal` or `Halted`."""
        goal = route.goal if route.final_yaw else Pose(route.goal.x, route.goal.y, _heading(route))
        message = NavigateToPose.Goal()
        self._address(message.pose, goal)

        def on_feedback(feedback: Any) -> None:
            distance = float(feedback.distance_remaining)
            if distance <= 0 or not math.isfinite(distance):
                return  # Nav2 says 0 until it has planned
            left = convert.seconds(feedback.estimated_time_remaining) or distance / self._limits.max_speed
            self._remaining = Remaining(distance, 0.0, left)

        begin = Remaining(route.length, 0.0, route.seconds)
        await self._move(self._navigate, self._settings.navigate, message, begin, on_feedback)

    async def turn(self, angle: float) -> None:
        """Let Nav2 turn it on the spot. Raises `Refusal` or `Halted`."""
        seconds = follower.turning_time(abs(angle), self._limits)
        message = Spin.Goal(target_yaw=float(angle))
        convert.set_seconds(message.time_allowance, 10.0 + 3 * seconds)

        def on_feedback(feedback: Any) -> None:
            left = max(0.0, abs(angle) - abs(float(feedback.angular_distance_traveled)))
            self._remaining = Remaining(0.0, left, follower.turning_time(left, self._limits))

        await self._move(self._spin, self._settings.spin, message, Remaining(0.0, abs(angle), seconds), on_feedback)

    async def _move(
        self, client: Any, name: str, message: Any, begin: Remaining, on_feedback: Callable[[Any], None]
    ) -> None:
        halts = self._halts
        await self._brake.let_go()
        self._located()
        if self._halts != halts:
            raise Halted
        goal = self._goal = Goal(self._ros, client, name, self._settings.answer_timeout)
        self._brake.watch(goal)
        self._remaining = begin
        try:
            status, result = await goal.run(
                message, silence=self._waits.silence, on_feedback=on_feedback, check=self._not_lost_while_moving
            )
        except Refusal:
            self._brake.halt()
            await self._at_rest()
            raise
        finally:
            if self._goal is goal:  # else a newer motion has begun
                self._goal = self._remaining = None
        await self._at_rest()
        if goal.halted and status in (CANCELED, ABORTED):
            raise Halted
        if status == CANCELED:
            raise failures.cancelled(name)
        if status != SUCCEEDED:
            raise failures.aborted(name, result)

    def _located(self) -> Fix:
        """The robot's pose in the map. Raises `Refusal` (lost) when it is not known well enough to move."""
        lost = self._senses.lost
        if lost is None:
            self._odometry_speaks()
            return self.fix
        if math.isinf(lost):
            sentence = "The robot does not know where it is. Set its initial pose, and wait for its localisation."
        else:
            sentence = f"The robot lost its pose {lost:.0f} s ago. Wait for its localisation, or set its pose anew."
        raise Refusal("lost", sentence)

    def _odometry_speaks(self) -> None:
        """Odometry is not older than `pose_timeout`; without it the robot would seem to stand. Raises `Refusal`
        (lost)."""
        if self._senses.age("odom") > self._limits.pose_timeout:
            advice = "Start what publishes it, or see `robot-acp doctor`."
            raise Refusal("lost", f"The robot's odometry is silent, on the topic {self._settings.odom}. {advice}")

    def _not_lost_while_moving(self) -> None:
        self._odometry_speaks()
        lost = self._senses.lost
        if lost is not None and lost > 2 * self._limits.pose_timeout:  # Nav2 may find it again a little later
            self._located()

    async def _at_rest(self) -> None:
        """Wait for a limited time until new odometry says that the robot stands."""
        began = time.monotonic()

        def stands() -> bool:
            odometry = self._senses.odometry
            return odometry is not None and odometry.arrived > began and self.velocity.twist == Twist(0.0, 0.0)

        if not await until(stands, self._waits.rest):
            logger.warning("The robot's odometry does not say that it stands.")

    def halt(self) -> None:
        """Cancel the goals of all clients and send zero velocity, at once."""
        self._halts += 1
        if self._goal:
            self._goal.halt()
        self._brake.halt()

    def hold(self, held: bool) -> None:
        """While held, keep cancelling the goals of all clients and sending zero velocity."""
        self._brake.hold(held)

    def _rerouted(self, points: Floats) -> None:
        if self._goal is not None and self._goal.name == self._settings.navigate and len(points):
            self.on_reroute(points)

    async def photo(self) -> Picture:
        """A picture from the camera, taken now. Raises `Refusal` (no_camera)."""
        return await self._camera.photo()

    async def synthesize(self, text: str) -> Sound:
        """The sound of a text."""
        return await speech.synthesize(text)

    async def say(self, text: str, sound: Sound) -> None:
        """Let the robot's voice say it. Raises `Refusal` (no_voice) or `Halted`."""
        await self._voice.say(text, sound.seconds)

    def hush(self) -> None:
        """Stop speaking."""
        self._voice.hush()

    def _address(self, message: Any, goal: Pose) -> None:
        """Fill in a PoseStamped in the map frame."""
        message.header.frame_id = self._settings.map_frame
        convert.set_seconds(message.header.stamp, self.clock())
        convert.set_pose(message.pose, goal)


def _heading(route: Route) -> float:
    """The direction in which a route arrives."""
    (x0, y0), (x1, y1) = route.points[max(0, len(route.points) - 4)], route.points[-1]
    return math.atan2(y1 - y0, x1 - x0) if (x0, y0) != (x1, y1) else route.goal.yaw
