"""The latest values of the robot's topics: pose, velocity, battery, map, laser, path, and when each arrived.

The ROS thread writes them, one whole value at a time; any thread reads them. A value always comes with its age, and
none is made up.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from msgspec.structs import replace
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, LaserScan
from tf2_msgs.msg import TFMessage

from backend.config import Ros2
from backend.mcp_robot.motion import keep_out
from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid
from backend.mcp_robot.robot import NOWHERE, Fix, Velocity
from backend.mcp_robot.ros2 import convert
from backend.mcp_robot.ros2.frames import Frames, Transform, compose, inverse
from backend.telemetry import Battery, Pose, Scan, Twist, Zone

logger = logging.getLogger(__name__)

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For streams: only the newest message matters, from publishers of either reliability."""
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ALL = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
CLOCK_PAUSE = 0.2
"""Seconds of silence of /clock after which time goes on by itself: otherwise nothing would ever become old."""
MOST_AHEAD = 5.0
"""Seconds that a stamp may be ahead of the robot's clock: where the clock is a topic, it arrives late."""
LONGEST_STEP = 5.0
"""An odometry that jumps farther (m) was reset: the jump is not counted as driven."""


@dataclass(frozen=True)
class Heard:
    """A pose from a topic: `stamp` in s of the robot's clock, `arrived` in s of this computer's monotonic clock."""

    pose: Pose
    stamp: float
    arrived: float


class Senses:
    """Subscriptions of a node, to be made on the ROS thread, and their latest values."""

    def __init__(self, node: Any, settings: Ros2, pose_timeout: float, zones: Sequence[Zone]) -> None:
        self.settings = settings
        self._pose_timeout = pose_timeout
        self._zones = zones
        self.grid: OccupancyGrid | None = None  # replaced whenever a map comes
        self.battery: Battery | None = None
        self.velocity = Velocity(Twist(0.0, 0.0), -math.inf)
        self.odometer = 0.0  # m, summed up from odometry
        self.odometry: Heard | None = None  # in the odometry's own frame
        self.frames = Frames()
        self.arrivals: dict[str, float] = {}  # setting of a topic -> monotonic time of its latest message
        self.on_plan: Callable[[Floats], None] = lambda _: None  # called on the ROS thread with each new path
        self.on_grid: Callable[[OccupancyGrid], None] = lambda _: None  # called on the maps' thread with each new map
        self._amcl: Heard | None = None
        self._located: tuple[Heard, Pose | None] | None = None  # last pose in the map, and the odometry then
        self._scan: tuple[Any, float, float] | None = None  # message, robot's time and monotonic time of its arrival
        self._converted: tuple[Any, Scan] | None = None  # the message converted last, and its scan
        self._in_percent = False  # set when the battery's driver has reported more than 1, as a percentage
        self._maps = ThreadPoolExecutor(
            1, "map"
        )  # a large map takes a while to prepare: neither ROS nor asyncio waits for it
        self._time: tuple[float, float] | None = None  # of /clock, and the monotonic time when that was heard
        self._complained: set[str] = set()  # topics whose unusable messages were logged
        s = settings
        wanted = [
            ("", "/tf_static", TFMessage, self._on_static_frames, LATCHED),
            ("", "/tf", TFMessage, self._on_frames, ALL),
            ("amcl_pose", s.amcl_pose, PoseWithCovarianceStamped, self._on_amcl, LATCHED),
            ("map", s.map, GridMessage, self._on_grid, LATCHED),
            ("battery", s.battery, BatteryState, self._on_battery, LATEST),
            ("plan", s.plan, PathMessage, self._on_plan, LATEST),
            ("scan", s.scan, LaserScan, self._on_scan, LATEST),
            ("odom", s.odom, Odometry, self._on_odometry, LATEST),
        ]
        if s.use_sim_time:
            wanted.append(("", "/clock", Clock, self._on_clock, LATEST))
        made = {
            topic: node.create_subscription(kind, topic, self._guarded(setting or topic, heard), qos)
            for setting, topic, kind, heard, qos in wanted
            if topic
        }
        self._moving_frames: Any = made["/tf"]

    def _guarded(self, name: str, heard: Callable[[Any], None]) -> Callable[[Any], None]:
        def callback(message: Any) -> None:
            try:
                heard(message)
            except ValueError as error:
                if name not in self._complained:
                    self._complained.add(name)
                    logger.error("What %s says cannot be used: %s.", name, error)
            else:
                self.arrivals[name] = time.monotonic()

        return callback

    def clock(self) -> float:
        """Unix seconds of the robot's clock."""
        if self._time is None:
            return time.time()
        told, arrived = self._time
        return told + max(0.0, time.monotonic() - arrived - CLOCK_PAUSE)

    def age(self, setting: str) -> float:
        """Seconds since the latest message on the topic of a setting; infinite before the first."""
        return time.monotonic() - self.arrivals.get(setting, -math.inf)

    @property
    def fix(self) -> Fix:
        """Where the robot is: the newer of `amcl_pose` and the transform; when both are old, that pose moved on by
        odometry."""
        heard, source = self._in_map()
        if heard is None:
            return NOWHERE
        odometry = self.odometry
        if self._fresh(heard) or odometry is None or self._located is None:
            return Fix(heard.pose, heard.stamp, source)
        then, odometry_then = self._located
        if odometry_then is None or not self._fresh(odometry):
            return Fix(heard.pose, heard.stamp, source)
        moved = compose(inverse(odometry_then), odometry.pose)
        return Fix(compose(then.pose, moved), odometry.stamp, "odometry")

    @property
    def lost(self) -> float | None:
        """Seconds for which no pose in the map has come, None while they come; infinite when none ever did."""
        heard, _ = self._in_map()
        if heard is None:
            return math.inf
        return None if self._fresh(heard) else time.monotonic() - heard.arrived

    def _fresh(self, heard: Heard) -> bool:
        return time.monotonic() - heard.arrived <= self._pose_timeout

    def _in_map(self) -> tuple[Heard | None, str]:
        found = self.frames.find(self.settings.base_frame, self.settings.map_frame)
        amcl = self._amcl
        if found and (amcl is None or found.arrived > amcl.arrived):
            now = time.monotonic()
            heard = Heard(found.pose, min(found.stamp, self.clock()), min(found.arrived, now))
            return heard, "tf"
        return amcl, "amcl_pose"

    def scan(self) -> Scan:
        """The latest laser scan; one without readings before the first, and while the laser's pose is unknown."""
        if self._scan is None:
            return Scan(0.0, self.fix.pose, -math.pi, math.tau, 0.0, [])
        message, heard, arrived = self._scan
        if self._converted is None or self._converted[0] is not message:
            sensor = self.frames.find(message.header.frame_id, self.settings.base_frame)
            scan = convert.scan(message, sensor.pose if sensor else None, self.fix.pose)
            # A stamp may be ahead of our clock: a laser is never younger than its message.
            scan = replace(scan, time=min(scan.time, heard))
            if sensor:  # else its transform may still come
                self._converted = (message, scan)
        else:
            scan = self._converted[1]
        now = self.clock()
        # A clock that was set back must not make a dead laser young either.
        return scan if scan.time <= now else replace(scan, time=now - (time.monotonic() - arrived))

    def _remember(self) -> None:
        heard, _ = self._in_map()
        if heard and self._fresh(heard):
            self._located = (heard, self.odometry.pose if self.odometry else None)

    def _on_frames(self, message: Any, fixed: bool = False) -> None:
        now = math.inf if fixed else time.monotonic()
        for each in message.transforms:
            where, turn = each.transform.translation, each.transform.rotation
            pose = Pose(where.x, where.y, convert.yaw(turn))
            stamp = math.inf if fixed else convert.seconds(each.header.stamp)
            if math.isfinite(pose.x) and math.isfinite(pose.y) and math.isfinite(pose.yaw):
                self.frames.put(each.child_frame_id, Transform(each.header.frame_id, pose, stamp, now))

    def _on_static_frames(self, message: Any) -> None:
        self._on_frames(message, fixed=True)

    def _on_amcl(self, message: Any) -> None:
        pose = convert.pose(message.pose.pose)
        self._amcl = Heard(pose, convert.seconds(message.header.stamp), time.monotonic())
        self._remember()

    def _take_waiting_frames(self) -> None:
        """Take in all transforms that have arrived.

        The executor takes one message of each topic a round. Of odometry only the newest waits, of transforms a hundred
        can: after a stall the robot would seem to stand, and its pose would go on along the way that it had come.
        """
        handle = self._moving_frames.handle
        with handle:
            while (taken := handle.take_message(TFMessage, False)) is not None:
                self._on_frames(taken[0])

    def _on_odometry(self, message: Any) -> None:
        self._take_waiting_frames()
        pose, twist = convert.pose(message.pose.pose), convert.twist(message.twist.twist)
        before = self.odometry
        if before:
            way = math.hypot(pose.x - before.pose.x, pose.y - before.pose.y)
            self.odometer += way if way < LONGEST_STEP else 0.0
        stamp = convert.seconds(message.header.stamp)
        now = self.clock()
        # Messages without a usable stamp count as measured when they arrive.
        dated = (before is None or stamp > before.stamp) and 0.0 < stamp <= now + MOST_AHEAD
        self.odometry = Heard(pose, stamp, time.monotonic())
        self.velocity = Velocity(twist, stamp if dated else now)
        self._remember()

    def _on_grid(self, message: Any) -> None:
        grid = convert.grid(message)

        def prepare() -> None:
            try:
                ready = keep_out.applied(grid, self._zones)
                ready.distance  # noqa: B018  # computed now: otherwise the guard would compute it on the event loop
                self.grid = ready
                self.on_grid(ready)
            except Exception:
                logger.exception("The map cannot be used.")

        self._maps.submit(prepare)

    def _on_battery(self, message: Any) -> None:
        self._in_percent = self._in_percent or convert.in_percent(message)
        self.battery = convert.battery(message, self._in_percent)

    def _on_scan(self, message: Any) -> None:
        self._scan = message, self.clock(), time.monotonic()

    def _on_plan(self, message: Any) -> None:
        self.on_plan(convert.path(message))

    def _on_clock(self, message: Any) -> None:
        self._time = convert.seconds(message.clock), time.monotonic()
