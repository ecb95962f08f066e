"""Any MCP server can be the robot: the agent is unchanged, and tools that say nothing of themselves ask first."""

from __future__ import annotations

import sys
from pathlib import Path

from backend.agent.robot.mcp_client import McpClient
from tests.processes import Client, Robot

OTHER = Path(__file__).parents[1] / "third_party_robot.py"


async def test_the_same_agent_drives_a_robot_that_shares_no_code_with_ours(tmp_path: Path) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__ROBOT_URL": f"stdio:{sys.executable} {OTHER}"})
    with robot.running("agent", port=robot.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        assert await client.prompt("say hello, then tell me where you are") == "end_turn"
        assert [c["title"] for c in client.of("tool_call")] == ["Say something: sentence Hello.", "Where am i"]
        assert [q["params"]["toolCall"]["title"] for q in client.questions] == [
            "Say something: sentence Hello.",
            "Where am i",
        ]
        assert "I said: “Hello.” I am at x 1.0 m, y 2.0 m." in client.said
        await client.close()


async def test_a_server_that_has_to_be_started_may_take_longer_than_one_that_runs() -> None:
    started = McpClient(f"stdio:{sys.executable} {OTHER}", absent="There is no robot.", connect_timeout=0.01)
    assert set(await started.tools()) == {"say_something", "where_am_i"}
    await started.close()


async def test_what_it_may_not_do_the_other_robot_is_not_asked(tmp_path: Path) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__ROBOT_URL": f"stdio:{sys.executable} {OTHER}"})
    with robot.running("agent", port=robot.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer="reject_once")
        await client.new()
        await client.prompt("say hello")
        assert len(client.questions) == 1
        client.answer = "allow_once"
        await client.prompt("say hello")
        done = [
            c for u in client.of("tool_call_update") for c in u.get("content") or [] if u.get("status") == "completed"
        ]
        assert [c["content"]["text"] for c in done] == ["said 1 sentences"]
        await client.close()
