"""ACP updates as plain dictionaries: one function for each kind of `session/update` that the agent sends.

Only types of ACP version 1 are made here, because clients break on others. What is not in ACP goes into `_meta`.
"""

from __future__ import annotations

from typing import Any, Literal

import orjson

from backend import meta as keys
from backend.agent.control.approvers import Outcome
from backend.agent.robot.mcp_client import Progress, Tool, ToolResult
from backend.agent.turns.phases import Phase

Update = dict[str, Any]
ToolStatus = Literal["pending", "in_progress", "completed", "failed"]


def text_block(text: str) -> dict[str, Any]:
    """A text content block."""
    return {"type": "text", "text": text}


def user_message(block: dict[str, Any], by: str, turn_id: str) -> Update:
    """One block of a person's prompt. The first one begins the turn."""
    meta = {keys.BY: by, keys.TURN: {"id": turn_id, "state": "running"}}
    return {"sessionUpdate": "user_message_chunk", "content": block, "_meta": meta}


def thought(text: str) -> Update:
    """A piece of what the model thinks."""
    return {"sessionUpdate": "agent_thought_chunk", "content": text_block(text)}


def message(text: str) -> Update:
    """A piece of what the robot answers."""
    return {"sessionUpdate": "agent_message_chunk", "content": text_block(text)}


def lease_revoked(text: str, taken_by: str | None) -> Update:
    """The message that the turn's lease was revoked; `taken_by` is the name of the person who took the robot over."""
    return message(text) | ({"_meta": {keys.TAKEN_OVER: {"by": taken_by}}} if taken_by is not None else {})


def plan(entries: Any) -> Update | None:
    """The whole plan of the task; None when `entries` are no steps of a plan."""
    if not isinstance(entries, list) or not entries or not all(_is_step(entry) for entry in entries):
        return None
    steps = [{"content": e["content"], "priority": "medium", "status": e["status"]} for e in entries]
    return {"sessionUpdate": "plan", "entries": steps}


def _is_step(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and isinstance(entry.get("content"), str)
        and entry.get("status") in ("pending", "in_progress", "completed")
    )


def tool_call(
    call_id: str, tool: Tool, arguments: dict[str, Any], status: ToolStatus, phase: Phase = "tools"
) -> Update:
    """The announcement of a tool call. `phase` is the phase of the turn that the call's time counts for."""
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
    """ACP's kind of a tool, for which clients may show an icon. Only a tool of the robot itself is "execute"."""
    if tool.server is None:
        return "read" if tool.read_only else "execute"
    return "fetch" if tool.read_only else "other"


def tool_status(call_id: str, status: ToolStatus, text: str | None = None, outcome: Outcome | None = None) -> Update:
    """A change of a call's status, with the reason for people, and the outcome of the permission request."""
    update: Update = {"sessionUpdate": "tool_call_update", "toolCallId": call_id, "status": status}
    if text is not None:
        update["content"] = [_content(text_block(text))]
    if outcome is not None:
        decision = {"by": outcome.by, "option": outcome.option, "reason": outcome.reason}
        if outcome.fingerprint is not None:
            decision["fingerprint"] = outcome.fingerprint
        update["_meta"] = {keys.DECISION: decision}
    return update


def tool_waits(call_id: str, text: str, waits: dict[str, Any]) -> Update:
    """A call that cannot begin yet: `text` tells people why, `waits` tells clients what it waits for."""
    return tool_status(call_id, "pending", text) | {"_meta": {keys.WAITING: waits}}


def tool_progress(call_id: str, progress: Progress) -> Update:
    """The progress of a tool call."""
    return {
        "sessionUpdate": "tool_call_update",
        "toolCallId": call_id,
        "content": [_content(text_block(progress.message))],
        "_meta": {keys.PROGRESS: {"fraction": progress.fraction, "message": progress.message}},
    }


def tool_result(call_id: str, result: ToolResult) -> Update:
    """The end of a tool call. Text that only repeats the structured output, as MCP recommends, is left out."""
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
    """How much of the model's context is `used`, of its `size`, in tokens."""
    return {"sessionUpdate": "usage_update", "used": used, "size": size}


def title(text: str) -> Update:
    """The session's name."""
    return {"sessionUpdate": "session_info_update", "title": text}


def turn_ended(turn_id: str, stop_reason: str, phases: dict[str, float] | None = None) -> Update:
    """The end of a turn, for the log and for people who did not start it. `phases` are the seconds that the turn took,
    by phase; None where they were not measured."""
    meta: dict[str, Any] = {keys.TURN: {"id": turn_id, "state": "ended", "stopReason": stop_reason}}
    if phases is not None:
        meta[keys.PHASES] = phases
    return {"sessionUpdate": "session_info_update", "_meta": meta}


def forked(original: str) -> Update:
    """The first of a fork's own events: those before it happened in the session `original`."""
    return {"sessionUpdate": "session_info_update", "_meta": {keys.FORKED: {"from": original}}}


def current_mode(mode_id: str) -> Update:
    """The session's new mode."""
    return {"sessionUpdate": "current_mode_update", "currentModeId": mode_id}


def config_options(options: list[dict[str, Any]]) -> Update:
    """All settings of the session with their values."""
    return {"sessionUpdate": "config_option_update", "configOptions": options}


def too_large(update: Update, size: int) -> Update:
    """The update in place of one of `size` bytes, which fits into no message: without what it contains."""
    note = text_block(f"This is left out: it has {size} bytes, more than a message may have.")
    kept: Update = {key: update[key] for key in ("sessionUpdate", "toolCallId", "status", "kind") if key in update}
    meta = update.get("_meta") or {}
    if known := {key: meta[key] for key in (keys.TURN, keys.BY, keys.TOOL, keys.PHASE) if key in meta}:
        kept["_meta"] = known
    match update["sessionUpdate"]:
        case "tool_call":
            kept["title"] = str(update["title"])[:200]
        case "tool_call_update":
            kept["content"] = [_content(note)]
        case "plan":
            kept["entries"] = []
        case kind if kind.endswith("_chunk"):
            kept["content"] = note
    return kept


def _repeats(block: dict[str, Any], structured: Any) -> bool:
    if structured is None or block["type"] != "text":
        return False
    try:
        return bool(orjson.loads(block["text"]) == structured)
    except ValueError:
        return False


def _content(block: dict[str, Any]) -> dict[str, Any]:
    return {"type": "content", "content": block}
