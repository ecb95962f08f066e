"""The safety rules while the robot moves: the guard checks pose, speed, laser and battery twenty times a second.

Each rule is a plain function of measured values that returns nothing or raises `Refusal`; `Guard` checks all of them
for one motion and keeps what only earlier measurements can show. It stands above every kind of robot: one that keeps
its limits and stops before obstacles by itself never triggers it. It moves and halts nothing: its caller halts.

The protective stop is an idea of ISO 3691-4 (a driverless truck detects persons in its path and stops before them), and
that reaction time and stopping distance decide how early it acts is one of ISO 13855. Neither standard's margins, tests
or performance levels are claimed: docs/safety.md says what this is not.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from backend.config import Limits
from backend.mcp_robot.motion import keep_out
from backend.mcp_robot.motion.safety import where_to_charge
from backend.mcp_robot.navigation.grid import OccupancyGrid
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import Fix, Robot, Velocity
from backend.telemetry import Battery, Pose, Scan, Twist, Zone

PERIOD = 0.05
"""Seconds of the wall's clock between two checks: the robot server's control period."""
REACTION = 2 * PERIOD
"""Seconds of the robot's clock from an obstacle's appearance to the brakes."""
POSE_TOLERANCE = 0.05
"""m by which the believed pose may be wrong beside a wall; a cell of the map is added. The laser sees the wall, too."""
SPEED_TOLERANCE = 0.05
"""A measured speed may be over its limit by so many m/s or rad/s, plus the same number as a share of the limit."""
GAIN_TIME, GAIN_TOLERANCE = 0.5, 0.1
"""Over so many seconds a measured speed may rise by so much more (m/s and rad/s) than the acceleration limit allows."""
SELF = 0.5
"""Readings nearer than this share of the footprint's radius are taken for the robot itself."""
ARC_POINTS = 8
"""Points on the way to rest at which the footprint is compared with the readings."""


def ordinary(pose: Pose) -> None:
    """The pose is finite."""
    if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
        raise Refusal("lost", "The robot's position is no ordinary number. It has halted; see to its localisation.")


def localised(fix: Fix, now: float, limits: Limits) -> None:
    """The robot knows where it is: its pose is not older than `pose_timeout`."""
    if now - fix.stamp > limits.pose_timeout:
        age = f"{now - fix.stamp:.1f} s"
        raise Refusal("lost", f"The robot has not known its position for {age} ({fix.source}), and has halted.")


def within_limits(twist: Twist, limits: Limits) -> None:
    """Neither speed is over its limit."""
    for speed, most, unit in ((twist.linear, limits.max_speed, "m/s"), (twist.angular, limits.max_turn_rate, "rad/s")):
        if not math.isfinite(speed) or abs(speed) > most * (1 + SPEED_TOLERANCE) + SPEED_TOLERANCE:
            raise Refusal("too_fast", f"The robot moved with {abs(speed):.2f} {unit}, over {most:g}, and was halted.")


def gains_gently(before: Twist, after: Twist, seconds: float, limits: Limits) -> None:
    """Between two measurements, `seconds` apart, neither speed rose faster than its limit allows. Braking may be
    harder."""
    for was, is_, most in (
        (before.linear, after.linear, limits.max_acceleration),
        (before.angular, after.angular, limits.max_turn_acceleration),
    ):
        if abs(is_) - abs(was) > most * (1 + SPEED_TOLERANCE) * seconds + GAIN_TOLERANCE:
            raise Refusal("too_fast", "The robot gained speed faster than its acceleration limit, and was halted.")


def on_free_floor(grid: OccupancyGrid, pose: Pose, room: float) -> None:
    """The robot is on the map, with `room` m of free floor around it."""
    where = f"({pose.x:.1f}, {pose.y:.1f})"
    if grid.state(pose.x, pose.y) is None:
        raise Refusal("outside_map", f"The robot left the map at {where}, and has halted.")
    if grid.clearance(pose.x, pose.y) < room:
        raise Refusal("occupied", f"The robot came too close to a wall at {where}, and has halted.")


def off_zones(zones: Sequence[Zone], pose: Pose, room: float) -> None:
    """The robot's centre is at least `room` m away from every keep-out zone."""
    near = keep_out.nearest(zones, pose.x, pose.y)
    if near and near[0] < room:
        where = f"({pose.x:.1f}, {pose.y:.1f})"
        raise Refusal("keep_out", f"The robot touched the keep-out zone {near[1].name} at {where}, and has halted.")


def sighted(scan: Scan, now: float, limits: Limits) -> None:
    """The latest scan has readings and is not older than `pose_timeout`."""
    if not scan.ranges:
        raise Refusal(
            "blind", "The laser has no readings, and the robot has halted. See to the laser and its transform."
        )
    if now - scan.time > limits.pose_timeout:
        raise Refusal("blind", f"The laser has been silent for {now - scan.time:.1f} s, and the robot has halted.")


def way_is_free(scan: Scan, now: float, twist: Twist, footprint_radius: float, limits: Limits) -> None:
    """The protective stop: nothing that the laser sees lies on the floor that the robot needs to come to rest.

    That floor is the footprint's circle, moved along the present arc by v * (REACTION + age of the scan) + v²/2b, with
    the speed v and the braking deceleration b. Things are taken to stand still. A reading that the circle passes
    without coming nearer to it is not in the way.
    """
    speed = abs(twist.linear)
    if speed < 1e-3:
        return  # a circle that turns on the spot covers no new floor
    ranges = np.asarray(scan.ranges)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    seen = np.isfinite(ranges) & (ranges < scan.range_max) & (ranges > SELF * footprint_radius)
    x, y = ranges[seen] * np.cos(angles[seen]), ranges[seen] * np.sin(angles[seen])
    way = math.copysign(speed * (REACTION + max(0.0, now - scan.time)) + speed**2 / (2 * limits.braking), twist.linear)
    along = np.linspace(0.0, way, ARC_POINTS + 1)[1:, None]
    turned = along * (twist.angular / twist.linear)
    chord = along * np.sinc(turned / math.tau)
    gap = np.hypot(x - chord * np.cos(turned / 2), y - chord * np.sin(turned / 2))
    if ((gap < footprint_radius) & (gap < np.hypot(x, y))).any():
        raise Refusal("blocked", "Something came into the robot's way, and it has halted. Look, then ask again.")


def battery_lasts(battery: Battery, limits: Limits, advice: str) -> None:
    """The charge is at least half of what a motion needs to begin, so that most motions reach their end."""
    if battery.level < limits.battery_floor / 2:
        raise Refusal("battery_low", f"The battery fell to {battery.level:.0%}, and the robot has halted.{advice}")


class Guard:
    """All rules for one motion. `to_dock` says that it ends at a dock: then an empty battery does not end it."""

    def __init__(self, robot: Robot, zones: Sequence[Zone], limits: Limits, *, to_dock: bool) -> None:
        self._robot = robot
        self._zones = zones
        self._limits = limits
        self._to_dock = to_dock
        self._room = (
            -math.inf
        )  # m of free floor that is required; a robot that begins too near to a wall may only not get nearer
        self._apart = -math.inf  # the same for the distance from zones
        self._past: deque[Velocity] = deque()  # the measurements of the last GAIN_TIME seconds

    def check(self) -> None:
        """Check every rule now. Raises `Refusal`."""
        robot, limits, radius = self._robot, self._limits, self._robot.footprint_radius
        now, fix, velocity = robot.clock(), robot.fix, robot.velocity
        twist = velocity.twist
        ordinary(fix.pose)
        if twist.linear or twist.angular:
            localised(fix, now, limits)
            within_limits(twist, limits)
        braking = self._gain(velocity)
        self._keep_distance(fix.pose, radius)
        if twist.linear and not braking:  # a robot that brakes already does what it can
            scan = robot.scan()
            sighted(scan, now, limits)
            way_is_free(scan, now, twist, radius, limits)
        if not self._to_dock:
            battery_lasts(robot.battery, limits, where_to_charge(robot.places))

    def _gain(self, velocity: Velocity) -> bool:
        """Check the acceleration; returns whether the robot has braked hard since the check before.

        Only times of measurement count: messages that arrive late, and then all at once, are no acceleration.
        """
        past, braking, now = self._past, False, velocity.stamp
        if past and now > past[-1].stamp:
            lost = abs(past[-1].twist.linear) - abs(velocity.twist.linear)
            braking = lost >= 0.5 * self._limits.braking * (now - past[-1].stamp)
        past.append(velocity)
        while len(past) > 2 and past[1].stamp <= now - GAIN_TIME:
            past.popleft()
        gains_gently(past[0].twist, velocity.twist, now - past[0].stamp, self._limits)
        return braking

    def _keep_distance(self, pose: Pose, radius: float) -> None:
        grid = self._robot.grid
        room = min(grid.clearance(pose.x, pose.y), radius - POSE_TOLERANCE - grid.resolution)
        near = keep_out.nearest(self._zones, pose.x, pose.y)
        apart = min(near[0], radius) if near else math.inf
        if self._apart == -math.inf:  # the first check: where the robot stood before it moved
            self._room, self._apart = room, apart
        on_free_floor(grid, pose, self._room - 0.01)
        off_zones(self._zones, pose, self._apart - 0.01)
        self._room, self._apart = max(self._room, room), max(self._apart, apart)
