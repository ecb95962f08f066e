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
"""What asks for it, in `clientCapabilities._meta` of `initialize`."""

_BATTERY_STEP = 0.1
_STANDS = 0.005  # m/s and rad/s; below, a measured speed is noise


class Turn(msgspec.Struct):
    """Whose turn controls the robot."""

    by: str


class Halt(msgspec.Struct):
    """A motion that the robot ended by itself, and why."""

    text: str


class Telemetry(msgspec.Struct):
    """The parameters of `_robot/telemetry` (docs/extensions.md); an agent may leave out any of the rest."""

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


@dataclass
class Status:
    """What is known of the robot at this moment."""

    trip: float | None = None
    """Seconds to the agent and back; None while no answer comes."""
    _told: Telemetry | None = field(default=None)
    _news: object = field(default=None)

    def take(self, params: dict[str, Any]) -> bool:
        """Take in one message. True for news: a change of more than numbers that move all the time."""
        try:
            told = msgspec.convert(params, Telemetry)
        except msgspec.ValidationError:
            told = Telemetry(online=False)
        news = (
            told.online,
            told.stop and told.stop.by,
            told.halted and told.halted.text,
            told.motion and (told.motion.kind, told.motion.place),
            told.speaking,
            told.turn and told.turn.by,
            told.battery and (told.battery.charging, math.ceil(told.battery.level / _BATTERY_STEP)),
        )
        is_news, self._told, self._news = news != self._news, told, news
        return is_news

    @property
    def line(self) -> str:
        """What matters most comes first: a narrow terminal cuts off the end."""
        told = self._told
        if told is None:
            return "no telemetry yet"
        parts = [_doing(told) if told.online else f"{told.robot} is not reachable"]
        if told.halted:
            parts.append(f"halted by itself: {told.halted.text}")
        if told.battery:
            charging = ", charging" if told.battery.charging else ""
            parts.append(f"battery {told.battery.level:.0%}{charging}")
        if told.twist:
            parts.append(f"{abs(told.twist.linear):.2f} m/s")
        if told.pose:
            parts.append(f"x {told.pose.x:.1f}, y {told.pose.y:.1f}, {math.degrees(told.pose.yaw):.0f}°")
        parts.append(f"held by {told.turn.by}" if told.turn else "held by nobody")
        parts.append("link –" if self.trip is None else f"link {self.trip * 1000:.0f} ms")
        return " · ".join(parts)


def _doing(told: Telemetry) -> str:
    if told.stop:
        return f"STOPPED by {told.stop.by}"
    if told.motion:
        if told.motion.kind == "rotate":
            return "turning"
        where = f" to {told.motion.place}" if told.motion.place else ""
        return f"driving{where}, {told.motion.distance:.1f} m to go"
    if told.speaking is not None:
        return "speaking"
    if told.twist and max(abs(told.twist.linear), abs(told.twist.angular)) > _STANDS:
        return "moving"
    return "ready"
