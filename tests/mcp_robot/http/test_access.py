"""Nobody talks to the robot without its token, and no web page does at all."""

from __future__ import annotations

import httpx
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from backend.mcp_robot.http.access import own_names
from tests.mcp_robot.conftest import Served

ROUTES = [("POST", "/mcp"), ("GET", "/mcp"), ("POST", "/stop"), ("POST", "/release"), ("GET", "/nothing")]


async def test_health_is_public(robot: Served) -> None:
    async with httpx.AsyncClient() as http:
        answer = await http.get(f"{robot.url}/health")
    assert answer.status_code == 200
    assert answer.json()["status"] == "ok"
    assert answer.json()["robot"] == "Sancho"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Authorization": ""}, 401),
        ({"Authorization": "Bearer wrong"}, 401),
        ({"Authorization": "Bearer ü".encode()}, 401),
        ({"Authorization": "Basic {token}"}, 401),
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://127.0.0.1:1"}, 403),
        ({"Host": "evil.example"}, 421),
        ({"Host": "127.0.0.1.evil.example:8000"}, 421),
    ],
)
async def test_a_request_that_proves_nothing_is_refused_with_a_sentence(
    robot: Served, headers: dict[str, str | bytes], status: int
) -> None:
    given = {k: v.replace("{token}", robot.token) if isinstance(v, str) else v for k, v in headers.items()}
    async with robot.http() as http:
        for method, route in ROUTES:
            answer = await http.request(method, route, headers=given, json={})  # type: ignore[arg-type]
            assert answer.status_code == status, route
            assert answer.json()["error"].endswith(".")


async def test_the_own_origin_and_localhost_may(robot: Served) -> None:
    async with robot.http() as http:
        assert (await http.post("/release", headers={"Origin": robot.url})).status_code == 200
        host = {"Host": f"localhost:{robot.port}"}
        assert (await http.post("/release", headers=host)).status_code == 200


@pytest.mark.parametrize(
    ("headers", "status"), [({}, 401), ({"Authorization": "Bearer no"}, 401), ({"Origin": "http://evil.example"}, 403)]
)
async def test_telemetry_is_refused_the_same_way(robot: Served, headers: dict[str, str], status: int) -> None:
    token = {} if status == 401 else robot.headers
    with pytest.raises(InvalidStatus) as refusal:
        async with connect(f"ws://127.0.0.1:{robot.port}/telemetry", additional_headers=token | headers):
            pass
    assert refusal.value.response.status_code == status
    assert b"error" in (refusal.value.response.body or b"")


def test_a_server_on_all_addresses_answers_to_addresses_and_its_name_only() -> None:
    assert "*" in own_names("::")
    assert "*" not in own_names("127.0.0.1")
    assert "robot.lan" in own_names("robot.lan")
