"""The MCP servers that a client brought into one session: their connections, and their tools beside the robot's.

They belong to the session and to this process's memory alone, because their headers can be secrets. Their tools are
nobody's word on the robot: each carries the name of its server, none takes the place of a tool of the robot, and what
one may do is `policy`'s business as for any other tool. That a server is away ends no turn.
"""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from backend.agent.robot.mcp_client import McpClient, ProgressCallback, ServerUnavailable, Tool, ToolResult
from backend.agent.robot.server_addresses import Offer

log = logging.getLogger(__name__)

SEPARATOR = "__"
MAX_TOOL_NAME_CHARS = 64
"""What the providers of language models take, of letters, digits, - and _."""
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]")


class ClientServers:
    """Those of one session; none at first. They are connected to when a turn first wants their tools."""

    def __init__(self) -> None:
        self._servers: dict[str, McpClient] = {}
        self._callers: dict[str, tuple[McpClient, str]] = {}
        """The name of a tool -> its server, and its name there; made anew with every listing."""
        self._away: frozenset[str] = frozenset()
        """The servers that did not answer the last listing."""
        self._told: frozenset[str] = frozenset()
        """Those of them that people have been told of."""

    async def take(self, offers: Iterable[Offer]) -> None:
        """Have these from now on; those before are disconnected, and a call of theirs that runs fails."""
        before = self._servers.values()
        self._servers = {
            offer.name: McpClient(offer.url, offer.headers, absent=f"The MCP server {offer.name} does not answer.")
            for offer in offers
        }
        self._away = self._told = frozenset()
        # A request that is withdrawn meanwhile must leave no connection behind.
        await asyncio.shield(asyncio.gather(*(server.close() for server in before)))

    async def close(self) -> None:
        """Disconnect and forget them."""
        await self.take(())

    async def beside(self, robot: dict[str, Tool]) -> dict[str, Tool]:
        """The robot's tools, and behind them those of the servers that answer, by name."""
        servers = dict(self._servers)
        listings = await asyncio.gather(*(_tools(server) for server in servers.values()))
        self._away = frozenset(name for name, tools in zip(servers, listings, strict=True) if tools is None)
        self._told &= self._away
        merged = dict(robot)
        self._callers = {}
        for (name, server), tools in zip(servers.items(), listings, strict=True):
            for tool in (tools or {}).values():
                offered = _as_offered(name, tool)
                if len(offered.name) > MAX_TOOL_NAME_CHARS or offered.name in merged:
                    log.info("a tool of the MCP server %s is left out: its name is too long or taken", name)
                    continue
                merged[offered.name] = offered
                self._callers[offered.name] = (server, tool.name)
        return merged

    async def call(
        self, name: str, arguments: dict[str, Any], on_progress: ProgressCallback | None = None
    ) -> ToolResult:
        """Run a tool of the last listing to its end. A server that is gone is a result with `failed`."""
        server, there = self._callers[name]
        try:
            return await server.call(there, arguments, on_progress)
        except ServerUnavailable as gone:
            return ToolResult(True, [{"type": "text", "text": str(gone)}], None)

    def news(self) -> str | None:
        """What people have not been told yet: whose tools are missing. Each loss is told once."""
        lost = sorted(self._away - self._told)
        self._told = self._away
        if not lost:
            return None
        if len(lost) == 1:
            missing = f"The MCP server {lost[0]} does not answer, so its tools are missing."
        else:
            missing = f"The MCP servers {', '.join(lost)} do not answer, so their tools are missing."
        return f"{missing} I try again at every prompt."


async def _tools(server: McpClient) -> dict[str, Tool] | None:
    try:
        return await server.tools()
    except ServerUnavailable:
        return None


def _as_offered(server: str, tool: Tool) -> Tool:
    """The tool under a name that says whose it is. Its title template goes: people who are asked must see the
    arguments, not what a stranger makes of them."""
    name = f"{server}{SEPARATOR}{_UNSAFE.sub('_', tool.name)}"
    return replace(tool, name=name, title=f"{server}: {tool.title}", title_template=None, server=server)
