"""The simulated robot as a state machine in time: `step(dt)` and nothing else makes anything happen.

No clock, no task, no socket: the same steps give the same states. It keeps its own protective stop: whatever the
follower asks for, the robot brakes when the way that it needs to stop is not free; its footprint never enters a wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from backend.config import Limits
from backend.mcp_robot.places import at_dock
from backend.mcp_robot.robot import Remaining
from backend.mcp_robot.simulator import follower
from backend.mcp_robot.simulator.battery import Accumulator
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose, Twist

STEP = 0.02
"""Simulated seconds a step: 50 Hz."""
FOOTPRINT_RADIUS = 0.25
BRAKING_MARGIN = 0.02
"""Free way in m beyond the braking distance."""
GIVE_UP = 2.0
"""Seconds at rest before a way that is not free ends the motion."""
STALLED = 5.0
"""Seconds without getting on, beyond a whole turn on the spot, after which a motion ends as blocked."""

Outcome = Literal["running", "reached", "blocked", "halted"]


@dataclass
class Drive:
    """Driving along a track. `along` m are done; for `waiting` s it has stood before something, for `stalled` s it has
    not got on, for whatever reason."""

    track: follower.Track
    along: float = 0.0
    waiting: float = 0.0
    stalled: float = 0.0
    outcome: Outcome = "running"


@dataclass
class Turn:
    """Turning on the spot; `left` rad are to go, counter-clockwise positive."""

    left: float
    outcome: Outcome = "running"


@dataclass
class Utterance:
    """Speaking; `left` s are to go."""

    left: float
    outcome: Outcome = "running"


class Simulation:
    """A robot in a world. Attributes are its state; `step` alone moves them on."""

    def __init__(self, world: World, limits: Limits, battery_level: float = 0.92) -> None:
        self.world = world
        self.limits = limits
        self.elapsed = 0.0  # s, grows with every step
        self.pose: Pose = world.start  # integrated by step
        self.twist = Twist(0.0, 0.0)  # what the last step moved with
        self.odometer = 0.0  # m
        self.battery = Accumulator(battery_level)
        self.motion: Drive | Turn | None = None  # set by begin, ends with its outcome and is dropped
        self.utterance: Utterance | None = None  # likewise
        self._halting = False  # from halt until at rest

    @property
    def at_rest(self) -> bool:
        """Whether it stands still."""
        return self.twist.linear == 0.0 and self.twist.angular == 0.0

    def begin(self, motion: Drive | Turn) -> None:
        """Start a motion; one that is under way ends as halted."""
        if self.motion:
            self.motion.outcome = "halted"
        self.motion = motion
        self._halting = False

    def halt(self) -> None:
        """Brake from the next step on."""
        self._halting = True

    def speak(self, seconds: float) -> Utterance:
        """Start to say something that takes `seconds`; what is being said ends."""
        self.hush()
        self.utterance = Utterance(seconds)
        return self.utterance

    def hush(self) -> None:
        """End what is being said."""
        if self.utterance:
            self.utterance.outcome = "halted"
            self.utterance = None

    def step(self, dt: float = STEP) -> None:
        """Move time on by `dt` s."""
        self.elapsed += dt
        if self._halting:
            command = follower.braked(self.twist, self.limits, dt)
        elif isinstance(self.motion, Drive):
            command = self._drive(self.motion, dt)
        elif isinstance(self.motion, Turn):
            command = follower.turn_towards(self.twist, self.motion.left, self.limits, dt)
        else:
            command = follower.braked(self.twist, self.limits, dt)
        self._move(command, dt)
        self._conclude(dt)

    def _drive(self, drive: Drive, dt: float) -> Twist:
        for cautious in (False, True):
            command = follower.follow(
                self.pose, self.twist, drive.track, drive.along, self.limits, dt, cautious=cautious
            )
            if self._free_to_stop(command.twist, dt):
                drive.stalled = 0.0 if command.along > drive.along + 1e-4 else drive.stalled + dt
                drive.along = command.along
                drive.waiting = 0.0
                if command.phase == "done":
                    drive.outcome = "reached"
                return command.twist
        drive.waiting += dt
        return follower.braked(self.twist, self.limits, dt)

    def _free_to_stop(self, command: Twist, dt: float) -> bool:
        """Whether the robot, one step on with this command, could still brake before anything."""
        way = command.linear * dt + command.linear**2 / (2 * self.limits.braking) + BRAKING_MARGIN
        if command.linear == 0.0:
            return True  # a circle that turns on the spot covers no new floor
        seconds = way / command.linear
        for part in (0.5, 1.0):
            ahead = integrate(self.pose, command, seconds * part)
            if self.world.grid.clearance(ahead.x, ahead.y) < FOOTPRINT_RADIUS:
                # Where it already stands too near, only driving nearer is refused.
                return self.world.grid.clearance(ahead.x, ahead.y) > self.world.grid.clearance(self.pose.x, self.pose.y)
        return True

    def _move(self, command: Twist, dt: float) -> None:
        pose = integrate(self.pose, command, dt)
        if command.linear and self.world.grid.clearance(pose.x, pose.y) < FOOTPRINT_RADIUS:
            here = self.world.grid.clearance(self.pose.x, self.pose.y)
            if self.world.grid.clearance(pose.x, pose.y) <= here:  # the bumper: no command moves it into a wall
                pose = Pose(self.pose.x, self.pose.y, pose.yaw)
                command = Twist(0.0, command.angular)
        way = math.hypot(pose.x - self.pose.x, pose.y - self.pose.y)
        if isinstance(self.motion, Turn):
            self.motion.left -= command.angular * dt
        self.odometer += way
        self.pose, self.twist = pose, command
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
        return self.at_rest and (drive.waiting >= GIVE_UP or drive.stalled >= STALLED + longest_turn)

    @property
    def remaining(self) -> Remaining | None:
        """What is left of the motion."""
        if isinstance(self.motion, Drive):
            return follower.remaining(self.motion.track, self.motion.along, self.pose, self.limits)
        if isinstance(self.motion, Turn):
            angle = abs(self.motion.left)
            return Remaining(0.0, angle, follower.turning_time(angle, self.limits))
        return None


def integrate(pose: Pose, twist: Twist, dt: float) -> Pose:
    """The pose after `dt` s of constant twist: along an arc, exactly."""
    turn = twist.angular * dt
    middle = pose.yaw + turn / 2
    chord = twist.linear * dt * (math.sin(turn / 2) / (turn / 2) if abs(turn) > 1e-9 else 1.0)
    return Pose(pose.x + chord * math.cos(middle), pose.y + chord * math.sin(middle), follower.wrap(pose.yaw + turn))
