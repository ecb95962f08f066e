"""The topics of the stand-in: what localisation, drivers, map server and camera of a real robot publish.

Latest values at fixed rates of the wall's clock, with the simulator's stamps. The AMCL pose is published when the robot
has moved, as by the real one; pictures are drawn only while they have a subscriber.
"""

from __future__ import annotations

import array
import asyncio
import io
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from PIL import Image as Pictures
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, CompressedImage, Image, LaserScan
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from backend.config import Robot
from backend.mcp_robot.navigation.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from backend.mcp_robot.ros2 import convert
from backend.mcp_robot.ros2.frames import compose, inverse
from backend.mcp_robot.ros2.ros_thread import RosThread
from backend.mcp_robot.ros2.senses import LATCHED
from backend.mcp_robot.ros2.waiting import until
from backend.mcp_robot.simulator.simulated_robot import SimulatedRobot
from backend.telemetry import Pose

TICK = 0.02
"""Wall seconds between poses."""
SCAN_EVERY, BATTERY_EVERY, PICTURE_EVERY = 0.1, 0.2, 0.2
"""Seconds between messages: of the robot's clock for scans, of the wall's for the rest."""
AMCL_WAY, AMCL_TURN = 0.25, 0.2
"""AMCL's update_min_d and update_min_a."""
ODOM_IN_MAP = Pose(0.9, 3.1, 0.4)
"""The pose of the odometry's frame in the map: odometry knows nothing of the map (REP 105)."""
LASER_FRAME = "base_scan"


class StandInTopics:
    """All publishers and subscriptions, made before the ROS thread starts."""

    def __init__(self, ros: RosThread, robot: SimulatedRobot, settings: Robot) -> None:
        self._robot = robot
        self._settings = s = settings.ros2
        self._time_scale = settings.time_scale
        self.on_zero: Callable[[], None] = lambda: None  # called on the ROS thread with each zero velocity
        self.on_say: Callable[[str], None] = lambda _: None  # called there with each text
        self._amcl_published: Pose | None = None  # the latest pose that was published as AMCL does
        self._due: dict[str, float] = {}  # topic -> time of its next message
        node = ros.node
        reliable, sensor = QoSProfile(depth=10), qos_profile_sensor_data
        self._clock = node.create_publisher(Clock, "/clock", sensor)
        self._frames = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
        self._fixed_frames = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._map = node.create_publisher(GridMessage, s.map, LATCHED)
        self._amcl = node.create_publisher(PoseWithCovarianceStamped, s.amcl_pose, LATCHED) if s.amcl_pose else None
        self._odometry = node.create_publisher(Odometry, s.odom, sensor)
        self._scan: Any = node.create_publisher(LaserScan, s.scan, sensor) if s.scan else None
        self._battery: Any = node.create_publisher(BatteryState, s.battery, reliable) if s.battery else None
        self._plan = node.create_publisher(PathMessage, s.plan, reliable) if s.plan else None
        kind = CompressedImage if s.image_type == "compressed" else Image
        self._picture: Any = node.create_publisher(kind, s.image, sensor) if s.image else None
        velocity = TwistStamped if s.stamped else Twist
        node.create_subscription(velocity, s.cmd_vel, self._hear_velocity, QoSProfile(depth=1))
        if s.speech:
            node.create_subscription(String, s.speech, lambda message: self.on_say(message.data), reliable)

    def _hear_velocity(self, message: Any) -> None:
        twist = convert.twist(message.twist if self._settings.stamped else message)
        if twist.linear == 0.0 and twist.angular == 0.0:
            self.on_zero()

    async def heard(self) -> None:
        """Wait for the first subscriber to odometry."""
        await until(self._odometry.get_subscription_count, math.inf)

    async def publish_for_ever(self) -> None:
        """All topics, each at its rate, from the simulator's first step on."""
        begin = self._robot.clock()
        await until(lambda: self._robot.clock() > begin, math.inf)
        self._map.publish(self._grid(self._robot.grid))
        self._fixed_frames.publish(
            TFMessage(transforms=[self._transform(self._settings.base_frame, LASER_FRAME, Pose(0.0, 0.0, 0.0))])
        )
        while True:
            await self._publish()
            await asyncio.sleep(TICK)

    async def _publish(self) -> None:
        robot, s = self._robot, self._settings
        now, pose = robot.clock(), robot.fix.pose
        in_odom = compose(inverse(ODOM_IN_MAP), pose)
        self._frames.publish(
            TFMessage(
                transforms=[
                    self._transform(s.map_frame, "odom", ODOM_IN_MAP),
                    self._transform("odom", s.base_frame, in_odom),
                ]
            )
        )
        if self._amcl and self._has_moved(pose):
            self._amcl_published = pose
            message = PoseWithCovarianceStamped()
            self._stamp(message.header, s.map_frame)
            convert.set_pose(message.pose.pose, pose)
            self._amcl.publish(message)
        self._publish_odometry(in_odom)
        if s.scan and self._is_due("scan", now, SCAN_EVERY):
            self._publish_scan()
        self._clock.publish(Clock(clock=self._time()))
        wall = time.monotonic()
        if s.battery and self._is_due("battery", wall, BATTERY_EVERY):
            self._publish_battery()
        if s.image and self._picture.get_subscription_count() and self._is_due("image", wall, PICTURE_EVERY):
            await self._publish_picture()

    def _is_due(self, topic: str, now: float, interval: float) -> bool:
        if now < self._due.get(topic, 0.0):
            return False
        self._due[topic] = max(self._due.get(topic, 0.0) + interval, now)
        return True

    def _has_moved(self, pose: Pose) -> bool:
        said = self._amcl_published
        if said is None:
            return True
        turned = abs(math.remainder(pose.yaw - said.yaw, math.tau))
        return math.hypot(pose.x - said.x, pose.y - said.y) >= AMCL_WAY or turned >= AMCL_TURN

    def _time(self) -> Any:
        stamp = Clock().clock
        convert.set_seconds(stamp, self._robot.clock())
        return stamp

    def _stamp(self, header: Any, frame: str) -> None:
        header.stamp, header.frame_id = self._time(), frame

    def _transform(self, parent: str, child: str, pose: Pose) -> Any:
        message = TransformStamped(child_frame_id=child)
        self._stamp(message.header, parent)
        message.transform.translation.x, message.transform.translation.y = pose.x, pose.y
        message.transform.rotation.z, message.transform.rotation.w = math.sin(pose.yaw / 2), math.cos(pose.yaw / 2)
        return message

    def _publish_odometry(self, pose: Pose) -> None:
        message, twist = Odometry(child_frame_id=self._settings.base_frame), self._robot.velocity.twist
        self._stamp(message.header, "odom")
        convert.set_pose(message.pose.pose, pose)
        message.twist.twist.linear.x, message.twist.twist.angular.z = twist.linear, twist.angular
        self._odometry.publish(message)

    def _publish_scan(self) -> None:
        scan = self._robot.scan()
        message = LaserScan(
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1),
            angle_increment=scan.angle_increment,
            range_min=0.05,
            range_max=scan.range_max,
            ranges=array.array("f", scan.ranges),
        )
        self._stamp(message.header, LASER_FRAME)
        self._scan.publish(message)

    def _publish_battery(self) -> None:
        battery = self._robot.battery
        message = BatteryState(percentage=battery.level, present=True, voltage=24.0)
        message.power_supply_status = convert.CHARGING if battery.charging else 2
        self._stamp(message.header, self._settings.base_frame)
        self._battery.publish(message)

    async def _publish_picture(self) -> None:
        picture = await self._robot.photo()
        if self._settings.image_type == "compressed":
            message: Any = CompressedImage(format="jpeg", data=array.array("B", picture.jpeg))
        else:
            with Pictures.open(io.BytesIO(picture.jpeg)) as image:
                data = array.array("B", image.convert("RGB").tobytes())
            message = Image(width=picture.width, height=picture.height, encoding="rgb8", step=3 * picture.width)
            message.data = data
        self._stamp(message.header, "camera")
        self._picture.publish(message)

    def publish_path(self, points: Sequence[tuple[float, float]]) -> None:
        """Show the way that is driven, as Nav2's planner does."""
        if self._plan:
            self._plan.publish(self.path(points))

    def path(self, points: Sequence[tuple[float, float]]) -> Any:
        """A nav_msgs/Path in the map frame."""
        message = PathMessage()
        self._stamp(message.header, self._settings.map_frame)
        for x, y in points:
            each = PoseStamped(header=message.header)
            each.pose.position.x, each.pose.position.y = x, y
            message.poses.append(each)
        return message

    def _grid(self, grid: OccupancyGrid) -> Any:
        message = GridMessage()
        self._stamp(message.header, self._settings.map_frame)
        message.info.resolution = grid.resolution
        message.info.width, message.info.height = grid.width, grid.height
        message.info.origin.position.x, message.info.origin.position.y = grid.origin_x, grid.origin_y
        cells = np.zeros(grid.cells.shape, dtype=np.int8)
        cells[grid.cells == UNKNOWN] = -1
        cells[grid.cells == OCCUPIED] = 100
        message.data = array.array("b", cells.tobytes())
        return message
