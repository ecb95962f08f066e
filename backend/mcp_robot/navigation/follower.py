"""Follows a path: from pose, twist and path to the next twist, within limits.

Plain functions and frozen data: no clock, no state of its own, no map. Pure pursuit (Coulter 1992) with a speed profile
that is computed once for a path, slow in turns and to rest at its end. It never asks for more than the limits allow. It
does not check whether the floor ahead is free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from backend.config import Limits
from backend.mcp_robot.navigation.grid import Floats
from backend.mcp_robot.robot import Remaining
from backend.telemetry import Pose, Twist

LOOKAHEAD = 0.16
"""Distance in m of the point on the path that is steered at."""
LOOKAHEAD_TIME = 0.4
"""LOOKAHEAD grows by the distance that the robot drives in so many seconds."""
STEERING_GAIN = 2.0
"""rad/s of turn for each rad of bearing to that point, at least, however slowly the robot drives."""
TURN_FIRST = math.pi / 4
"""With a bearing larger than this (rad) the robot turns on the spot first."""
CAUTIOUS_LOOKAHEAD, CAUTIOUS_TURN_FIRST, CAUTIOUS_SPEED = 0.1, 0.1, 0.15
"""The same (m, rad) and a speed (m/s) beside an obstacle: straight to a near point of the path, slowly."""
CRAWL = 0.04
"""Slowest speed of the profile in m/s, so that the robot reaches the end and does not only approach it."""
POSITION_TOLERANCE = 0.02
"""m along the path from the goal at which the robot has arrived."""
YAW_TOLERANCE = 0.01
"""rad from the wanted yaw at which a turn is done."""
COMFORT = 0.85
"""Share of the acceleration limit that the profile uses; the rest is left for corrections."""

Phase = Literal["drive", "align", "done"]


@dataclass(frozen=True, eq=False)
class Track:
    """A path prepared for following. For each point: x and y in m, distance along the path in m, fastest speed in m/s,
    and seconds to the end."""

    x: list[float]
    y: list[float]
    along: list[float]
    speed: list[float]
    seconds: list[float]
    goal: Pose
    final_yaw: bool

    @property
    def length(self) -> float:
        """Length of the path in m."""
        return self.along[-1]


@dataclass(frozen=True)
class Command:
    """The twist for the next step, how far along the path the robot is, and what it is doing."""

    twist: Twist
    along: float
    phase: Phase


def track(points: Floats, goal: Pose, final_yaw: bool, limits: Limits) -> Track:
    """Prepare a path of closely spaced points."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    speed = np.minimum(limits.max_speed, _speed_in_turns(points, limits))
    speed[-1] = 0.0
    acceleration = COMFORT * limits.max_acceleration
    for i in range(len(steps) - 1, -1, -1):
        speed[i] = min(speed[i], math.sqrt(speed[i + 1] ** 2 + 2 * acceleration * steps[i]))
    reached = np.maximum(0.5 * (speed[1:] + speed[:-1]), CRAWL)
    seconds = np.concatenate([np.cumsum((steps / reached)[::-1])[::-1], [0.0]])
    return Track(
        points[:, 0].tolist(), points[:, 1].tolist(), along.tolist(), speed.tolist(), seconds.tolist(), goal, final_yaw
    )


def _speed_in_turns(points: Floats, limits: Limits) -> Floats:
    """The speed in m/s at which each point's curvature needs two thirds of the turn rate. Curvature is measured over a
    third of a metre."""
    speed: Floats = np.full(len(points), limits.max_speed)
    reach = 3
    if len(points) > 2 * reach:
        before = points[reach:-reach] - points[: -2 * reach]
        after = points[2 * reach :] - points[reach:-reach]
        turn = np.abs(
            np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.einsum("ij,ij->i", before, after))
        )
        way = 0.5 * (np.hypot(*before.T) + np.hypot(*after.T))
        curvature = turn / np.maximum(way, 1e-6)
        speed[reach:-reach] = limits.max_turn_rate * (2 / 3) / np.maximum(curvature, 1e-6)
    np.maximum(speed, CRAWL, out=speed)
    return speed


def follow(
    pose: Pose, twist: Twist, track: Track, along: float, limits: Limits, dt: float, *, cautious: bool = False
) -> Command:
    """The next command of a robot that is `along` m along its track. `cautious` stays close to the track, slowly."""
    along = _progress(pose, track, along)
    left = track.length - along
    if left <= POSITION_TOLERANCE:
        return _align(pose, twist, track, along, limits, dt)
    reach = CAUTIOUS_LOOKAHEAD if cautious else LOOKAHEAD + LOOKAHEAD_TIME * twist.linear
    bearing = _bearing(pose, *_point(track, along + reach))
    if abs(bearing) > (CAUTIOUS_TURN_FIRST if cautious else TURN_FIRST):
        return Command(turn_towards(twist, bearing, limits, dt), along, "drive")
    fastest = max(_interpolate(track.speed, track, along + twist.linear * dt), CRAWL)
    if cautious:
        fastest = min(fastest, CAUTIOUS_SPEED)
    pursuit = 2 * twist.linear * math.sin(bearing) / reach
    gentle = STEERING_GAIN * bearing
    steering = pursuit if abs(pursuit) > abs(gentle) else gentle
    wanted = Twist(fastest * math.cos(2 * bearing), steering)
    return Command(limited(twist, wanted, limits, dt), along, "drive")


def _align(pose: Pose, twist: Twist, track: Track, along: float, limits: Limits, dt: float) -> Command:
    """At the goal: come to rest, and turn to its yaw where that was asked."""
    error = wrap(track.goal.yaw - pose.yaw) if track.final_yaw else 0.0
    command = turn_towards(twist, error, limits, dt)
    at_rest = twist.linear == 0.0 and twist.angular == 0.0 and abs(error) <= YAW_TOLERANCE
    return Command(command, along, "done" if at_rest else "align")


def turn_towards(twist: Twist, angle: float, limits: Limits, dt: float) -> Twist:
    """Turn on the spot by `angle` rad: to rest exactly there, as fast as the limits allow."""
    if abs(angle) <= YAW_TOLERANCE / 2 and abs(twist.angular) <= limits.max_turn_acceleration * dt:
        return limited(twist, Twist(0.0, 0.0), limits, dt)
    rate = math.copysign(stopping_speed(abs(angle), limits.max_turn_acceleration * COMFORT, dt), angle)
    return limited(twist, Twist(0.0, rate), limits, dt)


def stopping_speed(distance: float, deceleration: float, dt: float) -> float:
    """The fastest speed from which steps of `dt` come to rest within `distance`: the discrete v = sqrt(2 a d)."""
    change = deceleration * dt
    return change * (math.sqrt(0.25 + 2 * distance / (change * dt)) - 0.5)


def limited(twist: Twist, wanted: Twist, limits: Limits, dt: float) -> Twist:
    """The twist nearest to `wanted` that limits allow after `twist`. The robot does not drive backwards."""
    return Twist(
        _towards(twist.linear, min(max(wanted.linear, 0.0), limits.max_speed), limits.max_acceleration * dt),
        _towards(
            twist.angular,
            min(max(wanted.angular, -limits.max_turn_rate), limits.max_turn_rate),
            limits.max_turn_acceleration * dt,
        ),
    )


def braked(twist: Twist, limits: Limits, dt: float) -> Twist:
    """The twist one step into braking as hard as allowed; the turn brakes as much harder as the speed does."""
    turn_braking = limits.max_turn_acceleration * max(1.0, limits.braking / limits.max_acceleration)
    return Twist(_towards(twist.linear, 0.0, limits.braking * dt), _towards(twist.angular, 0.0, turn_braking * dt))


def _towards(value: float, wanted: float, change: float) -> float:
    return min(max(wanted, value - change), value + change)


def _progress(pose: Pose, track: Track, along: float) -> float:
    """How far along the track the robot is, in m: its nearest point, from the latest one up to a metre beyond it."""
    index = _index(track, along)
    best, best_distance = along, math.inf
    while index < len(track.x) - 1 and track.along[index] <= along + 1.0:
        ax, ay = track.x[index], track.y[index]
        dx, dy = track.x[index + 1] - ax, track.y[index + 1] - ay
        squared = dx * dx + dy * dy
        part = ((pose.x - ax) * dx + (pose.y - ay) * dy) / squared if squared else 0.0
        part = min(max(part, 0.0), 1.0)
        distance = math.hypot(ax + part * dx - pose.x, ay + part * dy - pose.y)
        if distance < best_distance - 1e-9:
            best_distance = distance
            best = track.along[index] + part * math.sqrt(squared)
        index += 1
    return max(along, best)


def _index(track: Track, along: float) -> int:
    """The last point at or before `along`; the points are evenly spaced but for rounding."""
    if track.length <= 0:
        return 0
    guess = int(along / track.length * (len(track.along) - 1))
    guess = min(max(guess, 0), len(track.along) - 1)
    while guess > 0 and track.along[guess] > along:
        guess -= 1
    return guess


def _point(track: Track, along: float) -> tuple[float, float]:
    """The point `along` m along the track. Beyond its end the track goes straight on, so that an arriving robot keeps
    its heading."""
    if along >= track.length:
        back = max(0, len(track.x) - 4)
        dx, dy = track.x[-1] - track.x[back], track.y[-1] - track.y[back]
        length = math.hypot(dx, dy) or 1.0
        beyond = along - track.length
        return track.x[-1] + dx / length * beyond, track.y[-1] + dy / length * beyond
    return _interpolate(track.x, track, along), _interpolate(track.y, track, along)


def _interpolate(values: list[float], track: Track, along: float) -> float:
    index = _index(track, along)
    if index >= len(values) - 1:
        return values[-1]
    step = track.along[index + 1] - track.along[index]
    part = min((along - track.along[index]) / step, 1.0) if step else 0.0
    return values[index] + part * (values[index + 1] - values[index])


def ahead(track: Track, along: float, reach: float) -> Floats:
    """The points of the track from `along` m on, for `reach` m; shape (n, 2)."""
    first = _index(track, along)
    last = first
    while last < len(track.along) and track.along[last] <= along + reach:
        last += 1
    return np.stack([track.x[first:last], track.y[first:last]], axis=1)


def remaining(track: Track, along: float, pose: Pose, limits: Limits) -> Remaining:
    """What is left, and about how long it takes: turning to the path, the profile's time, turning to the goal's yaw.

    The angle is 0 until only the final turn is left.
    """
    left = max(0.0, track.length - along)
    if left <= POSITION_TOLERANCE:
        angle = abs(wrap(track.goal.yaw - pose.yaw)) if track.final_yaw else 0.0
        return Remaining(0.0, angle, turning_time(angle, limits))
    first = abs(_bearing(pose, *_point(track, along + LOOKAHEAD)))
    end = math.atan2(track.y[-1] - track.y[max(0, len(track.y) - 4)], track.x[-1] - track.x[max(0, len(track.x) - 4)])
    last = abs(wrap(track.goal.yaw - end)) if track.final_yaw else 0.0
    seconds = _interpolate(track.seconds, track, along) + turning_time(last, limits)
    return Remaining(left, 0.0, seconds + (turning_time(first, limits) if first > TURN_FIRST else 0.0))


def turning_time(angle: float, limits: Limits) -> float:
    """Seconds for a turn on the spot from rest to rest: a trapezoid of speed."""
    acceleration = limits.max_turn_acceleration * COMFORT
    ramps = limits.max_turn_rate / acceleration
    if angle > limits.max_turn_rate * ramps:
        return angle / limits.max_turn_rate + ramps
    return 2 * math.sqrt(angle / acceleration)


def _bearing(pose: Pose, x: float, y: float) -> float:
    return wrap(math.atan2(y - pose.y, x - pose.x) - pose.yaw)


def integrate(pose: Pose, twist: Twist, dt: float) -> Pose:
    """The pose after `dt` s of constant twist: along an arc, exactly."""
    turn = twist.angular * dt
    middle = pose.yaw + turn / 2
    chord = twist.linear * dt * (math.sin(turn / 2) / (turn / 2) if abs(turn) > 1e-9 else 1.0)
    return Pose(pose.x + chord * math.cos(middle), pose.y + chord * math.sin(middle), wrap(pose.yaw + turn))


def wrap(angle: float) -> float:
    """The same angle within (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped <= -math.pi else wrapped
