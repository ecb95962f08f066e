"""The paper's session, P1 to P4, for any client: what the robot does is what counts, and its own telemetry tells it."""

from __future__ import annotations

import asyncio
from typing import Any

from tests.conformance.sdk_clients import SdkClient
from tests.processes import PATIENCE_S, Robot, eventually


def updates_of(client: SdkClient, kind: str) -> list[dict[str, Any]]:
    """The updates of one kind that a client heard."""
    return [params["update"] for params in client.heard if params["update"]["sessionUpdate"] == kind]


def place_in(client: SdkClient, name: str) -> tuple[float, float]:
    """Where a place is, from the map that the agent read."""
    outputs = [params["update"].get("rawOutput") or {} for params in client.heard]
    nodes = next(output["nodes"] for output in outputs if "nodes" in output)
    where = next(node["position"] for node in nodes if node["name"] == name)
    return where["x"], where["y"]


async def run_the_papers_session(client: SdkClient, robot: Robot, name: str) -> None:
    """Run it as the person `name`, and hold what the client heard against what the robot did."""
    async with robot.watched() as watched, asyncio.timeout(3 * PATIENCE_S):
        start = watched.state.pose
        assert await client.initialize() == 1
        session = await client.new_session()

        # P1: to the lab, and a message that is allowed.
        client.answers = ["allow_once"]
        assert await client.prompt("Go to lab 2.3.7 and tell them that the meeting is at noon") == "end_turn"
        lab = place_in(client, "lab 2.3.7")
        assert watched.distance_to(*lab) < 0.3
        assert watched.spoken == ["The meeting is at noon."]

        # P2: on the way back, cancelled once the robot has told how far it still has to go.
        heard = len(client.heard)
        turn = asyncio.create_task(client.prompt("Go back to where you started"))
        await eventually(lambda: progress(client, heard), "the robot to tell how far it has come")
        await client.cancel()
        assert await turn == "cancelled"
        assert await robot.stands()
        assert watched.distance_to(start.x, start.y) > 1

        # P3: two messages; the first is refused, the second allowed.
        client.answers = ["reject_once", "allow_once"]
        both = "tell them that it moved to one o'clock, and then tell them that lunch is at two"
        assert await client.prompt(f"Go to lab 2.3.7, {both}") == "end_turn"
        assert watched.distance_to(*lab) < 0.3

        # P4: home.
        assert await client.prompt("Go back to where you started") == "end_turn"
        assert watched.distance_to(start.x, start.y) < 0.3
        assert watched.spoken == ["The meeting is at noon.", "Lunch is at two."]

    assert [question["toolCall"]["title"] for question in client.questions] == [
        "Say aloud: “The meeting is at noon.”",
        "Say aloud: “It moved to one o'clock.”",
        "Say aloud: “Lunch is at two.”",
    ]
    titles = [call["title"] for call in updates_of(client, "tool_call")]
    assert titles[:3] == ["Read the map", "Drive to lab 2.3.7", "Say aloud: “The meeting is at noon.”"]
    assert updates_of(client, "agent_thought_chunk")
    said = "".join(update["content"]["text"] for update in updates_of(client, "agent_message_chunk"))
    assert "I said: “The meeting is at noon.”" in said
    assert f"I did not say “It moved to one o'clock.”: refused by {name}." in said
    metas = [params.get("_meta") or {} for params in client.heard if params["sessionId"] == session]
    numbered = [meta["robot-acp/seq"] for meta in metas if "robot-acp/seq" in meta]
    assert len(numbered) > len(titles)
    assert numbered == sorted(set(numbered))


def progress(client: SdkClient, since: int) -> bool:
    """Whether a call that runs has told of its progress after that update."""
    metas = [params["update"].get("_meta") or {} for params in client.heard[since:]]
    return any("robot-acp/progress" in meta for meta in metas)
