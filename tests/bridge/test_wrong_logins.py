"""Wrong logins at the bridge: many are answered with 429, and whoever has a right token does not notice them."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import uuid

import pytest
from websockets.exceptions import InvalidStatus

from backend import audit, logins
from backend.identity import Role
from backend.mcp_robot import server as robot_server
from tests.bridge.conftest import RunningBridge
from tests.bridge.scenes import PATIENCE

MOST = 5


@pytest.fixture
async def strict(bridge_with, agent):
    """A bridge that takes few wrong logins, in front of the scripted agent."""
    async with bridge_with(agent={"port": agent.port}, bridge={"requests": {"wrong_logins": MOST}}) as bridge:
        yield bridge


async def opened(bridge: RunningBridge, path: str, **options) -> int:
    """The status with which a WebSocket is refused."""
    with pytest.raises(InvalidStatus) as refusal:
        async with bridge.websocket(path, **options):
            pass
    return refusal.value.response.status_code


async def flood(bridge: RunningBridge) -> None:
    async with bridge.http() as http:
        for _ in range(MOST):
            assert (await http.post("/api/login", json={"token": "wrong"})).status_code == 401


async def test_they_are_limited_at_every_door_and_the_answer_says_how_long_to_wait(strict):
    late = strict.token(lifetime_s=-1)
    await flood(strict)
    code = "x" * 22
    assert logins.is_code(code)
    cookie = {"Cookie": "robot_acp=forged", "Origin": strict.origin}
    async with strict.http("forged") as bearer, strict.http() as http:
        answers = [
            await http.post("/api/login", json={"token": "forged"}),
            await http.post("/api/login", json={"token": code}),
            await http.post("/api/login", content=b"{"),
            await http.post("/api/login", json={"token": late}),
            await http.get("/api/me", headers=cookie),
            await bearer.get("/api/me"),
            await bearer.get("/scene/"),
            await bearer.post("/api/stop"),
        ]
    for answer in answers:
        assert answer.status_code == 429
        seconds = int(answer.headers["retry-after"])
        assert 1 <= seconds <= 60
        assert answer.json()["error"] == f"Too many wrong logins from this address. Try again in {seconds} s."
    for path in ("/acp", "/scene"):
        assert await opened(strict, path, token="forged") == 429
        assert await opened(strict, path, token=None, headers=cookie) == 429
        assert await opened(strict, path, token=None, subprotocols=["bearer.forged"]) == 429
    assert await opened(strict, f"/scene/{uuid.UUID(int=7)}?ticket=forged", token=None) == 429


async def test_a_right_token_gets_in_all_the_same(strict, agent, initialize):
    await flood(strict)
    async with strict.http() as http, strict.http(strict.token()) as bearer:
        assert (await http.post("/api/login", json={"token": "wrong"})).status_code == 429
        assert (await http.post("/api/login", json={"token": strict.token()})).status_code == 200
        assert (await http.get("/api/me")).status_code == 200
        assert (await bearer.get("/api/me")).status_code == 200
        assert (await http.post("/api/login", json={"token": logins.new_code(strict.settings.data_dir)})).is_success
    async with strict.websocket() as websocket:
        await websocket.send(initialize.decode())
        assert b"initialize" in await agent.heard()


async def test_a_stop_with_a_valid_login_is_never_limited(settings_for, bridge_with):
    port: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(robot_server.serve(settings_for(robot={"port": 0}), on_ready=port.set_result))
    try:
        async with asyncio.timeout(PATIENCE):
            robot_port = await port
        flags = {"robot": {"port": robot_port}, "bridge": {"requests": {"wrong_logins": MOST}}}
        async with bridge_with(**flags) as bridge, bridge.http(bridge.token(Role.VIEWER, "Vera")) as vera:
            await flood(bridge)
            for _ in range(2 * MOST):
                assert (await vera.post("/api/stop")).status_code == 200
    finally:
        serving.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await serving


async def test_who_shows_nothing_is_told_to_log_in_however_often(strict):
    async with strict.http() as http:
        for _ in range(3 * MOST):
            assert (await http.get("/api/me")).status_code == 401


async def test_a_flood_is_logged_and_recorded_once(strict, caplog):
    caplog.set_level(logging.WARNING, "backend.wrong_logins")
    async with strict.http("forged") as bearer:
        for _ in range(4 * MOST):
            await bearer.get("/api/me")
    (line,) = (record.getMessage() for record in caplog.records if record.name == "backend.wrong_logins")
    assert line == "many wrong logins, at present from 127.0.0.1: they are answered with a time to wait"

    async def recorded() -> list[dict[str, object]]:
        async with asyncio.timeout(PATIENCE):
            while len(events := list(audit.entries(strict.settings.data_dir))) <= MOST:
                await asyncio.sleep(0.01)
        return events

    events = await recorded()
    assert {event["event"] for event in events} == {"login_refused"}
    assert [event["reason"] for event in events][-1] == "too many wrong logins; further ones are not recorded"
    assert len(events) == MOST + 1


async def test_each_address_has_its_own_limit_and_all_together_have_one(strict):
    async with strict.http("forged") as bearer:
        statuses: list[int] = []
        while statuses[-1:] != [429] and len(statuses) < 30 * MOST:  # what is gained meanwhile may be taken, too
            address = {"X-Forwarded-For": f"192.0.2.{len(statuses)}"}
            statuses.append((await bearer.get("/api/me", headers=address)).status_code)
    assert statuses[: 10 * MOST] == [401] * 10 * MOST
    assert statuses[-1] == 429
