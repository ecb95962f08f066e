"""The memory of a session is a function of its events."""

from __future__ import annotations

import json
import pickle
from typing import Any

from backend.agent.acp import updates
from backend.agent.control.approvers import Outcome
from backend.agent.robot.mcp_client import Tool, ToolResult
from backend.agent.sessions.history import MAX_CHARS, PHOTO_NOTE, History

DRIVE = Tool("navigate_to_place", "Drive", {}, "Drive", "Drive to {place}", False)


def history_of(*updates: dict[str, Any]) -> History:
    history = History()
    for update in updates:
        history.apply(update)
    return history


def roles(history: History) -> list[str]:
    return [message["role"] for message in history.messages()]


def test_a_turn_becomes_the_chat_that_a_model_would_have_had() -> None:
    history = history_of(
        updates.user_message({"type": "text", "text": "go to the kitchen"}, "Ana", "t"),
        updates.thought("I will go."),
        updates.tool_call("t.1", DRIVE, {"place": "kitchen"}, "pending"),
        updates.tool_status("t.1", "in_progress"),
        updates.tool_result("t.1", ToolResult(False, [], {"reached": True})),
        updates.message("Here "),
        updates.message("I am."),
        updates.turn_ended("t", "end_turn"),
    )
    user, asked, result, answer = history.messages()
    assert user == {"role": "user", "content": [{"type": "text", "text": "go to the kitchen"}]}
    assert asked["tool_calls"][0]["function"] == {"name": "navigate_to_place", "arguments": '{"place": "kitchen"}'}
    assert result == {
        "role": "tool", "tool_call_id": "t.1", "name": "navigate_to_place", "content": '{"reached": true}'
    }  # fmt: skip
    assert answer == {"role": "assistant", "content": "Here I am."}
    assert history.interrupted is None


def test_a_failure_is_told_as_an_error() -> None:
    history = history_of(
        updates.user_message({"type": "text", "text": "go"}, "Ana", "t"),
        updates.tool_call("t.1", DRIVE, {"place": "moon"}, "pending"),
        updates.tool_status("t.1", "failed", "refused by Ana"),
    )
    assert history.messages()[-1]["content"] == "Error: refused by Ana"


def test_blocks_of_one_prompt_are_one_message_and_a_photo_follows_its_tool_call() -> None:
    photo = {"type": "image", "data": "AAAA", "mimeType": "image/png"}
    look = Tool("take_photo", "Photo", {}, "Photo", None, True)
    history = history_of(
        updates.user_message({"type": "text", "text": "compare"}, "Ana", "t"),
        updates.user_message(photo, "Ana", "t"),
        updates.tool_call("t.1", look, {}, "in_progress"),
        updates.tool_result("t.1", ToolResult(False, [photo], {"width": 1})),
    )
    assert roles(history) == ["user", "assistant", "tool", "user"]
    assert [part["type"] for part in history.messages()[0]["content"]] == ["text", "image_url"]
    assert history.messages()[-1]["content"][0]["text"] == PHOTO_NOTE


def test_a_turn_that_has_not_ended_and_its_open_calls_are_known() -> None:
    history = history_of(
        updates.user_message({"type": "text", "text": "go"}, "Ana", "t"),
        updates.tool_call("t.1", DRIVE, {"place": "kitchen"}, "pending"),
    )
    assert history.interrupted == "t"
    assert history.open_calls == ["t.1"]


def test_a_long_past_is_shortened_by_whole_turns_and_never_the_last() -> None:
    history = History()
    for number in range(50):
        history.apply(updates.user_message({"type": "text", "text": f"{number} " + "x" * 100}, "Ana", str(number)))
        history.apply(updates.message("y" * 100))
    kept = history.messages(max_chars=1000)
    assert kept[0]["role"] == "user"
    assert kept[-2]["content"][0]["text"].startswith("49 ")
    assert len(kept) == 2 * 4
    assert len(history.messages(max_chars=1)) == 2


def size(history: History) -> int:
    """Characters of what the model is given."""
    return len(json.dumps(history.messages()))


def test_however_long_a_session_is_its_model_gets_a_bounded_past() -> None:
    history, largest = History(), 0
    for number in range(1000):  # 5,000 events, and what an inference would get after each
        for update in (
            updates.user_message({"type": "text", "text": f"go to lab {number} " + "x" * 200}, "Ana", f"t{number}"),
            updates.message("I will go. " + "y" * 100),
            updates.tool_call(f"t{number}.1", DRIVE, {"place": f"lab {number}"}, "pending"),
            updates.tool_result(f"t{number}.1", ToolResult(False, [], {"reached": True, "log": "z" * 300})),
            updates.turn_ended(f"t{number}", "end_turn"),
        ):
            history.apply(update)
        largest = max(largest, size(history))
    assert MAX_CHARS < largest < 2 * MAX_CHARS, (
        "the past fills what there is, and no more; names and quotes come on top"
    )
    assert "go to lab 999 " in str(history.messages()[-3]["content"])


def test_a_turn_of_many_steps_keeps_its_prompt_its_calls_and_its_newest_results() -> None:
    history = history_of(updates.user_message({"type": "text", "text": "look at everything"}, "Ana", "t"))
    for number in range(100):
        history.apply(updates.tool_call(f"t.{number}", DRIVE, {"place": f"lab {number}"}, "pending"))
        history.apply(updates.tool_result(f"t.{number}", ToolResult(False, [], {"seen": f"{number} " + "x" * 5000})))
    messages = history.messages()
    assert len(messages) == 201, "every call has its result: a provider refuses a history in which one is missing"
    assert messages[0]["content"][0]["text"] == "look at everything"
    assert messages[2]["content"].endswith("(the rest is left out)")
    assert size(history) < 3 * MAX_CHARS
    short = history_of(*(updates.message("a"),), updates.tool_call("t.1", DRIVE, {}, "pending"))
    short.apply(updates.tool_result("t.1", ToolResult(False, [], {"seen": "x" * 5000})))
    assert "left out" not in str(short.messages())


def test_a_result_that_is_longer_than_all_the_past_is_cut() -> None:
    history = history_of(
        updates.user_message({"type": "text", "text": "read it"}, "Ana", "t"),
        updates.tool_call("t.1", DRIVE, {}, "pending"),
        updates.tool_result("t.1", ToolResult(False, [], {"text": "x" * 10_000_000})),
    )
    assert size(history) < MAX_CHARS


def test_a_fork_has_the_refusals_and_not_the_permissions_of_its_past() -> None:
    speak = Tool("speak", "Speak", {}, "Speak", None, False)
    history = history_of(
        updates.tool_call("t.1", DRIVE, {}, "pending"),
        updates.tool_status("t.1", "in_progress", outcome=Outcome(True, "selected", "allow_always", "Ana", "f1")),
        updates.tool_call("t.2", speak, {}, "pending"),
        updates.tool_status("t.2", "failed", outcome=Outcome(False, "selected", "reject_always", "Ana", "f2")),
    )
    assert history.remembered == {"navigate_to_place": True, "speak": False}
    history.apply(updates.forked("s0"))
    assert history.remembered == {"speak": False}
    assert (history.answer_for("f1"), history.answer_for("f2")) == (None, False)


def test_an_answer_for_a_session_that_does_not_say_for_which_tool_counts_for_none() -> None:
    history = history_of(
        updates.tool_call("t.1", DRIVE, {}, "pending"),
        updates.tool_status("t.1", "in_progress", outcome=Outcome(True, "selected", "allow_always", "Ana")),
    )
    assert history.remembered == {}
    assert history.answer_for("") is None


def test_pictures_of_turns_that_no_model_is_given_any_more_are_not_kept() -> None:
    history = History()
    photo = {"type": "image", "data": "A" * 100_000, "mimeType": "image/png"}
    for number in range(100):
        history.apply(updates.user_message({"type": "text", "text": "x" * 5000}, "Ana", str(number)))
        history.apply(updates.user_message(photo, "Ana", str(number)))
    assert history.messages()[-1]["content"][1]["image_url"]["url"].endswith("AAAA")
    assert len(pickle.dumps(history)) < 15 * len(photo["data"])
