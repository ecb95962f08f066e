"""viser's restarts: when they happen, that the picture is the same after them, and what a failing one leaves."""

from __future__ import annotations

import contextlib
import socket
import threading

import msgspec
import pytest
import viser

from backend.bridge.scene.scene import RestartLimits
from backend.bridge.scene.viser_starter import Backoff, ViserStarter, build_scene_graph
from backend.telemetry import Pose
from tests.bridge.scenes import HALL, TOO_SHORT, received, state
from tests.bridge.viser_page import CAMERA, dial, viser_page

NEVER = 10**9
FEW = 150
"""Changes, more than a restart makes."""
AT_ONCE = RestartLimits(unwatched=0, watched=NEVER)


def runs(server: viser.ViserServer) -> bool:
    with contextlib.closing(socket.socket()) as probe:
        return probe.connect_ex(("127.0.0.1", server.get_port())) == 0


async def test_while_somebody_watches_viser_restarts_later(scene_with, robot, opening, wait_until):
    async with scene_with(limits=RestartLimits(unwatched=FEW, watched=NEVER)) as scene:
        port = await scene.port()
        async with opening(scene) as opened, viser_page(opened()) as page:
            await robot.send(*[state(pose=Pose(1.0 + i / 100, 2.0, 0.0)) for i in range(2 * FEW)])
            await wait_until(lambda: page.nodes["/robot"]["position"] == (1.0 + (2 * FEW - 1) / 100, 2.0, 0.0))
            assert await scene.port() == port
        await wait_until(lambda: robot.subscriptions[-1].rate == 2)  # nobody watches any more
        await robot.send(state())

        async def restarted() -> bool:
            return await scene.port() != port

        await wait_until(restarted)


async def test_pages_connect_again_after_a_restart_and_find_the_same_picture(
    scene_with, robot, opening, wait_until, closing
):
    async with scene_with(limits=RestartLimits(unwatched=NEVER, watched=FEW)) as scene, opening(scene) as opened:
        port = await scene.port()
        async with opened() as watching:
            await wait_until(lambda: robot.subscriptions[-1].rate == 20)
            drive = [state(pose=Pose(2.0 + i * 0.3, 5.0, 0.0)) for i in range(5)]
            turn = [state(pose=Pose(3.2, 5.0, i / 100)) for i in range(FEW)]
            await robot.send(HALL, *drive, *turn)
            assert (await closing(watching))[0] == 1013
        assert await scene.port() != port
        async with opened() as watching:
            await watching.send(msgspec.msgpack.encode(CAMERA))
            assert await received(watching, "SetCameraPositionMessage")
        async with viser_page(dial(await scene.port())) as page:
            await wait_until(lambda: page.nodes["/robot"]["position"] == (3.2, 5.0, 0.0))
            assert page.visible("/robot")
            assert page.nodes["/map/floor"]["render_width"] == pytest.approx(10.0)
            trail = page.points("/trail/0")
            assert (trail[0][0], trail[-1][0]) == (pytest.approx(2.0), pytest.approx(3.2))


async def test_a_restart_that_fails_is_not_repeated_at_once_and_leaves_no_server_behind(
    scene_with, robot, wait_until, caplog, servers
):
    is_broken = True

    def build(name, trail, messages):
        return build_scene_graph(name, trail, [*messages, TOO_SHORT] if messages and is_broken else messages)

    backoff = Backoff(first=1e6)  # longer than any machine takes to draw what follows
    starter = ViserStarter("Sancho", build=build, backoff=backoff)
    async with scene_with(starter=starter, limits=AT_ONCE) as scene:
        port = await scene.port()
        async with viser_page(dial(port)) as page:
            await robot.send(*[state(pose=Pose(1.0 + i / 100, 2.0, 0.0)) for i in range(50)])
            await wait_until(lambda: page.nodes["/robot"]["position"] == (1.49, 2.0, 0.0))  # the picture goes on
        assert await scene.port() == port
        assert [runs(server) for server in servers] == [True, False]
        assert caplog.text.count("viser cannot restart and goes on as it is") == 1

        is_broken = False
        backoff.succeeded()  # the pause is over
        await robot.send(state(pose=Pose(2.0, 2.0, 0.0)))
        await wait_until(lambda: [runs(server) for server in servers] == [False, False, True])
        assert await scene.port() == servers[-1].get_port()


async def test_a_restart_that_hangs_lets_the_picture_go_on_and_is_closed_when_it_comes_late(
    scene_with, robot, wait_until, servers
):
    released = threading.Event()

    def build(name, trail, messages):
        graph = build_scene_graph(name, trail, messages)
        if messages:
            released.wait()
        return graph

    starter = ViserStarter("Sancho", build=build, restart_seconds=0.1, backoff=Backoff(first=0.0, longest=0.0))
    async with scene_with(starter=starter, limits=AT_ONCE) as scene:
        try:
            port = await scene.port()
            async with viser_page(dial(port)) as page:
                await robot.send(*[state(pose=Pose(1.0 + i / 100, 2.0, 0.0)) for i in range(50)])
                await wait_until(lambda: page.nodes["/robot"]["position"] == (1.49, 2.0, 0.0))
            await wait_until(lambda: len(servers) == 2)  # no other start while this one hangs
        finally:
            released.set()
        await wait_until(lambda: [runs(server) for server in servers] == [True, False])
        assert await scene.port() == port


def test_the_pause_between_restarts_doubles_up_to_a_limit():
    backoff = Backoff(first=10.0, longest=600.0)
    assert backoff.retry_at < 0
    pauses = []
    for _ in range(9):
        backoff.failed(now=1000.0)
        pauses.append(backoff.retry_at - 1000.0)
    assert pauses == [10, 20, 40, 80, 160, 320, 600, 600, 600]
    backoff.succeeded()
    backoff.failed(now=1000.0)
    assert backoff.retry_at == 1010.0
