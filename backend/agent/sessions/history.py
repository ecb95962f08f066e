"""The model's memory: chat messages, computed from a session's events and from nothing else.

So a session that is loaded after a restart has the memory that it had before. There is no I/O and no clock here. The
log is never shortened; only the past that the model gets is.
"""

from __future__ import annotations

import json
from typing import Any

from backend import meta as keys

PLAN_TOOL = "update_plan"
PHOTO_NOTE = "The picture that was just taken:"
"""The first words of the message that shows a photo to a model that can see. No person wrote that message."""
MAX_CHARS = 60_000
"""The model gets at most so many characters of the past. Whole turns are left out, the oldest first."""
RESULT_CHARS = 1_000
"""Where the last turn alone is longer than that, so many characters are left of a tool's result."""

Message = dict[str, Any]


class History:
    """The chat messages of one session. It has to be given every update of the session, in order."""

    def __init__(self) -> None:
        self._turns: list[list[Message]] = []
        self._tools: dict[str, str] = {}
        self._plans = 0
        self._turn_id: str | None = None
        self._answers: dict[str, tuple[str, bool]] = {}
        """Fingerprint of a tool -> its name and whether it is allowed, for answers that count for the rest of the
        session; the newest last."""
        self.interrupted: str | None = None
        """The id of a turn that began and has not ended; None otherwise."""

    @property
    def open_calls(self) -> list[str]:
        """The ids of tool calls that were announced and have not ended."""
        return list(self._tools)

    @property
    def remembered(self) -> dict[str, bool]:
        """Tool name -> allowed, for people: the newest answer of each name that counts for the rest of the session."""
        return dict(self._answers.values())

    def answer_for(self, fingerprint: str) -> bool | None:
        """Whether the tool with this fingerprint is allowed for the rest of the session; None where nobody said so."""
        answer = self._answers.get(fingerprint)
        return answer[1] if answer else None

    def apply(self, update: dict[str, Any]) -> None:
        """Add the next update."""
        kind = update["sessionUpdate"]
        meta = update.get("_meta") or {}
        if turn := meta.get(keys.TURN):
            self.interrupted = turn["id"] if turn["state"] == "running" else None
        if keys.FORKED in meta:  # in this session nobody has allowed anything yet
            self._answers = {of: answer for of, answer in self._answers.items() if not answer[1]}
        if kind == "user_message_chunk":
            self._user(update["content"], (turn or {}).get("id"))
        elif kind == "agent_message_chunk":
            self._assistant_text(update["content"].get("text", ""))
        elif kind == "plan":
            self._plan(update["entries"])
        elif kind == "tool_call":
            self._tool_call(update, meta.get(keys.TOOL, update["title"]))
        elif kind == "tool_call_update":
            self._remember(update["toolCallId"], meta.get(keys.DECISION) or {})
            if update.get("status") in ("completed", "failed"):
                self._tool_result(update)

    def messages(self, max_chars: int = MAX_CHARS) -> list[Message]:
        """The newest whole turns that fit into `max_chars`. The last turn is always among them; where it alone is too
        long, the results of its tools are shortened."""
        kept = self._newest(max_chars)
        return _fitted([message for turn in kept for message in turn], max_chars)

    def _newest(self, max_chars: int) -> list[list[Message]]:
        kept: list[list[Message]] = []
        size = 0
        for turn in reversed(self._turns):
            size += sum(_size(message) for message in turn)
            if kept and size > max_chars:
                break
            kept.append(turn)
        return kept[::-1]

    def _user(self, block: dict[str, Any], turn_id: str | None) -> None:
        part = _as_part(block)
        if turn_id is not None and turn_id == self._turn_id:  # a further block of the same prompt
            self._turns[-1][0]["content"].append(part)
        else:
            self._close_open_calls()
            self._turn_id = turn_id
            self._turns = self._newest(MAX_CHARS)  # the model gets no others any more, and those can contain pictures
            self._turns.append([{"role": "user", "content": [part]}])

    def _assistant_text(self, text: str) -> None:
        turn = self._current()
        last = turn[-1] if turn else None
        if last and last["role"] == "assistant" and "tool_calls" not in last:
            last["content"] += text
        else:
            turn.append({"role": "assistant", "content": text})

    def _plan(self, entries: list[dict[str, Any]]) -> None:
        self._plans += 1
        call_id = f"plan{self._plans}"
        arguments = [{"content": e["content"], "status": e["status"]} for e in entries]
        self._call(call_id, PLAN_TOOL, {"entries": arguments})
        self._current().append({"role": "tool", "tool_call_id": call_id, "name": PLAN_TOOL, "content": "shown"})

    def _tool_call(self, update: dict[str, Any], tool: str) -> None:
        self._tools[update["toolCallId"]] = tool
        self._call(update["toolCallId"], tool, update.get("rawInput") or {})

    def _call(self, call_id: str, tool: str, arguments: object) -> None:
        function = {"name": tool, "arguments": json.dumps(arguments, ensure_ascii=False)}
        calls = [{"id": call_id, "type": "function", "function": function}]
        turn = self._current()
        last = turn[-1] if turn else None
        if last and last["role"] == "assistant" and "tool_calls" not in last:
            last["tool_calls"] = calls  # the text just before the call is part of the same message
        else:
            turn.append({"role": "assistant", "content": None, "tool_calls": calls})

    def _close_open_calls(self) -> None:
        """Add a result for each call that has none, because providers refuse a history in which one is missing."""
        for call_id, tool in self._tools.items():
            answer = {"role": "tool", "tool_call_id": call_id, "name": tool, "content": "Error: interrupted"}
            self._current().append(answer)
        self._tools.clear()

    def _remember(self, call_id: str, decision: dict[str, Any]) -> None:
        # Logs of earlier versions have no fingerprint: such an answer does not say for which server it was given.
        option, fingerprint = str(decision.get("option")), decision.get("fingerprint")
        if (
            decision.get("reason") == "selected"
            and option.endswith("_always")
            and fingerprint
            and call_id in self._tools
        ):
            self._answers.pop(fingerprint, None)  # the newest answer comes last
            self._answers[fingerprint] = self._tools[call_id], option == "allow_always"

    def _tool_result(self, update: dict[str, Any]) -> None:
        call_id = update["toolCallId"]
        tool = self._tools.pop(call_id, None)
        if tool is None:
            return
        text = _result_text(update)
        self._current().append({"role": "tool", "tool_call_id": call_id, "name": tool, "content": text})
        for item in update.get("content") or []:
            if item.get("type") == "content" and item["content"].get("type") == "image":
                note = {"type": "text", "text": PHOTO_NOTE}
                self._current().append({"role": "user", "content": [note, _as_part(item["content"])]})

    def _current(self) -> list[Message]:
        if not self._turns:
            self._turns.append([])
        return self._turns[-1]


def _fitted(messages: list[Message], max_chars: int) -> list[Message]:
    """The same messages, with tool results cut to their beginning, the oldest first, until they fit into `max_chars`.

    So neither a turn of many steps nor a server with long results can exceed the model's context.
    """
    excess = sum(map(_size, messages)) - max_chars
    fitted: list[Message] = []
    for message in messages:
        content = message["content"]
        if excess > 0 and message["role"] == "tool" and len(content) > RESULT_CHARS:
            excess -= len(content) - RESULT_CHARS
            message = message | {"content": content[:RESULT_CHARS] + " … (the rest is left out)"}
        fitted.append(message)
    return fitted


def _size(message: Message) -> int:
    """How many characters of text a message has; a picture counts as a thousand."""
    content = message.get("content") or ""
    if isinstance(content, list):
        content = "".join(part.get("text", " " * 1000) for part in content)
    calls = message.get("tool_calls", [])
    return len(content) + sum(len(call["function"]["arguments"]) for call in calls)


def _as_part(block: dict[str, Any]) -> Message:
    """A content block of ACP as a content part of a chat message."""
    match block.get("type"):
        case "text":
            return {"type": "text", "text": block["text"]}
        case "image":
            url = f"data:{block.get('mimeType', 'image/png')};base64,{block['data']}"
            return {"type": "image_url", "image_url": {"url": url}}
        case "resource" if "text" in block.get("resource", {}):
            resource = block["resource"]
            return {"type": "text", "text": f"[{resource.get('uri', 'attachment')}]\n{resource['text']}"}
        case "resource_link":
            return {"type": "text", "text": f"[{block.get('name', 'link')}: {block.get('uri', '')}]"}
        case other:
            return {"type": "text", "text": f"[{other}: cannot be read here]"}


def _result_text(update: dict[str, Any]) -> str:
    """The model's view of a finished tool call: the structured output or else the text, never a picture or sound."""
    texts = [
        item["content"]["text"]
        for item in update.get("content") or []
        if item.get("type") == "content" and item["content"].get("type") == "text"
    ]
    if update["status"] == "failed":
        return "Error: " + (" ".join(texts) or "failed")
    if update.get("rawOutput") is not None:
        return json.dumps(update["rawOutput"], ensure_ascii=False)
    return "\n".join(texts) or "done"


def without_pictures(messages: list[Message]) -> list[Message]:
    """The messages for a model that cannot see: without photos, and with a note for each picture of a person."""
    kept: list[Message] = []
    for message in messages:
        content = message.get("content")
        if not isinstance(content, list):
            kept.append(message)
            continue
        if content and content[0].get("text") == PHOTO_NOTE:
            continue
        texts = [p["text"] if p["type"] == "text" else "[a picture that this model cannot see]" for p in content]
        kept.append(message | {"content": "\n".join(texts)})
    return kept
