"""The agent's sign of life to a robot server that asks for one, as long as a call lasts that moves the robot.

An open connection proves nothing: a process that is stopped leaves it open. So a tool's server may say how often it
wants a call from its client, and of which cheap tool (docs/safety.md). This process's event loop makes those calls: an
agent that hangs falls silent, and the robot halts. A server that asks for nothing receives nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

import mcp
from mcp_types import RequestParamsMeta

from backend import meta as keys

SHARE = 0.2
"""The share of the allowed silence that passes between two signs of life."""


@dataclass(frozen=True)
class Asked:
    """The sign of life that a tool's server asks for: a call of `tool` at least every `within` seconds."""

    within: float
    tool: str

    @classmethod
    def of(cls, meta: Mapping[str, Any]) -> Asked | None:
        """From a tool's `_meta`; None when nothing usable is asked."""
        asked = meta.get(keys.SIGN_OF_LIFE)
        match asked:
            case {"within": int() | float() as within, "tool": str(tool)} if within > 0:
                return cls(float(within), tool)
        return None


@contextlib.asynccontextmanager
async def given(client: mcp.Client, asked: Asked | None) -> AsyncIterator[RequestParamsMeta | None]:
    """Give signs of life while inside; yields the `_meta` that the call itself must carry."""
    if asked is None:
        yield None
        return
    name = cast("RequestParamsMeta", {keys.CALLER: secrets.token_urlsafe(16)})
    beating = asyncio.create_task(_beat(client, asked, name), name="sign of life")
    try:
        yield name
    finally:
        beating.cancel()
        await asyncio.gather(beating, return_exceptions=True)


async def _beat(client: mcp.Client, asked: Asked, name: RequestParamsMeta) -> None:
    while True:
        await asyncio.sleep(SHARE * asked.within)
        with contextlib.suppress(Exception):  # the call itself notices a connection that is gone
            async with asyncio.timeout(asked.within):
                await client.call_tool(asked.tool, {}, meta=name)
