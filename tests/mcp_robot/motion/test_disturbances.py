"""Localisation noise and wheel slip: off by default, bounded, seeded, and the robot still hits nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from backend.config import Limits, Simulator
from backend.mcp_robot.navigation import follower
from backend.mcp_robot.simulator.disturbances import BOUND, Localisation, Slip
from backend.mcp_robot.simulator.simulation import Simulation
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose, Twist

ROUGH = Simulator(localisation_noise=0.04, heading_noise=0.02, wheel_slip=0.2)


def test_by_default_the_robot_knows_exactly_where_it_is(office: World) -> None:
    simulation = Simulation(office, Limits())
    drive = simulation.drive_to(Pose(3.2, 3.0, 0.0))
    while drive.outcome == "running":
        simulation.step()
        assert simulation.believed is simulation.pose


def test_the_error_of_the_position_grows_with_the_way_has_the_asked_size_and_is_bounded() -> None:
    scales = np.array([0.05, 0.05, 0.02])
    localisation = Localisation(0.05, 0.02, np.random.default_rng(4))
    assert localisation.believed(Pose(1.0, 2.0, 0.5)) == Pose(1.0, 2.0, 0.5)
    errors = []
    for _ in range(40_000):
        localisation.after(0.012, 0.0)
        believed = localisation.believed(Pose(1.0, 2.0, 0.5))
        errors.append((believed.x - 1.0, believed.y - 2.0, believed.yaw - 0.5))
    seen = np.array(errors)
    assert np.abs(seen[:10]).max() < 0.02
    assert (np.abs(seen) <= BOUND * scales + 1e-12).all()
    assert seen.std(axis=0) == pytest.approx(scales, rel=0.3)
    assert np.abs(np.diff(seen, axis=0)).max() < 0.02  # it does not jump


def test_a_robot_at_rest_does_not_lose_its_position() -> None:
    localisation = Localisation(0.05, 0.02, np.random.default_rng(4))
    localisation.after(5.0, 1.0)
    before = localisation.believed(Pose(0.0, 0.0, 0.0))
    for _ in range(100):
        localisation.after(0.0, 0.0)
    assert localisation.believed(Pose(0.0, 0.0, 0.0)) == before


def test_slipping_wheels_never_make_it_faster_than_they_turn() -> None:
    slip, wheels, limits = Slip(0.3, np.random.default_rng(2)), Twist(0.6, 0.8), Limits()
    moves = [slip.after(0.02, wheels, limits.max_turn_rate) for _ in range(5000)]
    speeds = np.array([move.linear for move in moves])
    assert (speeds <= wheels.linear).all()
    assert (speeds >= 0.7 * wheels.linear - 1e-9).all()
    assert speeds.std() > 0.01
    assert max(abs(move.angular) for move in moves) <= limits.max_turn_rate


@pytest.mark.parametrize("seed", range(4))
def test_with_all_of_it_the_robot_arrives_about_where_asked_and_touches_nothing(office: World, seed: int) -> None:
    simulation = Simulation(office, Limits(), seed=seed, settings=ROUGH)
    for name in ("kitchen", "lab 2.3.3", "lab 2.3.8"):
        goal = next(p.pose for p in office.places.places if p.name == name)
        drive = simulation.drive_to(goal)
        while drive.outcome == "running":
            simulation.step()
            assert simulation.clearance > 0.0
        assert drive.outcome == "reached"
        error = math.hypot(simulation.pose.x - goal.x, simulation.pose.y - goal.y)
        assert error < 0.1 + BOUND * math.hypot(0.04, 0.04)
        assert abs(follower.wrap(simulation.pose.yaw - goal.yaw)) < 0.05 + BOUND * 0.02


def test_what_the_noise_makes_of_the_walls_is_not_taken_for_obstacles(office: World) -> None:
    settings = Simulator(localisation_noise=0.04, heading_noise=0.02)
    simulation = Simulation(office, Limits(), seed=1, settings=settings)
    drive = simulation.drive_to(Pose(21.0, 4.0, 0.0))
    while drive.outcome == "running":
        simulation.step()
    assert drive.outcome == "reached"
    assert drive.rerouted == 0
