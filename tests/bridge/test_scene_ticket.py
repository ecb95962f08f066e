"""The ticket with which viser's page, which has no cookies and no origin, opens its WebSocket."""

from __future__ import annotations

import asyncio
import re
import uuid

import pytest
from websockets.exceptions import InvalidStatus

from backend import tokens
from backend.identity import Role
from tests.bridge.conftest import RunningBridge
from tests.bridge.viser_page import SUBPROTOCOL

VIEWER = str(uuid.UUID(int=7))


async def ticket_of(bridge: RunningBridge, token: str, viewer: str = VIEWER) -> str:
    """The ticket in the page of a viewer."""
    async with bridge.http(token) as http:
        page = await http.get(f"/scene/{viewer}/" if viewer else "/scene/")
    found = re.search(r'const sceneTicket = "([\w-]+)"', page.text)
    assert found is not None
    return found[1]


def opened(bridge: RunningBridge, ticket: str, path: str = f"/scene/{VIEWER}"):
    """The WebSocket as viser's page opens it: from an opaque origin, without a cookie."""
    return bridge.websocket(f"{path}?ticket={ticket}", token=None, origin="null", subprotocols=[SUBPROTOCOL])


async def status_of(opening) -> int:
    with pytest.raises(InvalidStatus) as refused:
        await opening
    return refused.value.response.status_code


@pytest.mark.parametrize("viewer", ["", VIEWER])
async def test_it_opens_the_websocket_of_its_viewer(bridge, viewer):
    ticket = await ticket_of(bridge, bridge.token(Role.VIEWER), viewer)
    async with opened(bridge, ticket, f"/scene/{viewer}".removesuffix("/")) as page, asyncio.timeout(30):
        assert isinstance(await page.recv(), bytes)


async def test_it_reports_that_the_camera_was_moved(bridge):
    ticket = await ticket_of(bridge, bridge.token(Role.VIEWER))
    async with bridge.http() as http:
        moved = await http.post(f"/scene/{VIEWER}/moved?ticket={ticket}", headers={"Origin": "null"})
        assert moved.status_code == 204


async def test_it_is_the_same_for_the_same_viewer_so_that_the_page_is_kept(bridge):
    token = bridge.token(Role.VIEWER)
    assert await ticket_of(bridge, token) == await ticket_of(bridge, token)
    assert await ticket_of(bridge, token) != await ticket_of(bridge, token, str(uuid.UUID(int=8)))


async def test_it_is_good_for_nothing_else(bridge):
    ticket = await ticket_of(bridge, bridge.token(Role.SUPERVISOR))
    paths = [f"/scene/{uuid.UUID(int=8)}", "/scene", "/acp", "/camera", f"/scene/{VIEWER}/control"]
    for path in paths:
        assert await status_of(opened(bridge, ticket, path)) in (401, 403), path
    async with bridge.http(ticket) as http:
        assert (await http.get("/api/me")).status_code == 401
        assert (await http.post("/api/stop")).status_code == 401
    async with bridge.http() as http:
        assert (await http.get(f"/api/me?ticket={ticket}")).status_code == 401


@pytest.mark.parametrize("change", [lambda t: t[:-5], lambda t: "A" + t[1:], lambda t: "", lambda t: "x" * 5000])
async def test_a_forged_one_is_refused(bridge, change):
    ticket = await ticket_of(bridge, bridge.token(Role.VIEWER))
    assert await status_of(opened(bridge, change(ticket))) == 401


async def test_it_ends_with_its_login(bridge, closing):
    ticket = await ticket_of(bridge, bridge.token(Role.VIEWER, "Ana"))
    async with opened(bridge, ticket) as page:
        tokens.revoke(bridge.settings.data_dir, "Ana")
        assert (await closing(page))[0] == 4401
    assert await status_of(opened(bridge, ticket)) == 401


async def test_without_one_an_opaque_origin_is_refused(bridge):
    token = bridge.token(Role.VIEWER)
    cookie = {"Cookie": f"robot_acp={token}"}
    assert await status_of(bridge.websocket(f"/scene/{VIEWER}", token=None, origin="null", headers=cookie)) == 403


async def test_visers_page_runs_in_a_sandbox_however_it_is_opened(bridge):
    async with bridge.http(bridge.token(Role.VIEWER)) as http:
        policy = (await http.get("/scene/")).headers["content-security-policy"].split("; ")
    assert "sandbox allow-scripts" in policy
    assert "frame-ancestors 'self'" in policy
