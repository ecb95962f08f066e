"""How many WebSockets may be open at once, in all and of one login, and how the next one is refused."""

from __future__ import annotations

import asyncio
import contextlib
import uuid

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from backend.bridge.connection_limits import DESCRIPTORS_PER_PAGE, RESERVED_DESCRIPTORS, max_pages_for
from backend.bridge.limits import Limits
from backend.bridge.login import COOKIE
from backend.identity import Role
from tests.bridge.scenes import PATIENCE
from tests.bridge.viser_page import SUBPROTOCOL

VIEWER = uuid.UUID(int=7)
SCENE_PATHS = ["/scene", f"/scene/{VIEWER}", f"/scene/{VIEWER}/control", "/camera"]
ALL_ROOM_TAKEN = (1013, "Too many pages are open on this robot. Close one, or try again later.")
LOGIN_ROOM_TAKEN = (1013, "This login is open in too many pages. Close one of them, or try again later.")


@pytest.fixture
async def bridge(bridge_with, agent, robot, wait_until):
    """A bridge with room for one page, its `/acp` and three sockets beside it."""
    async with bridge_with(
        agent={"port": agent.port}, robot={"port": robot.port}, bridge={"max_connections": 1}
    ) as running:
        await wait_until(lambda: robot.subscriptions)
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


@pytest.mark.parametrize("path", SCENE_PATHS)
async def test_where_too_many_look_already_the_next_one_is_told_so(bridge, closing, path):
    async with (
        opened(bridge, "/scene"),
        opened(bridge, "/camera"),
        opened(bridge, "/camera"),
        opened(bridge, path, "Bo") as refused,
    ):
        assert await closing(refused) == ALL_ROOM_TAKEN


async def test_who_leaves_makes_room(bridge, closing, wait_until):
    async with opened(bridge, "/camera"), opened(bridge, "/scene"):
        async with opened(bridge, "/camera"), opened(bridge, "/camera", "Bo") as refused:
            assert await closing(refused) == ALL_ROOM_TAKEN
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
            assert await closing(refused) == ALL_ROOM_TAKEN


async def test_viewers_leave_room_for_those_who_may_approve(bridge_with, agent, closing):
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"max_connections": 4}) as bridge,
        opened(bridge, "/acp", "Ana"),
        opened(bridge, "/acp", "Bo"),
        opened(bridge, "/acp", "Carla"),
    ):
        async with opened(bridge, "/acp", "Dora") as refused:
            assert await closing(refused) == ALL_ROOM_TAKEN
        async with bridge.websocket("/acp", token=bridge.token(Role.OPERATOR, "Otto")) as otto:
            await (await otto.ping())
            assert otto.close_code is None


@pytest.mark.parametrize("path", ["/acp", "/camera"])
async def test_one_login_does_not_take_all_the_room(bridge_with, agent, closing, path):
    async with bridge_with(agent={"port": agent.port}, limits=Limits(pages_per_login=1)) as bridge:
        token = bridge.token(Role.VIEWER)
        room = 1 if path == "/acp" else 3
        inside = [await bridge.websocket(path, token=token) for _ in range(room)]
        async with bridge.websocket(path, token=token) as refused:
            assert await closing(refused) == LOGIN_ROOM_TAKEN
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
            assert await closing(refused) == ALL_ROOM_TAKEN


@pytest.mark.parametrize("path", ["/acp", *SCENE_PATHS])
async def test_who_is_refused_without_a_login_takes_no_room(bridge, path):
    for _ in range(4):
        with pytest.raises(InvalidStatus) as refusal:
            async with bridge.websocket(path, token=None, origin=bridge.origin):
                pass
        assert refusal.value.response.status_code == 401
    assert await is_let_in(bridge, path)


def test_a_system_with_few_descriptors_has_room_for_fewer_pages():
    assert max_pages_for(65_536, 512) == 512
    assert max_pages_for(1024, 512) * DESCRIPTORS_PER_PAGE + RESERVED_DESCRIPTORS <= 1024
    assert max_pages_for(1024, 512) > 60
    assert max_pages_for(64, 512) == 1


@pytest.mark.parametrize(
    ("path", "headers", "has_login", "status"),
    [
        ("/acp", {}, False, 401),
        ("/acp", {"Origin": "http://elsewhere.example"}, True, 403),
        ("/acp", {"Host": "elsewhere.example"}, True, 421),
        ("/scene/not-an-id", {}, True, 404),
        ("/nothing", {}, True, 403),
    ],
)
async def test_a_refused_websocket_is_no_error_of_the_bridge(bridge, caplog, path, headers, has_login, status):
    cookie = {"Cookie": f"{COOKIE}={bridge.token()}"} if has_login else {}
    origin = {"Origin": bridge.origin}
    reader, writer = await asyncio.open_connection("127.0.0.1", bridge.port)
    lines = {
        "Host": f"127.0.0.1:{bridge.port}",
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    }
    request = [
        f"GET {path} HTTP/1.1",
        *(f"{name}: {value}" for name, value in (lines | cookie | origin | headers).items()),
    ]
    writer.write("\r\n".join([*request, "", ""]).encode())
    async with asyncio.timeout(PATIENCE):
        assert (await reader.read()).startswith(f"HTTP/1.1 {status} ".encode())
    writer.close()
    assert caplog.text == ""
