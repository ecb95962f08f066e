"""Where one frame is in another, from what `/tf` and `/tf_static` said: the part of tf2 that a robot on a floor needs.

Transforms of the plane, the latest of each; no history and no interpolation. A chain is as old as its oldest moving
link. No ROS, no clock: arrival times are passed in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from backend.telemetry import Pose

LONGEST_CHAIN = 32


@dataclass(frozen=True)
class Link:
    """Where a frame is in its parent: `stamp` on the robot's clock, `arrived` on the caller's; infinite when fixed."""

    parent: str
    pose: Pose
    stamp: float
    arrived: float


@dataclass(frozen=True)
class Found:
    """A pose, its stamp and when the oldest part of it arrived."""

    pose: Pose
    stamp: float
    arrived: float


class Frames:
    """All frames. Written by one thread, read by any."""

    def __init__(self) -> None:
        self._links: dict[str, Link] = {}  # child -> its place in its parent

    def put(self, child: str, link: Link) -> None:
        """The latest about one frame."""
        self._links[_name(child)] = Link(_name(link.parent), link.pose, link.stamp, link.arrived)

    def find(self, frame: str, within: str) -> Found | None:
        """Where `frame` is in `within`, None when nothing joins them in that direction."""
        frame, within = _name(frame), _name(within)
        pose, stamp, arrived = Pose(0.0, 0.0, 0.0), math.inf, math.inf
        for _ in range(LONGEST_CHAIN):
            if frame == within:
                return Found(pose, stamp, arrived)
            link = self._links.get(frame)
            if link is None:
                return None
            pose = compose(link.pose, pose)
            stamp, arrived = min(stamp, link.stamp), min(arrived, link.arrived)
            frame = link.parent
        return None


def compose(a: Pose, b: Pose) -> Pose:
    """The pose `b`, which is seen from `a`, seen from where `a` is."""
    cos, sin = math.cos(a.yaw), math.sin(a.yaw)
    return Pose(a.x + cos * b.x - sin * b.y, a.y + sin * b.x + cos * b.y, math.remainder(a.yaw + b.yaw, math.tau))


def inverse(a: Pose) -> Pose:
    """Where the origin is, seen from `a`."""
    cos, sin = math.cos(a.yaw), math.sin(a.yaw)
    return Pose(-cos * a.x - sin * a.y, sin * a.x - cos * a.y, -a.yaw)


def _name(frame: str) -> str:
    return frame.lstrip("/")
