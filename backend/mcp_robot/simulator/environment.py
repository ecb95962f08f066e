"""The simulated environment: the building with its doors open or closed, and the people in it.

This is the ground truth. The robot knows of it only what its laser, its camera and its bumper meet. Seeded, no clock.
"""

from __future__ import annotations

import numpy as np

from backend.config import Simulator
from backend.mcp_robot.navigation.grid import Floats
from backend.mcp_robot.simulator import pedestrians
from backend.mcp_robot.simulator.laser import Laser
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose

DOORWAY_CLEAR = 0.6
"""A door does not close while the robot or a person is nearer to it than this (m)."""


class Environment:
    """`building` is the world with its doors as they are now; `closed` are the ids of the doors that are closed."""

    def __init__(self, world: World, settings: Simulator, generator: np.random.Generator) -> None:
        self._world = world
        self._rays = settings.laser_rays
        self.closed: frozenset[str] = frozenset()
        self.building = world  # replaced, like laser, by a door that opens or closes
        self.laser = Laser(world.grid, self._rays)
        self._set_doors(frozenset(settings.closed_doors))
        places = [place.pose for place in world.places.places if place.kind == "space"]
        self.people = pedestrians.populate(self.building.grid, places, settings.people, world.start, generator)

    def close_door(self, door: str, robot: Pose) -> None:
        """Close a door. Raises `WorldError` for an unknown one, `ValueError` while the robot or a person is in it."""
        leaf = self._world.door(door)
        if any(leaf.distance(pose.x, pose.y) < DOORWAY_CLEAR for pose in (robot, *self.people.poses)):
            raise ValueError(f"Somebody stands in the door {door}.")
        self._set_doors(self.closed | {door})

    def open_door(self, door: str) -> None:
        """Open a door. Raises `WorldError` for an unknown one."""
        self._set_doors(self.closed - {self._world.door(door).id})

    def _set_doors(self, closed: frozenset[str]) -> None:
        if closed != self.closed:
            self.closed = closed
            self.building = self._world.with_closed(sorted(closed))
            self.laser = Laser(self.building.grid, self._rays)

    def step(self, dt: float, robot: Pose, keep: float) -> None:
        """People walk for `dt` s, nobody nearer to the robot than `keep` m and their personal space."""
        self.people.step(dt, self.building.grid.clearance, robot, keep)

    def clearance(self, x: float, y: float) -> float:
        """m of free space around a point: to walls, closed doors and people."""
        return min(self.building.grid.clearance(x, y), self.people.clearance(x, y))

    def scan(self, pose: Pose, noise: np.random.Generator | None = None, *, every: int = 1) -> Floats:
        """The laser's ranges in m at a true pose, of each ray or `every` nth."""
        return self.laser.scan(pose, self.people.discs, noise, every=every)
