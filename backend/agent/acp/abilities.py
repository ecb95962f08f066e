"""The answer to `_robot/abilities`: the places and tools of the robot, for a screen that suggests what to ask for.

It only reads, and however many people ask at once, the robot is asked once. Whether a person may have something done is
decided by the policy when the person asks for it.
"""

from __future__ import annotations

import asyncio
from typing import Any

from backend.agent.robot.mcp_client import McpClient
from backend.agent.robot.readings import read


class Abilities:
    """The abilities of the robot with these `tools`. Its places are told by the tool `places_tool`."""

    def __init__(self, tools: McpClient, places_tool: str) -> None:
        self._tools = tools
        self._places_tool = places_tool
        self._reading: asyncio.Task[dict[str, Any]] | None = None

    async def read(self) -> dict[str, Any]:
        """The answer to `_robot/abilities`. Raises `ServerUnavailable`."""
        if self._reading is None or self._reading.done():
            self._reading = asyncio.create_task(self._read(), name="abilities")
            self._reading.add_done_callback(lambda done: done.cancelled() or done.exception())  # nobody may wait for it
        return await asyncio.shield(self._reading)

    async def _read(self) -> dict[str, Any]:
        known = await self._tools.tools()
        graph = await read(self._tools, self._places_tool) or {}
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
