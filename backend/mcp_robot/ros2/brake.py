"""Brings the robot to rest through ROS: cancels the goals of all clients, and sends zero velocity.

Zero velocity goes where Nav2's own controllers send theirs, so that the velocity smoother and the collision monitor
stay in the way of it. While held, both are repeated: whoever else commands the robot does not get far. It never sends
any velocity but zero.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from action_msgs.srv import CancelGoal
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile

from backend.config import Ros2
from backend.mcp_robot.ros2.link import RosLink
from backend.mcp_robot.ros2.waiting import until

PERIOD = 0.05
"""Seconds between zero velocities: as often as Nav2's controllers speak."""
PULSE = 1.0
"""Seconds for which a halt without a latch sends zero velocity."""
CANCEL_EVERY = 0.2
"""Seconds between cancelling everybody's goals while held."""
QUIET_LIMIT = 1.0
"""Seconds that a new motion waits for cancels that are under way."""


class Brake:
    """To be made on the ROS thread; `halt`, `hold` and `let_go` may be called from any."""

    def __init__(self, link: RosLink, settings: Ros2, clock: Callable[[], float]) -> None:
        self._link = link
        self._settings = settings
        self._robot_clock = clock
        self._held = False  # set by hold
        self._until = 0.0  # monotonic time until which zero velocity is sent
        self._cancelled_at = 0.0  # monotonic time of the latest cancel of everything
        self._open: set[Any] = set()  # cancels that were not answered yet; on the ROS thread
        node = link.node
        self._zero = TwistStamped if settings.stamped else Twist
        self._publisher = node.create_publisher(self._zero, settings.cmd_vel, QoSProfile(depth=1))
        actions = dict.fromkeys((settings.navigate, settings.spin, *settings.stops))
        self._cancels = [node.create_client(CancelGoal, f"{action}/_action/cancel_goal") for action in actions]
        node.create_timer(PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def halt(self) -> None:
        """Cancel all goals of everybody and send zero velocity for a while. Returns at once."""
        self._until = time.monotonic() + PULSE
        self._publish()
        self._link.submit(self._cancel_all)

    def hold(self, held: bool) -> None:
        """Do so until told otherwise."""
        self._held = held
        if held:
            self.halt()
        else:
            self._until = 0.0

    async def let_go(self) -> None:
        """Send no more zeros for a halt that is over, once all cancels are answered: the next motion may begin."""
        await until(lambda: not self._open, QUIET_LIMIT, every=0.01)
        self._until = 0.0

    def _tick(self) -> None:
        now = time.monotonic()
        if self._held or now < self._until:
            self._publish()
        if self._held and now - self._cancelled_at > CANCEL_EVERY:
            self._cancel_all()

    def _publish(self) -> None:
        message = self._zero()
        if self._settings.stamped:
            now = self._robot_clock()
            message.header.frame_id = self._settings.base_frame
            message.header.stamp.sec, message.header.stamp.nanosec = int(now), int(now % 1 * 1e9)
        self._publisher.publish(message)

    def _cancel_all(self) -> None:
        self._cancelled_at = time.monotonic()
        for client in self._cancels:
            if client.service_is_ready():
                # A request of zeros stands for all goals, whoever sent them (action_msgs/srv/CancelGoal).
                answer = client.call_async(CancelGoal.Request())
                self._open.add(answer)
                answer.add_done_callback(self._open.discard)
