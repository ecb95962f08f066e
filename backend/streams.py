"""How a stream to another process or machine is closed. Nothing here opens, reads or interprets one."""

from __future__ import annotations

import asyncio

CLOSE_SECONDS = 1.0
"""Clients give a process that they started about 2 s to end."""


async def close(writer: asyncio.StreamWriter) -> None:
    """Close a stream. The bytes that wait are still written, for up to `CLOSE_SECONDS`; then the stream is broken."""
    writer.close()
    try:
        async with asyncio.timeout(CLOSE_SECONDS):
            await writer.wait_closed()
    except TimeoutError:
        writer.transport.abort()
    except OSError:
        pass  # the other side was faster
