"""Converts ROS messages to this program's types and back. Plain functions.

Messages are outside input: sizes are checked, numbers have to be finite, and a message that cannot be used raises
`ValueError`.
"""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from PIL import Image

from backend.mcp_robot.navigation.grid import (
    COARSEST,
    FARTHEST,
    FINEST,
    FREE,
    MAX_CELLS,
    OCCUPIED,
    UNKNOWN,
    Floats,
    OccupancyGrid,
)
from backend.telemetry import Battery, Pose, Scan, Twist

FREE_BELOW, OCCUPIED_FROM = 20, 65
"""Occupancy in percent, as map_server's usual thresholds: what lies between is unknown, so it is not driven on."""
STANDSTILL = 0.003
"""A speed below this (m/s, rad/s) is taken for the noise of an encoder."""
CHARGING, FULL = 1, 4  # sensor_msgs/BatteryState
MAX_PIXELS, MAX_PICTURE_BYTES = 50_000_000, 10_000_000
JPEG_QUALITY = 86


def seconds(stamp: Any) -> float:
    """A stamp or duration in s."""
    return float(stamp.sec + stamp.nanosec * 1e-9)


def set_seconds(stamp: Any, value: float) -> None:
    """Set a stamp or duration to `value` s."""
    stamp.sec = math.floor(value)
    stamp.nanosec = min(int((value - stamp.sec) * 1e9), 999_999_999)


def yaw(orientation: Any) -> float:
    """The turn about the vertical axis, in rad."""
    q = orientation
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def pose(message: Any) -> Pose:
    """A geometry_msgs/Pose on the floor. Raises `ValueError`."""
    found = Pose(message.position.x, message.position.y, yaw(message.orientation))
    if not all(map(math.isfinite, (found.x, found.y, found.yaw))):
        raise ValueError("a pose with a number that is none")
    return found


def set_pose(message: Any, value: Pose) -> None:
    """Set a geometry_msgs/Pose."""
    message.position.x, message.position.y = float(value.x), float(value.y)
    message.orientation.z, message.orientation.w = math.sin(value.yaw / 2), math.cos(value.yaw / 2)


def twist(message: Any) -> Twist:
    """A geometry_msgs/Twist of a robot that drives forward and turns. Raises `ValueError`."""
    linear = math.copysign(math.hypot(message.linear.x, message.linear.y), message.linear.x)
    angular = float(message.angular.z)
    if not (math.isfinite(linear) and math.isfinite(angular)):
        raise ValueError("a velocity that is no number")
    return Twist(linear if abs(linear) > STANDSTILL else 0.0, angular if abs(angular) > STANDSTILL else 0.0)


def in_percent(message: Any) -> bool:
    """Whether the driver of this sensor_msgs/BatteryState counts `percentage` from 0 to 100, as some do, and not to
    1."""
    return float(message.percentage) > 1.5


def battery(message: Any, percent: bool) -> Battery:
    """A sensor_msgs/BatteryState; with `percent` its driver counts from 0 to 100. Raises `ValueError`."""
    level = float(message.percentage)
    if not math.isfinite(level):
        raise ValueError("a battery without a percentage")
    level = level / 100 if percent else level
    return Battery(min(max(level, 0.0), 1.0), message.power_supply_status in (CHARGING, FULL))


def grid(message: Any) -> OccupancyGrid:
    """A nav_msgs/OccupancyGrid. Raises `ValueError`."""
    info = message.info
    if not 0 < info.width * info.height <= MAX_CELLS or len(message.data) != info.width * info.height:
        raise ValueError(f"a map of {info.width} x {info.height} cells with {len(message.data)} values")
    # Resolution comes as a 32 bit float: 0.05 would be 0.05000000075, and a large map would grow by it.
    resolution, origin = round(float(info.resolution), 6), pose(info.origin)
    if not FINEST <= resolution <= COARSEST:
        raise ValueError(f"a map of {resolution:g} m a cell, which is not from {FINEST:g} to {COARSEST:g}")
    if abs(origin.yaw) > 1e-6 or max(abs(origin.x), abs(origin.y)) > FARTHEST:
        raise ValueError("a map whose origin is turned, or no place")
    occupancy = np.frombuffer(message.data, dtype=np.int8).reshape(info.height, info.width)
    cells = np.full(occupancy.shape, UNKNOWN, dtype=np.uint8)
    cells[(occupancy >= 0) & (occupancy < FREE_BELOW)] = FREE
    cells[occupancy >= OCCUPIED_FROM] = OCCUPIED
    cells.flags.writeable = False
    return OccupancyGrid(cells, resolution, origin.x, origin.y)


def scan(message: Any, sensor: Pose | None, robot: Pose) -> Scan:
    """A sensor_msgs/LaserScan, seen from the middle of the robot.

    `sensor` is the laser's pose in the robot's frame, None while it is unknown. Readings that hit nothing, and readings
    that are errors, become `range_max`. A scan that cannot be used has no readings; neither has a scan of nothing but
    errors (REP 117: NaN, or nearer than `range_min`), which a covered or dead laser sends.
    """
    ranges = np.array(message.ranges, dtype=np.float64)
    reach = float(message.range_max)
    numbers = (reach, message.angle_min, message.angle_increment)
    unusable = not message.angle_increment or not ((ranges > 0) & (ranges >= message.range_min)).any()
    if sensor is None or unusable or not all(map(math.isfinite, numbers)):
        return Scan(seconds(message.header.stamp), robot, -math.pi, math.tau, 0.0, [])
    hit = np.isfinite(ranges) & (ranges >= message.range_min) & (ranges < reach)
    angles = message.angle_min + message.angle_increment * np.arange(ranges.size) + sensor.yaw
    start, step = float(message.angle_min) + sensor.yaw, float(message.angle_increment)
    if math.hypot(sensor.x, sensor.y) < 0.01:
        ranges = np.where(hit, ranges, reach)
    else:
        ranges, start, step = _recentred(ranges[hit], angles[hit], sensor, ranges.size, reach)
    values = np.round(ranges, 3).tolist()
    return Scan(seconds(message.header.stamp), robot, start, step, reach, values)


def _recentred(ranges: Floats, angles: Floats, sensor: Pose, count: int, reach: float) -> tuple[Floats, float, float]:
    """Readings as seen from the robot's middle: the nearest in each of `count` directions all around."""
    x, y = sensor.x + ranges * np.cos(angles), sensor.y + ranges * np.sin(angles)
    step = math.tau / count
    direction = ((np.arctan2(y, x) + math.pi) / step).astype(np.intp) % count
    nearest = np.full(count, reach)
    np.minimum.at(nearest, direction, np.hypot(x, y))
    return nearest, -math.pi + step / 2, step


def path(message: Any) -> Floats:
    """A nav_msgs/Path as points in its frame, shape (n, 2)."""
    return np.array([(p.pose.position.x, p.pose.position.y) for p in message.poses], dtype=np.float64).reshape(-1, 2)


def jpeg(message: Any) -> tuple[bytes, int, int]:
    """A sensor_msgs/Image or CompressedImage as JPEG, with width and height. Raises `ValueError`."""
    if not hasattr(message, "format"):
        return _encoded(_raw(message))
    data = bytes(message.data)
    if len(data) > MAX_PICTURE_BYTES:
        raise ValueError(f"a picture of more than {MAX_PICTURE_BYTES} bytes")
    try:
        # Only these two: for some formats, Pillow starts other programs.
        with Image.open(io.BytesIO(data), formats=("JPEG", "PNG")) as picture:
            if picture.width * picture.height > MAX_PIXELS:
                raise ValueError(f"a picture of more than {MAX_PIXELS} pixels")
            if picture.format == "JPEG":
                return data, picture.width, picture.height
            return _encoded(picture.convert("RGB"))
    except ValueError:
        raise
    except Exception as error:  # what decoders raise for a damaged picture is not documented
        raise ValueError(f"a picture that cannot be read ({message.format[:80]})") from error


_MODES = {"rgb8": ("RGB", "RGB"), "bgr8": ("RGB", "BGR"), "rgba8": ("RGBA", "RGBA"), "bgra8": ("RGBA", "BGRA")}
_MODES |= {"mono8": ("L", "L"), "8UC1": ("L", "L"), "8UC3": ("RGB", "BGR")}


def _raw(message: Any) -> Image.Image:
    if message.encoding not in _MODES:
        known = ", ".join(_MODES)
        raise ValueError(f"pictures of the encoding {message.encoding}; those that can be read are {known}")
    mode, order = _MODES[message.encoding]
    if message.width * message.height > MAX_PIXELS:
        raise ValueError(f"a picture of more than {MAX_PIXELS} pixels")
    if message.step < message.width * len(order) or len(message.data) < message.step * message.height:
        raise ValueError("a picture with fewer bytes than its size needs")
    size = (message.width, message.height)
    return Image.frombuffer(mode, size, bytes(message.data), "raw", order, message.step, 1).convert("RGB")


def _encoded(picture: Image.Image) -> tuple[bytes, int, int]:
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=JPEG_QUALITY)
    return buffer.getvalue(), picture.width, picture.height
