"""The official SDKs as clients: what the robot does is what counts, and its own telemetry tells it."""

from __future__ import annotations

import asyncio
import json
import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

from acp import PROTOCOL_VERSION
from acp.client import ClientSideConnection
from acp.schema import (
    AgentMessageChunk,
    AllowedOutcome,
    ClientCapabilities,
    PermissionOption,
    RequestPermissionResponse,
    TextContentBlock,
    ToolCallStart,
    ToolCallUpdate,
)
from acp.ws import create_websocket_stream

from backend.identity import Role
from tests.processes import PATIENCE_S, Robot

SCRIPT = Path(__file__).with_name("typescript_client.mjs")
NOON = "Go to lab 2.3.7 and tell them that the meeting is at noon"


def place_in(updates: list[dict[str, Any]], name: str) -> tuple[float, float]:
    """Where a place is, from the map that the agent read."""
    nodes = next(u["rawOutput"]["nodes"] for u in updates if "nodes" in (u.get("rawOutput") or {}))
    where = next(node["position"] for node in nodes if node["name"] == name)
    return where["x"], where["y"]


async def test_the_typescript_sdk_runs_the_papers_session(robot: Robot) -> None:
    node = shutil.which("node")
    assert node is not None, "test.sh finds or installs it"
    address = f"ws://127.0.0.1:{robot.bridge_port}/acp"
    async with robot.watched() as watched:
        start = watched.state.pose
        process = await asyncio.create_subprocess_exec(
            *(node, "--experimental-websocket", str(SCRIPT), address, robot.token("Ana", Role.SUPERVISOR)),
            stdout=asyncio.subprocess.PIPE,
        )
        async with asyncio.timeout(2 * PATIENCE_S):
            printed, _ = await process.communicate()
        assert process.returncode == 0
        report = json.loads(printed)
        updates = [params["update"] for params in report["heard"]]
        lab = place_in(updates, "lab 2.3.7")
        assert watched.spoken == ["The meeting is at noon.", "Lunch is at two."]
        states = [state for _, state in watched.states]
        pairs = pairwise(states)
        rests = [after.pose for before, after in pairs if before.motion is not None and after.motion is None]
        away = [((p.x - lab[0]) ** 2 + (p.y - lab[1]) ** 2) ** 0.5 for p in rests]
        from_home = [((p.x - start.x) ** 2 + (p.y - start.y) ** 2) ** 0.5 for p in rests]
        # P1 ends in the lab, P2 where it was cancelled, P3 in the lab again, P4 at home.
        assert len(rests) == 4
        assert max(away[0], away[2], from_home[3]) < 0.3
        assert from_home[1] > 1
    assert report["protocolVersion"] == 1
    assert report["stopReasons"] == ["end_turn", "cancelled", "end_turn", "end_turn"]
    assert [(question["title"], question["answer"]) for question in report["questions"]] == [
        ("Say aloud: “The meeting is at noon.”", "allow_once"),
        ("Say aloud: “It moved to one o'clock.”", "reject_once"),
        ("Say aloud: “Lunch is at two.”", "allow_once"),
    ]
    assert updates_of(report, "agent_thought_chunk")
    said = "".join(update["content"]["text"] for update in updates_of(report, "agent_message_chunk"))
    assert "I did not say “It moved to one o'clock.”: refused by Ana." in said
    numbered = [p["_meta"]["robot-acp/seq"] for p in report["heard"] if "robot-acp/seq" in (p.get("_meta") or {})]
    assert numbered == sorted(set(numbered))


def updates_of(report: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """The updates of one kind that the TypeScript client heard."""
    return [params["update"] for params in report["heard"] if params["update"]["sessionUpdate"] == kind]


class Person:
    """A client as the Python SDK wants it: allows what it is asked."""

    def __init__(self) -> None:
        self.updates: list[Any] = []
        self.asked: list[str | None] = []

    async def session_update(self, session_id: str, update: Any, **_: Any) -> None:
        self.updates.append(update)

    async def request_permission(
        self, options: list[PermissionOption], session_id: str, tool_call: ToolCallUpdate, **_: Any
    ) -> RequestPermissionResponse:
        self.asked.append(tool_call.title)
        allow = next(option.option_id for option in options if option.kind == "allow_once")
        return RequestPermissionResponse(outcome=AllowedOutcome(outcome="selected", option_id=allow))


async def test_the_python_sdk_runs_the_papers_first_prompt(robot: Robot) -> None:
    person = Person()
    headers = {"Authorization": f"Bearer {robot.token('Ana', Role.SUPERVISOR)}"}
    stream = await create_websocket_stream(f"ws://127.0.0.1:{robot.bridge_port}/acp", headers=headers)
    connection = ClientSideConnection(lambda _: person, stream)  # type: ignore[arg-type, return-value]
    async with robot.watched() as watched, asyncio.timeout(2 * PATIENCE_S):
        hello = await connection.initialize(PROTOCOL_VERSION, client_capabilities=ClientCapabilities())
        assert hello.protocol_version == 1
        session = await connection.new_session(cwd="/", mcp_servers=[])
        prompt = [TextContentBlock(type="text", text=NOON)]
        answer = await connection.prompt(prompt=prompt, session_id=session.session_id)
        assert answer.stop_reason == "end_turn"
        assert watched.spoken == ["The meeting is at noon."]
        updates = [update.model_dump(by_alias=True) for update in person.updates]
        lab = place_in(updates, "lab 2.3.7")
        assert watched.distance_to(*lab) < 0.3
    assert person.asked == ["Say aloud: “The meeting is at noon.”"]
    titles = [update.title for update in person.updates if isinstance(update, ToolCallStart)]
    assert titles == ["Read the map", "Drive to lab 2.3.7", "Say aloud: “The meeting is at noon.”"]
    said = "".join(u.content.text for u in person.updates if isinstance(u, AgentMessageChunk))
    assert "I said: “The meeting is at noon.”" in said
    await connection.close()
    await stream.close()
