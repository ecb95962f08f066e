"""What was asked for before a stop never begins after it, even when the stop was released meanwhile."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from backend.config import Limits
from backend.mcp_robot.motion.path_preview import PathPreview
from backend.mcp_robot.motion.pilot import MOST_WAITING_PLANS, Pilot
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import Fix, Route, Sound, Velocity
from backend.mcp_robot.simulator.simulated_robot import SimulatedRobot
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose
from tests.processes import eventually

KITCHEN = Pose(2.9, 9.7, 0.0)


class Thoughtful(SimulatedRobot):
    """A simulated robot that plans and finds its voice only when it is let."""

    def __init__(self, world: World) -> None:
        super().__init__(world, Limits(), time_scale=20.0)
        self.asked, self.let = asyncio.Event(), asyncio.Event()

    async def plan(self, goal: Pose, *, final_yaw: bool) -> Route:
        self.asked.set()
        await self.let.wait()
        return await super().plan(goal, final_yaw=final_yaw)

    async def synthesize(self, text: str) -> Sound:
        self.asked.set()
        await self.let.wait()
        return await super().synthesize(text)


@pytest.fixture
async def robot(office: World) -> AsyncIterator[Thoughtful]:
    robot = Thoughtful(office)
    async with robot.running():
        yield robot


async def test_so_many_paths_are_asked_for_at_once_and_a_drive_all_the_same(robot: Thoughtful, tmp_path: Path) -> None:
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    plans = [asyncio.create_task(pilot.plan(KITCHEN, final_yaw=False)) for _ in range(MOST_WAITING_PLANS)]
    await robot.asked.wait()
    with pytest.raises(Refusal, match=r"^busy: 50 paths are being planned already"):
        await pilot.plan(KITCHEN, final_yaw=False)
    drive = asyncio.create_task(pilot.navigate(Pose(1.4, 3.1, 0.0), final_yaw=False))
    robot.let.set()
    await drive
    await asyncio.gather(*plans)
    await pilot.plan(KITCHEN, final_yaw=False)


@pytest.mark.parametrize("released", [True, False])
@pytest.mark.parametrize("act", ["drive", "speak"])
async def test_a_stop_while_it_thinks_ends_what_was_asked_even_if_released(
    robot: Thoughtful, tmp_path: Path, act: str, released: bool
) -> None:
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    asked = pilot.navigate(KITCHEN, final_yaw=False) if act == "drive" else pilot.speak("Hello")
    task = asyncio.ensure_future(asked)
    await robot.asked.wait()
    pilot.stop("Ana")
    if released:
        pilot.release("Ana")
    robot.let.set()
    with pytest.raises(Refusal, match=r"^stopped: "):
        await task
    assert robot.odometer == 0
    assert pilot.speech is None
    assert pilot.motion is None


async def test_cancelling_while_it_plans_leaves_the_robot_free_for_the_next(robot: Thoughtful, tmp_path: Path) -> None:
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    task = asyncio.create_task(pilot.navigate(KITCHEN, final_yaw=False))
    await robot.asked.wait()
    with pytest.raises(Refusal, match=r"^busy: The robot is driving to \(2.9, 9.7\) already"):
        await pilot.rotate(10)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await pilot.rotate(10)
    assert robot.odometer == 0


async def test_a_preview_that_is_taken_back_while_it_is_computed_is_never_drawn(
    robot: Thoughtful, tmp_path: Path
) -> None:
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    late = asyncio.create_task(pilot.plan(KITCHEN, final_yaw=False, preview=PathPreview("a.1")))
    await robot.asked.wait()
    assert pilot.forget_preview("a.1") is None
    robot.let.set()
    await late
    assert not pilot.path.points


async def test_a_preview_that_a_newer_one_overtakes_is_never_drawn(robot: Thoughtful, tmp_path: Path) -> None:
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    drawn: list[tuple[float, float]] = []
    pilot.on_change = lambda: drawn.extend(pilot.path.points[-1:])
    late = asyncio.create_task(pilot.plan(KITCHEN, final_yaw=False, preview=PathPreview("a.1")))
    await robot.asked.wait()
    robot.let.set()
    newer = asyncio.create_task(pilot.plan(Pose(3.0, 2.5, 0.0), final_yaw=False, preview=PathPreview("b.1")))
    await asyncio.gather(late, newer)
    assert pilot.path.preview
    assert len(drawn) == 1
    assert drawn[0] == pytest.approx((3.0, 2.5), abs=0.01)


@pytest.mark.parametrize("released", [True, False])
@pytest.mark.parametrize("end", ["stop", "brake"])
async def test_a_stop_in_the_tick_in_which_a_motion_begins_counts(
    office: World, tmp_path: Path, end: str, released: bool
) -> None:
    robot = SimulatedRobot(office, Limits(), time_scale=1.0)
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())

    def press() -> None:
        if end == "stop":
            pilot.stop("Ana")
        else:
            pilot.brake()
        if released:
            pilot.release("Ana")

    async with robot.running():
        task = asyncio.create_task(pilot.rotate(170))
        asyncio.get_running_loop().call_soon(press)
        with pytest.raises(Refusal, match=r"^stopped: "):
            await task
        assert robot.velocity.twist.angular == 0
        assert robot.fix.pose.yaw == pytest.approx(office.start.yaw, abs=0.05)


async def test_what_the_guard_refuses_at_its_first_look_does_not_begin(office: World, tmp_path: Path) -> None:
    class Blind(SimulatedRobot):
        @property
        def fix(self) -> Fix:
            fix = super().fix
            return Fix(Pose(math.nan, fix.pose.y, fix.pose.yaw), fix.stamp, fix.source) if self.lost_now else fix

        lost_now = False

        async def turn(self, angle: float) -> None:
            raise AssertionError("it has begun")

    robot = Blind(office, Limits(), time_scale=20.0)
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    async with robot.running():
        robot.lost_now = True
        with pytest.raises(Refusal, match=r"^lost: "):
            await pilot.rotate(170)
    assert pilot.motion is None


async def test_a_robot_that_fails_to_halt_is_stopped_all_the_same(office: World, tmp_path: Path) -> None:
    class Deaf(SimulatedRobot):
        def halt(self) -> None:
            raise RuntimeError("no connection to the wheels")

    robot = Deaf(office, Limits(), time_scale=20.0)
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    pilot.stop("Ana")
    assert pilot.stopped is not None
    with pytest.raises(Refusal, match=r"^stopped: "):
        await pilot.rotate(10)
    assert StopLatch(tmp_path).stop == pilot.stopped


async def test_whoever_is_inside_hears_that_the_simulators_time_stands_still(office: World) -> None:
    robot = SimulatedRobot(office, Limits(), time_scale=1.0)

    async def inside() -> None:
        async with robot.running():
            robot.simulation.step = None  # type: ignore[assignment, method-assign]
            await asyncio.Event().wait()

    task = asyncio.create_task(inside())
    await asyncio.wait({task}, timeout=20)
    assert task.cancelled()


async def test_a_preview_that_nobody_withdraws_ends_by_itself(office: World, tmp_path: Path) -> None:
    pilot = Pilot(SimulatedRobot(office, Limits()), StopLatch(tmp_path), Limits(), preview_age=0.2)
    await pilot.plan(KITCHEN, final_yaw=False, preview=PathPreview("a.1"))
    assert pilot.path.preview
    await eventually(lambda: not pilot.path.preview, "the end of the preview")
    assert not pilot.path.points


async def test_a_state_that_says_at_rest_has_the_pose_of_the_rest(office: World, tmp_path: Path) -> None:
    """A robot may move on between two readings of its properties, as one that is read from another thread does."""

    class Moving(SimulatedRobot):
        @property
        def fix(self) -> Fix:
            now = super().fix
            self._come_to_rest()
            return now

        @property
        def velocity(self) -> Velocity:
            now = super().velocity
            self._come_to_rest()
            return now

        def _come_to_rest(self) -> None:
            self.simulation.halt()
            while not self.simulation.at_rest:
                self.simulation.step()

    robot = Moving(office, Limits())
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    robot.simulation.drive_to(KITCHEN)
    while robot.simulation.twist.linear < 0.3:
        robot.simulation.step()
    state = pilot.state()
    assert state.twist.linear > 0.0 or state.pose == robot.simulation.pose
