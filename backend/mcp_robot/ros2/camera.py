"""The camera of a ROS 2 robot: it subscribes to the topic only while pictures are asked for.

A raw stream costs a processor core in Python: so the subscription begins with the first request and ends some seconds
after the last one. An old picture is never returned for a new one.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any

from sensor_msgs.msg import CompressedImage, Image

from backend.config import Ros2
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import Picture
from backend.mcp_robot.ros2 import convert
from backend.mcp_robot.ros2.ros_thread import RosThread
from backend.mcp_robot.ros2.senses import LATEST, Senses
from backend.mcp_robot.ros2.waiting import until

KEEP = 5.0
"""Seconds after the last request for which the subscription stays."""
NEW = 0.5
"""A picture that arrived within so many seconds is new."""


class Camera:
    """`photo` may be called several times at once."""

    def __init__(self, ros: RosThread, settings: Ros2, senses: Senses) -> None:
        self._ros = ros
        self._settings = settings
        self._senses = senses
        self._subscription: Any = None  # on the ROS thread
        self._latest: tuple[Any, float] | None = None  # message and monotonic time of its arrival
        self._asked = 0.0  # monotonic time of the latest request

    async def photo(self) -> Picture:
        """A picture that is new. Raises `Refusal` (no_camera)."""
        topic, limit = self._settings.image, self._settings.camera_timeout
        if not topic:
            raise Refusal("no_camera", "This robot has no camera: no topic is set for it.")
        self._asked = time.monotonic()
        await self._ros.run(self._listen)
        oldest = self._asked - NEW
        await until(lambda: self._latest and self._latest[1] > oldest, limit, every=0.01)
        latest = self._latest
        if latest is None or latest[1] <= oldest:
            sentence = f"No picture came on the topic {topic} within {limit:g} s. Is the camera running?"
            raise Refusal("no_camera", sentence)
        pose = self._senses.fix.pose
        try:
            jpeg, width, height = await asyncio.to_thread(convert.jpeg, latest[0])
        except ValueError as error:
            raise Refusal("no_camera", f"The camera on the topic {topic} sends {error}.") from None
        return Picture(jpeg, width, height, pose)

    def _listen(self) -> None:
        if self._subscription is None:
            kind = CompressedImage if self._settings.image_type == "compressed" else Image
            self._subscription = self._ros.node.create_subscription(kind, self._settings.image, self._hear, LATEST)

    def _hear(self, message: Any) -> None:
        now = time.monotonic()
        self._latest = (message, now)
        if now - self._asked > KEEP:
            self._ros.node.destroy_subscription(self._subscription)
            self._subscription = self._latest = None
