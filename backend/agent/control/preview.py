"""What a call would do, computed before people are asked about it: the robot plans its way, draws it and does not move.

Only a tool that the robot's own server says it of is believed to do no more than that, never one of a server that a
client brought. It is no step of the turn: it takes no part in deciding, is in no log, and delays a question for
`TIMEOUT_S` at most. What it tells beforehand is a refusal: nobody is asked for what the robot would not do anyway.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from backend import meta as keys
from backend import telemetry
from backend.agent.acp import updates
from backend.agent.robot.mcp_client import McpClient, ServerUnavailable, Tool, ToolResult

log = logging.getLogger(__name__)

TIMEOUT_S = 2.0


class Refused(Exception):
    """The robot would refuse this call; `result` is how it says so."""

    def __init__(self, result: ToolResult) -> None:
        super().__init__(result.text)
        self.result = result


def drawn_for(own: str, *, rehearsal: bool = False) -> dict[str, Any]:
    """The `_meta` of a call whose way is to be drawn under the id `own`; a `rehearsal` is held to all that the drive
    itself would have to pass."""
    return {keys.PREVIEW: {"id": own, "rehearsal": rehearsal}}


def not_stopped(tool: Tool, state: telemetry.State | None) -> None:
    """Raises `Refused` for a call that acts while the robot's stop is set. It spares people a question; what may begin
    is decided in the robot server, where the stop is."""
    if tool.server is None and not tool.read_only and state is not None and state.stop is not None:
        error = {"code": "stopped", "message": f"Stopped by {state.stop.by}. A supervisor has to release it."}
        told = updates.text_block(f"{error['code']}: {error['message']}")
        raise Refused(ToolResult(True, [told], {"error": error}))


async def rehearsed(tools: McpClient, tool: Tool, arguments: dict[str, Any], own: str) -> dict[str, Any] | None:
    """Let the robot draw the way that `tool`, which can preview, would take, under the id `own`.

    Returns the PREVIEW `_meta` of the question: length and seconds as far as the robot tells them; None when nothing
    came of it in time. Raises `Refused`.
    """
    assert tool.preview is not None  # noqa: S101 - the caller has looked
    try:
        async with asyncio.timeout(TIMEOUT_S):
            result = await tools.call(tool.name, arguments | {tool.preview: True}, meta=drawn_for(own, rehearsal=True))
    except (ServerUnavailable, TimeoutError) as error:
        log.info("no preview of %s: %s", tool.name, type(error).__name__)
        return None
    told = result.structured if isinstance(result.structured, dict) else {}
    if result.failed:
        # Without a code it may be the preview alone that failed.
        if _code(told):
            raise Refused(result)
        return None
    return {"path_length": _number(told.get("path_length")), "seconds": _number(told.get("expected_s"))}


def _code(told: dict[str, Any]) -> str | None:
    error = told.get("error")
    code = error.get("code") if isinstance(error, dict) else None
    return code if isinstance(code, str) else None


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
