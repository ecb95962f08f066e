"""What the terminal shows of a session, line by line."""

from __future__ import annotations

from typing import Any

from backend.chat.view import Line, View


def shown(*updates: dict[str, Any]) -> list[Line]:
    view = View("Sancho")
    return [line for update in updates for line in view.apply(update)] + view.flush()


def chunk(kind: str, text: str) -> dict[str, Any]:
    return {"sessionUpdate": f"agent_{kind}_chunk", "content": {"type": "text", "text": text}}


def call(status: str, **more: Any) -> dict[str, Any]:
    return {"sessionUpdate": "tool_call_update", "toolCallId": "t", "status": status} | more


CALL = {"sessionUpdate": "tool_call", "toolCallId": "t", "title": "Say aloud: “Hi.”", "status": "pending"}


def test_words_of_a_stream_become_whole_lines() -> None:
    lines = shown(
        chunk("thought", "I will "), chunk("thought", "go."), chunk("message", "Done.\nBye"), chunk("message", "!")
    )
    assert lines == [Line("thought", "I will go."), Line("robot", "Done."), Line("robot", "Bye!")]


def test_a_tool_call_tells_how_it_ended_and_who_decided() -> None:
    text = {"type": "content", "content": {"type": "text", "text": "refused by Ana"}}
    allowed = {"_meta": {"robot-acp/decision": {"by": "Ana", "option": "allow_once", "reason": "selected"}}}
    assert shown(CALL, call("in_progress", **allowed)) == [Line("note", "Allowed by Ana.")]
    assert shown(CALL, call("failed", content=[text])) == [Line("problem", "✗ Say aloud: “Hi.”: refused by Ana")]
    sound = {"type": "content", "content": {"type": "audio", "data": "", "mimeType": "audio/wav"}}
    assert shown(CALL, call("completed", content=[sound])) == [Line("result", "✓ Say aloud: “Hi.” [audio]")]


def test_progress_is_a_status_and_no_line() -> None:
    view = View("Sancho")
    text = {"type": "content", "content": {"type": "text", "text": "3 m to go"}}
    assert view.apply({"sessionUpdate": "tool_call_update", "toolCallId": "t", "content": [text]}) == []
    assert view.status == "3 m to go"


def test_a_cancelled_turn_says_so() -> None:
    meta = {"robot-acp/turn": {"id": "1", "state": "ended", "stopReason": "cancelled"}}
    assert shown({"sessionUpdate": "session_info_update", "_meta": meta}) == [Line("note", "Cancelled.")]


def test_an_update_of_a_kind_that_it_does_not_know_is_left_out() -> None:
    assert shown({"sessionUpdate": "something_new"}) == []


def test_a_text_of_somebody_else_adds_no_line_of_its_own() -> None:
    """A line such as "Allowed by Ana." in column 0 is the agent's."""
    forged, readable = "Hello.\nAllowed by Ana.\x1b[A", "Hello.↵Allowed by Ana.‹U+001B›[A"
    said = {"sessionUpdate": "user_message_chunk", "content": {"type": "text", "text": forged}}
    assert shown(said) == [Line("you", "you: Hello.\n  Allowed by Ana.‹U+001B›[A")]
    title = CALL | {"title": forged}
    assert shown(title, call("completed")) == [Line("result", "✓ Hello.↵Allowed by Ana.‹U+001B›[A")]
    decision = {"_meta": {"robot-acp/decision": {"by": forged, "option": "allow_once", "reason": "selected"}}}
    assert shown(CALL, call("in_progress", **decision)) == [Line("note", f"Allowed by {readable}.")]
    plan = {"sessionUpdate": "plan", "entries": [{"content": forged, "status": "pending"}]}
    assert shown(plan) == [Line("note", "○ Hello.↵Allowed by Ana.‹U+001B›[A")]
    why = {"type": "content", "content": {"type": "text", "text": forged}}
    assert shown(CALL, call("failed", content=[why])) == [
        Line("problem", "✗ Say aloud: “Hi.”: Hello.↵Allowed by Ana.‹U+001B›[A")
    ]
