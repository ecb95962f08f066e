"""Builds the robot that the settings ask for. The only file that knows more than one kind of robot."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from typing import Protocol

from backend.config import Settings
from backend.mcp_robot.motion import keep_out
from backend.mcp_robot.navigation.grid import Floats
from backend.mcp_robot.robot import Robot, TopologicalMap
from backend.mcp_robot.ros2.waiting import Waits
from backend.mcp_robot.simulator import world
from backend.mcp_robot.simulator.simulated_robot import SimulatedRobot
from backend.telemetry import Zone


class RunningRobot(Robot, Protocol):
    """A robot that has to be run, and calls `on_reroute` with the new path when a drive takes another one."""

    on_reroute: Callable[[Floats], None]

    def running(self) -> contextlib.AbstractAsyncContextManager[None]:
        """Run the robot while inside."""


def build(settings: Settings) -> tuple[RunningRobot, list[Zone]]:
    """The robot, and the zones that it must keep out of. Raises `WorldError` or `Ros2Missing`."""
    if settings.robot.kind == "ros2":
        return ros2(settings)
    place = world.load(settings.robot.world)
    zones = [*place.zones, *_zones(settings)]
    return simulated(settings, place, zones), zones


def simulated(settings: Settings, place: world.World | None = None, zones: Sequence[Zone] = ()) -> SimulatedRobot:
    """The simulator, in the world of the settings where none is given. Raises `WorldError`."""
    robot = settings.robot
    place = place or world.load(robot.world)
    return SimulatedRobot(
        place,
        robot.limits,
        name=robot.name,
        time_scale=robot.time_scale,
        seed=robot.seed,
        settings=robot.simulator,
        floor=keep_out.applied(place.grid, zones),
    )


def ros2(settings: Settings, waits: Waits | None = None) -> tuple[RunningRobot, list[Zone]]:
    """The ROS 2 adapter and its zones; `waits` as in the module `waiting`. Raises `WorldError` or `Ros2Missing`.

    ROS is imported only here, because most machines have none.
    """
    from backend.mcp_robot.ros2 import interfaces

    ros, robot = settings.robot.ros2, settings.robot
    zones = _zones(settings)
    places = TopologicalMap(ros.map_frame, (), ())
    if ros.demo:
        ros = ros.model_copy(update={"use_sim_time": True})
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        place = world.load(robot.world)
        places, zones = place.places, [*place.zones, *zones]
    if ros.places:
        places = world.names(ros.places)
        if places.frame_id != ros.map_frame:
            sentence = f"{ros.places}: frame_id is {places.frame_id}, but the robot's map has the frame {ros.map_frame}"
            raise world.WorldError(f"{sentence} (robot.ros2.map_frame). Poses of another frame are other points.")
    interfaces.provide(settings.data_dir, ros.distro)
    from backend.mcp_robot.ros2.ros2_robot import Ros2Robot

    return Ros2Robot(ros, robot.limits, name=robot.name, places=places, zones=zones, waits=waits), zones


def _zones(settings: Settings) -> list[Zone]:
    return [Zone(zone.name, zone.polygon) for zone in settings.robot.keep_out]
