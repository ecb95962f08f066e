"""The robot's state in one line of a terminal: telemetry in, words out. No terminal, no socket, no clock.

A message that cannot be read counts as "not reachable": the line never shows a number that nobody sent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import msgspec

from backend import meta as keys
from backend.telemetry import Battery, Motion, Pose, Stop, Twist

METHOD = "_robot/telemetry"
RATE_HZ = 2.0
SUBSCRIPTION = {keys.TELEMETRY: {"rate": RATE_HZ}}
"""The request for this telemetry, in `clientCapabilities._meta` of `initialize`."""

_BATTERY_STEP = 0.1
"""A change of the charge by this share of the whole is worth a new line."""
_MIN_SPEED = 0.005
"""m/s and rad/s; a lower measured speed is noise."""


class Turn(msgspec.Struct):
    """The person whose turn controls the robot."""

    by: str


class Halt(msgspec.Struct):
    """A motion that the robot ended by itself, and why."""

    text: str


class Away(msgspec.Struct):
    """The database of sessions cannot be used, and why."""

    text: str


class Telemetry(msgspec.Struct):
    """The parameters of `_robot/telemetry` (docs/extensions.md); an agent may leave out all but `online`."""

    online: bool
    robot: str = "The robot"
    pose: Pose | None = None
    twist: Twist | None = None
    battery: Battery | None = None
    motion: Motion | None = None
    stop: Stop | None = None
    speaking: str | None = None
    turn: Turn | None = None
    halted: Halt | None = None
    database: Away | None = None


@dataclass
class Status:
    """The newest state of the robot and of the connection to its agent."""

    round_trip: float | None = None
    """Seconds to the agent and back; None while no answer comes."""
    _telemetry: Telemetry | None = field(default=None)
    """The newest message; None before the first."""
    _key: object = field(default=None)
    """The values of that message whose change is worth a new line."""

    def apply(self, params: dict[str, Any]) -> bool:
        """Apply one message. True when it is worth a new line: more has changed than pose, speed and the like."""
        try:
            telemetry = msgspec.convert(params, Telemetry)
            _must_be_finite(telemetry)
        except ValueError:  # msgspec's own error is one
            telemetry = Telemetry(online=False)
        key = (
            telemetry.online,
            telemetry.stop and telemetry.stop.by,
            telemetry.halted and telemetry.halted.text,
            telemetry.motion and (telemetry.motion.kind, telemetry.motion.place),
            telemetry.speaking,
            telemetry.database is not None,
            telemetry.turn and telemetry.turn.by,
            telemetry.battery and (telemetry.battery.charging, math.ceil(telemetry.battery.level / _BATTERY_STEP)),
        )
        changed, self._telemetry, self._key = key != self._key, telemetry, key
        return changed

    @property
    def line(self) -> str:
        """The state in words, the most important first: a narrow terminal cuts off the end."""
        telemetry = self._telemetry
        if telemetry is None:
            return "no telemetry yet"
        parts = [_doing(telemetry) if telemetry.online else f"{telemetry.robot} is not reachable"]
        if telemetry.halted:
            parts.append(f"halted by itself: {telemetry.halted.text}")
        if telemetry.database:
            parts.append("the session log is away, no task can begin")
        if telemetry.battery:
            charging = ", charging" if telemetry.battery.charging else ""
            parts.append(f"battery {telemetry.battery.level:.0%}{charging}")
        if telemetry.twist:
            parts.append(f"{abs(telemetry.twist.linear):.2f} m/s")
        if telemetry.pose:
            parts.append(f"x {telemetry.pose.x:.1f}, y {telemetry.pose.y:.1f}, {math.degrees(telemetry.pose.yaw):.0f}°")
        parts.append(f"held by {telemetry.turn.by}" if telemetry.turn else "held by nobody")
        parts.append("link –" if self.round_trip is None else f"link {self.round_trip * 1000:.0f} ms")
        return " · ".join(parts)


def _must_be_finite(telemetry: Telemetry) -> None:
    """Raises `ValueError` for a number without a size."""
    for part in (telemetry.pose, telemetry.twist, telemetry.battery, telemetry.motion):
        for value in msgspec.structs.astuple(part) if part else ():
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError("a number is not finite")


def _doing(telemetry: Telemetry) -> str:
    if telemetry.stop:
        return f"STOPPED by {telemetry.stop.by}"
    if telemetry.motion:
        if telemetry.motion.kind == "rotate":
            return "turning"
        where = f" to {telemetry.motion.place}" if telemetry.motion.place else ""
        return f"driving{where}, {telemetry.motion.distance:.1f} m to go"
    if telemetry.speaking is not None:
        return "speaking"
    if telemetry.twist and max(abs(telemetry.twist.linear), abs(telemetry.twist.angular)) > _MIN_SPEED:
        return "moving"
    return "ready"
