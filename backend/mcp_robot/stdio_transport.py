"""MCP over standard input and output, in a way that can be cancelled.

The SDK reads standard input in a thread that nothing can interrupt, so that a server that has to end would wait for its
client's next line. So standard input is read here. The SDK writes standard output; nothing here does. This file stands
beside http/ and not among the tools, because it is a transport of MCP.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import cast

from anyio import AsyncFile
from mcp.server.stdio import stdio_server

from backend.mcp_robot.tools.mcp_server import RobotServer
from backend.stdio import stdin

STDIN = 0


async def run(server: RobotServer) -> None:
    """Serve until standard input ends, or until cancelled."""
    lines = cast("AsyncFile[str]", read_lines(STDIN))  # the SDK only iterates over it
    async with stdio_server(stdin=lines) as (incoming, outgoing):
        core = server.core
        await core.run(incoming, outgoing, core.create_initialization_options())


async def read_lines(descriptor: int) -> AsyncIterator[str]:
    """The lines of a file descriptor, without their newlines; a last one that has none counts."""
    async with stdin(descriptor=descriptor) as reader:
        async for line in reader:
            yield line.removesuffix(b"\n").decode("utf-8", "replace")
