"""How many WebSockets come in at once, of all people and of one login, and what those hear who do not."""

from __future__ import annotations

import contextlib
import uuid

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from backend.bridge import door
from backend.bridge.door import DESCRIPTORS_A_PAGE, DESCRIPTORS_KEPT, pages_for
from backend.identity import Role
from tests.bridge.scenes import SUBPROTOCOL

VIEWER = uuid.UUID(int=7)
TO_LOOK = ["/scene", f"/scene/{VIEWER}", f"/scene/{VIEWER}/control", "/camera"]
HOUSE_FULL = (1013, "Too many pages are open on this robot. Close one, or try again later.")
LOGIN_FULL = (1013, "This login is open in too many pages. Close one of them, or try again later.")


@pytest.fixture
async def bridge(bridge_with, agent, robot, wait_until):
    """A bridge with room for one page, its `/acp` and three sockets beside it."""
    async with bridge_with(
        agent={"port": agent.port}, robot={"port": robot.port}, bridge={"max_connections": 1}
    ) as running:
        await wait_until(lambda: robot.asked)
        yield running


def opened(bridge, path: str, name: str = "Ana", **options):
    subprotocols = [SUBPROTOCOL] if path.startswith("/scene") and not path.endswith("control") else None
    return bridge.websocket(path, token=bridge.token(Role.VIEWER, name), subprotocols=subprotocols, **options)


async def is_let_in(bridge, path: str, name: str = "Bo") -> bool:
    """Whether a WebSocket is still open once the bridge has answered its ping."""
    async with opened(bridge, path, name) as websocket:
        with contextlib.suppress(ConnectionClosed):
            await (await websocket.ping())
        return websocket.close_code is None


@pytest.mark.parametrize("path", TO_LOOK)
async def test_where_too_many_look_already_the_next_one_is_told_so(bridge, closing, path):
    async with (
        opened(bridge, "/scene"),
        opened(bridge, "/camera"),
        opened(bridge, "/camera"),
        opened(bridge, path, "Bo") as refused,
    ):
        assert await closing(refused) == HOUSE_FULL


async def test_who_leaves_makes_room(bridge, closing, wait_until):
    async with opened(bridge, "/camera"), opened(bridge, "/scene"):
        async with opened(bridge, "/camera"), opened(bridge, "/camera", "Bo") as refused:
            assert await closing(refused) == HOUSE_FULL
        assert await wait_until(lambda: is_let_in(bridge, "/camera"))


async def test_onlookers_take_nobodys_place_at_the_robot(bridge, agent, initialize, closing):
    async with (
        opened(bridge, "/camera"),
        opened(bridge, "/camera"),
        opened(bridge, "/camera"),
        opened(bridge, "/acp", "Bo") as bo,
    ):
        await bo.send(initialize.decode())
        await agent.heard()
        async with opened(bridge, "/acp", "Carla") as refused:
            assert await closing(refused) == HOUSE_FULL


async def test_viewers_leave_room_for_those_who_may_approve(bridge_with, agent, closing):
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"max_connections": 4}) as bridge,
        opened(bridge, "/acp", "Ana"),
        opened(bridge, "/acp", "Bo"),
        opened(bridge, "/acp", "Carla"),
    ):
        async with opened(bridge, "/acp", "Dora") as refused:
            assert await closing(refused) == HOUSE_FULL
        async with bridge.websocket("/acp", token=bridge.token(Role.OPERATOR, "Otto")) as otto:
            await (await otto.ping())
            assert otto.close_code is None


@pytest.mark.parametrize("path", ["/acp", "/camera"])
async def test_one_login_does_not_fill_the_house(bridge_with, agent, closing, monkeypatch, path):
    monkeypatch.setattr(door, "PAGES_A_LOGIN", 1)
    async with bridge_with(agent={"port": agent.port}) as bridge:
        token = bridge.token(Role.VIEWER)
        room = 1 if path == "/acp" else 3
        inside = [await bridge.websocket(path, token=token) for _ in range(room)]
        async with bridge.websocket(path, token=token) as refused:
            assert await closing(refused) == LOGIN_FULL
        assert await is_let_in(bridge, path)
        for websocket in inside:
            assert websocket.close_code is None
            await websocket.close()


async def test_a_refusal_speaks_the_subprotocol_that_a_browser_asked_for(bridge, agent, closing):
    async with opened(bridge, "/acp"):
        token = bridge.token()
        offered = [f"bearer.{token}", "acp.v1"]
        async with bridge.websocket("/acp", token=None, origin=bridge.origin, subprotocols=offered) as refused:
            assert refused.subprotocol == "acp.v1"
            assert await closing(refused) == HOUSE_FULL


@pytest.mark.parametrize("path", ["/acp", *TO_LOOK])
async def test_who_is_refused_without_a_login_takes_no_room(bridge, path):
    for _ in range(4):
        with pytest.raises(InvalidStatus) as refusal:
            async with bridge.websocket(path, token=None, origin=bridge.origin):
                pass
        assert refusal.value.response.status_code == 401
    assert await is_let_in(bridge, path)


def test_a_system_with_few_descriptors_has_room_for_fewer_pages():
    assert pages_for(65_536, 512) == 512
    assert pages_for(1024, 512) * DESCRIPTORS_A_PAGE + DESCRIPTORS_KEPT <= 1024
    assert pages_for(1024, 512) > 60
    assert pages_for(64, 512) == 1
