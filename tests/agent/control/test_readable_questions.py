"""People approve the text that they read: no invisible character of a prompt changes a question, a title or a log."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

import pytest

from backend import cli
from backend.agent.acp import export
from backend.agent.robot.mcp_client import MAX_TITLE_CHARS, Tool
from backend.agent.sessions.store import Event, SessionRow, Store, as_json
from tests.agent.conftest import Opener
from tests.databases import Database

TURNED = "the door is \u202ekcab"
ROW = SessionRow("s1", "Ana", None, "/", "supervised", "offline/commands", None, 0.0, 0.0)


async def test_a_question_shows_each_character_that_would_be_spoken(connect: Opener) -> None:
    client = await connect()
    await client.new()
    assert await client.prompt(f"say {TURNED}") == "end_turn"
    (question,) = client.questions
    assert question["params"]["toolCall"]["title"] == "Say aloud: “The door is ‹U+202E›kcab.”"
    assert client.of("tool_call")[-1]["title"] == "Say aloud: “The door is ‹U+202E›kcab.”"
    listed = (await client.link.request("session/list", {}))["sessions"]
    assert listed[0]["title"] == "say the door is ‹U+202E›kcab"


TOOL = Tool("speak", "", {}, "Speak", "Say “{text}”", None)


@pytest.mark.parametrize(
    ("tool", "arguments", "title"),
    [
        (TOOL, {"text": "a\x1b[2Jb\nc"}, "Say “a‹U+001B›[2Jb↵c”"),
        (replace(TOOL, title_template=None), {"te\u202ext": "x"}, "Speak: te‹U+202E›xt x"),
        (replace(TOOL, title_template="{text:>999999999}"), {"text": "x"}, "Speak: text x"),
        (replace(TOOL, title_template="{text:>{text}}"), {"text": "999999999"}, "Speak: text 999999999"),
    ],
)
def test_a_title_is_one_readable_line(tool: Tool, arguments: dict[str, Any], title: str) -> None:
    assert tool.title_for(arguments) == title


def test_a_title_that_is_cut_says_how_much_is_missing() -> None:
    title = TOOL.title_for({"text": "x" * 5_000})
    assert title.startswith("Say “xxx")
    assert title.endswith("x… (4006 more characters)")
    assert len(title) < MAX_TITLE_CHARS + 50


async def test_the_list_of_sessions_writes_no_control_character(
    database: Database, capsys: pytest.CaptureFixture[str]
) -> None:
    store = Store(database.url)
    await store.open()
    await store.add_session(replace(ROW, owner="A\u202ena", title="\x1b]0;mine\x07\x1b[2J\nforged line"))
    await store.append([Event("s1", 1, 0.0, as_json({"text": "hello"}))])
    await store.close()
    await export.list_sessions(database.url)
    listed = capsys.readouterr().out
    assert listed.count("\n") == 1
    assert "A‹U+202E›na  ‹U+001B›]0;mine‹U+0007›‹U+001B›[2J↵forged line" in listed


def test_a_record_of_the_log_is_one_line() -> None:
    text = "%s has stopped the robot"
    record = logging.LogRecord("agent", logging.INFO, "", 1, text, ("Ana\x1b[2J\n12:00 INFO forged",), None)
    assert (
        cli.LogLine("%(name)s: %(message)s").format(record)
        == "agent: Ana‹U+001B›[2J↵12:00 INFO forged has stopped the robot"
    )
