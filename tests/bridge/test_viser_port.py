"""viser's own port: closed to everybody but the proxy, and without an ear for what its pages ask."""

from __future__ import annotations

import asyncio

import httpx
import msgspec
import pytest
import viser
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from backend.bridge.scene.drawing.scene_graph import SceneGraph
from backend.bridge.scene.viser_port import _MAX_BEFORE_SECRET, SECRET_HEADERS
from tests.bridge.viser_page import CAMERA, SUBPROTOCOL, dial


@pytest.fixture
def graph():
    graph = SceneGraph("Sancho")
    yield graph
    graph.close()


WRONG = [{}, {"X-Robot-Acp-Viser": ""}, {"X-Robot-Acp-Viser": "x" * 43}, {"Origin": "https://evil.example"}]


@pytest.mark.parametrize("headers", WRONG)
async def test_the_page_and_the_websocket_are_refused_without_the_secret(graph, headers):
    async with httpx.AsyncClient(trust_env=False, base_url=f"http://127.0.0.1:{graph.port}") as http:
        for path in ("/", "/index.html", "/nothing"):
            answer = await http.get(path, headers=headers)
            assert answer.status_code == 403
            assert "belongs to the robot's bridge" in answer.text
    address = f"ws://127.0.0.1:{graph.port}/"
    with pytest.raises(InvalidStatus) as refused:
        await connect(address, subprotocols=[SUBPROTOCOL], additional_headers=headers, proxy=None)
    assert refused.value.response.status_code == 403


async def test_with_the_secret_both_are_answered(graph):
    async with httpx.AsyncClient(trust_env=False, headers=SECRET_HEADERS) as http:
        assert "<title>Viser</title>" in (await http.get(f"http://127.0.0.1:{graph.port}/")).text
    async with dial(graph.port) as page, asyncio.timeout(30):
        assert isinstance(await page.recv(), bytes)


async def test_a_page_that_asks_for_a_tunnel_gets_none(graph, servers, monkeypatch, wait_until):
    asked: list[object] = []
    monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda *_, **__: asked.append(True))
    again = SceneGraph("Sancho")
    try:
        assert viser._messages.ShareUrlRequest not in servers[-1]._websock_server._incoming_handlers
        async with dial(again.port) as page:
            await page.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
            await page.send(msgspec.msgpack.encode(CAMERA))
            await wait_until(lambda: servers[-1].get_clients())  # it has handled both
    finally:
        again.close()
    assert asked == []


def test_viser_itself_would_open_one():
    """The reason for `forget_page_requests`: once this fails, viser needs it no more."""
    from backend.bridge.scene import viser_internals

    with viser_internals.silenced():
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        assert viser._messages.ShareUrlRequest in server._websock_server._incoming_handlers
    finally:
        with viser_internals.silenced():
            server.stop()


async def test_silent_connections_take_no_room(graph):
    silent = [await asyncio.open_connection("127.0.0.1", graph.port) for _ in range(_MAX_BEFORE_SECRET + 10)]
    try:
        for reader, _ in silent[:5]:
            async with asyncio.timeout(5):  # sooner than the handshake's own limit
                with pytest.raises((ConnectionError, AssertionError)):
                    assert await reader.read() != b""
        async with dial(graph.port) as page, asyncio.timeout(30):
            assert isinstance(await page.recv(), bytes)
    finally:
        for _, writer in silent:
            writer.transport.abort()
