"""Stop, release and health, against the real robot server."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import pytest

from backend import audit, tokens
from backend.bridge.limits import Limits
from backend.config import Settings
from backend.identity import Role
from backend.mcp_robot import server as robot_server
from tests.bridge.scenes import PATIENCE


@pytest.fixture
async def robot(settings_for) -> AsyncIterator[Settings]:
    """The simulated robot's server on a free port; the settings that say where it is."""
    port: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    settings = settings_for(robot={"port": 0})
    serving = asyncio.create_task(robot_server.serve(settings, on_ready=port.set_result))
    async with asyncio.timeout(PATIENCE):
        await asyncio.wait({serving, port}, return_when=asyncio.FIRST_COMPLETED)
    yield settings_for(robot={"port": port.result()})
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving


async def test_everyone_may_stop_and_only_a_supervisor_may_release(bridge_with, robot):
    async with (
        bridge_with(robot={"port": robot.robot.port}) as bridge,
        bridge.http(bridge.token(Role.VIEWER, "Vera")) as viewer,
        bridge.http(bridge.token(Role.OPERATOR, "Otto")) as operator,
        bridge.http(bridge.token(Role.SUPERVISOR, "Susi")) as supervisor,
    ):
        stopped = await viewer.post("/api/stop")
        assert stopped.status_code == 200
        assert stopped.json()["stopped"]["by"] == "Vera"
        assert stopped.json()["stopped"]["at"] > 0

        again = await operator.post("/api/stop")
        assert again.json() == stopped.json()  # the first one is kept

        for other in (viewer, operator):
            refused = await other.post("/api/release")
            assert refused.status_code == 403
            assert refused.json() == {"error": "Only a supervisor can release the stop."}

        released = await supervisor.post("/api/release")
        assert (released.status_code, released.json()) == (200, {"stopped": None})


async def test_the_audit_log_says_who_stopped_and_released(bridge_with, robot):
    data = robot.data_dir
    async with (
        bridge_with(robot={"port": robot.robot.port}) as bridge,
        bridge.http(bridge.token(Role.VIEWER, "Vera")) as viewer,
        bridge.http(bridge.token(Role.SUPERVISOR, "Susi")) as supervisor,
    ):
        await viewer.post("/api/stop")
        await viewer.post("/api/release")  # refused
        await supervisor.post("/api/release")
    stop, release = [entry for entry in audit.entries(data) if entry["process"] == "bridge"]
    assert (stop["event"], stop["by"], stop["role"], stop["confirmed"]) == ("stop", "Vera", "viewer", True)
    assert (release["event"], release["by"], release["role"]) == ("release", "Susi", "supervisor")
    ids = {one.name: one.id for one in tokens.records(data)}
    assert (stop["token"], release["token"]) == (ids["Vera"], ids["Susi"])


async def test_a_stop_that_is_not_confirmed_is_in_the_audit_log(bridge_with, settings_for):
    async with bridge_with() as bridge, bridge.http(bridge.token(Role.VIEWER, "Vera")) as viewer:
        assert (await viewer.post("/api/stop")).status_code == 503
    (stop,) = [entry for entry in audit.entries(settings_for().data_dir) if entry["event"] == "stop"]
    assert (stop["by"], stop["confirmed"]) == ("Vera", False)


async def test_a_browser_stops_with_its_cookie_and_another_site_cannot(bridge_with, robot):
    async with bridge_with(robot={"port": robot.robot.port}) as bridge, bridge.http() as browser:
        await browser.post("/api/login", json={"token": bridge.token(Role.VISITOR, "Vic")})
        for origin in ("https://evil.example", "null"):
            refused = await browser.post("/api/stop", headers={"Origin": origin})
            assert refused.status_code == 403
        assert (await browser.post("/api/stop")).status_code == 403  # no Origin: not a browser's page
        stopped = await browser.post("/api/stop", headers={"Origin": bridge.origin})
        assert stopped.json()["stopped"]["by"] == "Vic"


async def test_without_a_login_nobody_stops_or_releases(bridge):
    async with bridge.http() as http:
        for path in ("/api/stop", "/api/release"):
            response = await http.post(path, headers={"Origin": bridge.origin})
            assert response.status_code == 401


async def test_a_stop_that_cannot_reach_the_robot_says_so_at_once(bridge):
    async with bridge.http(bridge.token(Role.VIEWER)) as http:
        response = await http.post("/api/stop")
    assert response.status_code == 503
    assert response.json()["error"].startswith("The robot cannot be reached to stop it.")


async def test_health_is_ok_when_agent_and_robot_answer(bridge_with, robot, agent, wait_until):
    ports = {"agent": {"port": agent.port}, "robot": {"port": robot.robot.port}}
    async with bridge_with(**ports) as bridge, bridge.http() as http:

        async def healthy() -> dict | None:
            """On a busy machine the robot's first answer may take longer than health waits."""
            body = (await http.get("/api/health")).json()
            return body if body["status"] == "ok" else None

        body = await wait_until(healthy)
    assert body["agent"]["up"]
    assert body["robot"]["up"]
    assert "Sancho" in body["robot"]["detail"]
    assert body["robot_name"] == "Sancho"
    assert body["version"]


async def test_health_tells_what_is_missing_and_sees_it_come_back(bridge_with, agent, wait_until):
    port = agent.port
    await agent.stop()
    async with bridge_with(agent={"port": port}) as bridge, bridge.http() as http:
        body = (await http.get("/api/health")).json()
        assert body["status"] == "degraded"
        assert body["agent"] == {"up": False, "detail": f"Nothing answers at 127.0.0.1:{port}."}
        assert not body["robot"]["up"]

        await agent.start(port)

        async def agent_is_up() -> bool:
            return (await http.get("/api/health")).json()["agent"]["up"]

        await wait_until(agent_is_up)


@pytest.mark.parametrize(("command", "up"), [("cat", True), ("/no/such/agent", False)])
async def test_an_agent_on_stdio_is_up_when_its_command_exists(bridge_with, command, up):
    async with bridge_with(bridge={"agent": f"stdio:{command}"}) as bridge, bridge.http() as http:
        assert (await http.get("/api/health")).json()["agent"]["up"] is up


async def test_the_agent_is_probed_once_however_many_ask(bridge_with, agent):
    patient = Limits(health_age_seconds=PATIENCE)  # the requests may take more than a second
    async with bridge_with(agent={"port": agent.port}, limits=patient) as bridge, bridge.http() as http:
        await asyncio.gather(*(http.get("/api/health") for _ in range(20)))
    assert agent.probes == 1


async def test_an_agent_that_accepts_and_reads_nothing_is_not_up(bridge_with, agent, wait_until):
    """A process that hangs still has an open port, and the connections of before."""
    at_once = Limits(health_age_seconds=0)
    async with bridge_with(agent={"port": agent.port}, limits=at_once) as bridge, bridge.http() as http:
        assert (await http.get("/api/health")).json()["agent"]["up"]
        async with bridge.websocket() as client:
            await client.send(b'{"jsonrpc":"2.0","id":0,"method":"initialize","params":{}}')
            await agent.heard()
            agent.reading.clear()
            detail = f"The agent at 127.0.0.1:{agent.port} accepts connections, but does not answer."
            assert (await http.get("/api/health")).json()["agent"] == {"up": False, "detail": detail}
            agent.reading.set()

            async def agent_is_up() -> bool:
                return (await http.get("/api/health")).json()["agent"]["up"]

            await wait_until(agent_is_up)
