"""The same seed gives the same states; a virtual clock runs as fast as the machine; no time is lost in silence."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from pathlib import Path

import pytest

from backend.config import Limits, Simulator
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.simulator.simulated_robot import SimulatedRobot
from backend.mcp_robot.simulator.simulation import Simulation
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose, Twist
from tests.mcp_robot.simulator.test_pedestrians import standing_at
from tests.processes import eventually

EVERYTHING = Simulator(people=4, localisation_noise=0.03, heading_noise=0.01, wheel_slip=0.1)
State = tuple[float, Pose, Twist, tuple[Pose, ...]]


def virtual(office: World, seed: int = 0, settings: Simulator | None = None) -> SimulatedRobot:
    return SimulatedRobot(office, Limits(), time_scale=math.inf, seed=seed, settings=settings)


def state(simulation: Simulation) -> State:
    return simulation.elapsed, simulation.pose, simulation.twist, tuple(simulation.environment.people.poses)


def run(office: World, seed: int) -> list[State]:
    simulation = Simulation(office, Limits(), seed=seed, settings=EVERYTHING)
    states = []
    for goal in (Pose(2.9, 9.7, 0.0), Pose(12.0, 7.0, 1.0)):
        drive = simulation.drive_to(goal)
        while drive.outcome == "running":
            simulation.step()
            states.append(state(simulation))
    return states


def test_the_same_seed_gives_the_same_states_bit_for_bit_and_another_seed_others(office: World) -> None:
    first = run(office, 5)
    assert first == run(office, 5)
    assert first != run(office, 6)


async def test_through_asyncio_the_virtual_clock_gives_the_same_states_too(office: World) -> None:
    async def session() -> list[State]:
        robot = virtual(office, 5, EVERYTHING)
        states = []
        async with robot.running():
            for goal in (Pose(2.9, 9.7, 0.0), Pose(12.0, 7.0, 1.0)):
                route = await robot.plan(goal, final_yaw=True)
                await robot.drive(route)
                states.append(state(robot.simulation))
            await robot.turn(1.0)
            states.append(state(robot.simulation))
        return states

    assert await session() == await session()


async def test_the_virtual_clock_does_not_wait_for_the_wall(office: World, monkeypatch: pytest.MonkeyPatch) -> None:
    def wait(*_: object, **__: object) -> None:
        raise AssertionError("it waits")

    robot = virtual(office)
    monkeypatch.setattr(asyncio.get_running_loop(), "call_at", wait)
    async with robot.running():
        await robot.drive(await robot.plan(Pose(21.0, 4.0, 0.0), final_yaw=True))
    assert robot.simulation.elapsed > 30.0


async def test_the_pilot_works_on_the_virtual_clock(office: World, tmp_path: Path) -> None:
    robot = virtual(office)
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    async with robot.running():
        _, leg = await pilot.navigate(Pose(3.2, 3.0, 0.0), final_yaw=False)
    assert leg.distance == pytest.approx(2.3, abs=0.2)
    assert leg.seconds > 3.0


async def test_a_closed_door_ends_a_drive_as_blocked_with_a_next_step(office: World) -> None:
    robot = virtual(office, settings=Simulator(closed_doors=["lab-2.3.7"]))
    async with robot.running():
        route = await robot.plan(Pose(11.8, 4.0, 0.0), final_yaw=True)
        with pytest.raises(Refusal, match=r"^blocked: .*no other way.*Take a photo"):
            await robot.drive(route)


@pytest.mark.slow
@pytest.mark.parametrize("time_scale", [math.inf, 4.0])
async def test_another_way_is_told_to_whoever_shows_it(office: World, time_scale: float) -> None:
    robot = SimulatedRobot(office, Limits(), time_scale=time_scale, settings=Simulator())
    shown = []
    robot.on_reroute = shown.append
    robot.simulation.pose = Pose(6.6, 7.0, 0.0)
    async with robot.running():
        moving = asyncio.create_task(robot.drive(await robot.plan(Pose(20.0, 7.0, 0.0), final_yaw=True)))
        await eventually(lambda: robot.simulation.pose.x > 8.0, "the robot to be in the corridor")
        robot.simulation.environment.people = standing_at(robot.simulation.pose.x + 3.0, 7.0)
        await moving
    assert len(shown) >= 1


async def test_time_that_the_machine_is_too_slow_for_is_counted_and_told(
    office: World, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = SimulatedRobot(office, Limits(), time_scale=100.0)
    step = robot.simulation.step

    def slow_step() -> None:
        end = time.monotonic() + 0.005
        while time.monotonic() < end:  # a machine that is busy
            pass
        step()

    monkeypatch.setattr(robot.simulation, "step", slow_step)
    with caplog.at_level(logging.WARNING):
        async with robot.running():
            await eventually(lambda: robot.lost > 0.1, "time to be lost")
    assert "cannot keep up" in caplog.text
