"""The terminal offers what the agent offers: by kind, whatever the ids are, and nothing more."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import orjson
import pytest

from backend.chat.question import Question
from tests.processes import PATIENCE_S, Robot

ONCE = [
    {"optionId": "x1", "name": "Go ahead", "kind": "allow_once"},
    {"optionId": "x2", "name": "Don't", "kind": "reject_once"},
]
ALWAYS = [
    {"optionId": "x3", "name": "Allow speech in this session", "kind": "allow_always"},
    {"optionId": "x4", "name": "Never speech in this session", "kind": "reject_always"},
]


def asked(options: Any, title: str = "Say aloud: “Hello.”") -> Question:
    return Question.of({"toolCall": {"title": title}, "options": options, "_meta": {"robot-acp/timeout_s": 60.0}})


def test_the_question_shows_what_was_offered() -> None:
    assert asked(ONCE).text("Sancho") == "Sancho asks: Say aloud: “Hello.” (60 s to answer)\n  y Go ahead · n Don't"
    assert "a Allow speech in this session · v Never speech in this session" in asked(ONCE + ALWAYS).text("Sancho")


@pytest.mark.parametrize(
    ("line", "option"),
    [("y", "x1"), ("Y", "x1"), ("yes", "x1"), ("n", "x2"), ("no", "x2"), ("a", None), ("v", None), ("yep", None)],
)
def test_what_was_not_offered_cannot_be_chosen(line: str, option: str | None) -> None:
    assert asked(ONCE).selected(line) == option


def test_a_key_stands_for_a_kind_and_the_id_is_the_agents() -> None:
    question = asked([ALWAYS[1], ALWAYS[0], ONCE[1], ONCE[0]])
    assert [question.selected(key) for key in "ynav"] == ["x1", "x2", "x3", "x4"]
    assert asked([{"optionId": "allow_once", "name": "No", "kind": "reject_once"}]).selected("y") is None


def test_a_second_option_of_a_kind_and_one_of_a_kind_that_is_not_known_have_numbers() -> None:
    more = [{"optionId": "x5", "name": "Go slowly", "kind": "allow_once"}, {"optionId": "x6", "name": "Ask Ben"}]
    question = asked(ONCE + more)
    assert question.text("Sancho").endswith("y Go ahead · n Don't · 1 Go slowly · 2 Ask Ben")
    assert [question.selected(key) for key in "y12"] == ["x1", "x5", "x6"]
    assert question.choices == "y, n, 1 or 2"


@pytest.mark.parametrize(
    "nonsense", [None, 1, {}, "y", [None, [], "y", {"kind": []}, {"optionId": 1, "kind": "allow_once"}]]
)
def test_options_that_cannot_be_read_are_none(nonsense: Any) -> None:
    assert Question.of({"toolCall": None, "options": nonsense, "_meta": []}).options == {}


def test_no_text_of_the_agent_has_a_line_of_its_own() -> None:
    forged = [{"optionId": "x1", "name": "Don't\n  n Allow", "kind": "allow_once"}]
    assert asked(forged, "Wait\nAllowed by Ana.").text("Sancho").count("\n") == 1


@dataclass
class OtherAgent:
    """An agent of another make: it asks twice at once, with ids of its own, and keeps the answers."""

    options: list[list[dict[str, Any]]]
    answers: list[dict[str, Any]] = field(default_factory=list)
    port: int = 0

    @asynccontextmanager
    async def running(self) -> AsyncIterator[OtherAgent]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        async with server:
            yield self

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        prompt: Any = None
        while line := await reader.readline():
            message = orjson.loads(line)
            if "method" not in message:
                self.answers.append(message)
                if len(self.answers) == len(self.options):
                    self._send(writer, {"id": prompt, "result": {"stopReason": "end_turn"}})
            elif message["method"] == "session/prompt":
                prompt = message["id"]
                for number, options in enumerate(self.options):
                    call = {"toolCallId": f"t{number}", "title": f"Do number {number}"}
                    params = {"sessionId": "s", "toolCall": call, "options": options}
                    self._send(writer, {"id": number, "method": "session/request_permission", "params": params})
            elif "id" in message:
                result = {"sessionId": "s", "protocolVersion": 1, "agentCapabilities": {}}
                self._send(writer, {"id": message["id"], "result": result})
        writer.close()

    def _send(self, writer: asyncio.StreamWriter, message: dict[str, Any]) -> None:
        writer.write(orjson.dumps({"jsonrpc": "2.0"} | message) + b"\n")


async def test_an_agent_of_another_make_gets_its_own_ids_one_question_after_the_other(tmp_path: Path) -> None:
    async with OtherAgent([ONCE, ALWAYS, []]).running() as agent:
        robot = Robot(tmp_path)
        command = robot.command("chat", f"tcp://127.0.0.1:{agent.port}")
        say = {"input": "do it\na\ny\ny\na\n", "text": True, "capture_output": True, "timeout": PATIENCE_S}
        done = await asyncio.to_thread(subprocess.run, command, env=robot.variables, **say)
    chosen = {answer["id"]: answer.get("result", {}).get("outcome", {}).get("optionId") for answer in agent.answers}
    assert chosen == {0: "x1", 1: "x3", 2: None}
    assert "Answer the question first: y or n." in done.stdout
    assert "Answer the question first: a or v." in done.stdout
    assert done.stdout.index("Answer the question first: y or n.") < done.stdout.index("asks: Do number 1")
