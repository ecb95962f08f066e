"""The lines that the terminal shows of a session: updates in, lines of text out. No terminal, no socket, no clock.

The lines are in the order of the events. A paragraph that is still streaming in becomes a line at its end; until then
`status` shows how it begins.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from backend import meta as keys
from backend.visible import visible

Style = Literal["you", "thought", "robot", "tool", "result", "problem", "note"]

_MARKS = {"pending": "○", "in_progress": "◌", "completed": "✓", "failed": "✗"}


@dataclass(frozen=True)
class Line:
    """One line for people, and the style that says what kind of line it is."""

    style: Style
    text: str


@dataclass
class View:
    """The lines of one session, made from its updates."""

    robot: str = "The robot"
    status: str = ""
    """A few words about the step of the turn that runs; empty between turns."""
    title: str | None = None
    """The title of the session, once it has one."""
    _streaming: Style | None = None
    """The kind of text that streams in; None when the last update was no text."""
    _buffer: str = ""
    """The paragraph that has not ended yet."""
    _titles: dict[str, str] = field(default_factory=dict)
    """Id of a tool call -> its title."""

    def apply(self, update: dict[str, Any]) -> list[Line]:
        """Follow an update, and return the lines that it adds: one of a wrong form adds a line that says so."""
        try:
            return self._lines(update)
        except (KeyError, TypeError, AttributeError, ValueError):
            return [Line("problem", "The agent sent an update that cannot be read. It is left out.")]

    def _lines(self, update: dict[str, Any]) -> list[Line]:
        kind = update.get("sessionUpdate", "")
        if kind == "agent_message_chunk":
            return self._stream("robot", update["content"])
        if kind == "agent_thought_chunk":
            return self._stream("thought", update["content"])
        meta = update.get("_meta") or {}
        if kind == "tool_call_update" and "status" not in update:
            self.status = _text(update) or self.status
            return []
        lines = self.flush()
        if kind == "user_message_chunk":
            said = visible(update["content"].get("text", "[attachment]"), lines=True).replace("\n", "\n  ")
            lines.append(Line("you", f"{visible(meta.get(keys.BY, 'you'))}: {said}"))
        elif kind == "plan":
            lines += [Line("note", f"{_MARKS[e['status']]} {visible(e['content'])}") for e in update["entries"]]
        elif kind == "tool_call":
            self.status = self._titles[update["toolCallId"]] = visible(update["title"])
        elif kind == "tool_call_update":
            lines += self._tool_status(update, meta)
        elif kind == "current_mode_update":
            lines.append(Line("note", f"The mode is now {visible(update['currentModeId'])}."))
        elif kind == "session_info_update":
            self.title = update.get("title") or self.title
            lines += self._turn_end(meta.get(keys.TURN) or {})
        return lines

    def flush(self) -> list[Line]:
        """End the paragraph that streams in, and return its lines."""
        style, text = self._streaming, self._buffer.strip()
        self._streaming, self._buffer = None, ""
        return [Line(style, line) for line in text.splitlines()] if style and text else []

    def _stream(self, style: Style, content: dict[str, Any]) -> list[Line]:
        lines = self.flush() if self._streaming not in (None, style) else []
        self._streaming = style
        *paragraphs, self._buffer = (self._buffer + content.get("text", "")).split("\n")
        self.status = self._buffer[-200:]
        return lines + [Line(style, paragraph) for paragraph in paragraphs]

    def _tool_status(self, update: dict[str, Any], meta: dict[str, Any]) -> list[Line]:
        title = self._titles.get(update["toolCallId"], "Tool")
        decision = meta.get(keys.DECISION) or {}
        allowed = str(decision.get("option") or "").startswith("allow_")
        lines = [Line("note", f"Allowed by {visible(decision['by'])}.")] if allowed and decision.get("by") else []
        if update["status"] in ("completed", "failed"):
            why = f": {visible(_text(update))}" if update["status"] == "failed" and _text(update) else ""
            extras = "".join(f" [{kind}]" for kind in _kinds(update) if kind in ("image", "audio"))
            style: Style = "result" if update["status"] == "completed" else "problem"
            lines.append(Line(style, f"{_MARKS[update['status']]} {title}{extras}{why}"))
        elif not lines:
            lines.append(Line("tool", f"{_MARKS[update['status']]} {title} …"))
        return lines

    def _turn_end(self, turn: dict[str, Any]) -> list[Line]:
        if turn.get("state") != "ended":
            return []
        self.status = ""
        return [Line("note", "Cancelled.")] if turn.get("stopReason") == "cancelled" else []


def _blocks(update: dict[str, Any]) -> list[dict[str, Any]]:
    return [c["content"] for c in update.get("content") or [] if c.get("type") == "content"]


def _text(update: dict[str, Any]) -> str:
    return " ".join(b["text"] for b in _blocks(update) if b.get("type") == "text")


def _kinds(update: dict[str, Any]) -> list[str]:
    return [b.get("type", "") for b in _blocks(update)]
