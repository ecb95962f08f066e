"""ACP updates as plain dictionaries: one function for each kind of `session/update` that the agent sends.

Only types of ACP version 1 are made here, because clients break on others; what is ours goes into `_meta`.
"""

from __future__ import annotations

import json
from typing import Any, Literal

from backend import meta as keys
from backend.agent.control.permissions import Verdict
from backend.agent.robot.mcp_client import Progress, Tool, ToolResult
from backend.agent.turns.phases import Phase

Update = dict[str, Any]
ToolStatus = Literal["pending", "in_progress", "completed", "failed"]


def text_block(text: str) -> dict[str, Any]:
    """A text content block."""
    return {"type": "text", "text": text}


def user_message(block: dict[str, Any], by: str, turn_id: str) -> Update:
    """One block of somebody's prompt; begins the turn."""
    meta = {keys.BY: by, keys.TURN: {"id": turn_id, "state": "running"}}
    return {"sessionUpdate": "user_message_chunk", "content": block, "_meta": meta}


def thought(text: str) -> Update:
    """A piece of what the model thinks."""
    return {"sessionUpdate": "agent_thought_chunk", "content": text_block(text)}


def message(text: str) -> Update:
    """A piece of what the robot answers."""
    return {"sessionUpdate": "agent_message_chunk", "content": text_block(text)}


def lost(text: str, taken_by: str | None) -> Update:
    """The robot was taken away from the turn; by whom, where it was a person."""
    return message(text) | ({"_meta": {keys.TAKEN_OVER: {"by": taken_by}}} if taken_by is not None else {})


def plan(entries: Any) -> Update | None:
    """The steps of the task, all of them; None when `entries` are no steps."""
    if not isinstance(entries, list) or not entries or not all(_is_step(entry) for entry in entries):
        return None
    shown = [{"content": e["content"], "priority": "medium", "status": e["status"]} for e in entries]
    return {"sessionUpdate": "plan", "entries": shown}


def _is_step(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and isinstance(entry.get("content"), str)
        and entry.get("status") in ("pending", "in_progress", "completed")
    )


def tool_call(
    call_id: str, tool: Tool, arguments: dict[str, Any], status: ToolStatus, phase: Phase = "tools"
) -> Update:
    """The announcement of a tool call, and what its time will count as."""
    return {
        "sessionUpdate": "tool_call",
        "toolCallId": call_id,
        "title": tool.title_for(arguments),
        "kind": _kind(tool),
        "status": status,
        "rawInput": arguments,
        "_meta": {keys.TOOL: tool.name, keys.PHASE: phase},
    }


def _kind(tool: Tool) -> str:
    """ACP's word for what a tool does; people may show a picture for it. Only the robot itself executes."""
    if tool.server is None:
        return "read" if tool.read_only else "execute"
    return "fetch" if tool.read_only else "other"


def tool_status(call_id: str, status: ToolStatus, text: str | None = None, verdict: Verdict | None = None) -> Update:
    """A change of status, with the reason for people and the decision that led to it."""
    update: Update = {"sessionUpdate": "tool_call_update", "toolCallId": call_id, "status": status}
    if text is not None:
        update["content"] = [_content(text_block(text))]
    if verdict is not None:
        decision = {"by": verdict.by, "option": verdict.option, "reason": verdict.reason}
        update["_meta"] = {keys.DECISION: decision}
    return update


def tool_waits(call_id: str, text: str, waits: dict[str, Any]) -> Update:
    """A call that cannot begin yet: why, in words for people, and in `_meta` what it waits for."""
    return tool_status(call_id, "pending", text) | {"_meta": {keys.WAITING: waits}}


def tool_progress(call_id: str, progress: Progress) -> Update:
    """How far a tool call is."""
    return {
        "sessionUpdate": "tool_call_update",
        "toolCallId": call_id,
        "content": [_content(text_block(progress.message))],
        "_meta": {keys.PROGRESS: {"fraction": progress.fraction, "message": progress.message}},
    }


def tool_result(call_id: str, result: ToolResult) -> Update:
    """The end of a tool call. Text that only repeats the structured output, as MCP has it, is left out."""
    blocks = [block for block in result.content if not _repeats(block, result.structured)]
    update: Update = {
        "sessionUpdate": "tool_call_update",
        "toolCallId": call_id,
        "status": "failed" if result.failed else "completed",
        "content": [_content(block) for block in blocks],
    }
    if result.structured is not None:
        update["rawOutput"] = result.structured
    return update


def usage(used: int, size: int) -> Update:
    """How much of the model's context is in use, in tokens."""
    return {"sessionUpdate": "usage_update", "used": used, "size": size}


def title(text: str) -> Update:
    """The session's name."""
    return {"sessionUpdate": "session_info_update", "title": text}


def turn_ended(turn_id: str, stop_reason: str, phases: dict[str, float] | None = None) -> Update:
    """The end of a turn, for those who did not ask for it and for the log; `phases` are the seconds it took, by phase,
    where they were measured."""
    meta: dict[str, Any] = {keys.TURN: {"id": turn_id, "state": "ended", "stopReason": stop_reason}}
    if phases is not None:
        meta[keys.PHASES] = phases
    return {"sessionUpdate": "session_info_update", "_meta": meta}


def forked(original: str) -> Update:
    """The first of a fork's own events: what comes before it happened in the session `original`."""
    return {"sessionUpdate": "session_info_update", "_meta": {keys.FORKED: {"from": original}}}


def current_mode(mode_id: str) -> Update:
    """The mode that counts from now on."""
    return {"sessionUpdate": "current_mode_update", "currentModeId": mode_id}


def config_options(options: list[dict[str, Any]]) -> Update:
    """All settings of the session with their values."""
    return {"sessionUpdate": "config_option_update", "configOptions": options}


def _repeats(block: dict[str, Any], structured: Any) -> bool:
    if structured is None or block["type"] != "text":
        return False
    try:
        return bool(json.loads(block["text"]) == structured)
    except ValueError:
        return False


def _content(block: dict[str, Any]) -> dict[str, Any]:
    return {"type": "content", "content": block}
