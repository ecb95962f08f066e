"""People walk about, are seen and block the way; the robot waits or goes round, and nobody touches anybody."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from backend.config import Limits, Simulator
from backend.mcp_robot.simulator import pedestrians
from backend.mcp_robot.simulator.pedestrians import Pedestrian, Pedestrians, Round
from backend.mcp_robot.simulator.simulation import FOOTPRINT_RADIUS, STEP, Simulation
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose


def standing_at(x: float, y: float) -> Pedestrians:
    """Somebody who stays there."""
    way = Round([(x, y), (x + 0.05, y)], frozenset())
    return Pedestrians([Pedestrian(way, 0.0, 1.0, 5.0, pausing=math.inf)], np.random.default_rng(0))


def busy(office: World, seed: int, count: int = 6) -> Simulation:
    return Simulation(office, Limits(), seed=seed, settings=Simulator(people=count))


def test_nobody_is_there_unless_asked_for(office: World) -> None:
    assert Simulation(office, Limits()).environment.people.poses == []


@pytest.mark.parametrize("seed", range(3))
def test_people_walk_at_a_walking_pace_clear_of_walls_and_each_other(office: World, seed: int) -> None:
    simulation = busy(office, seed)
    crowd, begin = simulation.environment.people, simulation.environment.people.poses[:]
    assert len(begin) == 6
    walked = [0.0] * 6
    for _ in range(3000):
        before = crowd.poses[:]
        simulation.step()
        for index, (old, new) in enumerate(zip(before, crowd.poses, strict=True)):
            way = math.hypot(new.x - old.x, new.y - old.y)
            walked[index] += way
            assert way <= pedestrians.HURRY * STEP + 1e-9
            assert office.grid.clearance(new.x, new.y) >= pedestrians.RADIUS
        for one, other in itertools.combinations(crowd.poses, 2):
            assert math.hypot(one.x - other.x, one.y - other.y) >= 2 * pedestrians.RADIUS
    assert sum(way > 10.0 for way in walked) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_the_robot_gets_about_among_people_and_none_of_them_touches_it(office: World, seed: int) -> None:
    simulation = busy(office, seed)
    outcomes = []
    for place in ("kitchen", "lab-2.3.2", "lab-2.3.7", "lab-2.3.5"):
        goal = next(p.pose for p in office.places.places if p.id == place)
        drive = simulation.drive_to(goal)
        while drive.outcome == "running":
            simulation.step()
            assert simulation.environment.people.clearance(simulation.pose.x, simulation.pose.y) > FOOTPRINT_RADIUS
            assert simulation.clearance > 0.0
        outcomes.append(drive.outcome)
    assert outcomes.count("reached") >= 3


def test_a_person_never_walks_into_a_robot_that_stands_in_the_way(office: World) -> None:
    simulation = Simulation(office, Limits())
    simulation.pose = Pose(12.0, 7.0, 0.0)
    way = Round([(x, 7.0) for x in np.arange(8.0, 16.0, 0.05)] + [(15.95, 7.0)], frozenset())
    walker = Pedestrian(way, 0.0, 1.2, patience=3.0)
    crowd = simulation.environment.people = Pedestrians([walker], np.random.default_rng(0))
    turned = False
    for _ in range(1000):
        simulation.step()
        assert crowd.clearance(12.0, 7.0) >= FOOTPRINT_RADIUS + pedestrians.PERSONAL_SPACE - 0.01
        turned = turned or walker.direction < 0 or crowd.poses[0].x > 12.5
    assert turned  # it stepped aside and went past, or went back


def test_the_robot_drives_round_somebody_who_stands_in_the_corridor(office: World) -> None:
    simulation = Simulation(office, Limits())
    simulation.pose = Pose(6.5, 7.0, 0.0)
    simulation.environment.people = standing_at(10.0, 7.2)
    drive = simulation.drive_to(Pose(13.0, 7.0, 0.0))
    while drive.outcome == "running":
        simulation.step()
        assert simulation.clearance > 0.0
    assert drive.outcome == "reached"


def test_somebody_who_stands_in_the_only_door_is_waited_for_and_then_it_is_blocked(office: World) -> None:
    simulation = Simulation(office, Limits())
    simulation.pose = Pose(11.6, 7.0, -math.pi / 2)
    simulation.environment.people = standing_at(11.6, 5.9)
    drive = simulation.drive_to(Pose(11.8, 4.0, 0.0))
    while drive.outcome == "running":
        simulation.step()
        assert simulation.clearance > 0.0
    assert drive.outcome == "blocked"
    assert simulation.at_rest
    assert simulation.elapsed >= 10.0


def test_a_robot_that_waits_goes_on_when_the_door_is_free_again(office: World) -> None:
    simulation = Simulation(office, Limits())
    simulation.pose = Pose(11.6, 7.0, -math.pi / 2)
    simulation.environment.people = standing_at(11.6, 5.9)
    drive = simulation.drive_to(Pose(11.8, 4.0, 0.0))
    while drive.waiting < 3.0:
        simulation.step()
    simulation.environment.people = Pedestrians([], np.random.default_rng(0))
    while drive.outcome == "running":
        simulation.step()
    assert drive.outcome == "reached"


def test_the_same_seed_gives_the_same_people_and_another_one_others(office: World) -> None:
    def walk(seed: int) -> list[Pose]:
        simulation = busy(office, seed, 3)
        for _ in range(500):
            simulation.step()
        return simulation.environment.people.poses

    assert walk(1) == walk(1)
    assert walk(1) != walk(2)
