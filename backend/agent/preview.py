"""What a call would do, computed before people are asked about it: the robot plans its way, draws it and does not move.

Only a tool of the robot itself is believed to do no more than that, never one of a server that a client brought. It is
no step of the turn: it takes no part in deciding, is in no log, and delays a question for `TIMEOUT_S` at most. What it
tells beforehand is a refusal: nobody is asked for what the robot would not do anyway.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

from backend.agent.phases import Phases
from backend.agent.robot_link import RobotLink
from backend.agent.tool_server import ServerUnavailable, Tool, ToolResult, ToolServer

log = logging.getLogger(__name__)

TIMEOUT_S = 2.0


class Refused(Exception):
    """The robot would refuse this call; `result` is how it says so."""

    def __init__(self, result: ToolResult) -> None:
        super().__init__(result.text)
        self.result = result


@dataclass
class View:
    """What people are shown. `meta` is `robot-acp/preview` of the question, None where nothing was computed."""

    meta: dict[str, Any] | None = None
    stays: bool = False
    """Set when the call goes on: what was drawn is then its own."""


@contextlib.asynccontextmanager
async def shown(
    tools: ToolServer, link: RobotLink, phases: Phases, argument: str, tool: Tool, arguments: dict[str, Any]
) -> AsyncIterator[View]:
    """Show what `tool` would do with `arguments` while inside, and afterwards if it `stays`. Raises `Refused`."""
    if not can_preview(tool, argument):
        yield View()
        return
    view = View()
    try:
        with phases.during("tools"):
            view.meta = await _computed(tools, tool, arguments | {argument: True})
        yield view
    finally:
        if not view.stays:
            await link.forget_preview()


def can_preview(tool: Tool, argument: str) -> bool:
    """Whether `tool` has the flag `argument`, and is believed to do nothing when it is set."""
    if tool.server is not None or not argument:
        return False
    flag = (tool.parameters.get("properties") or {}).get(argument)
    return isinstance(flag, dict) and flag.get("type") == "boolean"


async def _computed(tools: ToolServer, tool: Tool, arguments: dict[str, Any]) -> dict[str, Any] | None:
    """Length and seconds of the way, as far as the robot tells them; None when nothing came of it in time."""
    try:
        async with asyncio.timeout(TIMEOUT_S):
            result = await tools.call(tool.name, arguments)
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
