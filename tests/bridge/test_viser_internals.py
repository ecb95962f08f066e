"""What this project knows of viser's inside, compared with the installed viser: each test fails when viser changes it.

The page's classes are seen in a browser as well, by `test_scene_in_browser.py`.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import msgspec
import pytest
import viser

from backend.bridge.scene import viser_internals
from backend.bridge.scene.drawing.scene_graph import SceneGraph
from backend.telemetry import Pose
from tests.bridge.scenes import received, state
from tests.bridge.viser_page import CAMERA, CLICK, SUBPROTOCOL, dial, messages_in

MESSAGES = viser._messages
CLIENT = Path(viser.__file__).parent / "client"
SCENE = Path(viser_internals.__file__).parent


async def wait_for_idle_page(server: viser.ViserServer, wait_until) -> None:
    """Wait until viser waits for something to send, and let asyncio refuse calls from another thread from then on."""
    infra = server._websock_server
    await wait_until(lambda: infra.get_message_buffer().message_event._waiters)
    infra.get_message_buffer().event_loop.set_debug(True)


async def test_viser_itself_still_wakes_its_pages_from_the_thread_that_draws(wait_until):
    """The reason for `wake_pages_in_own_thread`: once this fails, viser needs it no more."""
    with viser_internals.silenced():
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        async with dial(server.get_port()) as page:
            await received(page, "ReplayDoneMessage")
            await wait_for_idle_page(server, wait_until)
            with pytest.raises(RuntimeError, match="Non-thread-safe operation"):
                server.scene.add_frame("/frame")
    finally:
        with viser_internals.silenced():
            server.stop()


async def test_a_scene_graph_is_drawn_from_any_thread_and_wakes_its_pages_in_visers_own(servers, wait_until):
    graph = SceneGraph("Sancho")
    try:
        async with dial(graph.port) as page:
            await received(page, "ReplayDoneMessage")
            await wait_for_idle_page(servers[0], wait_until)
            graph.draw(state(pose=Pose(7.0, 2.0, 0.0)))
            assert (await received(page, "SetPositionMessage"))["position"] == [7.0, 2.0, 0.0]
    finally:
        graph.close()


def test_viser_prints_its_start_and_end_unless_it_is_silenced(capfd):
    viser.ViserServer(host="127.0.0.1", port=0, verbose=False).stop()
    assert "viser" in capfd.readouterr().out
    with viser_internals.silenced():
        viser.ViserServer(host="127.0.0.1", port=0, verbose=False).stop()
    assert capfd.readouterr().out == ""


def test_what_a_page_reports_is_read_as_viser_reads_it():
    for message, kind in ((CAMERA, MESSAGES.ViewerCameraMessage), (CLICK, MESSAGES.ScenePointerMessage)):
        theirs = MESSAGES.Message.deserialize(msgspec.msgpack.encode(message))
        assert isinstance(theirs, kind)
        ours = viser_internals.decode(msgspec.msgpack.encode(theirs.as_serializable_dict()))
        if kind is MESSAGES.ViewerCameraMessage:
            assert ours == viser_internals.PageCamera((3.0, 3.0, 3.0), (0.0, 0.0, 0.0), 600 / 500)
        else:
            assert ours == viser_internals.Click((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))


def test_what_the_bridge_sends_is_what_viser_would_send():
    position, look_at = messages_in(viser_internals.camera_frame((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)))
    assert position == as_sent(MESSAGES.SetCameraPositionMessage((1.0, 2.0, 3.0)))
    assert look_at == as_sent(MESSAGES.SetCameraLookAtMessage((4.0, 5.0, 6.0)))
    for wanted, modifiers in ((True, (None,)), (False, ())):
        (clicks,) = messages_in(viser_internals.click_frame(wanted))
        theirs = as_sent(MESSAGES.ScenePointerEnableMessage("click", modifiers))
        assert clicks == theirs | {"owner": "bridge"}


def as_sent(message) -> dict:
    """A message of viser as a page receives it."""
    return msgspec.msgpack.decode(msgspec.msgpack.encode(message.as_serializable_dict([])))


async def test_viser_checks_the_version_of_its_pages_by_the_subprotocol(servers):
    assert SUBPROTOCOL.startswith(viser_internals.SUBPROTOCOL_PREFIX)
    graph = SceneGraph("Sancho")
    try:
        async with asyncio.timeout(30), dial(graph.port) as page:
            assert page.subprotocol == SUBPROTOCOL
            assert messages_in(await page.recv())
    finally:
        graph.close()


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("WebsocketInterface.tsx", "document.hasFocus()"),  # _STAY_CONNECTED
        ("ControlPanel/ControlPanel.tsx", "IconCloudCheck"),  # _SHOW_DISCONNECTION
        ("CameraControls.tsx", '"KeyW"'),  # _REPORT_CAMERA_MOVES
        ("CameraControls.tsx", '"ArrowUp"'),  # _REPORT_CAMERA_MOVES
        ("App.tsx", "<Notifications"),  # _HIDE_PANEL
    ],
)
def test_visers_page_contains_what_its_patches_rest_on(file, text):
    assert text in (CLIENT / "src" / file).read_text()


def test_the_patches_are_in_the_head_of_visers_page_before_its_own_scripts():
    page = (CLIENT / "build" / "index.html").read_text()
    patched = viser_internals.patched_page(page)
    assert len(patched) > len(page)
    assert patched.index("document.hasFocus = () => true") < patched.index("</head>")
    own_script = page[page.index("<script") :][:200]
    assert patched.index("window.requestAnimationFrame = ") < patched.index(own_script)
    with pytest.raises(ValueError, match="no <head>"):
        viser_internals.patched_page("<!doctype html><body>")


def test_no_other_file_rests_on_visers_inside():
    inside = ("_websock_server", "_messages", "zstandard", "requestAnimationFrame", 'Message"', "console.quiet")
    for file in SCENE.rglob("*.py"):
        found = [name for name in inside if name in file.read_text()]
        assert bool(found) == (file.name in ("viser_internals.py", "viser_port.py")), (file, found)


@pytest.mark.parametrize(
    ("room", "may_not_import"),
    [
        ("drawing", ("backend.bridge.scene.viewers", "starlette", "from websockets")),
        ("viewers", ("import viser\n", "backend.bridge.scene.scene ", "from websockets")),
    ],
)
def test_what_is_drawn_knows_no_viewers_and_those_who_view_it_draw_nothing(room, may_not_import):
    files = list((SCENE / room).glob("*.py"))
    assert len(files) > 3
    for file in files:
        assert not [name for name in may_not_import if name in file.read_text()], file
