"""The simulated robot drives within its limits and never into anything: whole drives, step by step, over many seeds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from backend.config import Limits, Simulator
from backend.mcp_robot.navigation import follower, planner
from backend.mcp_robot.simulator.motions import Drive, Turn
from backend.mcp_robot.simulator.simulation import FOOTPRINT_RADIUS, MAX_REROUTES, STEP, Simulation
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose, Twist

RADIUS = FOOTPRINT_RADIUS + 0.05
SLACK = 1e-9
LIMITS = [
    Limits(),
    Limits(max_speed=1.5, max_acceleration=2.0, max_turn_rate=2.0),
    Limits(max_speed=0.2, max_turn_rate=0.3, max_acceleration=0.2, max_turn_acceleration=0.5),
]


def free_goal(office: World, generator: np.random.Generator) -> Pose:
    while True:
        x, y = generator.uniform((0, 0), (24, 14))
        if office.grid.clearance(x, y) >= RADIUS:
            return Pose(x, y, generator.uniform(-math.pi, math.pi))


def drive_to(office: World, simulation: Simulation, goal: Pose, limits: Limits) -> Drive:
    search = planner.search_grid(office.grid, RADIUS)
    here = (simulation.pose.x, simulation.pose.y)
    path = planner.plan(office.grid, search, here, (goal.x, goal.y), RADIUS)
    return Drive(follower.track(path, goal, True, limits))


def step_within_limits(simulation: Simulation, limits: Limits, braking: bool = False) -> None:
    before = simulation.twist
    simulation.step()
    after = simulation.twist
    turn_braking = limits.max_turn_acceleration * limits.braking / limits.max_acceleration
    slower = limits.braking if braking else limits.max_acceleration
    turn = turn_braking if braking else limits.max_turn_acceleration
    assert 0.0 <= after.linear <= limits.max_speed + SLACK
    assert abs(after.angular) <= limits.max_turn_rate + SLACK
    assert -slower * STEP - SLACK <= after.linear - before.linear <= limits.max_acceleration * STEP + SLACK
    assert abs(after.angular - before.angular) <= turn * STEP + SLACK
    assert simulation.world.grid.clearance(simulation.pose.x, simulation.pose.y) >= FOOTPRINT_RADIUS


@pytest.mark.slow
@pytest.mark.parametrize("limits", LIMITS, ids=["usual", "fast", "slow"])
@pytest.mark.parametrize("seed", range(3))
def test_a_drive_arrives_where_asked_and_keeps_every_limit_and_its_distance_to_walls(
    office: World, limits: Limits, seed: int
) -> None:
    generator = np.random.default_rng(seed)
    simulation = Simulation(office, limits)
    arrived = 0
    for _ in range(4):
        goal = free_goal(office, generator)
        try:
            drive = drive_to(office, simulation, goal, limits)
        except planner.Unreachable:
            continue
        simulation.begin(drive)
        began, expected = simulation.elapsed, follower.remaining(drive.track, 0.0, simulation.pose, limits).seconds
        while drive.outcome == "running":
            step_within_limits(simulation, limits, braking=limits.max_speed > 1.0)
        assert drive.outcome == "reached"
        assert simulation.at_rest
        assert math.hypot(simulation.pose.x - goal.x, simulation.pose.y - goal.y) < 0.08
        assert abs(follower.wrap(simulation.pose.yaw - goal.yaw)) < 0.02
        assert simulation.elapsed - began == pytest.approx(expected, rel=0.4, abs=4.0)
        arrived += 1
    assert arrived >= 2


@pytest.mark.parametrize("seed", range(4))
def test_a_halt_stands_still_within_the_braking_time_wherever_it_comes(office: World, seed: int) -> None:
    generator, limits = np.random.default_rng(seed), Limits()
    simulation = Simulation(office, limits)
    drive = drive_to(office, simulation, Pose(18.0, 10.6, 0.0), limits)
    simulation.begin(drive)
    for _ in range(int(generator.integers(100, 1000))):
        step_within_limits(simulation, limits)
    speed = simulation.twist.linear
    assert speed > 0
    simulation.halt()
    steps = 0
    while not simulation.at_rest:
        step_within_limits(simulation, limits, braking=True)
        steps += 1
    assert steps * STEP <= max(speed / limits.braking, 0.1) + 2 * STEP
    simulation.step()
    assert drive.outcome == "halted"
    assert simulation.motion is None


def test_nothing_moves_again_after_a_halt(office: World) -> None:
    simulation = Simulation(office, Limits())
    simulation.begin(Turn(2.0))
    for _ in range(20):
        simulation.step()
    simulation.halt()
    for _ in range(50):
        simulation.step()
    pose = simulation.pose
    for _ in range(200):
        simulation.step()
    assert simulation.pose == pose


@pytest.mark.parametrize("angle", [math.pi / 2, -math.pi, 3 * math.tau, -0.05])
def test_a_turn_on_the_spot_turns_by_as_much_as_asked_and_stays_there(office: World, angle: float) -> None:
    limits = Limits()
    simulation = Simulation(office, limits)
    turn, before = Turn(angle), simulation.pose
    simulation.begin(turn)
    turned = 0.0
    while turn.outcome == "running":
        step_within_limits(simulation, limits)
        turned += simulation.twist.angular * STEP
    assert turn.outcome == "reached"
    assert turned == pytest.approx(angle, abs=0.011)
    assert (simulation.pose.x, simulation.pose.y) == (before.x, before.y)


def test_whatever_the_path_says_the_robot_stops_before_a_wall_and_gives_up(office: World) -> None:
    limits = Limits(max_speed=3.0, max_acceleration=3.0)
    simulation = Simulation(office, limits)
    path = np.linspace((0.9, 3.1), (12.0, 3.1), 200)  # straight through the wall at x = 5.6
    drive = Drive(follower.track(path, Pose(12.0, 3.1, 0.0), False, limits), rerouted=MAX_REROUTES)
    simulation.begin(drive)
    while drive.outcome == "running":
        step_within_limits(simulation, limits, braking=True)  # the protective stop brakes harder than driving
    assert drive.outcome == "blocked"
    assert simulation.at_rest
    assert simulation.pose.x < 5.6 - FOOTPRINT_RADIUS


def test_a_robot_that_was_put_at_a_wall_can_leave_it(office: World) -> None:
    limits = Limits()
    simulation = Simulation(office, limits)
    simulation.pose = Pose(10.0, 6.22, 0.0)  # nearer to the wall than its own radius
    drive = drive_to(office, simulation, Pose(12.0, 7.0, 0.0), limits)
    simulation.begin(drive)
    while drive.outcome == "running":
        simulation.step()
    assert drive.outcome == "reached"


def test_a_new_motion_ends_the_one_before(office: World) -> None:
    simulation = Simulation(office, Limits())
    first, second = Turn(3.0), Turn(0.1)
    simulation.begin(first)
    simulation.step()
    simulation.begin(second)
    assert first.outcome == "halted"
    while second.outcome == "running":
        simulation.step()
    assert second.outcome == "reached"


def test_the_same_steps_give_the_same_states(office: World) -> None:
    def run() -> list[Pose]:
        simulation = Simulation(office, Limits())
        simulation.begin(drive_to(office, simulation, Pose(6.6, 10.6, 1.0), Limits()))
        poses = []
        for _ in range(600):
            simulation.step()
            poses.append(simulation.pose)
        return poses

    assert run() == run()


def test_the_battery_drains_on_the_way_and_charges_at_the_dock(office: World) -> None:
    simulation = Simulation(office, Limits(), settings=Simulator(battery=0.5))
    simulation.step()
    assert simulation.battery.charging
    assert simulation.battery.level > 0.5
    drive = drive_to(office, simulation, Pose(12.0, 7.0, 0.0), Limits())
    simulation.begin(drive)
    simulation.step()
    level = simulation.battery.level
    while drive.outcome == "running":
        simulation.step()
    assert not simulation.battery.charging
    assert simulation.battery.level < level


def test_speech_lasts_as_long_as_its_sound_and_ends_when_hushed(office: World) -> None:
    simulation = Simulation(office, Limits())
    said = simulation.speak(0.5)
    for _ in range(24):
        simulation.step()
    assert said.outcome == "running"
    for _ in range(3):
        simulation.step()
    assert said.outcome == "reached"
    cut = simulation.speak(10.0)
    simulation.step()
    simulation.hush()
    assert cut.outcome == "halted"


@pytest.mark.parametrize("distance", [0.001, 0.01, 0.1, 1.0])
def test_from_the_stopping_speed_it_stops_within_the_distance(distance: float) -> None:
    speed = follower.stopping_speed(distance, 2.0, STEP)
    way, twist, limits = 0.0, Twist(speed, 0.0), Limits(max_speed=3.0, max_acceleration=2.0)
    while twist.linear > 0:
        way += twist.linear * STEP
        twist = follower.limited(twist, Twist(0.0, 0.0), limits, STEP)
    assert way <= distance + 2.0 * STEP**2 / 8  # a share of one step: it cannot be hit more exactly


@pytest.mark.parametrize("turn", [-1.5, 0.0, 0.4])
@pytest.mark.parametrize("braking", [0.5, 4.0])
def test_the_way_to_rest_that_it_reckons_with_is_the_one_that_it_goes(
    office: World, braking: float, turn: float
) -> None:
    simulation = Simulation(office, Limits(max_speed=1.5, max_turn_rate=2.0, braking=braking))
    simulation.pose, simulation.twist = Pose(12.0, 7.0, 0.3), Twist(0.6, turn)
    reckoned = list(simulation._way_to_rest(simulation.twist))
    simulation.pose = reckoned[0]  # after the time of its reaction
    simulation.halt()
    while not simulation.at_rest:
        simulation.step()
    there = reckoned[-2]  # before the margin
    assert math.hypot(simulation.pose.x - there.x, simulation.pose.y - there.y) < 0.02
