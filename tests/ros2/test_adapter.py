"""What only a ROS 2 robot can do wrong: each failure is a refusal with a code, and the robot stands."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from backend.telemetry import Pose
from tests.mcp_robot.tools.test_tools import TOOLS, apart, call, refused
from tests.processes import eventually
from tests.ros2.conftest import Setting, node
from tests.ros2_robots import WAITS

Never = Callable[..., None]
LAB = Pose(11.8, 4.0, -1.57)


def goal_to(pose: Pose) -> Any:
    from nav2_msgs.action import NavigateToPose

    from backend.mcp_robot.ros2 import convert

    goal = NavigateToPose.Goal()
    goal.pose.header.frame_id = "map"
    convert.set_pose(goal.pose.pose, pose)
    return goal


class Others:
    """Another client of Nav2: it sends goals and knows how they ended."""

    def __init__(self, link: Any) -> None:
        from nav2_msgs.action import NavigateToPose
        from rclpy.action import ActionClient

        self._link = link
        self._client = ActionClient(link.node, NavigateToPose, "navigate_to_pose")
        self.ends: list[int] = []
        self._handles: list[Any] = []  # of the goals that were accepted
        link.open()

    async def drive(self, pose: Pose) -> None:
        await eventually(self._client.server_is_ready, "Nav2 to be seen by another client")

        def accepted(answer: Any) -> None:
            self._handles.append(answer.result())
            answer.result().get_result_async().add_done_callback(lambda end: self.ends.append(end.result().status))

        await self._link.run(lambda: self._client.send_goal_async(goal_to(pose)).add_done_callback(accepted))

    async def cancel(self) -> None:
        """Cancel the latest goal."""
        await self._link.run(lambda: self._handles[-1].cancel_goal_async())


class Wheels:
    """What odometry says of the speed, and zero velocities when they are wanted."""

    def __init__(self, link: Any) -> None:
        from geometry_msgs.msg import TwistStamped
        from nav_msgs.msg import Odometry
        from rclpy.qos import qos_profile_sensor_data

        self.speed = 0.0
        link.node.create_subscription(Odometry, "odom", self._hear, qos_profile_sensor_data)
        zero, publisher = TwistStamped(), link.node.create_publisher(TwistStamped, "cmd_vel_nav", 1)
        self.send_zero = lambda: publisher.publish(zero)

    def _hear(self, message: Any) -> None:
        self.speed = message.twist.twist.linear.x

    async def drive(self) -> None:
        await eventually(lambda: self.speed > 0.3, "the robot to drive")

    async def stand(self) -> None:
        await eventually(lambda: self.speed == 0, "the robot to stand")


async def test_zero_velocities_stop_the_stand_in_and_end_no_goal_as_with_nav2(real_time: Setting) -> None:
    from action_msgs.msg import GoalStatus

    async with node(real_time.domain) as link:
        wheels, others = Wheels(link), Others(link)
        await others.drive(LAB)
        await wheels.drive()
        wheels.send_zero()
        await wheels.stand()
        await others.cancel()
        await eventually(lambda: others.ends, "the end of the goal")
        assert others.ends == [GoalStatus.STATUS_CANCELED]


async def test_a_stop_ends_other_clients_goals_and_holds_against_new_ones(real_time: Setting) -> None:
    from action_msgs.msg import GoalStatus

    async with (
        real_time.served() as robot,
        robot.mcp() as client,
        robot.http() as http,
        robot.telemetry("state", rate=50) as reader,
        node(real_time.domain) as link,
    ):
        others = Others(link)
        await others.drive(LAB)
        await reader.state(lambda s: s.twist.linear > 0.4)
        await http.post("/stop", params={"by": "Ana"})
        await eventually(lambda: others.ends, "the end of the other client's goal")
        assert others.ends == [GoalStatus.STATUS_CANCELED]
        halted = await reader.state(lambda s: s.twist.linear == 0)
        for number in (2, 3):
            await others.drive(LAB)
            await eventually(lambda wanted=number: len(others.ends) == wanted, "the end of a goal sent while stopped")
        state = await reader.state(lambda s: s.twist.linear == 0)
        assert math.hypot(state.pose.x - halted.pose.x, state.pose.y - halted.pose.y) < 0.1
        await http.post("/release", params={"by": "Ana"})
        await call(client, "rotate_in_place", degrees=5)  # nothing is left of the stop when that may begin
        await others.drive(LAB)
        await reader.state(lambda s: s.twist.linear > 0.2)


async def test_a_robot_server_that_starts_brings_to_rest_what_a_killed_one_left_to_nav2(real_time: Setting) -> None:
    from action_msgs.msg import GoalStatus

    async with node(real_time.domain) as link:
        wheels, others = Wheels(link), Others(link)  # nobody is there who could halt their goal
        await others.drive(LAB)
        await wheels.drive()
        async with real_time.served() as robot, robot.telemetry("state") as reader:
            await reader.state(lambda s: s.twist.linear == 0)
            await eventually(lambda: others.ends, "the end of the goal")
            assert others.ends == [GoalStatus.STATUS_CANCELED]
            await wheels.stand()


def qos_of_sensors() -> Any:
    from rclpy.qos import qos_profile_sensor_data

    return qos_profile_sensor_data


async def test_cancelling_the_call_reaches_nav2(real_time: Setting) -> None:
    from action_msgs.msg import GoalStatus, GoalStatusArray
    from rclpy.qos import qos_profile_action_status_default

    seen: list[int] = []
    async with node(real_time.domain) as link:
        link.node.create_subscription(
            GoalStatusArray,
            "navigate_to_pose/_action/status",
            lambda message: seen.extend(each.status for each in message.status_list),
            qos_profile_action_status_default,  # latched: what was told before this node was discovered comes, too
        )
        link.open()
        async with real_time.served() as robot, robot.mcp() as client, robot.telemetry("state") as reader:
            driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
            await reader.state(lambda s: s.twist.linear > 0.2)
            driving.cancel()
            await eventually(lambda: GoalStatus.STATUS_CANCELED in seen, "Nav2 to say that the goal was cancelled")
            await reader.state(lambda s: s.twist.linear == 0)


async def test_a_goal_that_is_rejected_is_told(real_time: Setting) -> None:
    from nav2_msgs.action import NavigateToPose
    from rclpy.action import ActionServer, GoalResponse

    async with node(real_time.domain) as link:
        ActionServer(
            link.node, NavigateToPose, "choosy", lambda _: None, goal_callback=lambda _: GoalResponse.REJECT
        )  # fmt: skip
        link.open()
        async with real_time.served(navigate="choosy") as robot, robot.mcp() as client:
            text = await refused(client, "navigate_to_place", place="reception")
            assert text == "goal_rejected: choosy rejected the goal. Choose another, or look at its log."
            assert (await call(client, "get_robot_status"))["mode"] == "idle"


async def test_a_server_that_is_missing_is_told(real_time: Setting, never: Never) -> None:
    never("the action absent")
    async with real_time.served(spin="absent", answer_timeout=0.5) as robot, robot.mcp() as client:
        text = await refused(client, "rotate_in_place", degrees=10)
        assert text.startswith("nav_unavailable: The robot's action server absent does not answer. Start Nav2")
        assert (await call(client, "get_robot_status"))["mode"] == "idle"


async def test_a_server_that_accepts_and_then_says_nothing_ends_with_a_timeout(real_time: Setting) -> None:
    from nav2_msgs.action import Spin
    from rclpy.action import ActionServer

    waits = replace(WAITS, silence=1.0, halted_goal=1.0)  # its goal never ends
    async with node(real_time.domain) as link:
        ActionServer(link.node, Spin, "mute", lambda _: Spin.Result(), handle_accepted_callback=lambda _: None)
        link.open()
        async with real_time.served(waits=waits, spin="mute") as robot, robot.mcp() as client:
            text = await refused(client, "rotate_in_place", degrees=10)
            assert text == "timeout: mute has said nothing for 1 s. Look at its log, then try again."


@pytest.mark.parametrize(
    ("number", "code"), [(703, "blocked"), (702, "lost"), (701, "timeout"), (799, "nav_failed"), (0, "nav_failed")]
)
async def test_what_nav2_says_of_its_failure_is_told_with_a_code(real_time: Setting, number: int, code: str) -> None:
    from nav2_msgs.action import Spin
    from rclpy.action import ActionServer

    def fail(handle: Any) -> Any:
        handle.abort()
        return Spin.Result(error_code=number, error_msg="a chair leg")

    async with node(real_time.domain) as link:
        ActionServer(link.node, Spin, "failing", fail)
        link.open()
        async with real_time.served(spin="failing") as robot, robot.mcp() as client:
            text = await refused(client, "rotate_in_place", degrees=10)
            assert text.startswith(f"{code}: failing gave up")
            assert "(a chair leg)" in text


async def test_a_camera_that_is_dead_is_told(real_time: Setting) -> None:
    async with real_time.served(image="no/camera", camera_timeout=0.3) as robot, robot.mcp() as client:
        text = await refused(client, "take_photo")
        assert text == "no_camera: No picture came on the topic no/camera within 0.3 s. Is the camera running?"


@pytest.mark.parametrize(
    ("without", "missing"),
    [
        ({"image": ""}, {"take_photo"}),
        ({"speech": ""}, {"speak"}),
        ({"scan": ""}, {"navigate_to_pose", "navigate_to_place"}),
    ],
)
async def test_a_robot_has_no_tool_for_a_part_that_it_lacks(
    real_time: Setting, without: dict[str, str], missing: set[str]
) -> None:
    async with real_time.served(**without) as robot, robot.mcp() as client:
        assert {tool.name for tool in (await client.list_tools()).tools} == TOOLS - missing


async def test_a_robot_without_a_listener_for_speech_has_no_voice(real_time: Setting) -> None:
    async with real_time.served(speech="nobody", answer_timeout=0.5) as robot, robot.mcp() as client:
        text = await refused(client, "speak", text="Hello")
        assert text == "no_voice: The robot has no voice: nobody listens, on the topic nobody."


async def test_a_robot_that_never_knew_where_it_is_says_so_and_does_not_move(real_time: Setting, never: Never) -> None:
    never("the robot's pose", "the laser")
    async with real_time.served(base_frame="another_robot", amcl_pose="") as robot, robot.mcp() as client:
        assert (await refused(client, "get_current_pose")).startswith("lost: The robot does not know where it is.")
        for tool, arguments in (("navigate_to_place", {"place": "reception"}), ("rotate_in_place", {"degrees": 9})):
            assert (await refused(client, tool, **arguments)).startswith("lost: ")


async def test_a_robot_whose_odometry_was_never_heard_does_not_move(real_time: Setting, never: Never) -> None:
    from nav_msgs.msg import Odometry

    never("odometry")
    async with node(real_time.domain) as link:
        # The stand-in is silent until somebody listens to its odometry.
        link.node.create_subscription(Odometry, "odom", lambda _: None, qos_of_sensors())
        link.open()
        await refuses_to_move_without_odometry(real_time)


async def refuses_to_move_without_odometry(real_time: Setting) -> None:
    async with real_time.served(odom="nobody/odom") as robot, robot.mcp() as client:
        for tool, arguments in (("navigate_to_place", {"place": "reception"}), ("rotate_in_place", {"degrees": 9})):
            text = await refused(client, tool, **arguments)
            assert text.startswith("lost: The robot's odometry is silent, on the topic nobody/odom.")


async def test_a_robot_whose_odometry_dies_on_the_way_is_halted(
    real_time: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    from backend.mcp_robot.ros2 import convert

    def unusable(_: Any) -> Any:
        raise ValueError("a broken encoder")

    limits = {"pose_timeout": 3.0}
    async with real_time.served(limits=limits) as robot, robot.mcp() as client, robot.telemetry("state") as reader:
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.3)
        with monkeypatch.context() as patch:
            patch.setattr(convert, "twist", unusable)
            result = await driving
        assert result.is_error
        assert result.content[0].text.startswith("lost: The robot's odometry is silent")  # type: ignore[union-attr]
        await reader.state(lambda s: s.twist.linear == 0 and s.motion is None)


async def test_a_robot_without_a_map_says_so(real_time: Setting) -> None:
    async with (
        real_time.served(waits=replace(WAITS, start=1.0), map="no/map") as robot,
        robot.mcp() as client,
        robot.telemetry("state", "map") as reader,
    ):
        await reader.state(lambda s: s.battery.level > 0.5)  # until it is heard, the battery counts as empty
        text = await refused(client, "navigate_to_place", place="reception")
        assert text == "no_map: No map has come on the topic no/map. Is the map server running?"
        await reader.state()


async def test_without_transforms_the_pose_is_amcls_and_goes_on_with_odometry(real_time: Setting, never: Never) -> None:
    never("the robot's pose", "the laser")  # it is known anew only when AMCL speaks, which is when the robot moves
    async with (
        real_time.served(map_frame="map", base_frame="nowhere", limits={"pose_timeout": 0.5}) as robot,
        robot.mcp() as client,
        node(real_time.domain) as link,
    ):
        while (await client.call_tool("get_current_pose", {})).is_error:
            await asyncio.sleep(0.05)
        pose = await call(client, "get_current_pose")
        assert pose["source"] in ("amcl_pose", "odometry")
        assert apart(pose, {"x": 0.9, "y": 3.1}) < 0.01
        others = Others(link)
        await others.drive(Pose(3.2, 3.0, 1.57))
        seen = set()
        while not others.ends:
            pose = await call(client, "get_current_pose")
            seen.add(pose["source"])
        assert seen >= {"odometry"}
        assert apart(pose, {"x": 3.2, "y": 3.0}) < 0.15


async def test_a_robot_that_falls_silent_is_known_to_be_old_and_does_not_move(
    real_time: Setting, stand_ins: Any
) -> None:
    limits = {"pose_timeout": 3.0}
    async with real_time.served(limits=limits) as robot, robot.mcp() as client, robot.telemetry("state") as reader:
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.3)
        with stand_ins.frozen(real_time.stand_in):
            result = await driving
            assert result.is_error
            assert result.content[0].text.startswith(("lost: ", "blind: "))  # type: ignore[union-attr]
            await eventually_stale(client)
            assert (await refused(client, "rotate_in_place", degrees=9)).startswith("lost: ")
        await reader.state(lambda s: s.twist.linear == 0 and s.motion is None)


async def test_a_battery_that_falls_silent_counts_as_empty(real_time: Setting, stand_ins: Any) -> None:
    async with real_time.served(waits=replace(WAITS, battery=1.0)) as robot, robot.telemetry("state") as reader:
        await reader.state(lambda s: s.battery.level > 0.5)
        with stand_ins.frozen(real_time.stand_in):
            await reader.state(lambda s: s.battery.level == 0)


async def eventually_stale(client: Any) -> None:
    while not (await call(client, "get_current_pose"))["stale"]:
        await asyncio.sleep(0.05)
