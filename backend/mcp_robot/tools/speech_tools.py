"""The tool that speaks aloud through the robot's loudspeaker. It moves nothing."""

from __future__ import annotations

from typing import Annotated

from mcp.server.mcpserver import Context
from mcp_types import CallToolResult
from pydantic import Field

from backend import meta as keys
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.tools import results, watchdog
from backend.mcp_robot.tools.long_call import long_call
from backend.mcp_robot.tools.mcp_server import ACTS, RobotServer, audio, with_content


def add(server: RobotServer, pilot: Pilot) -> None:
    """Register this tool with the server, for a robot that has a voice."""
    if not pilot.robot.capabilities.voice:
        return
    sign = watchdog.announced(pilot.limits)

    @server.tool(title="Say something aloud", annotations=ACTS, meta={keys.TITLE: "Say aloud: “{text}”", **sign})
    async def speak(
        ctx: Context, text: Annotated[str, Field(description="what to say, in plain words")]
    ) -> Annotated[CallToolResult, results.Spoken]:
        """Say a text aloud through the robot's loudspeaker; returns when it is said."""
        async with long_call(ctx, server.callers, pilot.limits):
            sound = await pilot.speak(text)
        facts = results.Spoken(text=text, seconds=round(sound.seconds, 2), audible=sound.audible)
        return with_content(facts, audio(sound.wav))
