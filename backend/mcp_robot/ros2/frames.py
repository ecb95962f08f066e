"""Looks up transforms between frames of `/tf` and `/tf_static`: the part of tf2 that a robot on a floor needs.

Only the plane, and only the latest transform of each frame; no history and no interpolation. Frame names follow REP
105. A chain is as old as its oldest transform that moves. No ROS, no clock: arrival times are passed in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from backend.telemetry import Pose

LONGEST_CHAIN = 32


@dataclass(frozen=True)
class Transform:
    """The pose of a frame in its parent. `stamp` is on the robot's clock, `arrived` on the caller's, both in s and
    infinite for a fixed transform."""

    parent: str
    pose: Pose
    stamp: float
    arrived: float


@dataclass(frozen=True)
class Found:
    """The result of a lookup: the pose, and stamp and arrival of the oldest transform in its chain, in s."""

    pose: Pose
    stamp: float
    arrived: float


class Frames:
    """All frames. Written by one thread, read by any."""

    def __init__(self) -> None:
        self._transforms: dict[str, Transform] = {}  # child -> its place in its parent

    def put(self, child: str, transform: Transform) -> None:
        """Keep the latest transform of one frame."""
        self._transforms[_name(child)] = Transform(
            _name(transform.parent), transform.pose, transform.stamp, transform.arrived
        )

    def find(self, frame: str, within: str) -> Found | None:
        """The pose of `frame` in the frame `within`; None when no chain of parents leads there."""
        frame, within = _name(frame), _name(within)
        pose, stamp, arrived = Pose(0.0, 0.0, 0.0), math.inf, math.inf
        for _ in range(LONGEST_CHAIN):
            if frame == within:
                return Found(pose, stamp, arrived)
            transform = self._transforms.get(frame)
            if transform is None:
                return None
            pose = compose(transform.pose, pose)
            stamp, arrived = min(stamp, transform.stamp), min(arrived, transform.arrived)
            frame = transform.parent
        return None


def compose(a: Pose, b: Pose) -> Pose:
    """The pose `b`, which is given in the frame of `a`, in the frame in which `a` is given."""
    cos, sin = math.cos(a.yaw), math.sin(a.yaw)
    return Pose(a.x + cos * b.x - sin * b.y, a.y + sin * b.x + cos * b.y, math.remainder(a.yaw + b.yaw, math.tau))


def inverse(a: Pose) -> Pose:
    """The pose of the origin in the frame of `a`."""
    cos, sin = math.cos(a.yaw), math.sin(a.yaw)
    return Pose(-cos * a.x - sin * a.y, sin * a.x - cos * a.y, -a.yaw)


def _name(frame: str) -> str:
    return frame.lstrip("/")
