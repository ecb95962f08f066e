"""What must hold in every world, from every pose, for every goal, whatever happens on the way.

Drives and turns in small worlds made up by hypothesis, step by step on the virtual clock: about a thousand, the same in
every run; in a deep run (`./test.sh --deep`) more than ten thousand, from a fresh seed that is printed. After every
step:

- the footprint, a circle around the true pose, overlaps no cell that is occupied or touched by a keep-out zone;
- no speed and no acceleration is over its limit;
- after a halt the robot is at rest within the distance and the time that its speed and its braking imply.

Things appear on the way, but none nearer than the robot then needs to stop: nobody could avoid that one. The
overlap is measured here by the cells' squares, not by the distance field that robot and planner use.
"""

from __future__ import annotations

import math
import os
import secrets
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from backend.config import Limits, Simulator
from backend.mcp_robot.motion import guard, keep_out, safety
from backend.mcp_robot.navigation import follower, planner
from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, Floats, OccupancyGrid
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import TopologicalMap
from backend.mcp_robot.simulator.laser import Laser
from backend.mcp_robot.simulator.motions import Drive, Turn
from backend.mcp_robot.simulator.simulation import BRAKING_MARGIN, FOOTPRINT_RADIUS, STEP, Simulation
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose, Twist, Zone
from tests.deep import DEEP

CASES = 10_000 if DEEP else 1_000
ENOUGH = 20 if DEEP else 1
"""So many motions at least have to end in each of the ways that matter, or the worlds are not varied enough."""
LEGS = 10
"""Goals in one made-up world: where one ends, the next one begins."""
PARTS = 5
"""Motions on the way to a goal at the most: all but the last are halted on the way, and begun again from there."""
LONGEST, LAST = 60, 150
"""Steps after which a motion, and the last one, is halted at the latest."""
SLACK = 1e-9
SIDE = 0.3
"""What appears on the way is a box of this size, in m."""


@dataclass(frozen=True)
class Leg:
    """What is asked for, and what happens: the robot is halted after so many steps, again and again, and a box appears
    in the part `appears`.

    The goal is `pick`, from 0 to 1, through all cells with room for it, or without that `anywhere`; or it is a `turn`.
    """

    pick: float | None
    anywhere: Pose
    turn: float | None
    halted: tuple[int, ...]
    appears: int
    box: tuple[float, float]


def uniform(low: float, high: float) -> st.SearchStrategy[float]:
    # Not st.floats: half of those are 0 and the ends, and the worlds are all alike.
    return st.integers(0, 1000).map(lambda part: low + (high - low) * part / 1000)


def made_up(draw: st.DrawFn) -> tuple[World, Limits, Simulator, list[Leg], int]:
    resolution = draw(st.sampled_from([0.05, 0.1]))
    width, height = draw(uniform(2.5, 5.0)), draw(uniform(2.5, 4.0))
    cells = np.full((round(height / resolution), round(width / resolution)), FREE, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    x0, y0 = draw(uniform(-3, 3)), draw(uniform(-3, 3))
    for _ in range(draw(st.integers(0, 4))):
        left, low = draw(uniform(0, width)), draw(uniform(0, height))
        wide, high = draw(uniform(0.05, 1.5)), draw(uniform(0.05, 1.5))
        rows = slice(int(low / resolution), int((low + high) / resolution) + 1)
        cells[rows, int(left / resolution) : int((left + wide) / resolution) + 1] = OCCUPIED
    zones = []
    for number in range(draw(st.integers(0, 2))):
        corners = [(x0 + draw(uniform(0, width)), y0 + draw(uniform(0, height))) for _ in range(3)]
        zones.append(Zone(f"zone {number}", corners))
    limits = Limits(
        max_speed=draw(uniform(0.1, 1.5)),
        max_turn_rate=draw(uniform(0.3, 3.0)),
        max_acceleration=draw(uniform(0.2, 3.0)),
        max_turn_acceleration=draw(uniform(0.5, 8.0)),
        braking=draw(uniform(0.5, 8.0)),
    )
    legs = [
        Leg(
            draw(st.none() | uniform(0, 1) | uniform(0, 1) | uniform(0, 1) | uniform(0, 1)),
            Pose(x0 + draw(uniform(-0.5, width + 0.5)), y0 + draw(uniform(-0.5, height + 0.5)), draw(uniform(-3, 3))),
            draw(st.none() | st.none() | st.none() | st.none() | st.none() | uniform(-7, 7)),
            (*(draw(st.integers(1, LONGEST)) for _ in range(PARTS - 1)), draw(st.integers(1, LAST))),
            draw(st.integers(0, 2 * PARTS)),
            (x0 + draw(uniform(0, width)), y0 + draw(uniform(0, height))),
        )
        for _ in range(LEGS)
    ]
    grid = OccupancyGrid(cells, resolution, x0, y0)
    world = World(grid, cells, TopologicalMap("map", (), ()), zones=tuple(zones))
    return (
        world,
        limits,
        Simulator(laser_rays=60, wheel_slip=draw(st.sampled_from([0.0, 0.2]))),
        legs,
        draw(st.integers(0, 9999)),
    )


class Witness:
    """Drives one leg after another in one world, and looks at every step."""

    def __init__(self, world: World, limits: Limits, disturbed: Simulator, seed: int) -> None:
        self.world = world
        self.limits = limits
        self.floor = keep_out.applied(world.grid, world.zones)
        self.simulation = Simulation(world, limits, seed=seed, settings=disturbed, floor=self.floor)
        self.forbidden = squares(self.floor)
        self.roomy = np.argwhere(self.floor.distance >= FOOTPRINT_RADIUS + 0.2).tolist()
        roomiest = np.unravel_index(int(np.argmax(self.floor.distance)), self.floor.distance.shape)
        self.simulation.pose = Pose(*centre(self.floor, int(roomiest[0]), int(roomiest[1])), 0.0)
        self.poses: list[Pose] = []  # since the last look at the footprint

    @property
    def fits(self) -> bool:
        """Whether there is room for a robot at all."""
        return self.simulation.clearance >= 0.0

    def drive(self, leg: Leg) -> list[str]:
        """Do one leg; returns how each of its motions ended, or why there was none."""
        motion: Drive | Turn
        try:
            motion = Turn(leg.turn) if leg.turn is not None else self.planned(self.goal(leg))
        except Refusal as refusal:
            return [refusal.code]
        except planner.Unreachable:
            return ["unreachable"]
        outcomes = []
        for part, steps in enumerate(leg.halted):
            self.simulation.begin(motion)
            for step in range(steps):
                if part == leg.appears and step == steps // 2:
                    self.appear(leg.box)
                self.step(self.limits.braking)
                if motion.outcome != "running":
                    break
            self.halt()
            self.look()
            outcomes.append(motion.outcome)
            if motion.outcome != "halted" or isinstance(motion, Turn):
                break
            motion = Drive(motion.track, motion.along)
        return outcomes

    def goal(self, leg: Leg) -> Pose:
        if leg.pick is None or not len(self.roomy):
            return leg.anywhere
        row, column = self.roomy[round(leg.pick * (len(self.roomy) - 1))]
        return Pose(*centre(self.floor, row, column), leg.anywhere.yaw)

    def planned(self, goal: Pose) -> Drive:
        """As the pilot does it: rules for the goal, a plan, rules for the path."""
        simulation, limits = self.simulation, self.limits
        safety.goal_keeps_out(self.world.zones, self.floor, goal, FOOTPRINT_RADIUS)
        safety.goal_is_free(self.floor, goal, FOOTPRINT_RADIUS)
        points = simulation.plan(simulation.believed, goal, simulation.look())
        safety.path_is_free(self.floor, self.world.zones, points, FOOTPRINT_RADIUS)
        return Drive(follower.track(points, goal, True, limits))

    def step(self, braking: float) -> None:
        limits, before = self.limits, self.simulation.twist
        self.simulation.step()
        after = self.simulation.twist
        harder = max(1.0, braking / limits.max_acceleration)
        assert 0.0 <= after.linear <= limits.max_speed + SLACK
        assert abs(after.angular) <= limits.max_turn_rate + SLACK
        gain = after.linear - before.linear
        assert -max(braking, limits.max_acceleration) * STEP - SLACK <= gain <= limits.max_acceleration * STEP + SLACK
        assert abs(after.angular - before.angular) <= limits.max_turn_acceleration * harder * STEP + SLACK
        guard.within_limits(after, limits)
        self.poses.append(self.simulation.pose)

    def halt(self) -> None:
        """Halt, and be at rest within what the limits imply: the way v²/2b, and one step of the control loop."""
        simulation, limits = self.simulation, self.limits
        twist, driven = simulation.twist, simulation.odometer
        turn_braking = limits.max_turn_acceleration * max(1.0, limits.braking / limits.max_acceleration)
        seconds = max(twist.linear / limits.braking, abs(twist.angular) / turn_braking)
        simulation.halt()
        for _ in range(math.ceil(seconds / STEP) + 1):
            self.step(limits.braking)
        assert simulation.twist == Twist(0.0, 0.0)
        assert simulation.odometer - driven <= twist.linear**2 / (2 * limits.braking) + twist.linear * STEP + SLACK
        self.step(limits.braking)
        assert simulation.motion is None

    def look(self) -> None:
        """No pose since the last look lets the footprint overlap what it must not."""
        if self.poses:
            poses = np.array([(pose.x, pose.y) for pose in self.poses])
            assert overlap(poses, self.forbidden, self.floor.resolution) <= SLACK
            last = self.poses[-1]
            guard.off_zones(self.world.zones, last, FOOTPRINT_RADIUS - SLACK)
        self.poses.clear()

    def appear(self, box: tuple[float, float]) -> None:
        """A box appears, unless it would be nearer to the robot than it needs to stop."""
        simulation, resolution = self.simulation, self.floor.resolution
        self.look()
        offsets = np.arange(0.0, SIDE, resolution / 2)
        dx, dy = (axis.ravel() for axis in np.meshgrid(offsets, offsets))
        points = np.stack([box[0] + dx, box[1] + dy], axis=1)
        building = simulation.environment.building
        changed = building.grid.with_occupied(points)
        new = squares(changed, changed.cells != building.grid.cells)
        speed = simulation.twist.linear
        way = speed * STEP + speed**2 / (2 * self.limits.braking) + BRAKING_MARGIN + 2 * resolution
        here = np.array([(simulation.pose.x, simulation.pose.y)])
        if overlap(here, new, resolution, FOOTPRINT_RADIUS + way) > 0.0:
            return
        simulation.environment.building = replace(building, grid=changed)
        simulation.environment.laser = Laser(changed, 60)
        self.forbidden = np.concatenate([self.forbidden, new])


def centre(grid: OccupancyGrid, row: int, column: int) -> tuple[float, float]:
    return grid.origin_x + (column + 0.5) * grid.resolution, grid.origin_y + (row + 0.5) * grid.resolution


def squares(grid: OccupancyGrid, cells: npt.NDArray[np.bool_] | None = None) -> Floats:
    """Centres of the cells that are not free, or of these."""
    rows, columns = np.nonzero(grid.cells != FREE if cells is None else cells)
    x = grid.origin_x + (columns + 0.5) * grid.resolution
    y = grid.origin_y + (rows + 0.5) * grid.resolution
    return np.stack([x, y], axis=1)


def overlap(poses: Floats, squares: Floats, resolution: float, radius: float = FOOTPRINT_RADIUS) -> float:
    """How deep in m a circle at the worst of these poses reaches into the nearest square; 0 for not at all."""
    if not len(squares):
        return 0.0
    gaps = np.maximum(np.abs(poses[:, None, :] - squares[None, :, :]) - resolution / 2, 0.0)
    nearest = math.sqrt(float(np.einsum("ijk,ijk->ij", gaps, gaps).min()))
    return max(0.0, radius - nearest)


@pytest.mark.slow
def test_motions_keep_the_footprint_free_the_limits_and_the_braking_distance() -> None:
    ended: dict[str, int] = {}
    chosen = int(os.environ.get("ROBOT_ACP_TEST_SEED") or secrets.randbits(32)) if DEEP else 0
    print(f"seed {chosen}; to run it again: ROBOT_ACP_TEST_DEEP=1 ROBOT_ACP_TEST_SEED={chosen}")

    @seed(chosen)
    @settings(
        max_examples=max(1, CASES // 24),
        deadline=None,
        database=None,
        phases=[Phase.generate],  # a failure can be run again as it is; to make it smaller takes minutes
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example],
    )
    @given(st.composite(made_up)())
    def holds(case: Any) -> None:
        world, limits, disturbed, legs, noise = case
        witness = Witness(world, limits, disturbed, noise)
        if not witness.fits:
            return
        for leg in legs:
            for outcome in witness.drive(leg):
                ended[outcome] = ended.get(outcome, 0) + 1

    began = time.perf_counter()
    holds()
    moved = sum(ended.get(outcome, 0) for outcome in ("reached", "halted", "blocked"))
    print(f"{moved} motions in {time.perf_counter() - began:.0f} s: {dict(sorted(ended.items()))}")
    assert moved >= CASES
    for outcome in ("reached", "halted", "occupied", "outside_map", "keep_out", "unreachable"):
        assert ended.get(outcome, 0) >= ENOUGH, f"hardly any motion ended as {outcome}"


def test_the_witness_sees_an_overlap() -> None:
    square = np.array([[1.0, 1.0]])
    assert overlap(np.array([[0.5, 1.0]]), square, 0.1, 0.25) == 0.0
    assert math.isclose(overlap(np.array([[0.75, 1.0]]), square, 0.1, 0.25), 0.05)
    corner = overlap(np.array([[0.8, 0.8]]), square, 0.1, 0.25)
    assert math.isclose(corner, 0.25 - 0.15 * math.sqrt(2))
