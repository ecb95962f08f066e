"""MCP over standard input and output, in a way that can be cancelled.

The SDK reads standard input in a thread that nothing can interrupt, so that a server that has to end would wait for its
client's next line. Here a daemon thread reads, and ends with the process. The SDK writes standard output; nothing here
does. It stands beside http/ and not among the tools, because it is a transport of MCP.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections.abc import AsyncIterator
from typing import cast

from anyio import AsyncFile
from mcp.server.stdio import stdio_server

from backend.mcp_robot.tools.mcp_server import RobotServer

STDIN = 0


async def run(server: RobotServer) -> None:
    """Serve until standard input ends, or until cancelled."""
    lines = cast("AsyncFile[str]", read_lines(STDIN))  # the SDK only iterates over it
    async with stdio_server(stdin=lines) as (incoming, outgoing):
        core = server.core
        await core.run(incoming, outgoing, core.create_initialization_options())


async def read_lines(descriptor: int) -> AsyncIterator[str]:
    """Lines of a file descriptor; a last one without its newline counts."""
    loop = asyncio.get_running_loop()
    chunks: asyncio.Queue[bytes] = asyncio.Queue()

    def read() -> None:
        # os.read and not sys.stdin: a daemon thread that holds a buffer's lock aborts the interpreter at its exit.
        with contextlib.suppress(OSError, RuntimeError):  # closed, or the loop has ended
            while chunk := os.read(descriptor, 65536):
                loop.call_soon_threadsafe(chunks.put_nowait, chunk)
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(chunks.put_nowait, b"")

    threading.Thread(target=read, name="stdin", daemon=True).start()
    rest = b""
    while chunk := await chunks.get():
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            yield line.decode("utf-8", "replace")
    if rest:
        yield rest.decode("utf-8", "replace")
