"""The MCP servers that a client brought into one session: their connections, and their tools beside the robot's.

They are kept in this process's memory alone, because their headers can be secrets. Their tools say nothing about the
robot: each carries the name of its server, none replaces a tool of the robot, and the policy decides on their calls as
on any other. A server that does not answer ends no turn.
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
from backend.robot_address import is_loopback

log = logging.getLogger(__name__)

SEPARATOR = "__"
MAX_TOOL_NAME_CHARS = 64
"""The limit that the providers of language models set, for names of letters, digits, - and _."""
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]")


class ClientServers:
    """The servers of one session; none at first. They are connected when a turn first needs their tools."""

    def __init__(self) -> None:
        self._servers: dict[str, McpClient] = {}
        self._callers: dict[str, tuple[McpClient, str]] = {}
        """Name of a tool -> its server, and the tool's name there; made anew with every listing."""
        self._away: frozenset[str] = frozenset()
        """The servers that did not answer the last listing."""
        self._told: frozenset[str] = frozenset()
        """Those of them that `news` has reported."""

    async def take(self, offers: Iterable[Offer]) -> None:
        """Use these servers from now on. The former ones are disconnected, and their calls under way fail."""
        before = self._servers.values()
        self._servers = {
            offer.name: McpClient(
                offer.url,
                offer.headers,
                absent=f"The MCP server {offer.name} does not answer.",
                by_proxy=not is_loopback(offer.url),  # it may be far away; a proxy's loopback is not ours
            )
            for offer in offers
        }
        self._away = self._told = frozenset()
        # A request that is cancelled meanwhile must leave no connection open.
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
        """Run a tool of the latest listing to its end. A server that is gone is a result with `failed`."""
        server, there = self._callers[name]
        try:
            return await server.call(there, arguments, on_progress)
        except ServerUnavailable as gone:
            return ToolResult(True, [{"type": "text", "text": str(gone)}], None)

    def news(self) -> str | None:
        """A sentence on the servers that have stopped answering since the last call; None for none. Each is reported
        once."""
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
    """The tool under a name that begins with its server's. Its title template is dropped: people who are asked for
    permission must see the arguments, not a text that a foreign server made of them."""
    name = f"{server}{SEPARATOR}{_UNSAFE.sub('_', tool.name)}"
    return replace(tool, name=name, title=f"{server}: {tool.title}", title_template=None, server=server)
