"""The commands as a person starts them: the stand-in, the doctor, `up` on it, and another ROS distribution."""

from __future__ import annotations

import asyncio
import subprocess
from pathlib import Path

import pytest

from backend.mcp_robot.ros2 import interfaces
from backend.mcp_robot.ros2.interfaces import Distro
from tests.end_to_end.conftest import start
from tests.processes import PATIENCE_S, Client, Robot, end
from tests.ros2_robots import VARIABLES, StandIns, free_domain


def doctor(robot: Robot, *arguments: str) -> tuple[int, str]:
    done = subprocess.run(
        robot.command("doctor", *arguments), env=robot.variables, text=True, capture_output=True, timeout=PATIENCE_S
    )
    return done.returncode, done.stdout


async def test_up_on_the_stand_in_serves_the_papers_first_prompt_over_tcp(tmp_path: Path) -> None:
    up = start(Robot(tmp_path, dict(VARIABLES)), "--robot", "ros2", "--ros2-demo", "--time-scale", "4")
    try:
        async with asyncio.timeout(90):
            client = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}")
            await client.new()
            async with up.robot.watched() as watched:
                assert await client.prompt("Go to lab 2.3.7, say hello, and come back to the dock.") == "end_turn"
                await watched.until(lambda: watched.distance_to(0.9, 3.1) < 0.15, "the robot at its dock")
                assert "ello" in " ".join(watched.spoken)
                assert min(((s.pose.x - 11.8) ** 2 + (s.pose.y - 4.0) ** 2) ** 0.5 for _, s in watched.states) < 0.15
            await client.close()
    finally:
        assert end(up.process) == 0


@pytest.mark.parametrize("distro", ["humble", "jazzy"])
async def test_a_robot_of_an_older_distribution_is_driven_and_its_failure_told(tmp_path: Path, distro: Distro) -> None:
    """Humble's results have no error code, Jazzy's no message to it; both ends speak its interfaces here."""
    interfaces.generated(tmp_path, distro)
    robot = Robot(
        tmp_path,
        VARIABLES
        | {
            "ROBOT_ACP_ROBOT__ROS2__DISTRO": distro,
            "ROBOT_ACP_ROBOT__ROS2__DOMAIN_ID": str(free_domain()),
            "ROBOT_ACP_ROBOT__TIME_SCALE": "1",
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        },
    )
    stand_in = robot.spawn("ros2-demo", stdout=subprocess.PIPE)
    try:
        assert stand_in.stdout is not None
        assert "on the domain" in await asyncio.to_thread(stand_in.stdout.readline)
        with robot.running("robot", "--robot", "ros2", "--ros2-demo", port=robot.robot_port):
            from tests.mcp_robot.conftest import Served
            from tests.mcp_robot.tools.test_tools import call

            served = Served(robot.robot_port, robot.robot_headers["Authorization"].removeprefix("Bearer "))
            async with served.mcp() as client:
                assert (await call(client, "rotate_in_place", degrees=45))["reached"]
                arrived = await call(client, "navigate_to_place", place="reception")
                assert arrived["reached"]
                async with robot.watched() as watched:
                    driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
                    await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
                    end(stand_in)  # and with it Nav2
                    result = await driving
            assert result.is_error
            # With the patience of the tests it may count as having driven on, into what it saw last: blocked.
            codes = ("lost", "blind", "blocked", "nav_unavailable", "nav_failed", "timeout")
            assert result.content[0].text.split(":")[0] in codes  # type: ignore[union-attr]
    finally:
        end(stand_in)


async def test_the_doctor_finds_all_of_a_running_robot_and_says_what_a_missing_one_lacks(
    tmp_path: Path, stand_ins: StandIns
) -> None:
    with stand_ins.one("--time-scale", "1.0") as stand_in:
        robot = Robot(tmp_path, {"ROBOT_ACP_ROBOT__ROS2__DOMAIN_ID": str(stand_in.domain)})
        robot.environment |= {"ROBOT_ACP_ROBOT__ROS2__DEMO": "true", "ROBOT_ACP_ROBOT__KIND": "ros2"}
        status, told = await asyncio.to_thread(doctor, robot)
        assert status == 0, told
        for line in (
            "ok       rclpy",
            "ok       nav2_msgs",
            "ok       topic map: 1 publisher, last heard",
            "ok       action navigate_to_pose: its server is there",
            "ok       transform map to base_link",
        ):
            assert line in told
        robot.environment |= {
            "ROBOT_ACP_ROBOT__ROS2__NAVIGATE": "absent",
            "ROBOT_ACP_ROBOT__ROS2__SCAN": "silent",
            "ROBOT_ACP_ROBOT__ROS2__CMD_VEL_STAMPED": "false",
        }
        status, told = await asyncio.to_thread(doctor, robot)
    assert status == 1
    assert "missing  action absent: no server\n         → Start Nav2" in told
    assert "missing  topic silent: 0 publishers, nothing heard yet\n         → Start what publishes it" in told
    assert "its listeners want geometry_msgs/msg/TwistStamped\n         → Set robot.ros2.cmd_vel_stamped." in told


async def test_the_doctor_sees_an_empty_domain(tmp_path: Path) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_ROBOT__ROS2__DOMAIN_ID": str(free_domain())})
    robot.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    status, told = await asyncio.to_thread(doctor, robot, "--robot", "ros2")
    assert status == 1
    assert "missing  ROS graph: no other node is to be seen" in told


@pytest.mark.parametrize("command", [["ros2-demo"], ["robot", "--robot", "ros2"]])
def test_a_machine_without_a_compiler_is_told_what_to_install(tmp_path: Path, command: list[str]) -> None:
    # Nothing was generated yet: else no compiler would be needed.
    robot = Robot(tmp_path, {"CC": "no-compiler", "XDG_CACHE_HOME": str(tmp_path / "cache")})
    done = subprocess.run(
        robot.command(*command), env=robot.variables, text=True, capture_output=True, timeout=PATIENCE_S
    )
    assert done.returncode == 2
    assert "a C and C++ compiler (on Debian and Ubuntu: apt install g++)" in done.stderr
    assert "Traceback" not in done.stderr
