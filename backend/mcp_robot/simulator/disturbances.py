"""Disturbances: an error of the robot's localisation, and wheels that slip.

Plain state in time, seeded, no clock: the same steps give the same errors. Both are bounded, so that tests can state
what the robot still keeps. With a scale of 0 no random number is drawn and nothing changes.
"""

from __future__ import annotations

import math

import numpy as np

from backend.mcp_robot.navigation.follower import wrap
from backend.mcp_robot.navigation.grid import Floats
from backend.telemetry import Pose, Twist

BOUND = 3.0
"""No error is larger than this many standard deviations."""
CORRECTION_WAY, CORRECTION_TURN = 0.25, 0.5
"""The localisation corrects itself after so many m or rad, as AMCL does (`update_min_d`, `update_min_a`)."""
MEMORY = 0.8
"""Share of an error that is left after one correction."""
SLIP_TIME = 0.5
"""Seconds over which the grip of the wheels changes."""
DRIFT = 0.5
"""rad that a robot whose wheels slip wholly would turn aside on each m."""


class Localisation:
    """The error of the pose that the robot believes: it grows with distance, and corrections reduce it.

    `position` (m) and `heading` (rad) are the standard deviations of the error in each of x and y, and in yaw.
    """

    def __init__(self, position: float, heading: float, generator: np.random.Generator) -> None:
        self._scale: Floats = np.array([position, position, heading])
        self._generator = generator
        self._from = self._to = self._error = np.zeros(3)  # before, after, and on the way to a correction
        self._progress = 1.0  # from one correction (0) to the next (1)

    def after(self, way: float, turn: float) -> None:
        """The error after the robot moved on by `way` m and `turn` rad."""
        if not self._scale.any():
            return
        self._progress += way / CORRECTION_WAY + abs(turn) / CORRECTION_TURN
        if self._progress >= 1.0:
            self._from, self._progress = self._error, 0.0
            drawn = MEMORY * self._to / np.where(self._scale > 0, self._scale, 1.0)
            drawn = drawn + math.sqrt(1 - MEMORY**2) * self._generator.standard_normal(3)
            self._to = np.clip(drawn, -BOUND, BOUND) * self._scale
        self._error = self._from + self._progress * (self._to - self._from)

    def believed(self, pose: Pose) -> Pose:
        """The pose that the robot believes at a true one."""
        if not self._scale.any():
            return pose
        dx, dy, turn = self._error.tolist()
        return Pose(pose.x + dx, pose.y + dy, wrap(pose.yaw + turn))


class Slip:
    """Wheels that slip: `share` is the most of their motion that they lose, from 0 to 1."""

    def __init__(self, share: float, generator: np.random.Generator) -> None:
        self._share = share
        self._generator = generator
        self._loss = self._aside = 0.0  # share lost (0 to 1), and to which side it pulls (-1 to 1)
        self._left = 0.0  # s until both change
        self._slope = (0.0, 0.0)  # a second

    def after(self, dt: float, wheels: Twist, max_turn_rate: float) -> Twist:
        """The robot's true twist when its wheels turn for the twist `wheels`; never faster."""
        if self._share == 0.0:
            return wheels
        if self._left <= 0.0:
            loss, aside = self._generator.uniform(0, 1), self._generator.uniform(-1, 1)
            self._slope = (loss - self._loss) / SLIP_TIME, (aside - self._aside) / SLIP_TIME
            self._left = SLIP_TIME
        self._left -= dt
        self._loss = min(max(self._loss + self._slope[0] * dt, 0.0), 1.0)
        self._aside = min(max(self._aside + self._slope[1] * dt, -1.0), 1.0)
        grip = 1.0 - self._share * self._loss
        drift = self._share * self._aside * DRIFT * wheels.linear
        turn = min(max(wheels.angular * grip + drift, -max_turn_rate), max_turn_rate)
        return Twist(wheels.linear * grip, turn)
