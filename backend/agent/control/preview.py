"""The preview of a tool call: before people are asked, the robot plans the path, draws it and does not move.

Only the robot's own server is trusted to do no more than that, never a server that a client brought. A preview is not
part of the turn: it is not in the log, it allows nothing, and it delays a permission request by `TIMEOUT_S` at most.
What it can do is refuse: people are not asked for what the robot would refuse anyway.
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


class RefusedByRobot(Exception):
    """The robot would refuse this call; `result` is its answer."""

    def __init__(self, result: ToolResult) -> None:
        super().__init__(result.text)
        self.result = result


def draw_path(call_id: str, *, for_permission: bool = False) -> dict[str, Any]:
    """The `_meta` of a call that only plans its path: the robot draws the path under `call_id`.

    With `for_permission`, the robot checks all that the drive itself would have to pass, as people are about to be
    asked for it.
    """
    return {keys.PREVIEW: {"id": call_id, "rehearsal": for_permission}}


def refuse_if_stopped(tool: Tool, state: telemetry.State | None) -> None:
    """Raise `RefusedByRobot` for a call that acts while the robot's stop is set.

    This only spares people a request. The robot server, which has the stop, decides what may begin.
    """
    if tool.server is None and not tool.read_only and state is not None and state.stop is not None:
        error = {"code": "stopped", "message": f"Stopped by {state.stop.by}. A supervisor has to release it."}
        text = updates.text_block(f"{error['code']}: {error['message']}")
        raise RefusedByRobot(ToolResult(True, [text], {"error": error}))


async def compute(
    tools: McpClient, tool: Tool, arguments: dict[str, Any], call_id: str, timeout_s: float = TIMEOUT_S
) -> dict[str, Any] | None:
    """Let the robot plan and draw the path that `tool`, which must have a preview, would take, under `call_id`.

    Returns the preview `_meta` of the permission request: the path's length in m and the drive's time in s, each None
    where the robot does not give it. Returns None where the robot gave no preview within `timeout_s` seconds. Raises
    `RefusedByRobot`.
    """
    assert tool.preview is not None  # noqa: S101 - the caller has checked it
    planning = arguments | {tool.preview: True}
    try:
        async with asyncio.timeout(timeout_s):
            result = await tools.call(tool.name, planning, meta=draw_path(call_id, for_permission=True))
    except (ServerUnavailable, TimeoutError) as error:
        log.info("no preview of %s: %s", tool.name, type(error).__name__)
        return None
    structured = result.structured if isinstance(result.structured, dict) else {}
    if result.failed:
        if _has_error_code(structured):
            raise RefusedByRobot(result)
        return None  # without a code, perhaps only the preview failed
    return {"path_length": _number(structured.get("path_length")), "seconds": _number(structured.get("expected_s"))}


def _has_error_code(structured: dict[str, Any]) -> bool:
    error = structured.get("error")
    code = error.get("code") if isinstance(error, dict) else None
    return isinstance(code, str) and bool(code)


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
