"""What the robot can do and where it can go, for a screen that suggests it: the places and tools of its MCP server.

Reads only, and offers nothing: what somebody may have done is decided when it is asked for, by policy.
"""

from __future__ import annotations

import asyncio
from typing import Any

from backend.agent.robot.mcp_client import McpClient, ServerUnavailable

LOOK_TIMEOUT_S = 2.0


async def look(tools: McpClient, name: str) -> dict[str, Any] | None:
    """What the tool `name`, which only looks, says now; None when the robot is not there or has no such tool."""
    try:
        async with asyncio.timeout(LOOK_TIMEOUT_S):
            if name not in await tools.tools():
                return None
            result = await tools.call(name, {})
    except (ServerUnavailable, TimeoutError):
        return None
    return result.structured if not result.failed and isinstance(result.structured, dict) else None


async def abilities(tools: McpClient, places_tool: str) -> dict[str, Any]:
    """The answer to `_robot/abilities`. Raises `ServerUnavailable`."""
    known = await tools.tools()
    told = await look(tools, places_tool) or {}
    nodes = told.get("nodes")
    places = [_place(node) for node in nodes if _is_place(node)] if isinstance(nodes, list) else []
    return {
        "places": places,
        "tools": [{"name": tool.name, "title": tool.title, "readOnly": tool.read_only} for tool in known.values()],
    }


def _is_place(node: object) -> bool:
    return isinstance(node, dict) and isinstance(node.get("name"), str)


def _place(node: dict[str, Any]) -> dict[str, Any]:
    kind = node.get("type")
    return {"name": node["name"], "type": kind if isinstance(kind, str) else None}
