"""The scene behind the bridge: login, the page, and the WebSocket between a viewer and viser."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import AsyncIterator, Callable

import msgspec
import pytest
import uvicorn
import viser
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from backend import tokens
from backend.bridge.door import Door
from backend.bridge.login import Gate
from backend.bridge.origin import OriginPolicy
from backend.bridge.scene.proxy import SceneSocket
from backend.bridge.scene.renewal import Renewal
from backend.bridge.scene.scene import Scene
from backend.bridge.scene.stage import Stage
from backend.identity import Role
from backend.telemetry import Map, Motion, Path, Picture, Pose, Scan, Stop, Zone
from tests.bridge.scenes import CAMERA, MAP, PATIENCE, POINTER, SUBPROTOCOL, TelemetryPeer, state, told


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


async def test_a_viewer_whose_login_expires_is_cut_off(bridge, closing):
    token = bridge.token(lifetime_s=8)
    async with bridge.websocket("/scene", token=token, subprotocols=[SUBPROTOCOL]) as viewer:
        assert await closing(viewer) == (4401, "Your login has expired. Log in again.")


@pytest.fixture
async def scene(robot: TelemetryPeer, wait_until) -> AsyncIterator[Scene]:
    """A scene that follows the peer."""
    scene = Scene("Sancho", f"ws://127.0.0.1:{robot.port}/telemetry", b"secret")
    running = asyncio.create_task(scene.run())
    await wait_until(lambda: robot.asked)
    yield scene
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running


@pytest.fixture
async def viewer(scene, wait_until, tmp_path) -> AsyncIterator[Callable[[Role], connect]]:
    """Opens a viewer of that scene for somebody of a role."""
    gate = Gate(tokens.Registry(tmp_path), OriginPolicy("127.0.0.1"))
    app = Starlette(routes=[WebSocketRoute("/scene", Door(gate, 9, 9).to(SceneSocket(gate, scene).serve))])
    server = uvicorn.Server(uvicorn.Config(app, port=0, ws="websockets-sansio", log_config=None))
    serving = asyncio.create_task(server.serve())
    await wait_until(lambda: server.started)
    url = f"ws://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}/scene"

    def opened(role: Role) -> connect:
        headers = {"Authorization": f"Bearer {tokens.create(tmp_path, 'Ana', role, 60)}"}
        return connect(
            url, additional_headers=headers, subprotocols=[SUBPROTOCOL], compression=None, max_size=None, proxy=None
        )

    yield opened
    server.should_exit = True
    await serving


@pytest.mark.parametrize("role", list(Role))
async def test_nothing_that_a_viewer_sends_reaches_viser(scene, robot, viewer, wait_until, role):
    server = scene._stage._server._websock_server
    clicks, cameras = [], []
    server.register_handler(viser._messages.ScenePointerMessage, lambda client, message: clicks.append(message))
    server.register_handler(viser._messages.ViewerCameraMessage, lambda client, message: cameras.append(message))
    await robot.send(MAP)
    await wait_until(lambda: scene._stage._grid)
    async with viewer(role) as page:
        await page.send(b"\xc1 no msgpack")
        await page.send("text")
        await page.send(bytes(100_000))
        for message in (POINTER, {"type": "ShareUrlRequest"}, {"no": "type"}, CAMERA):
            await page.send(msgspec.msgpack.encode(message))
        assert await told(page, "SetCameraPositionMessage")  # all that came before was read, and this by the bridge
    assert clicks == cameras == []
    # The same message does arrive where nothing stands between.
    port = await scene.port()
    direct = connect(f"ws://127.0.0.1:{port}/", subprotocols=[SUBPROTOCOL], max_size=None, proxy=None)
    async with direct as page:
        await page.send(msgspec.msgpack.encode(POINTER))
        await wait_until(lambda: clicks)


async def test_a_page_that_opens_is_shown_the_whole_map_in_its_own_shape(scene, robot, viewer, wait_until):
    await robot.send(MAP)
    await wait_until(lambda: scene.viewers._places)
    async with viewer(Role.VIEWER) as page:
        await page.send(msgspec.msgpack.encode(CAMERA))
        x, _, z = (await told(page, "SetCameraPositionMessage"))["position"]
        assert x == pytest.approx(2.0)  # the middle of the map
        assert z > 4


async def test_the_robot_is_asked_for_much_only_while_somebody_looks(scene, robot, viewer, wait_until):
    assert robot.authorization == "Bearer secret"
    assert robot.asked[-1].rate == 2
    assert "scan" not in robot.asked[-1].channels
    async with viewer(Role.VIEWER):
        await wait_until(lambda: robot.asked[-1].rate == 20 and "scan" in robot.asked[-1].channels)
        async with viewer(Role.VIEWER):
            pass
        assert robot.asked[-1].rate == 20
    await wait_until(lambda: robot.asked[-1].rate == 2)


async def test_the_scene_shows_what_the_telemetry_says(scene, robot, wait_until):
    stage = scene._stage
    await robot.send(MAP, state())
    await wait_until(lambda: stage._robot.visible)
    assert tuple(stage._robot.position) == (1.0, 2.0, 0.0)
    assert stage._label.text == "Sancho"
    assert [label.text for label in stage._building.names] == ["kitchen"]
    assert stage._building._walls.vertices.max() == pytest.approx(4.0)
    assert not stage._notice.visible
    assert not stage._goal.visible

    goal = Motion("navigate", Pose(3.0, 1.0, 0.0), "kitchen", 2.0, 4.0)
    await robot.send(Path(1.0, [(1, 2), (3, 1)]), state(motion=goal))
    await wait_until(lambda: stage._goal.visible)
    assert tuple(stage._goal.position) == (3.0, 1.0, 0.0)
    assert stage._path.visible

    await robot.send(Path(1.0, [(1, 2), (2, 2)], preview=True), state())
    await wait_until(lambda: stage._preview.visible)
    assert not stage._goal.visible

    await robot.send(state(speaking="The meeting is at noon."))
    await wait_until(lambda: stage._label.text == "Sancho: “The meeting is at noon.”")
    await robot.send(state(stop=Stop("Ana", 1.0)))
    await wait_until(lambda: stage._label.text == "Sancho ■ Ana")

    scan = Scan(1.0, Pose(0.5, 0.5, 0.0), 0.0, 0.1, 10.0, [1.0, 2.0, 10.0])
    await robot.send(scan)
    await wait_until(lambda: len(stage._surroundings.points.points) == 2)
    assert stage._surroundings.points.points[0] == pytest.approx([1.5, 0.5, 0.3])


async def test_standing_still_costs_viser_nothing(scene, robot, wait_until):
    stage = scene._stage
    buffer = stage._server._websock_server._broadcast_buffer
    await robot.send(MAP, state())
    await wait_until(lambda: stage._robot.visible)
    before = buffer.message_counter
    await robot.send(*[state(time=float(i)) for i in range(50)], MAP, state(pose=Pose(1.1, 2.0, 1.5)))
    await wait_until(lambda: tuple(stage._robot.position) == (1.1, 2.0, 0.0))
    assert buffer.message_counter == before + 1


async def test_standing_still_with_people_about_costs_what_they_move_and_no_more(scene, robot, viewer, wait_until):
    stage = scene._stage
    buffer = stage._server._websock_server._broadcast_buffer
    await robot.send(HALL, state(pose=Pose(5.0, 5.0, 0.0)))
    async with viewer(Role.VIEWER):
        await robot.send(person(7.0))
        await wait_until(lambda: any(post.visible for post in stage._surroundings.posts))
        before, nodes = buffer.message_counter, len(buffer.message_from_id)
        await robot.send(*[person(7.0) for _ in range(50)], state(pose=Pose(5.0, 5.0, 0.1)))
        await wait_until(lambda: tuple(stage._robot.wxyz)[3] > 0)
        assert buffer.message_counter == before + 1  # the heading
        await robot.send(*[person(7.0 + i / 50) for i in range(50)], state(pose=Pose(5.0, 5.0, 0.2)))
        await wait_until(lambda: tuple(stage._robot.wxyz)[3] > 0.09)
        assert len(buffer.message_from_id) <= nodes + 4  # what is kept for a new viewer does not grow


async def test_the_noise_of_the_laser_is_no_news(scene):
    surroundings = scene._stage._surroundings

    def drawn(x: float) -> float:
        surroundings.show(person(x), 0.0)
        return float(surroundings.points.points[2][0])

    assert drawn(7.0) == pytest.approx(6.8, abs=0.01)
    assert drawn(7.05) == pytest.approx(6.8, abs=0.01)
    assert drawn(7.12) == pytest.approx(6.92, abs=0.01)
    surroundings.hide()
    assert drawn(7.12) == pytest.approx(6.92, abs=0.01)
    assert surroundings.points.visible
    surroundings.show(Scan(1.0, Pose(5.0, 5.0, 0.0), -0.06, 0.03, 10.0, [10.0] * 5), 0.0)
    assert drawn(7.12) == pytest.approx(6.92, abs=0.01)


async def test_who_the_laser_sees_is_a_post_that_is_gone_with_the_robot(scene, robot, wait_until):
    stage = scene._stage
    await robot.send(HALL, state(pose=Pose(5.0, 5.0, 0.0)), person(7.0))
    (post,) = await wait_until(lambda: [post for post in stage._surroundings.posts if post.visible])
    assert tuple(post.position) == pytest.approx((7.0, 5.0, 0.0), abs=0.15)
    await robot.hang_up()
    await wait_until(lambda: not post.visible)


async def test_the_trail_is_drawn_and_another_map_clears_it(scene, robot, wait_until):
    stage = scene._stage
    await robot.send(HALL, *[state(pose=Pose(2.0 + i * 0.3, 5.0, 0.0)) for i in range(5)])
    await wait_until(lambda: stage._pieces[0].visible and len(stage._pieces[0].points) == 4)
    assert stage._pieces[0].points[-1][1][:2] == pytest.approx([3.2, 5.0])
    await robot.send(MAP)
    await wait_until(lambda: not any(piece.visible for piece in stage._pieces))


async def test_zones_are_named(scene, robot, wait_until):
    await robot.send(msgspec.structs.replace(MAP, zones=[Zone("store", [(1, 1), (2, 1), (2, 2), (1, 2)])]))
    await wait_until(lambda: [label.text for label in scene._stage._building.names] == ["kitchen", "× store"])


async def test_the_cameras_view_is_shown_while_somebody_looks_through_it(scene, robot, wait_until):
    stage = scene._stage
    await robot.send(MAP, state())
    picture = Picture(1.0, Pose(1.0, 2.0, 1.5), 640, 360, b"jpeg")
    with scene.pictures() as pictures:
        await robot.send(picture)
        await wait_until(lambda: stage._sight.visible)
        assert stage._sight.aspect == pytest.approx(16 / 9)
        assert await pictures.take() == [b"jpeg"]
    await robot.send(picture, state(time=2.0))
    await wait_until(lambda: not stage._sight.visible)


async def test_viser_begins_anew_before_its_numbers_slow_anybody_down(
    scene, robot, viewer, wait_until, closing, monkeypatch
):
    """Whoever looks is connected again, to the same picture."""
    await robot.send(HALL, *[state(pose=Pose(2.0 + i * 0.3, 5.0, 0.0)) for i in range(5)])
    await wait_until(lambda: scene._stage._pieces[0].visible)
    old = scene._stage
    async with viewer(Role.VIEWER) as page:
        monkeypatch.setattr("backend.bridge.scene.scene.RENEW_UNSEEN", 0)
        await robot.send(state(pose=Pose(3.5, 5.0, 0.0)))
        await wait_until(lambda: tuple(old._robot.position) == (3.5, 5.0, 0.0))
        assert scene._stage is old  # somebody looks: not yet
        monkeypatch.setattr("backend.bridge.scene.scene.RENEW_SEEN", 0)
        await robot.send(state(pose=Pose(3.8, 5.0, 0.0)))
        await wait_until(lambda: scene._stage is not old)
        monkeypatch.undo()
        assert (await closing(page))[0] == 1013
    stage = scene._stage
    assert tuple(stage._robot.position) == (3.8, 5.0, 0.0)
    assert stage._pieces[0].points[-1][1][:2] == pytest.approx([3.8, 5.0])
    assert stage._grid == HALL
    assert stage.changes < old.changes
    async with viewer(Role.VIEWER) as page:
        await page.send(msgspec.msgpack.encode(CAMERA))
        assert await told(page, "SetCameraPositionMessage")


async def test_viser_is_drawn_to_from_one_thread_and_wakes_its_pages_in_its_own(wait_until):
    """asyncio's debug mode refuses what else fails now and then, in the midst of a drawing, where many pages wait."""
    stage = Stage("Sancho")
    try:
        url = f"ws://127.0.0.1:{stage.port}/"
        async with connect(url, subprotocols=[SUBPROTOCOL], max_size=None, proxy=None) as page:
            await told(page, "ReplayDoneMessage")
            waiters = stage._server._websock_server._broadcast_buffer.message_event._waiters
            await wait_until(lambda: waiters)
            stage._server._websock_server._background_event_loop.set_debug(True)
            stage.show(state(pose=Pose(7.0, 2.0, 0.0)))
            assert (await told(page, "SetPositionMessage"))["position"] == [7.0, 2.0, 0.0]
    finally:
        stage.close()


@pytest.fixture
def servers(monkeypatch) -> list[viser.ViserServer]:
    """Every viser server that is started from here on."""
    started: list[viser.ViserServer] = []

    class Noted(viser.ViserServer):
        def __init__(self, *arguments, **options) -> None:
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(viser, "ViserServer", Noted)
    return started


def runs(server: viser.ViserServer) -> bool:
    return server._websock_server._server_thread.is_alive()


async def test_a_renewal_that_fails_is_not_tried_at_each_message_and_leaves_no_server_behind(
    scene, robot, wait_until, monkeypatch, caplog, servers
):
    old = scene._stage
    await robot.send(HALL, state())
    await wait_until(lambda: old._robot.visible)
    good = scene._shown[Map]
    scene._shown[Map] = Map(0.5, 8, 6, 0.0, 0.0, b"too short", [])  # cannot be drawn
    scene._renewal._pause = 1e6  # longer than any machine takes to draw what follows
    monkeypatch.setattr("backend.bridge.scene.scene.RENEW_UNSEEN", 0)
    await robot.send(*[state(pose=Pose(1.0 + i / 100, 2.0, 0.0)) for i in range(50)])
    await wait_until(lambda: tuple(old._robot.position) == (1.49, 2.0, 0.0))  # the picture goes on
    assert scene._stage is old
    assert runs(old._server)
    assert len(servers) == 1
    assert not runs(servers[0])
    assert caplog.text.count("viser cannot begin anew and goes on as it is") == 1

    scene._shown[Map] = good
    scene._renewal._not_before = 0.0  # the pause is over
    await robot.send(state(pose=Pose(2.0, 2.0, 0.0)))
    await wait_until(lambda: scene._stage is not old)
    await wait_until(lambda: not runs(old._server))
    assert len(servers) == 2
    assert runs(servers[1])


async def test_a_renewal_that_hangs_lets_the_picture_go_on_and_what_comes_of_it_late_is_closed(
    scene, robot, wait_until, monkeypatch, servers
):
    old, held = scene._stage, threading.Event()
    build = Stage._set_up
    monkeypatch.setattr(Stage, "_set_up", lambda *asked: (held.wait(), build(*asked)))
    monkeypatch.setattr("backend.bridge.scene.renewal.RENEWAL_SECONDS", 0.1)
    scene._renewal._pause = 0.0  # what keeps a second start away is the first one
    monkeypatch.setattr("backend.bridge.scene.scene.RENEW_UNSEEN", 0)
    await robot.send(*[state(pose=Pose(1.0 + i / 100, 2.0, 0.0)) for i in range(50)])
    await wait_until(lambda: tuple(old._robot.position) == (1.49, 2.0, 0.0))
    assert scene._stage is old
    assert len(servers) == 1
    monkeypatch.setattr("backend.bridge.scene.scene.RENEW_UNSEEN", 1_000_000)
    held.set()
    await wait_until(lambda: not runs(servers[0]))
    assert scene._stage is old
    assert runs(old._server)


def test_the_pause_between_renewals_grows_to_a_limit(monkeypatch):
    monkeypatch.setattr(time, "monotonic", lambda: 0.0)
    renewal = Renewal("Sancho")
    pauses = []
    for _ in range(9):
        renewal.failed()
        pauses.append(renewal._not_before)
    assert pauses == [10, 20, 40, 80, 160, 320, 600, 600, 600]


HALL = Map(0.1, 100, 100, 0.0, 0.0, bytes(10000), [])


def person(x: float) -> Scan:
    """What the laser at (5, 5) sees of somebody who stands at (x, 5)."""
    return Scan(1.0, Pose(5.0, 5.0, 0.0), -0.06, 0.03, 10.0, [x - 5.2] * 5)


async def test_while_the_robot_is_gone_the_scene_says_so_and_comes_back(scene, robot, wait_until):
    stage = scene._stage
    await robot.send(state())
    await wait_until(lambda: not stage._notice.visible)
    await robot.hang_up()
    await wait_until(lambda: stage._notice.visible)
    assert stage._notice.text == "Sancho ?"
    asked = len(robot.asked)
    await wait_until(lambda: len(robot.asked) > asked)
    await robot.send(state())
    await wait_until(lambda: not stage._notice.visible)


async def test_a_message_that_cannot_be_drawn_does_not_end_the_scene(scene, robot, wait_until, caplog):
    await robot.send(Map(0.5, 8, 6, 0.0, 0.0, b"too short", []), state())
    await wait_until(lambda: scene._stage._robot.visible)
    assert "a Map message cannot be drawn" in caplog.text


async def test_a_message_that_is_none_is_dropped_and_the_next_one_shown(scene, robot, wait_until, caplog):
    await robot._connection.send(b"\xc1")
    await robot._connection.send(msgspec.msgpack.encode({"type": "state"}))
    await robot.send(state())
    await wait_until(lambda: scene._stage._robot.visible)
    assert caplog.text.count("dropped a telemetry message") == 2
