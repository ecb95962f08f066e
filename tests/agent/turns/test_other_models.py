"""A model of a provider, over HTTP through litellm: its calls are run, and an answer that is not whole does nothing."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

from tests.processes import Client, Robot


@dataclass
class Provider:
    """A server that speaks the OpenAI chat API and streams what the test wrote down, one answer after the other."""

    answers: list[list[dict[str, Any]] | int] = field(default_factory=list)
    asked: list[dict[str, Any]] = field(default_factory=list)
    port: int = 0

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[Provider]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        async with server:
            yield self

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().lower()
        length = int(head.split("content-length:")[1].split("\r\n")[0])
        self.asked.append(json.loads(await reader.readexactly(length)))
        answer = self.answers.pop(0)
        if isinstance(answer, int):
            writer.write(f"HTTP/1.1 {answer} Error\r\nContent-Length: 2\r\nConnection: close\r\n\r\n{{}}".encode())
        else:
            writer.write(b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nConnection: close\r\n\r\n")
            for choice in answer:
                chunk = {"id": "c", "object": "chat.completion.chunk", "created": 1, "model": "m"}
                writer.write(f"data: {json.dumps(chunk | {'choices': [{'index': 0} | choice]})}\n\n".encode())
            writer.write(b"data: [DONE]\n\n")
        await writer.drain()
        writer.close()


def text(words: str) -> dict[str, Any]:
    return {"delta": {"role": "assistant", "content": words}, "finish_reason": None}


def call(name: str, arguments: str) -> dict[str, Any]:
    function = {"name": name, "arguments": arguments}
    return {"delta": {"tool_calls": [{"index": 0, "id": "1", "type": "function", "function": function}]}}


def end(reason: str) -> dict[str, Any]:
    return {"delta": {}, "finish_reason": reason}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """The robot server; each test has an agent of its own."""
    robot = Robot(tmp_path_factory.mktemp("data"))
    with robot.running("robot", "--time-scale", "20", port=robot.robot_port):
        yield robot


THE_PROVIDERS = {"ROBOT_ACP_AGENT__MODEL": "openai/m"}


@contextlib.asynccontextmanager
async def client_of(robot: Robot, provider: Provider, models: dict[str, str] = THE_PROVIDERS) -> AsyncIterator[Client]:
    """A client of an agent with these models; the first thought, which asks the model too, is off."""
    address = f"http://127.0.0.1:{provider.port}/v1"
    agent = robot.with_another_agent({"OPENAI_API_KEY": "none", "OPENAI_API_BASE": address, **models})
    with agent.running("agent", port=agent.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{agent.agent_port}")
        session = await client.new()
        off = {"sessionId": session, "configId": "thought", "type": "boolean", "value": False}
        await client.link.request("session/set_config_option", off)
        yield client
        await client.close()


async def test_a_call_of_the_model_is_run_and_its_result_told_to_the_model(robot: Robot) -> None:
    provider = Provider([[call("rotate_in_place", '{"degrees": 20}'), end("tool_calls")], [text("Done."), end("stop")]])
    async with provider.running(), client_of(robot, provider) as client:
        assert await client.prompt("turn a little") == "end_turn"
        assert client.said == "Done."
    assert [m["role"] for m in provider.asked[1]["messages"]] == ["system", "user", "assistant", "tool"]


@pytest.mark.parametrize(
    ("finish", "stop_reason", "told"),
    [("length", "max_tokens", "got longer"), ("content_filter", "refusal", "refused")],
)
async def test_nothing_of_an_answer_that_is_not_whole_is_done(
    robot: Robot, finish: str, stop_reason: str, told: str
) -> None:
    provider = Provider([[text("I will "), call("rotate_in_place", '{"degrees": 20}'), end(finish)]])
    async with provider.running(), client_of(robot, provider) as client:
        assert await client.prompt("turn a little") == stop_reason
        assert client.of("tool_call") == []
        assert told in client.said
        provider.answers = [[text("Here."), end("stop")]]
        assert await client.prompt("are you there?") == "end_turn"


async def test_a_provider_that_fails_is_told_in_words_and_the_next_prompt_works(robot: Robot) -> None:
    provider = Provider([401, [text("Here."), end("stop")]])
    async with provider.running(), client_of(robot, provider) as client:
        assert await client.prompt("are you there?") == "end_turn"
        assert "The model openai/m refused the key." in client.said
        assert await client.prompt("are you there?") == "end_turn"
        assert client.said.endswith("Here.")


async def test_a_model_that_is_chosen_in_the_session_answers_its_first_prompt(robot: Robot) -> None:
    provider = Provider([[text("Here."), end("stop")]])
    offered = {"ROBOT_ACP_AGENT__MODELS": '["openai/m"]'}
    async with provider.running(), client_of(robot, provider, offered) as client:
        assert await client.prompt("where are you?") == "end_turn"
        assert "I am at x" in client.said
        assert provider.asked == []
        chosen = {"sessionId": client.session, "configId": "model", "value": "openai/m"}
        await client.link.request("session/set_config_option", chosen)
        assert await client.prompt("are you there?") == "end_turn"
        assert client.said.endswith("Here.")
