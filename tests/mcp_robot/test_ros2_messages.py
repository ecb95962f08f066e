"""What ROS messages become, and what is not believed: no ROS is needed to read them."""

from __future__ import annotations

import array
import io
import math
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from PIL import Image

from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, UNKNOWN
from backend.mcp_robot.ros2 import convert, failures, interface_definitions
from backend.mcp_robot.ros2.frames import Frames, Transform, compose, inverse
from backend.telemetry import Pose


def turned(yaw: float) -> Message:
    return Message(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))


def close(a: Pose, b: Pose) -> bool:
    return math.hypot(a.x - b.x, a.y - b.y) < 1e-9 and abs(math.remainder(a.yaw - b.yaw, math.tau)) < 1e-9


def test_a_chain_of_frames_is_composed_and_as_old_as_its_oldest_moving_link() -> None:
    frames = Frames()
    frames.put("odom", Transform("/map", Pose(1.0, 2.0, math.pi / 2), stamp=5.0, arrived=50.0))
    frames.put("base_link", Transform("odom", Pose(3.0, 0.0, 0.0), stamp=4.0, arrived=60.0))
    frames.put("laser", Transform("base_link", Pose(0.2, 0.0, math.pi), stamp=math.inf, arrived=math.inf))
    found = frames.find("/laser", "map")
    assert found is not None
    assert close(found.pose, Pose(1.0, 5.2, -math.pi / 2))
    assert (found.stamp, found.arrived) == (4.0, 50.0)


def test_frames_that_nothing_joins_and_frames_in_a_circle_are_not_found() -> None:
    frames = Frames()
    frames.put("a", Transform("b", Pose(0, 0, 0), 0.0, 0.0))
    frames.put("b", Transform("a", Pose(0, 0, 0), 0.0, 0.0))
    assert frames.find("a", "map") is None
    assert frames.find("base_link", "map") is None


@pytest.mark.parametrize("pose", [Pose(1.0, -2.0, 0.3), Pose(0.0, 0.0, -3.0), Pose(-4.0, 5.0, math.pi)])
def test_a_pose_after_its_inverse_is_the_origin(pose: Pose) -> None:
    assert close(compose(pose, inverse(pose)), Pose(0.0, 0.0, 0.0))


def grid_message(**changes: Any) -> Message:
    origin = Message(position=Message(x=-1.0, y=2.0), orientation=turned(changes.pop("turned", 0.0)))
    info = Message(width=3, height=2, resolution=float(np.float32(0.05)), origin=origin)
    vars(info).update(changes)
    return Message(info=info, data=array.array("b", [0, 100, -1, 19, 50, 65]))


def test_a_map_is_free_occupied_or_unknown_and_in_doubt_unknown() -> None:
    grid = convert.grid(grid_message())
    assert grid.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN], [FREE, UNKNOWN, OCCUPIED]]
    assert (grid.resolution, grid.origin_x, grid.origin_y) == (0.05, -1.0, 2.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 4},
        {"width": 0},
        {"resolution": 0.0},
        {"resolution": 1e-4},
        {"resolution": math.inf},
        {"resolution": math.nan},
        {"turned": 0.5},
        {"origin": Message(position=Message(x=1e300, y=0.0), orientation=turned(0.0))},
    ],
)
def test_a_map_that_does_not_fit_is_not_believed(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="a map"):
        convert.grid(grid_message(**changes))


@pytest.mark.parametrize("field", ["x", "y"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_pose_with_a_number_that_is_none_is_not_believed(field: str, value: float) -> None:
    position = Message(x=0.0, y=0.0)
    setattr(position, field, value)
    with pytest.raises(ValueError, match="a number that is none"):
        convert.pose(Message(position=position, orientation=turned(0.0)))


def test_a_scan_of_a_laser_that_sits_ahead_and_looks_back_is_seen_from_the_middle() -> None:
    message = Message(
        header=Message(stamp=Message(sec=7, nanosec=500_000_000)),
        angle_min=-math.pi,
        angle_increment=math.pi / 2,
        range_min=0.1,
        range_max=10.0,
        ranges=array.array("f", [1.0, math.inf, 2.0, 0.05]),  # behind, right, ahead, left in the laser's frame
    )
    scan = convert.scan(message, Pose(0.3, 0.0, math.pi), Pose(4.0, 5.0, 0.0))
    assert scan.time == 7.5
    assert scan.range_max == 10.0
    seen = {
        round(math.remainder(scan.angle_min + i * scan.angle_increment, math.tau), 1): distance
        for i, distance in enumerate(scan.ranges)
        if distance < scan.range_max
    }
    assert sorted(seen.values()) == [1.3, 1.7]  # 1 m ahead of the laser's back, 2 m behind its front


@pytest.mark.parametrize("sensor", [None, Pose(0.0, 0.0, 0.0), Pose(0.3, 0.0, math.pi)])
@pytest.mark.parametrize(
    "wrong",
    [
        {"ranges": array.array("f")},
        {"ranges": array.array("f", [math.nan, 0.0, -math.inf, 0.05])},
        {"ranges": array.array("f", [0.0, 0.0]), "range_min": 0.0},
        {"range_max": math.nan},
        {"angle_increment": 0.0},
    ],
)
def test_a_scan_that_cannot_be_used_has_no_readings(sensor: Pose | None, wrong: dict[str, Any]) -> None:
    header = Message(stamp=Message(sec=7, nanosec=0))
    usual = {"angle_min": -1.0, "angle_increment": 0.1, "range_min": 0.1, "range_max": 9.0}
    message = Message(header=header, ranges=array.array("f", [1.0]), **usual)
    if sensor:
        assert convert.scan(message, sensor, Pose(0.0, 0.0, 0.0)).ranges
        vars(message).update(wrong)
    assert convert.scan(message, sensor, Pose(0.0, 0.0, 0.0)).ranges == []


def test_a_driver_says_percent_when_it_has_said_more_than_a_share_can_be() -> None:
    assert convert.in_percent(Message(percentage=1.6))
    assert not convert.in_percent(Message(percentage=1.0))
    assert convert.battery(Message(percentage=1.0, power_supply_status=2), percent=True).level == 0.01


def test_a_battery_in_percent_and_one_without_a_number() -> None:
    assert convert.battery(Message(percentage=87.0, power_supply_status=1), percent=True).level == 0.87
    assert convert.battery(Message(percentage=0.5, power_supply_status=2), percent=False).charging is False
    with pytest.raises(ValueError, match="without a percentage"):
        convert.battery(Message(percentage=math.nan, power_supply_status=2), percent=False)


def test_pictures_of_several_encodings_become_the_same_jpeg() -> None:
    red = np.zeros((4, 6, 3), dtype=np.uint8)
    red[:, :, 0] = 255
    for encoding, pixels in (("rgb8", red), ("bgr8", red[:, :, ::-1])):
        message = Message(encoding=encoding, width=6, height=4, step=18, data=array.array("B", pixels.tobytes()))
        data, width, height = convert.jpeg(message)
        with Image.open(io.BytesIO(data)) as picture:
            assert picture.getpixel((3, 2))[0] > 240  # type: ignore[index]
        assert (width, height) == (6, 4)


def bomb() -> bytes:
    """A picture of few bytes and many pixels."""
    buffer = io.BytesIO()
    Image.new("1", (9000, 9000)).save(buffer, "PNG")
    return buffer.getvalue()


@pytest.mark.parametrize(
    "message",
    [
        Message(encoding="yuv422", width=2, height=2, step=4, data=b"12345678"),
        Message(encoding="rgb8", width=2, height=2, step=6, data=b"1234"),
        Message(encoding="rgb8", width=60_000, height=60_000, step=180_000, data=b"1234"),
        Message(format="jpeg", data=b"no picture"),
        Message(format="jpeg", data=b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n"),
        Message(format="jpeg", data=bytes(11_000_000)),
        Message(format="png", data=bomb()),
    ],
)
def test_a_picture_that_cannot_be_read_is_told(message: Message) -> None:
    with pytest.raises(ValueError, match="picture"):
        convert.jpeg(message)


def test_durations_are_split_into_seconds_and_nanoseconds() -> None:
    stamp = Message(sec=0, nanosec=0)
    convert.set_seconds(stamp, 1795240339.25)
    assert (stamp.sec, stamp.nanosec) == (1795240339, 250_000_000)
    assert convert.seconds(stamp) == 1795240339.25


def test_humbles_result_without_a_code_is_a_failure_all_the_same() -> None:
    assert failures.aborted("navigate_to_pose", Message()).code == "nav_failed"
    told = failures.aborted("navigate_to_pose", Message(error_code=209, error_msg=""))
    assert str(told) == "unreachable: navigate_to_pose gave up: no path leads there. Choose another goal."


def test_each_distribution_has_the_results_that_it_is_known_for() -> None:
    def result(distro: str) -> str:
        return interface_definitions.definitions("nav2_msgs", distro)["action/NavigateToPose.action"].split("---\n")[1]

    assert result("humble") == "std_msgs/Empty result\n"
    assert result("jazzy") == "uint16 error_code\n"
    assert result("kilted") == "uint16 error_code\nstring error_msg\n"
