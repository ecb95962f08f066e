"""While it moves, the robot is looked at all the time: what it should not do ends its motion, whatever robot it is.

The robots here are the simulated one, with one thing wrong each.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import numpy as np
import pytest

from backend.config import Limits, Simulator
from backend.mcp_robot.motion import guard
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import Fix, Route, Velocity
from backend.mcp_robot.simulator.battery import Accumulator
from backend.mcp_robot.simulator.simulated_robot import LARGEST_LAG, SimulatedRobot
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose, Scan, Twist, Zone

LAB = Pose(11.8, 4.0, 0.0)
RADIUS = 0.25


class Faulty(SimulatedRobot):
    """A simulated robot whose word can be changed on the way: `fault` is what happens to each thing it tells."""

    def __init__(self, world: World, limits: Limits, time_scale: float = 4.0) -> None:
        super().__init__(world, limits, time_scale=time_scale)
        self.faulty = False  # set by a test
        self.pilot: Pilot | None = None  # who drives it, set by `driving`
        self.wrong_clock: Callable[[float], float] = lambda now: now
        self.wrong_fix: Callable[[Fix], Fix] = lambda fix: fix
        self.wrong_scan: Callable[[Scan], Scan] = lambda scan: scan
        self.other_way: list[tuple[float, float]] | None = None

    def clock(self) -> float:
        now = super().clock()
        return self.wrong_clock(now) if self.faulty else now

    @property
    def velocity(self) -> Velocity:
        return Velocity(self.simulation.twist, super().clock())

    @property
    def fix(self) -> Fix:
        fix = super().fix
        return self.wrong_fix(fix) if self.faulty else fix

    def scan(self) -> Scan:
        scan = super().scan()
        return self.wrong_scan(scan) if self.faulty else scan

    async def drive(self, route: Route) -> None:
        if self.other_way:
            points = np.linspace(self.other_way[0], self.other_way[-1], 100)
            route = Route(tuple((x, y) for x, y in points.tolist()), route.length, route.seconds, route.goal, False)
        await super().drive(route)


@contextlib.asynccontextmanager
async def driving(robot: Faulty, pilot: Pilot, goal: Pose = LAB) -> AsyncIterator[asyncio.Task[object]]:
    """Inside, the robot is on its way and moves."""
    robot.pilot = pilot
    async with robot.running():
        task: asyncio.Task[object] = asyncio.create_task(pilot.navigate(goal, final_yaw=False))
        while robot.velocity.twist.linear < 0.3 and not task.done():
            await asyncio.sleep(0)
        yield task


async def refusal_of(task: asyncio.Task[object], robot: Faulty) -> str:
    """The code that the motion ends with; the robot is at rest by then, and telemetry tells why."""
    with pytest.raises(Refusal) as refused:
        await task
    assert robot.velocity.twist == Twist(0.0, 0.0)
    assert robot.remaining is None
    halted = robot.pilot and robot.pilot.state().halted
    assert halted is not None
    assert (halted.code, halted.text) == (refused.value.code, refused.value.sentence)
    assert halted.at == pytest.approx(time.time(), abs=30)
    return refused.value.code


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (lambda fix: Fix(Pose(math.nan, 0.0, 0.0), fix.stamp, fix.source), "lost"),
        (lambda fix: Fix(fix.pose, fix.stamp - 1.5, fix.source), "lost"),
        (lambda fix: Fix(Pose(99.0, 0.0, 0.0), fix.stamp, fix.source), "outside_map"),
        (lambda fix: Fix(Pose(5.6, 3.0, 0.0), fix.stamp, fix.source), "occupied"),
    ],
    ids=["no number", "old", "off the map", "in a wall"],
)
async def test_a_robot_that_is_not_where_it_can_be(
    office: World, tmp_path: Path, wrong: Callable[[Fix], Fix], code: str
) -> None:
    robot = Faulty(office, Limits())
    robot.wrong_fix = wrong
    async with driving(robot, Pilot(robot, StopLatch(tmp_path), Limits())) as task:
        robot.faulty = True
        assert await refusal_of(task, robot) == code


@pytest.mark.parametrize(
    ("allowed", "words"),
    [
        (Limits(max_speed=0.2), "moved with"),
        (Limits(max_turn_rate=0.2), "rad/s, over 0.2"),
        (Limits(max_acceleration=0.05), "gained speed"),
    ],
)
async def test_a_robot_that_keeps_other_limits_than_it_should(
    office: World, tmp_path: Path, allowed: Limits, words: str
) -> None:
    robot = Faulty(office, Limits(max_acceleration=2.0), time_scale=2.0)
    async with driving(robot, Pilot(robot, StopLatch(tmp_path), allowed), Pose(0.9, 4.5, 0.0)) as task:
        with pytest.raises(Refusal, match=rf"^too_fast: .*{words}"):
            await task
        assert robot.velocity.twist == Twist(0.0, 0.0)


async def test_a_speed_that_is_heard_late_is_no_acceleration(office: World, tmp_path: Path) -> None:
    robot = Faulty(office, Limits())
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    began = robot.clock()
    robot.wrong_clock = lambda now: began if robot.velocity.twist.linear < 0.5 else now
    robot.faulty = True
    async with driving(robot, pilot, Pose(2.9, 3.1, 0.0)) as task:
        await task


async def test_a_robot_that_takes_another_way_than_it_said_through_a_keep_out_zone(
    office: World, tmp_path: Path
) -> None:
    robot = Faulty(office, Limits(), time_scale=1.0)  # how far it gets is a matter of the wall's time
    zone = Zone("wet floor", [(2.5, 2.6), (3.5, 2.6), (3.5, 3.6), (2.5, 3.6)])
    robot.other_way = [(0.9, 3.1), (4.0, 3.1)]
    goal = Pose(1.8, 3.1, 0.0)
    async with driving(robot, Pilot(robot, StopLatch(tmp_path), Limits(), [zone]), goal) as task:
        assert await refusal_of(task, robot) == "keep_out"
    unseen = LARGEST_LAG * Limits().max_speed  # what it may drive at once after the machine stood
    assert robot.fix.pose.x < 2.5 - RADIUS + 0.2 + unseen


async def test_something_in_the_way_that_the_robot_itself_does_not_stop_for(office: World, tmp_path: Path) -> None:
    def somebody(scan: Scan) -> Scan:
        ahead = [0.28 if abs(scan.angle_min + i * scan.angle_increment) < 0.1 else r for i, r in enumerate(scan.ranges)]
        return Scan(scan.time, scan.pose, scan.angle_min, scan.angle_increment, scan.range_max, ahead)

    robot = Faulty(office, Limits())
    robot.wrong_scan = somebody
    async with driving(robot, Pilot(robot, StopLatch(tmp_path), Limits())) as task:
        robot.faulty = True
        assert await refusal_of(task, robot) == "blocked"


async def test_a_laser_that_has_fallen_silent(office: World, tmp_path: Path) -> None:
    robot = Faulty(office, Limits())
    robot.wrong_scan = lambda s: Scan(
        s.time - 2, s.pose, s.angle_min, s.angle_increment, s.range_max, [9.0] * len(s.ranges)
    )
    async with driving(robot, Pilot(robot, StopLatch(tmp_path), Limits())) as task:
        robot.faulty = True
        assert await refusal_of(task, robot) == "blind"


@pytest.mark.parametrize(("level", "ends"), [(0.049, True), (0.051, False)])
async def test_a_battery_at_half_its_floor_ends_the_motion(
    office: World, tmp_path: Path, level: float, ends: bool
) -> None:
    robot = Faulty(office, Limits())
    async with driving(robot, Pilot(robot, StopLatch(tmp_path), Limits()), Pose(2.9, 3.1, 0.0)) as task:
        robot.simulation.battery = Accumulator(level)
        if ends:
            assert await refusal_of(task, robot) == "battery_low"
        else:
            await task


async def test_a_battery_that_low_still_takes_it_to_its_dock(office: World, tmp_path: Path) -> None:
    robot = Faulty(office, Limits())
    robot.simulation.pose = Pose(2.9, 3.1, math.pi)
    dock = next(place.pose for place in office.places.places if place.kind == "docking")
    async with driving(robot, Pilot(robot, StopLatch(tmp_path), Limits()), dock) as task:
        robot.simulation.battery = Accumulator(0.01)
        await task


async def test_another_way_that_is_refused_ends_the_motion(office: World, tmp_path: Path) -> None:
    robot = Faulty(office, Limits())
    zone = Zone("stairs", [(10.0, 6.4), (11.0, 6.4), (11.0, 7.6), (10.0, 7.6)])
    pilot = Pilot(robot, StopLatch(tmp_path), Limits(), [zone])
    async with driving(robot, pilot, Pose(2.9, 3.1, 0.0)) as task:
        pilot.rerouted(np.linspace((1.0, 3.1), (2.9, 3.2), 50))
        assert pilot.path.points[-1] == pytest.approx((2.9, 3.2))
        pilot.rerouted(np.linspace((9.0, 7.0), (12.0, 7.0), 50))
        assert await refusal_of(task, robot) == "keep_out"


def scan_with(points: list[tuple[float, float]]) -> Scan:
    """What a laser sees of a few points in the robot's frame."""
    ranges = [12.0] * 360
    for x, y in points:
        ranges[round((math.atan2(y, x) + math.pi) / (math.tau / 360)) % 360] = math.hypot(x, y)
    return Scan(0.0, Pose(0, 0, 0), -math.pi, math.tau / 360, 12.0, ranges)


@pytest.mark.parametrize(
    ("twist", "point", "blocked"),
    [
        (Twist(0.6, 0.0), (0.33, 0.0), True),
        (Twist(0.6, 0.0), (0.45, 0.0), False),
        (Twist(0.6, 0.0), (0.05, 0.27), False),
        (Twist(0.6, 0.0), (-0.28, 0.0), False),
        (Twist(-0.3, 0.0), (-0.27, 0.0), True),
        (Twist(0.0, 1.2), (0.26, 0.0), False),
        (Twist(1.5, 0.0), (0.6, 0.0), True),
        (Twist(1.5, 2.0), (0.6, -0.12), False),
        (Twist(1.5, 0.0), (0.6, -0.12), True),
        (Twist(0.6, 0.0), (0.1, 0.0), False),
    ],
    ids=[
        "before it", "far enough", "beside it", "behind it", "behind, driving backwards", "turning on the spot",
        "farther at speed", "passed by an arc", "not passed straight on", "its own body",
    ],
)  # fmt: skip
def test_only_what_lies_on_the_floor_that_it_needs_to_stop_is_in_its_way(
    twist: Twist, point: tuple[float, float], blocked: bool
) -> None:
    expected = pytest.raises(Refusal, match=r"^blocked: ") if blocked else contextlib.nullcontext()
    with expected:
        guard.way_is_free(scan_with([point]), 0.0, twist, RADIUS, Limits())


@pytest.mark.parametrize(("age", "blocked"), [(0.0, False), (0.3, True), (-5.0, False)])
def test_an_old_scan_makes_the_way_longer_that_has_to_be_free(age: float, blocked: bool) -> None:
    expected = pytest.raises(Refusal, match=r"^blocked: ") if blocked else contextlib.nullcontext()
    with expected:
        guard.way_is_free(scan_with([(0.45, 0.0)]), age, Twist(0.6, 0.0), RADIUS, Limits())


def test_a_scan_without_readings_is_no_free_floor() -> None:
    with pytest.raises(Refusal, match=r"^blind: The laser has no readings"):
        guard.sighted(Scan(10.0, Pose(0, 0, 0), -math.pi, math.tau, 0.0, []), 10.0, Limits())


async def test_a_robot_that_gives_up_before_a_closed_door_is_told_as_halted(office: World, tmp_path: Path) -> None:
    robot = SimulatedRobot(office, Limits(), time_scale=20.0, settings=Simulator(closed_doors=["lab-2.3.6"]))
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    async with robot.running():
        with pytest.raises(Refusal, match=r"^blocked: "):
            await pilot.navigate(Pose(7.2, 4.0, 0.0), final_yaw=False)
        halted = pilot.state().halted
        assert halted is not None
        assert halted.code == "blocked"


@pytest.mark.slow
async def test_a_robot_that_does_nothing_wrong_never_hears_of_the_guard(office: World, tmp_path: Path) -> None:
    robot = SimulatedRobot(office, Limits(), time_scale=20.0)
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    async with robot.running():
        for place in office.places.places:
            _, leg = await pilot.navigate(place.pose, final_yaw=True)
            assert math.hypot(leg.pose.x - place.pose.x, leg.pose.y - place.pose.y) < 0.1
