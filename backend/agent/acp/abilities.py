"""The answer to `_robot/abilities`: the places and tools of the robot, for a screen that suggests what to ask for.

It only reads. Whether a person may have something done is decided by the policy when the person asks for it.
"""

from __future__ import annotations

from typing import Any

from backend.agent.robot.mcp_client import McpClient
from backend.agent.robot.readings import read


async def abilities(tools: McpClient, places_tool: str) -> dict[str, Any]:
    """The answer to `_robot/abilities`. Raises `ServerUnavailable`."""
    known = await tools.tools()
    graph = await read(tools, places_tool) or {}
    nodes = graph.get("nodes")
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
