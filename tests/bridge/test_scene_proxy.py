"""The scene behind the bridge: login, the page, and the WebSocket between a page and viser."""

from __future__ import annotations

import asyncio

import msgspec
import pytest
from websockets.exceptions import InvalidStatus

from backend.identity import Role
from tests.bridge.scenes import MAP, PATIENCE, received
from tests.bridge.viser_page import CAMERA, CLICK, SUBPROTOCOL, dial


async def test_the_page_and_the_websocket_want_a_login(bridge):
    async with bridge.http() as http:
        page = await http.get("/scene/")
        assert page.status_code == 401
        assert page.json() == {"error": "Log in with a token first."}
    with pytest.raises(InvalidStatus) as refusal:
        async with bridge.websocket("/scene", token=None, origin=bridge.origin):
            pass
    assert refusal.value.response.status_code == 401
    with pytest.raises(InvalidStatus) as refusal:
        async with bridge.websocket("/scene", origin="https://evil.example"):
            pass
    assert refusal.value.response.status_code == 403


async def test_the_page_is_visers_and_stays_connected_without_the_focus(bridge):
    async with bridge.http(bridge.token(Role.VIEWER)) as http:
        moved = await http.get("/scene")
        assert (moved.status_code, moved.headers["location"]) == (308, "/scene/")
        page = await http.get("/scene/")
        again = await http.get("/scene/", headers={"If-None-Match": page.headers["etag"]})
    assert page.status_code == 200
    assert "<title>Viser</title>" in page.text
    head = page.text.index("document.hasFocus = () => true")
    assert head < page.text.index("</head>")
    assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
    assert page.headers["cache-control"] == "private, no-cache"
    assert again.status_code == 304


async def test_the_websocket_speaks_visers_protocol(bridge):
    async with bridge.websocket("/scene", subprotocols=[SUBPROTOCOL]) as viewer:
        assert viewer.subprotocol == SUBPROTOCOL
        async with asyncio.timeout(PATIENCE):
            first = await viewer.recv()
        assert isinstance(first, bytes)
        assert int.from_bytes(first[:8], "little") > 0  # the size of what is packed behind it


@pytest.fixture
async def bridge_of_robot(bridge_with, robot, wait_until):
    """A bridge whose robot is the peer."""
    async with bridge_with(robot={"port": robot.port}) as running:
        await wait_until(lambda: robot.subscriptions)
        yield running


def page_of(bridge, role: Role):
    return bridge.websocket("/scene", token=bridge.token(role), subprotocols=[SUBPROTOCOL])


@pytest.mark.parametrize("role", list(Role))
async def test_nothing_that_a_page_sends_reaches_viser(servers, bridge_of_robot, robot, wait_until, role):
    await robot.send(MAP)
    async with page_of(bridge_of_robot, role) as page:
        clicks = []
        servers[0].scene.on_click()(clicks.append)
        await page.send(b"\xc1 no msgpack")
        await page.send("text")
        await page.send(bytes(100_000))
        for message in (CLICK, {"type": "ShareUrlRequest"}, {"no": "type"}, CAMERA):
            await page.send(msgspec.msgpack.encode(message))
        assert await received(page, "SetCameraPositionMessage")  # the bridge has read all of it, and answers
        assert servers[0].get_clients() == {}  # viser lists a page once it has received its camera
        assert clicks == []
        # Without the bridge in between, and with its secret, viser receives the camera; it has no ear for clicks.
        async with dial(servers[0].get_port()) as direct:
            for message in (CLICK, CAMERA):
                await direct.send(msgspec.msgpack.encode(message))
            await wait_until(lambda: len(servers[0].get_clients()) == 1)
        assert clicks == []


async def test_a_page_that_opens_is_shown_the_whole_map_in_its_own_shape(bridge_of_robot, robot):
    await robot.send(MAP)
    async with page_of(bridge_of_robot, Role.VIEWER) as page:
        async with asyncio.timeout(PATIENCE):
            position = (0.0, 0.0, 0.0)
            while position[0] != pytest.approx(2.0):  # the middle of the map, once the map has come
                await page.send(msgspec.msgpack.encode(CAMERA))
                position = (await received(page, "SetCameraPositionMessage"))["position"]
        assert position[2] > 4


async def test_the_robot_is_asked_for_much_only_while_somebody_watches(bridge_of_robot, robot, wait_until):
    assert robot.subscriptions[-1].rate == 2
    assert "scan" not in robot.subscriptions[-1].channels
    async with page_of(bridge_of_robot, Role.VIEWER):
        await wait_until(lambda: robot.subscriptions[-1].rate == 20 and "scan" in robot.subscriptions[-1].channels)
        async with page_of(bridge_of_robot, Role.VIEWER):
            pass
        assert robot.subscriptions[-1].rate == 20
    await wait_until(lambda: robot.subscriptions[-1].rate == 2)


async def test_the_robot_is_shown_the_shared_secret(scene, robot):
    assert robot.authorization == "Bearer secret"
