"""All tools of the robot, in one list. To add a tool: write it in one of these files, or in a new one beside them that
has a function `add`, and name that file in TOOLS.

A robot has the tools that its capabilities allow: the function `add` leaves out a tool that could only refuse.
A tool translates arguments for the pilot and the pilot's answer into a typed result (results.py). It never decides what
is safe and never knows which kind of robot it moves. Its title and docstring are for people and LLMs.
"""

from __future__ import annotations

import logging

from backend import __version__
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.tools import motion_tools, observation_tools, speech_tools
from backend.mcp_robot.tools.mcp_server import RobotServer

TOOLS = (observation_tools.add, motion_tools.add, speech_tools.add)

INSTRUCTIONS = """\
You move a real or simulated service robot called {name} in a building. Look before you act: get_topological_map lists
the places that have names. Coordinates are metres in the map frame, yaw is in radians counter-clockwise. One motion at
a time; every motion tool returns when the robot has arrived. Errors read `code: sentence`; the sentence says what to
do."""


def build(pilot: Pilot) -> RobotServer:
    """The MCP server with the tools that this robot's capabilities allow."""
    server = RobotServer(
        name="robot-acp robot",
        title=pilot.robot.name,
        version=__version__,
        instructions=INSTRUCTIONS.format(name=pilot.robot.name),
        log_level="WARNING",
    )
    for add in TOOLS:
        add(server, pilot)
    server.enforce_schemas()
    logging.getLogger("mcp").setLevel(logging.WARNING)
    return server
