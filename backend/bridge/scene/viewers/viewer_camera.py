"""Where one viewer's camera is to stand, and whether its viewer has taken it over.

A state machine without clock, socket or viser: what happens is told to it, and what it returns is to be sent to the
page. A camera that its viewer has moved is not moved again until the viewer asks for a view.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from backend.bridge.scene.camera import TYPICAL_ASPECT, View, behind, fitting, overhead
from backend.bridge.scene.shapes import Extent
from backend.telemetry import Pose

Choice = Literal["map", "top", "follow"]
ViewName = Literal["map", "top", "follow", "free"]

SETTLING = 2.0
"""s after a page opened or a view was chosen in which reports of other positions are still on their way."""
_NEAR = 0.02
"""m that a camera may be off what it was set to, and still count as not moved."""
_REMEMBERED = 60
"""Positions sent last: a report of one of them is an echo, not the viewer's hand. 3 s of following."""
_TURNING = 0.6
"""s in which the following camera comes half round when the robot turns."""
_AWAY = 3.0
"""m that the robot does not drive between two states: the camera jumps there at once."""


@dataclass(frozen=True)
class Report:
    """What a page says of its camera."""

    view: View
    aspect: float


class Eye:
    """One viewer's camera. `view` is what it shows; every method returns where to put it, None to leave it."""

    def __init__(self, extent: Extent, robot: Pose | None) -> None:
        self.view: ViewName = "map"
        self._extent = extent
        self._robot = robot  # smoothed while following
        self._moved = -math.inf  # when the robot's pose came last
        self._aspect: float | None = None  # of the page; None while there is none
        self._found: Report | None = None  # where a page of before stands, until anything moves its camera
        self._chosen = False  # the view was asked for, so that a page that opens goes there from wherever it stands
        self._settled = math.inf  # until then any position is that of before
        self._sent: deque[View] = deque(maxlen=_REMEMBERED)

    def closed(self) -> None:
        """The page is gone; one that comes tells its shape anew."""
        self._aspect = None

    def reported(self, report: Report, now: float) -> View | None:
        """The page says where its camera stands."""
        opened, self._aspect = self._aspect is None, report.aspect
        if opened:
            self._settled = now + SETTLING
            if self.view != "free" and not (self._chosen or self._is_fresh(report)):
                self.view, self._found = "free", report  # a page that connected again stands where its viewer left it
                self._recognise()
        if self.view == "free":
            if self._found is not None and not _same(report.view, self._found.view):
                self._found = None
            return None
        if self._echoes(report.view):
            return self._aim()
        if now < self._settled or _same(report.view, self._initial()):
            return self._aim(again=True)
        self.view = "free"
        return None

    def choose(self, view: Choice, now: float) -> View | None:
        """The viewer asks for a view."""
        self.view, self._chosen, self._settled = view, True, now + SETTLING
        self._found = None
        return self._aim(again=True)

    def moved(self) -> None:
        """The viewer has taken the camera in hand."""
        self.view, self._found = "free", None

    def look_at(self, extent: Extent) -> View | None:
        """From now on this part of the map is all of it."""
        self._extent = extent
        self._recognise()
        return self._aim() if self.view in ("map", "top") else None

    def robot_at(self, pose: Pose, now: float) -> View | None:
        """The robot is there now."""
        passed, self._moved = now - self._moved, now
        self._robot = _eased(self._robot, pose, passed) if self.view == "follow" else pose
        return self._aim() if self.view == "follow" else None

    def _aim(self, *, again: bool = False) -> View | None:
        """Where the camera is to stand; None when that was said last, unless it has to be said `again`."""
        target = self._target()
        if target is None or (not again and self._sent and _same(target, self._sent[-1], 0.002)):
            return None
        self._sent.append(target)
        return target

    def _target(self) -> View | None:
        if self._aspect is None or self.view == "free":
            return None
        if self.view == "follow":
            return behind(self._robot, self._aspect) if self._robot is not None else None
        return (fitting if self.view == "map" else overhead)(self._extent, self._aspect)

    def _is_fresh(self, report: Report) -> bool:
        """Whether the page was just opened: it looks at the origin, or has the initial view, or ours, already."""
        at_origin = math.dist(report.view.look_at, (0.0, 0.0, 0.0)) < _NEAR
        return at_origin or _same(report.view, self._initial()) or self._echoes(report.view)

    def _initial(self) -> View:
        """Where viser puts a page's camera, late on a slow computer."""
        return fitting(self._extent, TYPICAL_ASPECT)

    def _recognise(self) -> None:
        """A camera that stands exactly where the whole map is seen was put there by us, before we were restarted."""
        if self._found is not None and _same(self._found.view, fitting(self._extent, self._found.aspect)):
            self.view = "map"
            self._sent.append(self._found.view)
            self._found = None

    def _echoes(self, view: View) -> bool:
        return any(_same(view, sent) for sent in reversed(self._sent))


def _same(one: View, other: View, near: float = _NEAR) -> bool:
    return math.dist(one.position, other.position) < near and math.dist(one.look_at, other.look_at) < near


def _eased(before: Pose | None, pose: Pose, passed: float) -> Pose:
    """The pose to follow: its place at once, its heading little by little, so that the picture does not swing."""
    if before is None or math.dist((before.x, before.y), (pose.x, pose.y)) > _AWAY:
        return pose
    share = 1.0 - 0.5 ** (passed / _TURNING)
    turn = math.remainder(pose.yaw - before.yaw, math.tau)
    return Pose(pose.x, pose.y, math.remainder(before.yaw + turn * share, math.tau))
