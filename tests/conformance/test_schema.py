"""The judge of the frames finds what is wrong, so its silence means something."""

from __future__ import annotations

from typing import Any

import pytest

from tests.conformance.schema import Frame, Judge, Sender


def update(**fields: Any) -> Frame:
    return {"jsonrpc": "2.0", "method": "session/update", "params": {"sessionId": "s", "update": fields}}


def request(method: str, **params: Any) -> Frame:
    return {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}


def answer(result: Any) -> Frame:
    return {"jsonrpc": "2.0", "id": 1, "result": result}


@pytest.mark.parametrize(
    ("frames", "complaint"),
    [
        ([("agent", update(sessionUpdate="nonsense"))], "SessionNotification.update"),
        ([("agent", update(sessionUpdate="tool_call", toolCallId="t"))], "SessionNotification.update"),
        ([("agent", update(sessionUpdate="plan", entries=[{"content": "x"}]))], "SessionNotification.update"),
        ([("agent", {"jsonrpc": "2.0", "method": "session/nonsense"})], "has no such notification"),
        ([("agent", request("session/prompt", sessionId="s", prompt=[]))], "has no such request"),
        ([("client", request("session/new", cwd="/"))], "'mcpServers' is a required property"),
        ([("client", request("initialize", protocolVersion=1)), ("agent", answer({}))], "InitializeResponse"),
        ([("client", request("_robot/stop")), ("agent", answer([]))], "_robot/stop: no object"),
        ([("agent", answer({}))], "an answer to nothing"),
        (
            [("client", request("session/list")), ("agent", answer({"sessions": []}))] * 2 + [("agent", answer({}))],
            "an",
        ),
        ([("client", {"id": 1, "method": "session/list"})], "version"),
        ([("client", request("logout")), ("agent", {"jsonrpc": "2.0", "id": 1, "error": {"code": 1}})], "'message'"),
        ([("client", request("logout") | {"id": 1.5})], "RequestId"),
    ],
)
def test_what_is_wrong_is_found(frames: list[tuple[Sender, Frame]], complaint: str) -> None:
    judge = Judge()
    for sender, frame in frames:
        judge.see(sender, frame)
    (violation,) = judge.violations
    assert complaint in violation


def test_what_is_right_is_passed_over() -> None:
    judge = Judge()
    judge.see("client", request("initialize", protocolVersion=1))
    judge.see("agent", answer({"protocolVersion": 1}))
    judge.see("agent", update(sessionUpdate="plan", entries=[]))
    judge.see("client", request("session/fork", sessionId="s", cwd="/"))
    judge.see("agent", answer({"sessionId": "t"}))
    judge.see("client", {"jsonrpc": "2.0", "method": "$/cancel_request", "params": {"requestId": 1}})
    assert judge.violations == []
