"""Closing a stream: what waits is still written, but nobody is waited for who does not read."""

from __future__ import annotations

import asyncio

CLOSE_SECONDS = 1.0
"""Clients give the process that they started about 2 s to end."""


async def close(writer: asyncio.StreamWriter) -> None:
    """Close, within `CLOSE_SECONDS`."""
    writer.close()
    try:
        async with asyncio.timeout(CLOSE_SECONDS):
            await writer.wait_closed()
    except TimeoutError:
        writer.transport.abort()
    except OSError:
        pass  # the other side was faster
