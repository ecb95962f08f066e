"""A login that is revoked is over soon, wherever it is in use; a broken list lets nobody new in."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from websockets.exceptions import InvalidStatus

from backend import tokens
from backend.identity import Role
from backend.mcp_robot import server as robot_server
from tests.bridge.scenes import PATIENCE
from tests.bridge.viser_page import SUBPROTOCOL

REVOKED = (4401, "Your login was revoked. Ask for a new one.")


@pytest.fixture
def revoke(bridge):
    """Revokes as `robot-acp token revoke` does."""
    return lambda name: tokens.revoke(bridge.settings.data_dir, name)


async def test_a_live_client_is_closed_with_a_reason_and_others_stay(bridge, agent, initialize, closing, revoke):
    async with (
        bridge.websocket(token=bridge.token(name="Ana")) as ana,
        bridge.websocket(token=bridge.token(name="Ben")) as ben,
    ):
        for websocket in (ana, ben):
            await websocket.send(initialize.decode())
            await agent.heard()
        revoke("Ana")
        assert await closing(ana) == REVOKED
        await ben.send('{"jsonrpc":"2.0","method":"$/ping"}')
        assert b"$/ping" in await agent.heard()


async def test_the_reason_is_the_same_when_the_agent_hangs_up_first(bridge, agent, initialize, closing, revoke):
    async with bridge.websocket(token=bridge.token(name="Ana")) as websocket:
        await websocket.send(initialize.decode())
        await agent.heard()
        revoke("Ana")
        agent.hang_up()
        assert await closing(websocket) == REVOKED


async def test_a_client_that_has_not_begun_is_closed_too(bridge, closing, revoke):
    async with bridge.websocket(token=bridge.token(name="Ana")) as websocket:
        revoke("Ana")
        assert await closing(websocket) == REVOKED


async def test_a_viewer_of_the_scene_is_closed_too(bridge, closing, revoke):
    async with bridge.websocket(
        "/scene", token=bridge.token(Role.VIEWER, "Vera"), subprotocols=[SUBPROTOCOL]
    ) as viewer:
        revoke("Vera")
        assert await closing(viewer) == REVOKED


async def test_a_revoked_token_opens_nothing_from_that_moment_on(bridge, agent, revoke):
    token = bridge.token(Role.SUPERVISOR, "Ana")
    cookie, own = {"Cookie": f"robot_acp={token}"}, {"Origin": bridge.origin}
    async with bridge.http(token) as bearer, bridge.http() as browser:
        assert (await browser.post("/api/login", json={"token": token})).status_code == 200
        revoke("Ana")
        answers = [
            await browser.get("/api/me"),
            await browser.get("/scene/"),
            await browser.post("/api/login", json={"token": token}, headers=own),
            await browser.post("/api/stop", headers=own),
            await browser.post("/api/release", headers=own),
            await bearer.get("/api/me"),
            await bearer.post("/api/stop"),
        ]
    for answer in answers:
        assert (answer.status_code, answer.json()) == (
            401,
            {"error": "This login token was revoked. Ask for a new one."},
        )
    for path in ("/acp", "/scene"):
        for options in ({"token": token}, {"token": None, "headers": cookie, "origin": bridge.origin}):
            with pytest.raises(InvalidStatus) as refusal:
                async with bridge.websocket(path, **options):
                    pass
            assert refusal.value.response.status_code == 401
    assert agent.connections == 0


async def logged_in(bridge, token: str, browser) -> dict[str, str]:
    """The headers of a browser that has logged in."""
    response = await browser.post("/api/login", json={"token": token})
    assert response.status_code == 200
    return {"Cookie": f"robot_acp={response.cookies['robot_acp']}", "Origin": bridge.origin}


async def test_a_logout_ends_the_login_wherever_it_is_in_use_and_no_other(bridge, agent, initialize, closing):
    token = bridge.token(Role.SUPERVISOR, "Ana")
    async with bridge.http() as here, bridge.http() as there:
        page, other = await logged_in(bridge, token, here), await logged_in(bridge, token, there)
        async with (
            bridge.websocket(token=None, headers=page) as acp,
            bridge.websocket("/scene", token=None, headers=page, subprotocols=[SUBPROTOCOL]) as scene,
            bridge.websocket(token=None, headers=other) as others,
            bridge.websocket(token=token) as bearer,
        ):
            for websocket in (acp, others, bearer):
                await websocket.send(initialize.decode())
                sent = await agent.heard()
                assert (token.encode() in sent) == (websocket is bearer)
            assert (await here.post("/api/logout", headers=page)).status_code == 204
            for websocket in (acp, scene):
                assert await closing(websocket) == (4401, "This login has ended. Log in again.")
            for websocket in (others, bearer):
                await websocket.send('{"jsonrpc":"2.0","method":"$/ping"}')
                assert b"$/ping" in await agent.heard()
        old = await here.get("/api/me", headers=page)
        assert (old.status_code, old.json()["error"]) == (401, "This login has ended. Log in again.")
        assert (await here.post("/api/stop", headers=page)).status_code == 401
        assert (await there.get("/api/me")).status_code == 200


@pytest.mark.parametrize("cookie", ["", "forged", "expired", "gone"])
async def test_a_logout_without_a_login_is_no_error(bridge, cookie):
    value = bridge.token(lifetime_s=-1) if cookie == "expired" else cookie
    async with bridge.http() as http:
        if cookie == "gone":
            value = (await logged_in(bridge, bridge.token(), http))["Cookie"].partition("=")[2]
        for _ in range(2):
            headers = {"Cookie": f"robot_acp={value}", "Origin": bridge.origin}
            answer = await http.post("/api/logout", headers=headers)
            assert (answer.status_code, answer.content) == (204, b"")


async def test_a_logout_does_not_end_a_token_that_a_person_was_given(bridge):
    token = bridge.token()
    async with bridge.http(token) as http:
        headers = {"Cookie": f"robot_acp={token}", "Origin": bridge.origin}
        assert (await http.post("/api/logout", headers=headers)).status_code == 204
        assert (await http.get("/api/me")).status_code == 200


async def test_a_revoked_token_ends_the_logins_that_were_made_with_it(bridge, agent, initialize, closing, revoke):
    async with bridge.http() as http:
        page = await logged_in(bridge, bridge.token(name="Ana"), http)
        shown = tokens.records(bridge.settings.data_dir)[0].id
        async with bridge.websocket(token=None, headers=page) as websocket:
            await websocket.send(initialize.decode())
            await agent.heard()
            assert [record.id for record in revoke(shown)] == [shown]
            assert await closing(websocket) == REVOKED
        assert (await http.get("/api/me")).status_code == 401


async def test_while_the_list_is_broken_nobody_new_comes_in_and_those_inside_stay(bridge, agent, client, wait_until):
    token = bridge.token(Role.OPERATOR, "Ben")
    file = bridge.settings.data_dir / tokens.REGISTRY
    good = file.read_bytes()
    file.write_bytes(b"broken")
    async with bridge.http(token) as http:
        answers = [await http.get("/api/me"), await http.get("/scene/"), await http.post("/api/release")]
        answers.append(await http.post("/api/login", json={"token": token}))
        for answer in answers:
            assert answer.status_code == 503
            assert answer.json()["error"].startswith("Nobody can log in now")
            assert str(file) not in answer.text
            assert "set-cookie" not in answer.headers
        for path in ("/acp", "/scene"):
            with pytest.raises(InvalidStatus) as refusal:
                async with bridge.websocket(path, token=token):
                    pass
            assert refusal.value.response.status_code == 503
        await client.send('{"jsonrpc":"2.0","method":"$/ping"}')
        assert b"$/ping" in await agent.heard()
        file.write_bytes(good)
        assert (await http.get("/api/me")).status_code == 200


async def test_while_the_list_is_broken_a_cookie_still_stops_the_robot(settings_for, bridge_with):
    port: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(robot_server.serve(settings_for(robot={"port": 0}), on_ready=port.set_result))
    try:
        async with asyncio.timeout(PATIENCE):
            robot_port = await port
        async with bridge_with(robot={"port": robot_port}) as bridge, bridge.http() as browser:
            (bridge.settings.data_dir / tokens.REGISTRY).unlink(missing_ok=True)
            vera, eve = bridge.token(Role.VIEWER, "Vera"), bridge.token(Role.VIEWER, "Eve")
            tokens.revoke(bridge.settings.data_dir, "Eve")
            await browser.post("/api/login", json={"token": vera})
            (bridge.settings.data_dir / tokens.REGISTRY).write_bytes(b"broken")
            own = {"Origin": bridge.origin}
            refused = await browser.post("/api/stop", headers={"Authorization": f"Bearer {eve}"})
            assert refused.status_code == 401
            assert (await browser.post("/api/stop", headers={"Origin": "https://evil.example"})).status_code == 403
            stopped = await browser.post("/api/stop", headers=own)
            assert (stopped.status_code, stopped.json()["stopped"]["by"]) == (200, "Vera")
            assert (await browser.post("/api/release", headers=own)).status_code == 503
    finally:
        serving.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await serving
