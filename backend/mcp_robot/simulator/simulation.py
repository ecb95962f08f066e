"""The simulated robot as a state machine in time: `step(dt)` and nothing else makes anything happen.

No clock, no task, no socket, one seed: the same steps give the same states, bit for bit. This is the virtual clock of
tests, as fast as the machine is:

    simulation = Simulation(world.load("office"), Limits(), seed=7, settings=Simulator(people=3, wheel_slip=0.1))
    drive = simulation.drive_to(Pose(11.8, 4.0, 0.0))         # plans, begins; raises planner.Unreachable
    while drive.outcome == "running":
        simulation.step()
        assert simulation.clearance >= 0.0                    # free floor around the true footprint, in m

`pose` is the true pose, `believed` the pose that the robot takes for true. The robot keeps its own protective stop:
whatever the follower asks for, it brakes when the way that it needs to stop is not free. Its footprint never enters
anything.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator

import numpy as np

from backend.config import Limits, Simulator
from backend.mcp_robot.navigation import follower, planner
from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid
from backend.mcp_robot.navigation.named_places import at_dock
from backend.mcp_robot.robot import Remaining
from backend.mcp_robot.simulator import disturbances
from backend.mcp_robot.simulator.battery import Accumulator
from backend.mcp_robot.simulator.environment import Environment
from backend.mcp_robot.simulator.motions import Drive, Turn, Utterance
from backend.mcp_robot.simulator.obstacle_layer import ObstacleLayer
from backend.mcp_robot.simulator.world import FOOTPRINT_RADIUS as FOOTPRINT_RADIUS
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose, Twist

STEP = 0.02
"""Simulated seconds a step: 50 Hz."""
PLANNING_RADIUS = FOOTPRINT_RADIUS + 0.05
REACTION, BRAKING_MARGIN = 0.15, 0.03
"""The robot brakes when, beyond its braking distance, only the way of so many seconds and so many m are free: earlier
than the safety layer's guard, which checks less often, has to."""
BRAKING_PARTS = 4
"""Poses along the braking distance that are checked."""
PASSING_MARGIN = 0.02
"""Free floor in m beside the footprint: a robot that brakes in a curve leaves the checked arc a little."""
PATIENCE = 10.0
"""Seconds that the robot waits before something in its way; then the motion ends as blocked."""
STALLED = 5.0
"""Seconds without progress, beyond those of a whole turn on the spot, after which a motion ends as blocked."""
LOOK_INTERVAL = 0.2
"""Seconds between two laser scans that a driving robot takes in."""
LOOK_AHEAD = 3.0
"""m of the path ahead that have to be free of known obstacles; else the robot seeks another path."""
LOOK_RAYS = 180
"""Rays of such a scan, about."""
REROUTE_AFTER = 1.0
"""Seconds that something is in the way before another path is planned: a person who crosses is gone by then."""
MAX_REROUTES = 8


class Simulation:
    """A robot in a world. Attributes are its state; `step` alone moves them on.

    `floor` is the map that it plans in and may drive on: the world's, or that with keep-out zones as occupied cells.
    """

    def __init__(
        self,
        world: World,
        limits: Limits,
        *,
        seed: int = 0,
        settings: Simulator | None = None,
        floor: OccupancyGrid | None = None,
    ) -> None:
        settings = settings or Simulator()
        people, fix, wheels = np.random.default_rng(seed).spawn(3)
        self.world = world
        self.limits = limits
        self.floor = floor or world.grid
        self.search = planner.search_grid(self.floor, PLANNING_RADIUS)
        self.environment = Environment(world, settings, people)
        self.elapsed = 0.0  # s, grows with every step
        self.pose: Pose = world.start  # the true one, integrated by step
        self.twist = Twist(0.0, 0.0)  # what the wheels did in the last step
        self.odometer = 0.0  # m
        self.battery = Accumulator(settings.battery)
        self.motion: Drive | Turn | None = None  # set by `begin`; None again when its outcome is known
        self.utterance: Utterance | None = None  # the sentence under way, set by `speak`
        tolerance = disturbances.BOUND * (settings.localisation_noise + settings.heading_noise)
        self.obstacles = ObstacleLayer(self.floor, tolerance)  # what the laser saw and the map does not show
        self.reroute: Callable[[Drive], None] = self._reroute_now  # called by step for a drive that is obstructed
        self.on_reroute: Callable[[Floats], None] = lambda _: (
            None
        )  # called with the points of another way that is taken
        self._localisation = disturbances.Localisation(settings.localisation_noise, settings.heading_noise, fix)
        self._pull = settings.wheel_slip * disturbances.DRIFT  # rad a m that slipping wheels may turn it aside
        self._slip = disturbances.Slip(settings.wheel_slip, wheels)
        self._halting = False  # from halt until at rest
        self._next_look = 0.0  # value of elapsed at which a driving robot looks again
        self._every = max(1, settings.laser_rays // LOOK_RAYS)

    @property
    def at_rest(self) -> bool:
        """Whether the robot stands still."""
        return self.twist.linear == 0.0 and self.twist.angular == 0.0

    @property
    def believed(self) -> Pose:
        """Where the robot believes that it is."""
        return self._localisation.believed(self.pose)

    @property
    def clearance(self) -> float:
        """m of free floor around the true footprint."""
        return self._room(self.pose) - FOOTPRINT_RADIUS

    def begin(self, motion: Drive | Turn) -> None:
        """Start a motion; one that is under way ends as halted."""
        if self.motion:
            self.motion.outcome = "halted"
        self.motion = motion
        self._halting = False

    def drive_to(self, goal: Pose, *, final_yaw: bool = True) -> Drive:
        """Plan a way to `goal` and start to drive it. Raises `planner.Unreachable`."""
        points = self.plan(self.believed, goal, self.look())
        drive = Drive(follower.track(points, goal, final_yaw, self.limits))
        self.begin(drive)
        return drive

    def plan(self, start: Pose, goal: Pose, obstacles: Floats) -> Floats:
        """A path around the map's walls and these points, shape (n, 2); through the points where there is no other,
        because they may be gone when the robot comes. Safe in a thread. Raises `Unreachable`."""
        try:
            return self.plan_around(start, goal, obstacles)
        except planner.Unreachable:
            return self.plan_around(start, goal, obstacles[:0])

    def plan_around(self, start: Pose, goal: Pose, obstacles: Floats) -> Floats:
        """A path around the map's walls and these points, shape (n, 2). Safe in a thread. Raises `Unreachable`."""
        ends = (start.x, start.y), (goal.x, goal.y)
        return planner.plan(self.floor, self.search, *ends, PLANNING_RADIUS, obstacles)

    def look(self) -> Floats:
        """Take in a scan of this moment; returns all known obstacles that the map does not show, shape (n, 2)."""
        ranges = self.environment.scan(self.pose, every=self._every)
        angles = self.environment.laser.angles[:: self._every]
        self.obstacles.take(self.elapsed, self.believed, angles, ranges)
        return self.obstacles.points

    def close_door(self, door: str) -> None:
        """Close a door of the world. Raises `WorldError` for an unknown one, `ValueError` while somebody is in it."""
        self.environment.close_door(door, self.pose)

    def open_door(self, door: str) -> None:
        """Open a door again. Raises `WorldError` for an unknown one."""
        self.environment.open_door(door)

    def halt(self) -> None:
        """Brake from the next step on."""
        self._halting = True

    def speak(self, seconds: float) -> Utterance:
        """Begin a sentence that takes `seconds`; the one before ends."""
        self.hush()
        self.utterance = Utterance(seconds)
        return self.utterance

    def hush(self) -> None:
        """End the sentence under way."""
        if self.utterance:
            self.utterance.outcome = "halted"
            self.utterance = None

    def step(self, dt: float = STEP) -> None:
        """Move time on by `dt` s."""
        self.elapsed += dt
        self.environment.step(dt, self.pose, FOOTPRINT_RADIUS + self._stopping_way(self.twist.linear))
        if self._halting:
            command = follower.braked(self.twist, self.limits, dt)
        elif isinstance(self.motion, Drive):
            self._look_ahead(self.motion)
            command = self._drive(self.motion, dt)
        elif isinstance(self.motion, Turn):
            command = follower.turn_towards(self.twist, self.motion.left, self.limits, dt)
        else:
            command = follower.braked(self.twist, self.limits, dt)
        self._move(command, dt)
        self._conclude(dt)

    def _look_ahead(self, drive: Drive) -> None:
        """Take in a scan; when something stays on the path ahead, ask for another path."""
        if self.elapsed < self._next_look:
            return
        self._next_look = self.elapsed + LOOK_INTERVAL
        self.look()
        ahead = follower.ahead(drive.track, drive.along, LOOK_AHEAD)
        obstructed = drive.waiting > 0.0 or self.obstacles.obstruct(ahead, PLANNING_RADIUS)
        drive.obstructed = drive.obstructed + LOOK_INTERVAL if obstructed else 0.0
        if drive.obstructed >= REROUTE_AFTER and drive.rerouted < MAX_REROUTES:
            drive.obstructed = 0.0
            drive.rerouted += 1
            self.reroute(drive)

    def _reroute_now(self, drive: Drive) -> None:
        # Where there is no other path the robot waits before the obstacle, and gives up after PATIENCE.
        with contextlib.suppress(planner.Unreachable):
            self.take_way(drive, self.plan_around(self.believed, drive.track.goal, self.obstacles.points))

    def take_way(self, drive: Drive, points: Floats) -> None:
        """Go on along another path to the same goal, which begins about where the robot is."""
        drive.track = follower.track(points, drive.track.goal, drive.track.final_yaw, self.limits)
        drive.along = 0.0
        self.on_reroute(points)

    def _drive(self, drive: Drive, dt: float) -> Twist:
        pose = self.believed
        for cautious in (False, True):
            command = follower.follow(pose, self.twist, drive.track, drive.along, self.limits, dt, cautious=cautious)
            if self._free_to_stop(command.twist):
                drive.stalled = 0.0 if command.along > drive.along + 1e-4 else drive.stalled + dt
                drive.along = command.along
                drive.waiting = 0.0
                if command.phase == "done":
                    drive.outcome = "reached"
                return command.twist
        drive.waiting += dt
        return follower.braked(self.twist, self.limits, dt)

    def _stopping_way(self, speed: float) -> float:
        return speed * REACTION + speed**2 / (2 * self.limits.braking) + BRAKING_MARGIN

    def _free_to_stop(self, command: Twist) -> bool:
        """Whether the robot, if it followed this command, could still brake before anything."""
        if command.linear == 0.0:
            return True  # a circle that turns on the spot covers no new floor
        needed = FOOTPRINT_RADIUS + PASSING_MARGIN + self._pull / 2 * self._stopping_way(command.linear) ** 2
        for pose in self._way_to_rest(command):
            room = self._room(pose)
            if room < needed:
                return room > self._room(self.pose)  # a robot that already stands too near may only not get nearer
        return True

    def _way_to_rest(self, command: Twist) -> Iterator[Pose]:
        """The poses of the robot after this command until it rests: its reaction, its braking, and the margin.

        Speed and turn do not brake alike, so that the robot leaves the arc of the command.
        """
        limits, pose = self.limits, follower.integrate(self.pose, command, REACTION)
        yield pose
        part = command.linear / limits.braking / BRAKING_PARTS
        twist = command
        for _ in range(BRAKING_PARTS):
            slower = follower.braked(twist, limits, part)
            mean = Twist((twist.linear + slower.linear) / 2, (twist.angular + slower.angular) / 2)
            pose, twist = follower.integrate(pose, mean, part), slower
            yield pose
        yield follower.integrate(pose, Twist(BRAKING_MARGIN, 0.0), 1.0)

    def _room(self, pose: Pose) -> float:
        """m of free floor around a true pose: to real walls, doors and people, and to what the map forbids."""
        room = self.environment.clearance(pose.x, pose.y)
        if self.floor is self.world.grid:
            return room
        believed = self._localisation.believed(pose)
        return min(room, self.floor.clearance(believed.x, believed.y))

    def _move(self, wheels: Twist, dt: float) -> None:
        moved = self._slip.after(dt, wheels, self.limits.max_turn_rate)
        pose = follower.integrate(self.pose, moved, dt)
        room = self._room(pose) if moved.linear else math.inf
        if room < FOOTPRINT_RADIUS and room <= self._room(
            self.pose
        ):  # the bumper: no command moves the robot into a wall
            pose = Pose(self.pose.x, self.pose.y, pose.yaw)
            wheels = Twist(0.0, wheels.angular)
        way = math.hypot(pose.x - self.pose.x, pose.y - self.pose.y)
        before = self.believed.yaw
        self._localisation.after(way, follower.wrap(pose.yaw - self.pose.yaw))
        self.odometer += way
        self.pose, self.twist = pose, wheels
        if isinstance(self.motion, Turn):
            self.motion.left -= follower.wrap(self.believed.yaw - before)
        docked = self.at_rest and at_dock(self.pose, self.world.places)
        self.battery = self.battery.after(dt, way, docked=docked)

    def _conclude(self, dt: float) -> None:
        motion = self.motion
        if self._halting and self.at_rest:
            self._halting = False
            if motion:
                motion.outcome = "halted"
        elif isinstance(motion, Drive) and motion.outcome == "running" and self._hopeless(motion):
            motion.outcome = "blocked"
        elif isinstance(motion, Turn) and self.at_rest and abs(motion.left) <= follower.YAW_TOLERANCE:
            motion.outcome = "reached"
        if motion and motion.outcome != "running":
            self.motion = None
        if self.utterance:
            self.utterance.left -= dt
            if self.utterance.left <= 0:
                self.utterance.outcome = "reached"
                self.utterance = None

    def _hopeless(self, drive: Drive) -> bool:
        longest_turn = math.tau / self.limits.max_turn_rate
        return self.at_rest and (drive.waiting >= PATIENCE or drive.stalled >= STALLED + longest_turn)

    @property
    def remaining(self) -> Remaining | None:
        """What is left of the motion."""
        if isinstance(self.motion, Drive):
            return follower.remaining(self.motion.track, self.motion.along, self.believed, self.limits)
        if isinstance(self.motion, Turn):
            angle = abs(self.motion.left)
            return Remaining(0.0, angle, follower.turning_time(angle, self.limits))
        return None
