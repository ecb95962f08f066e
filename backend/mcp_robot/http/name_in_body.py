"""The name of a person in the body of a request: `{"by": "Ana"}`.

A stop has happened before this is read, and must not be refused or held up by it. So a body that is too long, too slow
or no such object is a request without a name, and no error.
"""

from __future__ import annotations

import asyncio
import contextlib

import msgspec
from starlette.requests import ClientDisconnect, Request

from backend import wire

MAX_BYTES = 4096
SECONDS = 1.0
"""The time that a body may take."""


class _Body(msgspec.Struct):
    by: str | None = None


async def name_in_body(request: Request) -> str | None:
    """The name; None where the body has none that can be used."""
    body = bytearray()
    with contextlib.suppress(TimeoutError, ClientDisconnect, *wire.UNREADABLE):
        async with asyncio.timeout(SECONDS):
            async for piece in request.stream():
                body += piece
                if len(body) > MAX_BYTES:
                    return None
        return msgspec.json.decode(bytes(body), type=_Body).by if body else None
    return None
