"""A stop that the robot's server does not take goes to the agent; what people read is the truth in every case."""

from __future__ import annotations

import asyncio
from typing import Any

import orjson
import pytest

from backend.identity import Role

LOST = "The robot cannot be reached to stop it."
OWN = "Use the stop button on the robot."


async def answer(agent: Any, **outcome: Any) -> dict[str, Any]:
    """Let the agent answer the next request; the request."""
    request = await agent.heard_message()
    await agent.say(orjson.dumps({"jsonrpc": "2.0", "id": request["id"]} | outcome) + b"\n")
    return dict(request)


@pytest.mark.parametrize(
    ("outcome", "status", "told"),
    [
        ({"result": {"stopped": {"by": "Vera", "at": 1.0}}}, 200, {"stopped": {"by": "Vera", "at": 1.0}}),
        (
            {"error": {"code": -32603, "message": "It was not stopped.", "data": {"cancelled": 2}}},
            503,
            {"error": "It was not stopped."},
        ),
        (
            {"error": {"code": -32601, "message": "Method not found"}},
            503,
            {"error": f"{LOST} This agent cannot cancel the turns of all people; cancel in each session. {OWN}"},
        ),
        (
            {"result": {}},
            503,
            {"error": f"{LOST} This agent cannot cancel the turns of all people; cancel in each session. {OWN}"},
        ),
    ],
)
async def test_an_agents_answer_is_told_as_it_is(
    bridge: Any, agent: Any, outcome: dict[str, Any], status: int, told: dict[str, Any]
) -> None:
    token = bridge.token(Role.VIEWER, "Vera")
    async with bridge.http(token) as http:
        pressed = asyncio.create_task(http.post("/api/stop"))
        initialize = await answer(agent, result={"protocolVersion": 1})
        assert initialize["method"] == "initialize"
        assert initialize["params"]["_meta"] == {"robot-acp/token": token}
        assert (await answer(agent, **outcome))["method"] == "_robot/stop"
        response = await pressed
    assert (response.status_code, response.json()) == (status, told)


async def test_an_agent_that_refuses_the_login_cancels_nothing_and_this_is_told(bridge: Any, agent: Any) -> None:
    async with bridge.http(bridge.token(Role.VIEWER)) as http:
        pressed = asyncio.create_task(http.post("/api/stop"))
        await answer(agent, error={"code": -32000, "message": "Log in first."})
        response = await pressed
    assert response.status_code == 503
    told = f"{LOST} The agent did not accept this login, so its turns were not cancelled either. {OWN}"
    assert response.json() == {"error": told}


async def test_an_agent_behind_a_command_is_not_started_for_a_stop(bridge_with: Any) -> None:
    async with bridge_with(bridge={"agent": "stdio:cat"}) as bridge, bridge.http(bridge.token()) as http:
        response = await http.post("/api/stop")
    assert response.json()["error"].startswith(f"{LOST} This agent cannot cancel the turns of all people")


async def test_an_agent_that_is_away_is_named(bridge_with: Any) -> None:
    async with bridge_with() as bridge, bridge.http(bridge.token()) as http:
        response = await http.post("/api/stop")
    told = f"{LOST} The agent does not answer, so its turns were not cancelled either. {OWN}"
    assert response.json() == {"error": told}
