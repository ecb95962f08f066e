"""A reading tool of the robot, called once and without patience: for answers that are welcome and not needed."""

from __future__ import annotations

import asyncio
from typing import Any

from backend.agent.robot.mcp_client import McpClient, ServerUnavailable

READING_TIMEOUT_S = 2.0


async def read(tools: McpClient, name: str) -> dict[str, Any] | None:
    """The structured answer of the reading tool `name`; None without one: the robot is not there, is too slow, has no
    such tool, or failed."""
    try:
        async with asyncio.timeout(READING_TIMEOUT_S):
            if name not in await tools.tools():
                return None
            result = await tools.call(name, {})
    except (ServerUnavailable, TimeoutError):
        return None
    return result.structured if not result.failed and isinstance(result.structured, dict) else None
