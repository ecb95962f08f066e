"""What topics say is never taken for younger, nearer or surer than it is."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from backend.mcp_robot.robot import Velocity
from backend.telemetry import Pose, Twist
from tests.processes import eventually
from tests.ros2.conftest import node
from tests.ros2.test_brake import busy
from tests.ros2_robots import free_domain


class Spoken:
    """Senses, and a voice for the topics that they listen to."""

    def __init__(self, link: Any) -> None:
        from nav_msgs.msg import OccupancyGrid, Odometry
        from sensor_msgs.msg import BatteryState, LaserScan

        from backend.config import Ros2
        from backend.mcp_robot.ros2.frames import Transform
        from backend.mcp_robot.ros2.senses import LATCHED, Senses

        self.senses = Senses(link.node, Ros2(), 1.0, ())
        self.laser_is_at = lambda pose: self.senses.frames.put("laser", Transform("base_link", pose, time.time(), 0.0))
        self.scans = link.node.create_publisher(LaserScan, "scan", 1)
        self.batteries = link.node.create_publisher(BatteryState, "battery_state", 1)
        self.odometry = link.node.create_publisher(Odometry, "odom", 1)
        self.maps = link.node.create_publisher(OccupancyGrid, "map", LATCHED)

    async def say_scan(self, *, ahead: float = 0.0, ranges: tuple[float, ...] = (1.0, 2.0)) -> None:
        from sensor_msgs.msg import LaserScan

        from backend.mcp_robot.ros2 import convert

        message = LaserScan(angle_increment=0.1, range_max=9.0, ranges=ranges)
        message.header.frame_id = "laser"
        convert.set_seconds(message.header.stamp, time.time() + ahead)
        before = self.senses.arrivals.get("scan")
        await eventually(self.scans.get_subscription_count, "somebody who listens to scans")
        self.scans.publish(message)
        await eventually(lambda: self.senses.arrivals.get("scan") != before, "the scan")

    async def say_odometry(self, stamp: float) -> Velocity:
        """Tell a speed that was measured at `stamp` (Unix seconds); returns how it was understood."""
        from nav_msgs.msg import Odometry

        from backend.mcp_robot.ros2 import convert

        message = Odometry()
        convert.set_seconds(message.header.stamp, stamp)
        before = self.senses.velocity
        await eventually(self.odometry.get_subscription_count, "somebody who listens to odometry")
        self.odometry.publish(message)
        await eventually(lambda: self.senses.velocity is not before, "the odometry")
        return self.senses.velocity


@pytest.fixture
async def spoken(interfaces: Path) -> AsyncIterator[Spoken]:
    async with node(free_domain()) as link:
        spoken = Spoken(link)
        link.open()
        yield spoken


async def test_a_scan_with_a_stamp_from_the_future_is_as_old_as_its_message(spoken: Spoken) -> None:
    spoken.laser_is_at(Pose(0.0, 0.0, 0.0))
    await spoken.say_scan(ahead=60.0)
    first = spoken.senses.scan()
    assert first.time <= time.time()
    await eventually(lambda: time.time() - spoken.senses.scan().time > 0.2, "the scan to be old")
    assert spoken.senses.scan() == first


async def test_a_clock_that_is_set_back_makes_no_laser_young(spoken: Spoken, monkeypatch: pytest.MonkeyPatch) -> None:
    spoken.laser_is_at(Pose(0.0, 0.0, 0.0))
    await spoken.say_scan()
    monkeypatch.setattr(spoken.senses, "clock", lambda: time.time() - 60)
    await eventually(lambda: spoken.senses.clock() - spoken.senses.scan().time > 0.2, "the scan to be old")


async def test_a_laser_that_is_nobody_knows_where_has_no_readings_until_somebody_does(spoken: Spoken) -> None:
    await spoken.say_scan()
    assert spoken.senses.scan().ranges == []
    spoken.laser_is_at(Pose(0.2, 0.0, 0.0))
    assert spoken.senses.scan().ranges


async def test_a_speed_is_as_old_as_its_stamp_and_without_one_as_its_message(spoken: Spoken) -> None:
    now = time.time()
    assert (await spoken.say_odometry(now - 5)).stamp == pytest.approx(now - 5, abs=1e-3)
    assert (await spoken.say_odometry(now - 4)).stamp == pytest.approx(now - 4, abs=1e-3)
    heard = await spoken.say_odometry(0.0)
    assert now < heard.stamp <= time.time()
    assert heard.stamp < (await spoken.say_odometry(0.0)).stamp <= time.time()
    assert (await spoken.say_odometry(now - 3)).stamp == pytest.approx(now - 3, abs=1e-3)
    assert (await spoken.say_odometry(now + 1e6)).stamp <= time.time()


async def test_a_battery_in_percent_stays_one_at_its_end(spoken: Spoken) -> None:
    from sensor_msgs.msg import BatteryState

    await eventually(spoken.batteries.get_subscription_count, "somebody who listens to the battery")
    for percentage, level in ((2.0, 0.02), (1.0, 0.01)):
        spoken.batteries.publish(BatteryState(percentage=percentage))
        await eventually(
            lambda wanted=level: spoken.senses.battery and spoken.senses.battery.level == pytest.approx(wanted),
            f"a battery at {level:.0%}",
        )


async def test_a_map_comes_with_its_distances(spoken: Spoken) -> None:
    from nav_msgs.msg import OccupancyGrid

    message = OccupancyGrid(data=[0] * 6)
    message.info.width, message.info.height, message.info.resolution = 3, 2, 0.5
    message.info.origin.orientation.w = 1.0
    spoken.maps.publish(message)
    await eventually(lambda: spoken.senses.grid, "the map")
    assert "distance" in vars(spoken.senses.grid)


async def test_a_robot_that_stands_is_where_it_came_to_rest_however_many_transforms_wait(interfaces: Path) -> None:
    from geometry_msgs.msg import TransformStamped
    from nav_msgs.msg import Odometry
    from rclpy.duration import Duration
    from tf2_msgs.msg import TFMessage

    seen: list[tuple[Twist, Pose]] = []
    async with node(free_domain()) as link:
        spoken = Spoken(link)
        senses, frames = spoken.senses, link.node.create_publisher(TFMessage, "/tf", 100)
        # Made after those of the senses: it is called after them for the same message.
        link.node.create_subscription(
            Odometry, "odom", lambda _: seen.append((senses.velocity.twist, senses.fix.pose)), 1
        )
        link.open()
        await eventually(frames.get_subscription_count, "somebody who listens to transforms")
        await eventually(lambda: spoken.odometry.get_subscription_count() == 2, "both who listen to odometry")
        with busy(link):
            for step in range(20):
                message = TransformStamped(child_frame_id="base_link")
                message.header.frame_id = "map"
                message.transform.translation.x, message.transform.rotation.w = step / 100, 1.0
                frames.publish(TFMessage(transforms=[message]))
            assert frames.wait_for_all_acked(Duration(seconds=10))
            spoken.odometry.publish(Odometry())
        await eventually(lambda: seen, "the odometry")
        assert seen[0] == (Twist(0.0, 0.0), Pose(0.19, 0.0, 0.0))
