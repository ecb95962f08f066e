"""The typed messages of the robot's telemetry stream.

One msgpack map a WebSocket frame, tagged by `type`; units are SI, frames follow REP 103 (x forward, y left,
counter-clockwise positive), times are Unix seconds of the robot's clock. The stream is latest-value: a slow
reader gets fewer messages, never older ones. Nothing in here may depend on the simulator or on ROS.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from backend import wire

VERSION = 1

Channel = Literal["state", "scan", "path", "map", "speech", "camera"]
CHANNELS: tuple[Channel, ...] = ("state", "scan", "path", "map", "speech", "camera")


class Message(msgspec.Struct, frozen=True, tag_field="type", omit_defaults=False):
    """Base of all messages; `type` on the wire is the tag of the subclass."""


class Pose(msgspec.Struct, frozen=True):
    """Where something is in the map frame: `x`, `y` in m, `yaw` in rad within (-pi, pi]."""

    x: float
    y: float
    yaw: float


class Twist(msgspec.Struct, frozen=True):
    """Body velocity: `linear` in m/s forward, `angular` in rad/s counter-clockwise."""

    linear: float
    angular: float


class Battery(msgspec.Struct, frozen=True):
    """`level` from 0 to 1; `charging` while the robot stands at its dock; `floor` the level below which only a dock
    can be driven to, None where it is not known."""

    level: float
    charging: bool
    floor: float | None = None


class Stop(msgspec.Struct, frozen=True):
    """The stop latch: who set it, and when (Unix seconds)."""

    by: str
    at: float


class Halt(msgspec.Struct, frozen=True):
    """A motion that the safety rules ended, and no person: the stable code, the sentence for people, and when (Unix
    seconds). docs/safety.md has the codes."""

    code: str
    text: str
    at: float


class Motion(msgspec.Struct, frozen=True):
    """The motion under way: `kind` is `navigate` or `rotate`, `goal` the pose it ends at,
    `place` the name that was asked for, `distance` in m and `seconds` in s what is left."""

    kind: Literal["navigate", "rotate"]
    goal: Pose
    place: str | None
    distance: float
    seconds: float


class State(Message, frozen=True, tag="state"):
    """Where the robot is and what it is doing; sent at the subscriber's rate. `halted` is the latest motion, if it
    ended by itself, and None again when the next one begins."""

    time: float
    robot: str
    pose: Pose
    twist: Twist
    battery: Battery
    motion: Motion | None
    stop: Stop | None
    speaking: str | None
    halted: Halt | None = None


class Scan(Message, frozen=True, tag="scan"):
    """One laser scan. Range i lies at `angle_min + i * angle_increment` rad in the robot's frame, in m;
    a reading of `range_max` or more means that nothing was hit. `pose` is the robot's at that moment."""

    time: float
    pose: Pose
    angle_min: float
    angle_increment: float
    range_max: float
    ranges: list[float]


class Path(Message, frozen=True, tag="path"):
    """The planned path in the map frame, from the robot to the goal; no points when there is none.
    `preview` is true for a path that was only computed and is not being driven."""

    time: float
    points: list[tuple[float, float]]
    preview: bool = False


class Place(msgspec.Struct, frozen=True):
    """A node of the topological map. `kind` is `space` or `docking`."""

    id: str
    name: str
    kind: str
    pose: Pose


class Zone(msgspec.Struct, frozen=True):
    """A keep-out zone: a polygon in the map frame, its corners in order, that the robot's footprint does not touch."""

    name: str
    polygon: list[tuple[float, float]]


class Map(Message, frozen=True, tag="map"):
    """The occupancy grid, the places and the keep-out zones; sent on subscription and on change.

    `cells` holds `height * width` bytes, row 0 at the bottom (y smallest): 0 free, 100 occupied, 255 unknown.
    The cell (0, 0) has its lower left corner at (`origin_x`, `origin_y`); `resolution` is in m a cell.
    """

    resolution: float
    width: int
    height: int
    origin_x: float
    origin_y: float
    cells: bytes
    places: list[Place]
    zones: list[Zone] = []


class Speech(Message, frozen=True, tag="speech"):
    """A sentence that the robot began to say aloud, and its duration in s."""

    time: float
    text: str
    seconds: float


class Picture(Message, frozen=True, tag="camera"):
    """A camera picture as JPEG and the robot's pose when it was taken; at most five a second, only while subscribed."""

    time: float
    pose: Pose
    width: int
    height: int
    jpeg: bytes


class Hello(Message, frozen=True, tag="hello"):
    """The first message of every connection."""

    version: int
    robot: str
    channels: list[str]


class Subscribe(msgspec.Struct, frozen=True, tag_field="type", tag="subscribe"):
    """The one message a reader sends: the channels it wants and, for `state`, `scan` and `camera`, at most how many a
    second. It may be sent again at any time and replaces the subscription before."""

    channels: list[Channel]
    rate: float = 20.0


AnyMessage = State | Scan | Path | Map | Speech | Picture | Hello

_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(AnyMessage)
_subscribe_decoder = msgspec.msgpack.Decoder(Subscribe)


def encode(message: AnyMessage | Subscribe) -> bytes:
    """One message as the bytes of one frame."""
    return _encoder.encode(message)


def decode(frame: bytes) -> AnyMessage:
    """The message in a frame. Raises `msgspec.ValidationError` or `msgspec.DecodeError`."""
    try:
        message: AnyMessage = _decoder.decode(frame)
    except wire.UNREADABLE as error:
        raise _announced(error) from None
    return message


def decode_subscribe(frame: bytes) -> Subscribe:
    """The subscription in a frame. Raises `msgspec.ValidationError` or `msgspec.DecodeError`."""
    try:
        return _subscribe_decoder.decode(frame)
    except wire.UNREADABLE as error:
        raise _announced(error) from None


def _announced(error: Exception) -> msgspec.DecodeError:
    return error if isinstance(error, msgspec.DecodeError) else msgspec.DecodeError(str(error))
