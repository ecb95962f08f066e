"""Whatever stands in a tool's arguments, the answer is a result or a refusal with a code, and the robot lives.

The messages go out as bytes, because no client would send some of them.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.mcp_robot.tools.results import RobotStatus
from tests.mcp_robot.conftest import TIME_LIMIT, Served, serving

LEGACY = "2025-06-18"
ACCEPT = {"accept": "application/json, text/event-stream", "content-type": "application/json"}
NUMBERS = [1e308, -1e308, 1e300, 1e18, 1e7, 1e6, 1000001, 5e-324, -0.0, 10**400, 2**63, math.nan, math.inf, -math.inf]
OTHERS = [True, None, "1", "NaN", "", "…", "\u202e", "\x00", "x" * 5000, [], {}, [1], {"x": 1}]
FITTING: dict[str, dict[str, Any]] = {
    "navigate_to_pose": {"x": 1.5, "y": 3.1, "yaw": 0.0, "plan_only": True},
    "navigate_to_place": {"place": "kitchen", "plan_only": True},
    "rotate_in_place": {"degrees": 1.0},
    "speak": {"text": "hi"},
    "take_photo": {},
    "get_current_pose": {},
    "get_robot_status": {},
    "get_topological_map": {},
}
REFUSALS = {"bad_arguments", "not_finite", "outside_map", "occupied", "unknown_place", "too_long", "empty"}


def request(params: bytes) -> bytes:
    return b'{"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": ' + params + b"}"


class Raw:
    """An MCP client that sends bytes."""

    def __init__(self, http: httpx.AsyncClient, session: str) -> None:
        self._http = http
        self._headers = ACCEPT | {"mcp-session-id": session, "mcp-protocol-version": LEGACY}

    async def send(self, content: bytes) -> httpx.Response:
        return await self._http.post("/mcp", content=content, headers=self._headers)

    async def call(self, tool: str, arguments: Any) -> dict[str, Any]:
        """The result of a call."""
        params = json.dumps({"name": tool, "arguments": arguments}).encode()
        return answer(await self.send(request(params)))["result"]  # type: ignore[no-any-return]


def answer(response: httpx.Response) -> dict[str, Any]:
    """The last message of an answer."""
    lines = [line.removeprefix("data: ") for line in response.text.splitlines() if line.startswith("data: {")]
    message: dict[str, Any] = json.loads(lines[-1] if lines else response.text)
    assert "result" in message, response.text
    return message


@contextlib.asynccontextmanager
async def raw(robot: Served) -> AsyncIterator[Raw]:
    async with robot.http() as http:
        client = {"protocolVersion": LEGACY, "capabilities": {}, "clientInfo": {"name": "raw", "version": "1"}}
        hello = {"jsonrpc": "2.0", "id": 0, "method": "initialize", "params": client}
        response = await http.post("/mcp", json=hello, headers=ACCEPT)
        client_of = Raw(http, response.headers["mcp-session-id"])
        await client_of.send(b'{"jsonrpc": "2.0", "method": "notifications/initialized"}')
        yield client_of


@pytest.fixture
async def client(tmp_path: Path) -> AsyncIterator[Raw]:
    most = {"max_motions_per_minute": 6000, "max_speeches_per_minute": 6000}
    async with serving(tmp_path, limits=most, time_scale=100.0) as robot, raw(robot) as client_of:
        yield client_of


def code(result: dict[str, Any]) -> str | None:
    """The code of a refusal, which text and structured content both have; None for a result."""
    if not result.get("isError"):
        return None
    error = result["structuredContent"]["error"]
    text = result["content"][0]["text"]
    assert text == f"{error['code']}: {error['message']}"
    assert len(text) < 1000, text
    return str(error["code"])


@pytest.mark.parametrize("tool", FITTING)
async def test_an_argument_of_any_kind_is_answered_with_a_result_or_a_refusal(client: Raw, tool: str) -> None:
    fitting = FITTING[tool]
    async with asyncio.timeout(4 * TIME_LIMIT):
        for key in [*fitting, "unknown"]:
            for value in [*NUMBERS, *OTHERS]:
                found = code(await client.call(tool, fitting | {key: value}))
                assert found in REFUSALS | {None}, (key, value, found)
                if key == "unknown":
                    assert found == "bad_arguments", (key, value)
        for arguments in ([], "x", 1, None):
            params = json.dumps({"name": tool, "arguments": arguments}).encode()
            response = await client.send(request(params))
            assert response.status_code < 500
        assert code(await client.call(tool, fitting)) is None  # it works as before


@pytest.mark.parametrize(
    ("tool", "arguments", "told"),
    [
        ("navigate_to_pose", {"x": 1e308}, "outside_map: The goal (1e+308, 3.1) is outside every map"),
        ("navigate_to_pose", {"y": -1e308}, "outside_map: The goal (1.5, -1e+308) is outside every map"),
        ("navigate_to_pose", {"x": 999999.0}, "outside_map: The goal (999999.0, 3.1) is outside the map (x from -0.5"),
        ("navigate_to_pose", {"yaw": 1e308}, "bad_arguments: A yaw is in rad, from -62.8 to 62.8, not 1e+308."),
        ("navigate_to_pose", {"x": math.nan}, "not_finite: x must be an ordinary number"),
        ("rotate_in_place", {"degrees": 1e308}, "too_long: A turn of 1e+308° is more than 3600° at once."),
        ("rotate_in_place", {"degrees": math.inf}, "not_finite: degrees must be an ordinary number"),
    ],
)
async def test_a_number_beyond_all_maps_is_told(client: Raw, tool: str, arguments: dict[str, float], told: str) -> None:
    result = await client.call(tool, FITTING[tool] | arguments)
    assert result["content"][0]["text"].startswith(told)
    assert code(await client.call(tool, FITTING[tool])) is None


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"\xff\xfe",
        b"[" * 100_000,
        request(b'{"name": "speak", "arguments": {"text": "\\ud800"}}'),
        request(b'{"name": "nothing", "arguments": {}}'),
        request(b"{}"),
        request(b'{"name": "speak", "arguments": {"text": "' + b"x" * 8_000_000 + b'"}}'),
    ],
)
async def test_a_message_of_any_kind_is_answered_and_the_next_one_works(client: Raw, content: bytes) -> None:
    response = await client.send(content)
    assert response.status_code < 500
    status = await client.call("get_robot_status", {})
    assert RobotStatus.model_validate(status["structuredContent"]).name == "Sancho"
