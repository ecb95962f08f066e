"""Questions of the agent to a person, and requests that a client takes back."""

from __future__ import annotations

import asyncio
import json
import subprocess
from typing import Any

import pytest

from backend.identity import Role
from tests.agent.acp.test_connection import HELLO, dial
from tests.agent.conftest import Opener
from tests.processes import Client, Robot, eventually

FORMS = {"elicitation": {"form": {}}}


async def form_of(client: Client) -> dict[str, Any]:
    def form() -> dict[str, Any] | None:
        return next((m for m in client.heard if m["method"] == "elicitation/create"), None)

    return dict(await eventually(form, "the form"))


async def test_an_ambiguous_place_is_settled_by_a_form_where_the_client_shows_one(connect: Opener) -> None:
    client = await connect(capabilities=FORMS)
    await client.new()
    turn = client.later(client.prompt("go to a lab"))
    form = await form_of(client)
    assert form["params"]["requestedSchema"]["properties"]["answer"]["enum"][0] == "lab 2.3.1"
    await client.link.respond(form["id"], {"action": "accept", "content": {"answer": "lab 2.3.6"}})
    assert await turn == "end_turn"
    assert "I am at lab 2.3.6." in client.said


@pytest.mark.parametrize(
    "answer",
    [
        {"action": "decline"},
        {"action": "cancel"},
        {"action": "accept", "content": {"answer": "the moon"}},
        {"action": "accept"},
    ],
)
async def test_without_a_choice_the_question_is_put_in_plain_words_and_nothing_moves(
    robot: Robot, connect: Opener, answer: dict[str, Any]
) -> None:
    client = await connect(capabilities=FORMS)
    await client.new()
    async with robot.watched() as watched:
        turn = client.later(client.prompt("go to a lab"))
        await client.link.respond((await form_of(client))["id"], answer)
        assert await turn == "end_turn"
        assert all(state.twist.linear == 0 for _, state in watched.states)
    assert "Which one do you mean: lab 2.3.1" in client.said


async def test_cancelling_the_turn_withdraws_the_form(connect: Opener) -> None:
    client = await connect(capabilities=FORMS)
    await client.new()
    turn = client.later(client.prompt("go to a lab"))
    form = await form_of(client)
    await client.cancel()
    assert await turn == "cancelled"
    assert {"requestId": form["id"]} in [m["params"] for m in client.heard if m["method"] == "$/cancel_request"]


async def test_any_other_request_that_is_taken_back_is_answered_once(robot: Robot) -> None:
    raw = await dial(robot)
    await raw.send(json.dumps(HELLO).encode())
    await raw.answer()
    request = {"jsonrpc": "2.0", "id": "a", "method": "session/new", "params": {"cwd": "/", "mcpServers": []}}
    cancel = {"jsonrpc": "2.0", "method": "$/cancel_request", "params": {"requestId": "a"}}
    await raw.send(json.dumps(request).encode() + b"\n" + json.dumps(cancel).encode())
    answer = await raw.answer()
    assert (answer["id"], answer["error"]["code"]) == ("a", -32800)
    for odd in ({"requestId": "a"}, {"requestId": "never"}, {"requestId": None}, {"requestId": []}, {}):
        await raw.send(json.dumps(cancel | {"params": odd}).encode())
    await raw.send(json.dumps(HELLO | {"id": 9}).encode())
    assert (await raw.answer())["id"] == 9
    raw.writer.close()


async def test_the_command_line_lists_and_exports_sessions(robot: Robot, connect: Opener) -> None:
    client = await connect()
    session = await client.new()
    await client.prompt("where are you?")

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = robot.command("sessions", *arguments)
        return subprocess.run(command, env=robot.variables, text=True, capture_output=True)

    listed = await asyncio.to_thread(run, "list")
    assert f"{session}  " in listed.stdout
    assert "where are you?" in listed.stdout
    exported = await asyncio.to_thread(run, "export", session)
    assert [json.loads(line)["update"] for line in exported.stdout.splitlines()][1:] == client.updates
    missing = await asyncio.to_thread(run, "export", "nonsense")
    assert missing.returncode == 1
    assert "There is no session nonsense" in missing.stderr


async def test_somebody_who_only_watches_chooses_no_place(robot: Robot, connect: Opener) -> None:
    client, viewer = await connect(), await connect(robot.token("Vic", Role.VIEWER), capabilities=FORMS)
    await viewer.load(await client.new())
    assert await client.prompt("go to a lab") == "end_turn"
    assert "Which one do you mean: lab 2.3.1" in client.said
    assert "elicitation/create" not in [message["method"] for message in viewer.heard]


async def test_who_chose_is_in_the_log(robot: Robot, connect: Opener) -> None:
    client, ben = await connect(), await connect(robot.token("Ben", Role.OPERATOR), capabilities=FORMS)
    await ben.load(await client.new())
    turn = client.later(client.prompt("go to a lab"))
    await ben.link.respond((await form_of(ben))["id"], {"action": "accept", "content": {"answer": "lab 2.3.6"}})
    assert await turn == "end_turn"
    assert {"answer": "lab 2.3.6", "by": "Ben"} in [u.get("rawOutput") for u in client.of("tool_call_update")]
    assert "I am at lab 2.3.6." in client.said


async def test_the_choice_of_one_who_may_no_longer_approve_does_not_count(robot: Robot, connect: Opener) -> None:
    client, ben = await connect(), await connect(robot.token("Ben", Role.OPERATOR), capabilities=FORMS)
    await ben.load(await client.new())
    turn = client.later(client.prompt("go to a lab"))
    form = await form_of(ben)
    lesser = {"methodId": "token", "_meta": {"robot-acp/token": robot.token("Ben", Role.VIEWER)}}
    await ben.link.request("authenticate", lesser)
    await ben.link.respond(form["id"], {"action": "accept", "content": {"answer": "lab 2.3.6"}})
    assert await turn == "end_turn"
    assert "Which one do you mean: lab 2.3.1" in client.said
