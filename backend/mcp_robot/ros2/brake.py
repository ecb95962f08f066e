"""Brings the robot to rest through ROS: cancels the goals of all clients, and sends zero velocity.

Zero velocity goes to the topic of Nav2's own controllers, so that it passes the velocity smoother and the collision
monitor, too. Both are repeated while held, for a while after a halt, and until the halted goal has ended and the robot
stands: another program that commands the robot does not get far. It never sends any velocity but zero.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from action_msgs.srv import CancelGoal
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile

from backend.config import Ros2
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.ros2.goals import Goal
from backend.mcp_robot.ros2.ros_thread import RosThread
from backend.mcp_robot.ros2.waiting import Waits, until

logger = logging.getLogger(__name__)

PERIOD = 0.05
"""Seconds between zero velocities: as often as Nav2's controllers publish."""
PULSE = 1.0
"""Seconds for which a halt without a latch brakes at least."""
CANCEL_EVERY = 0.2
"""Seconds between cancelling everybody's goals while braking."""
ANSWER_LIMIT = 1.0
"""Seconds after which a cancel without an answer is sent again: its server may have been killed."""
UNKNOWN_GOAL = CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID


class Brake:
    """To be made before the ROS thread runs. Its methods are called from the event loop, and hand each change over to
    the ROS thread: two threads that both write would lose a halt."""

    def __init__(
        self,
        ros: RosThread,
        settings: Ros2,
        clock: Callable[[], float],
        moves: Callable[[], bool],
        *,
        patience: float = Waits.halted_goal,
    ) -> None:
        """`clock` is the robot's, in Unix seconds; `moves` says whether it moves or may; `patience` is in s, as in
        `Waits.halted_goal`."""
        self._patience = patience
        self._ros = ros
        self._settings = settings
        self._robot_clock = clock
        self._moves = moves
        # These belong to the event loop:
        self._halts = 0  # how often `halt` was called
        self._handed: Future[None] | None = None  # the change that was handed over to the ROS thread last
        # All others belong to the ROS thread, which alone writes them:
        self._begun = 0  # halts that it has begun
        self._held = False  # set by `hold`
        self._until = 0.0  # monotonic time until which zero velocity is sent in any case
        self._settling = False  # from a halt until the robot stands
        self._cancelled_at = 0.0  # monotonic time at which all goals were cancelled last
        self._goals: tuple[Goal, ...] = ()  # our motions whose end is not known
        self._unfinished_since: float | None = None  # monotonic time since when a halted motion has not ended
        self._complained = False  # whether the log has that motion already
        node = ros.node
        self._zero = TwistStamped if settings.stamped else Twist
        self._publisher = node.create_publisher(self._zero, settings.cmd_vel, QoSProfile(depth=1))
        actions = dict.fromkeys((settings.navigate, settings.spin, *settings.stops))
        self._cancels = [_Canceller(node, action) for action in actions]
        node.create_timer(PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def watch(self, goal: Goal) -> None:
        """Know a motion that is about to begin, so that a halt is repeated until it has ended."""
        self._hand_over(lambda: self._take(goal))

    def halt(self) -> None:
        """Cancel the goals of all clients and send zero velocity until the robot is at rest. Returns at once."""
        self._halts += 1
        self._hand_over(self._begin)  # first: a publisher that fails must not prevent it
        self._publish()

    def hold(self, held: bool) -> None:
        """While `held`, go on cancelling and sending zero velocity."""
        self._hand_over(lambda: self._set_held(held))
        if held:
            self.halt()

    def _hand_over(self, change: Callable[[], None]) -> None:
        """Let the ROS thread make a change. It makes them in the order in which they were handed over."""
        self._handed = self._ros.submit(change)

    def _take(self, goal: Goal) -> None:
        self._goals = (*(each for each in self._goals if each.unfinished), goal)

    def _begin(self) -> None:
        self._begun += 1
        self._until, self._settling = time.monotonic() + PULSE, True
        self._cancel_all()

    def _set_held(self, held: bool) -> None:
        self._held = held
        if not held:
            self._until = 0.0

    def _end(self, halts: int) -> None:
        if self._begun == halts:  # else another halt has begun since
            self._until, self._settling = 0.0, False

    def reaches(self, action: str) -> bool:
        """Whether the server of this action has answered a cancel, so that requests and answers arrive.

        That its server is in the ROS graph is not enough: an answer is lost that a server sends before it has
        discovered the node that asked.
        """
        return any(each.answered for each in self._cancels if each.action == action)

    async def let_go(self) -> None:
        """End the braking for a halt that is over, once all cancels are answered: the next motion may begin.

        A halt that comes meanwhile stays. Raises `Refusal` (timeout) when the motion that was halted has not ended.
        """
        halts = self._halts
        await until(self._is_quiet, self._patience, every=0.01)
        if unfinished := self._unfinished:
            sentence = f"{unfinished[0].name} does not end the motion that was halted. Look at its log, or restart it."
            raise Refusal("timeout", sentence)
        try:
            await self._ros.run(lambda: self._end(halts))
        except TimeoutError:
            sentence = "The robot server's own ROS node does not answer. Restart the robot server."
            raise Refusal("timeout", sentence) from None

    def _is_quiet(self) -> bool:
        """Whether nothing is left of a halt that could end the next motion."""
        made = self._handed is None or self._handed.done()
        return made and not self._unfinished and not any(each.waiting for each in self._cancels)

    @property
    def _unfinished(self) -> list[Goal]:
        return [goal for goal in self._goals if goal.unfinished]

    def _tick(self) -> None:
        now = time.monotonic()
        unfinished = self._unfinished
        self._complain(now, unfinished)
        if now >= self._until:
            self._settling = self._settling and self._moves()
        if self._held or now < self._until or self._settling or unfinished:
            if now - self._cancelled_at > CANCEL_EVERY:
                self._cancel_all()
            self._publish()

    def _complain(self, now: float, unfinished: list[Goal]) -> None:
        if not unfinished:
            self._unfinished_since, self._complained = None, False
            return
        if self._unfinished_since is None:
            self._unfinished_since = now
        if now - self._unfinished_since > self._patience and not self._complained:
            self._complained = True
            logger.error("%s has not ended a motion that was halted; it is cancelled on and on.", unfinished[0].name)

    def _publish(self) -> None:
        message = self._zero()
        if self._settings.stamped:
            now = self._robot_clock()
            message.header.frame_id = self._settings.base_frame
            message.header.stamp.sec, message.header.stamp.nanosec = int(now), int(now % 1 * 1e9)
        self._publisher.publish(message)

    def _cancel_all(self) -> None:
        self._cancelled_at = time.monotonic()
        unfinished = self._unfinished
        for canceller in self._cancels:
            canceller.cancel([goal for goal in unfinished if goal.name == canceller.action])


class _Canceller:
    """Cancels the goals of one action. All but `answered` and `waiting` belongs to the ROS thread."""

    def __init__(self, node: Any, action: str) -> None:
        self.action = action
        self._open: Any = None  # the cancel without an answer; one at most
        self._asked = 0.0  # monotonic time when it was sent
        self._one = False  # whether the next cancel names one goal
        self.answered = False  # at least once
        self._client = node.create_client(CancelGoal, f"{action}/_action/cancel_goal")

    @property
    def waiting(self) -> bool:
        """Whether a cancel is under way that may still be answered."""
        return self._open is not None and time.monotonic() - self._asked < ANSWER_LIMIT

    def cancel(self, unfinished: list[Goal]) -> None:
        """Cancel the goals of all clients; every second time only one of `unfinished`, because the answer to that says
        whether the server still knows the goal."""
        if self.waiting:
            return
        if self._open is not None:
            self._client.remove_pending_request(self._open)
            self._open = None
        if not self._client.service_is_ready():
            for goal in unfinished:
                if goal.id is None and not goal.server_is_there():
                    goal.forget()  # it was never accepted, and its server is gone
            return
        # A request of zeros stands for all goals, whoever sent them (action_msgs/srv/CancelGoal).
        request = CancelGoal.Request()
        named = [goal for goal in unfinished if goal.id is not None] if self._one else []
        self._one = not self._one and bool(unfinished)
        if named:
            request.goal_info.goal_id = named[0].id
        self._asked = time.monotonic()
        answer = self._open = self._client.call_async(request)

        def answered(_: Any) -> None:
            self.answered = True
            if self._open is answer:
                self._open = None
            if named and answer.exception() is None and answer.result().return_code == UNKNOWN_GOAL:
                named[0].forget()

        answer.add_done_callback(answered)
