"""Where one viewer's camera has to stand, and whether the viewer has moved it.

A state machine without clock, socket or viser: each event is a method call, and what a method returns has to be sent to
the page. Once its viewer has moved the camera, nothing moves it again until the viewer asks for a view.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from backend.bridge.scene.drawing.camera_views import TYPICAL_ASPECT, View, follow_view, map_view, top_view
from backend.bridge.scene.drawing.shapes import Extent
from backend.telemetry import Pose

ViewChoice = Literal["map", "top", "follow"]
ViewName = Literal["map", "top", "follow", "free"]

SETTLING_SECONDS = 2.0
"""After a page opened or a view was chosen, reports of older positions may still arrive for this long."""
_SAME_DISTANCE = 0.02
"""m between two positions that count as the same."""
_SENT_AGAIN_DISTANCE = 0.002
"""m that a target has to move before it is sent again."""
_REMEMBERED_VIEWS = 60
"""How many of the views sent last are remembered, 3 s of following. A report of one of them is an echo: the page
reports where it was put, and its viewer has moved nothing."""
_TURN_SECONDS = 0.6
"""s in which the following camera turns half of what is left when the robot turns."""
_JUMP_DISTANCE = 3.0
"""m that no robot drives between two states: the following camera goes there at once."""


@dataclass(frozen=True)
class CameraReport:
    """Where a page says that its camera stands; `aspect` is the width of its pane to its height."""

    view: View
    aspect: float


class ViewerCamera:
    """One viewer's camera. `view` is what it shows.

    The methods that return a `View` return where to put the camera, None to leave it. `now` is in s of any clock that
    never goes back.
    """

    def __init__(self, extent: Extent, robot: Pose | None) -> None:
        self.view: ViewName = "map"
        self._extent = extent
        self._robot = robot  # the robot's pose, smoothed while following
        self._robot_time = -math.inf  # when that pose came
        self._aspect: float | None = None  # of the page's pane; None while no page is connected
        self._first_report: CameraReport | None = (
            None  # set while a page stands where an earlier bridge may have put it
        )
        self._is_chosen = False  # the viewer asked for the view, so that a page that opens goes there from anywhere
        self._settled_at = math.inf  # until then, a report may be older than what was sent
        self._sent: deque[View] = deque(maxlen=_REMEMBERED_VIEWS)

    def page_closed(self) -> None:
        """The page has disconnected."""
        self._aspect = None

    def reported(self, report: CameraReport, now: float) -> View | None:
        """The page reports where its camera stands."""
        is_first, self._aspect = self._aspect is None, report.aspect
        if is_first:
            self._settled_at = now + SETTLING_SECONDS
            if self.view != "free" and not (self._is_chosen or self._is_initial(report)):
                # The page has connected again, and stands where its viewer left it.
                self.view, self._first_report = "free", report
                self._recognise_map_view()
        if self.view == "free":
            if self._first_report is not None and not _are_same(report.view, self._first_report.view):
                self._first_report = None
            return None
        if self._is_echo(report.view):
            return self._next_view()
        if now < self._settled_at or _are_same(report.view, self._initial_view()):
            return self._next_view(repeat=True)
        self.view = "free"
        return None

    def choose(self, view: ViewChoice, now: float) -> View | None:
        """The viewer asks for a view."""
        self.view, self._is_chosen, self._settled_at = view, True, now + SETTLING_SECONDS
        self._first_report = None
        return self._next_view(repeat=True)

    def moved_by_hand(self) -> None:
        """The viewer has moved the camera."""
        self.view, self._first_report = "free", None

    def map_changed(self, extent: Extent) -> View | None:
        """The map covers `extent` from now on."""
        self._extent = extent
        self._recognise_map_view()
        return self._next_view() if self.view in ("map", "top") else None

    def robot_moved(self, pose: Pose, now: float) -> View | None:
        """The robot is at `pose`."""
        passed, self._robot_time = now - self._robot_time, now
        self._robot = _smoothed(self._robot, pose, passed) if self.view == "follow" else pose
        return self._next_view() if self.view == "follow" else None

    def _next_view(self, *, repeat: bool = False) -> View | None:
        """Where the camera has to stand; None when that was sent last, unless it has to be sent again (`repeat`)."""
        target = self._target()
        if target is None:
            return None
        if not repeat and self._sent and _are_same(target, self._sent[-1], _SENT_AGAIN_DISTANCE):
            return None
        self._sent.append(target)
        return target

    def _target(self) -> View | None:
        if self._aspect is None or self.view == "free":
            return None
        if self.view == "follow":
            return follow_view(self._robot, self._aspect) if self._robot is not None else None
        return (map_view if self.view == "map" else top_view)(self._extent, self._aspect)

    def _is_initial(self, report: CameraReport) -> bool:
        """Whether nobody has moved this camera: it looks at the origin, has the initial view, or one that was sent."""
        at_origin = math.dist(report.view.look_at, (0.0, 0.0, 0.0)) < _SAME_DISTANCE
        return at_origin or _are_same(report.view, self._initial_view()) or self._is_echo(report.view)

    def _initial_view(self) -> View:
        """The view that viser gives a page, on a slow computer only some time after it has opened."""
        return map_view(self._extent, TYPICAL_ASPECT)

    def _recognise_map_view(self) -> None:
        """A camera that stands exactly where the whole map is seen was put there by this bridge before its restart."""
        found = self._first_report
        if found is not None and _are_same(found.view, map_view(self._extent, found.aspect)):
            self.view = "map"
            self._sent.append(found.view)
            self._first_report = None

    def _is_echo(self, view: View) -> bool:
        return any(_are_same(view, sent) for sent in reversed(self._sent))


def _are_same(one: View, other: View, distance: float = _SAME_DISTANCE) -> bool:
    return math.dist(one.position, other.position) < distance and math.dist(one.look_at, other.look_at) < distance


def _smoothed(before: Pose | None, pose: Pose, passed: float) -> Pose:
    """The pose to follow: its position at once, its heading gradually, so that the picture does not swing."""
    if before is None or math.dist((before.x, before.y), (pose.x, pose.y)) > _JUMP_DISTANCE:
        return pose
    share = 1.0 - 0.5 ** (passed / _TURN_SECONDS)
    turn = math.remainder(pose.yaw - before.yaw, math.tau)
    return Pose(pose.x, pose.y, math.remainder(before.yaw + turn * share, math.tau))
