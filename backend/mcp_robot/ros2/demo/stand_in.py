"""A stand-in for a ROS 2 robot: the simulator behind real ROS nodes, with the topics and actions that Nav2 serves.

A process of its own, for tests and for trying robot-acp where no ROS is installed: `robot-acp ros2-demo`. What its
clients see is ROS and nothing else. As with Nav2, a new goal takes over from the one before, whoever sent it, and a
zero velocity on the velocity topic stops the robot, but ends no goal: that is what a cancel is for. It is no Nav2:
there are no costmaps and no recoveries.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine
from typing import Any, Literal

from nav2_msgs.action import ComputePathToPose, NavigateToPose, Spin
from rclpy.action import ActionServer, CancelResponse, GoalResponse

from backend.config import Robot
from backend.mcp_robot.navigation.grid import FREE
from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.ros2 import convert
from backend.mcp_robot.ros2.demo.stand_in_topics import StandInTopics
from backend.mcp_robot.ros2.ros_thread import RosThread
from backend.mcp_robot.ros2.waiting import until
from backend.mcp_robot.simulator.simulated_robot import SimulatedRobot
from backend.telemetry import Pose

logger = logging.getLogger(__name__)

FEEDBACK_EVERY = 0.05
"""Wall seconds between feedbacks, and between two checks whether a goal was cancelled."""
PROGRESS_TIME = 10.0
"""Wall seconds without progress after which a goal is given up, as by Nav2's progress checker."""
COLLISION_AHEAD, NO_PROGRESS, NO_VALID_PATH, UNKNOWN = 703, 105, 209, 9000

End = Literal["succeeded", "canceled", "aborted"]


class StandIn:
    """The robot's nodes. `running()` joins the ROS graph."""

    def __init__(self, robot: SimulatedRobot, settings: Robot) -> None:
        self._robot = robot
        self._settings = settings.ros2
        self._ros = RosThread("robot_acp_demo", settings.ros2.domain_id)
        self._topics = StandInTopics(self._ros, robot, settings)
        self._loop = asyncio.get_running_loop()
        self._tasks: set[asyncio.Task[None]] = set()  # goals under way, and what the robot says
        self._latest: Any = None  # the goal that moves the robot
        self._planned: Any = None  # the latest goal of the planner, which serves one at a time
        s = self._settings
        for kind, name, serve in (
            (NavigateToPose, s.navigate, self._navigate),
            (Spin, s.spin, self._turn),
            (ComputePathToPose, s.compute_path, self._compute_path),
        ):
            if name:
                self._serve(kind, name, serve)
        self._topics.on_zero = lambda: self._soon(robot.halt)
        self._topics.on_say = lambda text: self._soon(lambda: self._start(self._say(text)))

    async def run(self) -> None:
        """Be part of the ROS graph until cancelled. Simulated time begins with the first subscriber to odometry."""
        self._ros.open()
        print(f"The stand-in for a ROS 2 robot is on the domain {self._ros.domain}.", flush=True)
        try:
            await self._topics.heard()
            async with self._robot.running():
                await self._topics.publish_for_ever()
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            await asyncio.to_thread(self._ros.close)

    def _soon(self, work: Callable[[], Any]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(work)

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _serve(self, kind: Any, name: str, serve: Callable[[Any, Any], Coroutine[Any, Any, End]]) -> None:
        """An action server whose goals are asyncio tasks.

        rclpy would run a goal in a thread, or resume a coroutine as often as it can. So a goal is only executed, in
        rclpy's sense, once the task has ended: to say how.
        """
        ends: dict[bytes, tuple[End, Any]] = {}  # of goals that have ended and are about to say so

        async def work(handle: Any) -> None:
            result = kind.Result()
            ends[bytes(handle.goal_id.uuid)] = (await serve(handle, result), result)
            self._ros.submit(handle.execute)

        def execute(handle: Any) -> Any:
            end, result = ends.pop(bytes(handle.goal_id.uuid))
            {"succeeded": handle.succeed, "canceled": handle.canceled, "aborted": handle.abort}[end]()
            return result

        ActionServer(
            self._ros.node, kind, name, execute,
            goal_callback=self._acceptable,
            handle_accepted_callback=lambda handle: self._soon(lambda: self._start(work(handle))),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def _acceptable(self, goal: Any) -> Any:
        """As bt_navigator, which rejects a goal in a frame that it cannot transform."""
        frame = goal.pose.header.frame_id if hasattr(goal, "pose") else self._settings.map_frame
        return GoalResponse.ACCEPT if frame == self._settings.map_frame else GoalResponse.REJECT

    async def _navigate(self, handle: Any, result: Any) -> End:
        goal = convert.pose(handle.request.pose.pose)
        began = self._robot.clock()
        self._latest = handle
        try:
            route = await self._robot.plan(goal, final_yaw=True)
        except Refusal as refusal:
            _explain(result, NO_VALID_PATH, refusal)
            return "aborted"
        self._topics.publish_path(route.points)

        def feedback() -> Any:
            left = self._robot.remaining
            message = NavigateToPose.Feedback()
            message.current_pose.header.frame_id = self._settings.map_frame
            convert.set_pose(message.current_pose.pose, self._robot.fix.pose)
            convert.set_seconds(message.navigation_time, self._robot.clock() - began)
            message.distance_remaining = left.distance if left else 0.0
            convert.set_seconds(message.estimated_time_remaining, left.seconds if left else 0.0)
            return message

        try:
            return await self._move(handle, result, self._robot.drive(route), feedback, NO_PROGRESS)
        finally:
            self._topics.publish_path(())

    async def _turn(self, handle: Any, result: Any) -> End:
        angle, began = float(handle.request.target_yaw), self._robot.clock()
        self._latest = handle

        def feedback() -> Any:
            left = self._robot.remaining
            return Spin.Feedback(angular_distance_traveled=abs(angle) - (left.angle if left else 0.0))

        end = await self._move(handle, result, self._robot.turn(angle), feedback, COLLISION_AHEAD)
        convert.set_seconds(result.total_elapsed_time, self._robot.clock() - began)
        return end

    async def _move(
        self, handle: Any, result: Any, motion: Coroutine[Any, Any, None], feedback: Callable[[], Any], failure: int
    ) -> End:
        moving = asyncio.ensure_future(motion)
        try:
            while not moving.done():
                await asyncio.wait({moving}, timeout=FEEDBACK_EVERY)
                if handle.is_cancel_requested:
                    self._robot.halt()
                if not moving.done() and self._latest is handle:
                    handle.publish_feedback(feedback())
            moving.result()
        except Halted:
            # Zero velocities and a cancel come by ways of their own, in any order.
            await until(lambda: handle.is_cancel_requested or self._latest is not handle, PROGRESS_TIME)
            if handle.is_cancel_requested:
                return "canceled"
            _explain(result, failure, "The motion was stopped.")
            return "aborted"
        except Refusal as refusal:
            _explain(result, failure, refusal)
            return "aborted"
        finally:
            moving.cancel()
        return "succeeded"

    async def _compute_path(self, handle: Any, result: Any) -> End:
        goal: Pose = convert.pose(handle.request.goal.pose)
        self._planned = handle
        try:
            if self._robot.grid.state(goal.x, goal.y) != FREE:
                raise Refusal("occupied", "The goal is not on free floor.")
            route = await self._robot.plan(goal, final_yaw=True)
        except Refusal as refusal:
            _explain(result, NO_VALID_PATH, refusal)
            return "aborted"
        if self._planned is not handle:
            return "aborted"  # as Nav2's action servers do: without a word on why
        result.path = self._topics.path(route.points)
        return "succeeded"

    async def _say(self, text: str) -> None:
        if not text:
            self._robot.hush()
            return
        sound = await self._robot.synthesize(text)
        with contextlib.suppress(Halted):
            await self._robot.say(text, sound)


def _explain(result: Any, number: int, why: object) -> None:
    """Set what the distribution's result has room for: Humble's has none."""
    if hasattr(result, "error_code"):
        result.error_code = number
    if hasattr(result, "error_msg"):
        result.error_msg = str(why)
