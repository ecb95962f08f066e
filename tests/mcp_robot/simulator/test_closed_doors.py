"""A door can be closed; the robot learns of it from its laser alone, and takes another way where there is one."""

from __future__ import annotations

import math

import pytest

from backend.config import Limits, Simulator
from backend.mcp_robot.navigation import planner
from backend.mcp_robot.navigation.grid import FREE, OCCUPIED
from backend.mcp_robot.simulator import world
from backend.mcp_robot.simulator.motions import Drive
from backend.mcp_robot.simulator.simulation import Simulation
from backend.mcp_robot.simulator.world import World, WorldError
from backend.telemetry import Pose


@pytest.fixture(scope="module")
def hospital() -> World:
    return world.load("hospital")


def place(building: World, name: str) -> Pose:
    return next(p.pose for p in building.places.places if p.name == name)


def drive(simulation: Simulation, goal: Pose) -> Drive:
    motion = simulation.drive_to(goal)
    while motion.outcome == "running":
        simulation.step()
        assert simulation.clearance > 0.0
    return motion


@pytest.mark.slow
@pytest.mark.parametrize("name", ["office", "hospital"])
def test_every_place_is_reached_through_open_doors_and_every_closed_door_shuts_its_way(name: str) -> None:
    building = world.load(name)
    shut = building.with_closed([door.id for door in building.doors])
    for door in building.doors:
        (x0, y0), (x1, y1) = door.start, door.end
        assert building.grid.state((x0 + x1) / 2, (y0 + y1) / 2) == FREE
        assert shut.grid.state((x0 + x1) / 2, (y0 + y1) / 2) == OCCUPIED
    start = building.start
    search = planner.search_grid(building.grid, 0.3)
    closed = planner.search_grid(shut.grid, 0.3)
    for goal in building.places.places:
        if goal.pose == start:
            continue
        ends = (start.x, start.y), (goal.pose.x, goal.pose.y)
        assert len(planner.plan(building.grid, search, *ends, 0.3)) > 2
        if "corridor" not in goal.name and goal.name not in ("reception", "lobby") and "link" not in goal.name:
            with pytest.raises(planner.Unreachable):
                planner.plan(shut.grid, closed, *ends, 0.3)


def test_the_distance_field_of_a_closed_door_is_that_of_the_whole_map(office: World) -> None:
    shut = office.with_closed(["lab-2.3.7", "kitchen"]).grid
    anew = type(shut)(shut.cells, shut.resolution, shut.origin_x, shut.origin_y)
    assert abs(shut.distance - anew.distance).max() < 1e-5


def test_a_robot_that_meets_a_closed_door_takes_the_other_one(hospital: World) -> None:
    # Room 103 has a door to the south corridor and one to the west link.
    simulation = Simulation(hospital, Limits(), settings=Simulator(closed_doors=["room-103"]))
    simulation.pose = Pose(2.0, 14.5, 0.0)  # too far to see that door from
    motion = drive(simulation, place(hospital, "room 103"))
    assert motion.outcome == "reached"
    assert motion.rerouted >= 1


def test_the_map_that_the_robot_has_knows_nothing_of_a_closed_door(office: World) -> None:
    simulation = Simulation(office, Limits(), settings=Simulator(closed_doors=["lab-2.3.7"]))
    assert simulation.floor is office.grid
    assert len(simulation.look()) == 0  # it stands at the dock and cannot see it
    simulation.pose = Pose(11.6, 7.0, -math.pi / 2)
    assert len(simulation.look()) > 0


def test_behind_the_only_door_when_it_is_closed_nothing_is_reached(office: World) -> None:
    simulation = Simulation(office, Limits(), settings=Simulator(closed_doors=["lab-2.3.7"]))
    assert drive(simulation, place(office, "lab 2.3.7")).outcome == "blocked"
    assert simulation.pose.y > 5.93


def test_a_door_that_closes_before_the_robot_stops_it_and_one_that_opens_lets_it_go_on(office: World) -> None:
    simulation = Simulation(office, Limits())
    simulation.pose = Pose(10.0, 7.0, 0.0)
    motion = simulation.drive_to(place(office, "lab 2.3.7"))
    simulation.close_door("lab-2.3.7")
    while motion.waiting < 3.0:
        simulation.step()
        assert simulation.clearance > 0.0
    simulation.open_door("lab-2.3.7")
    while motion.outcome == "running":
        simulation.step()
    assert motion.outcome == "reached"


def test_a_door_does_not_close_on_the_robot_and_an_unknown_one_is_refused(office: World) -> None:
    simulation = Simulation(office, Limits())
    simulation.pose = Pose(11.6, 6.0, 0.0)
    with pytest.raises(ValueError, match="Somebody stands in the door"):
        simulation.close_door("lab-2.3.7")
    assert simulation.environment.closed == frozenset()
    with pytest.raises(WorldError, match=r"no door 'cellar'.*lab-2\.3\.7"):
        simulation.close_door("cellar")
    with pytest.raises(WorldError, match="no door 'cellar'"):
        Simulation(office, Limits(), settings=Simulator(closed_doors=["cellar"]))
