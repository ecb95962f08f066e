"""Starts the stand-in for a ROS 2 robot, once the interfaces that it speaks can be imported."""

from __future__ import annotations

import os

from backend.config import Settings
from backend.mcp_robot import robots
from backend.mcp_robot.ros2 import interfaces


async def serve(settings: Settings) -> None:
    """Be a robot until cancelled. Raises `Ros2Missing` or `WorldError`."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    interfaces.provide(settings.data_dir, settings.robot.ros2.distro)
    from backend.mcp_robot.ros2.demo.stand_in import StandIn

    await StandIn(robots.simulated(settings), settings.robot).run()
