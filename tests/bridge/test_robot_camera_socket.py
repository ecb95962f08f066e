"""`WS /camera`: pictures while somebody looks, the newest first, for whoever is logged in."""

from __future__ import annotations

import asyncio

import pytest
from websockets.exceptions import InvalidStatus

from backend import tokens
from backend.identity import Role
from backend.telemetry import Picture, Pose
from tests.bridge.scenes import PATIENCE
from tests.bridge.viser_page import SUBPROTOCOL


def picture(jpeg: bytes) -> Picture:
    return Picture(1.0, Pose(0.0, 0.0, 0.0), 640, 480, jpeg)


@pytest.fixture
async def bridge(bridge_with, robot, wait_until):
    """A bridge whose robot is the peer."""
    async with bridge_with(robot={"port": robot.port}) as running:
        await wait_until(lambda: robot.subscriptions)
        yield running


async def received(camera) -> bytes:
    async with asyncio.timeout(PATIENCE):
        frame = await camera.recv()
    assert isinstance(frame, bytes)
    return frame


async def test_the_robot_is_asked_for_pictures_only_while_somebody_looks(bridge, robot, wait_until):
    assert "camera" not in robot.subscriptions[-1].channels
    async with bridge.websocket("/camera", token=bridge.token(Role.VIEWER)) as one:
        await wait_until(lambda: "camera" in robot.subscriptions[-1].channels)
        assert robot.subscriptions[-1].rate >= 5
        assert "scan" not in robot.subscriptions[-1].channels
        async with bridge.websocket("/camera") as other:
            await robot.send(picture(b"a"))
            assert await received(one) == await received(other) == b"a"
        await robot.send(picture(b"b"))
        assert await received(one) == b"b"
        assert "camera" in robot.subscriptions[-1].channels
    await wait_until(lambda: "camera" not in robot.subscriptions[-1].channels)
    assert robot.connections == 1


async def test_scene_and_camera_share_one_subscription(bridge, robot, wait_until):
    async with bridge.websocket("/camera"), bridge.websocket("/scene", subprotocols=[SUBPROTOCOL]):
        await wait_until(lambda: {"camera", "scan"} <= set(robot.subscriptions[-1].channels))
        assert robot.subscriptions[-1].rate == 20
    await wait_until(lambda: robot.subscriptions[-1].rate == 2)
    assert robot.connections == 1


async def test_whoever_reads_slowly_gets_the_newest_picture_and_never_a_pile(bridge, robot, wait_until):
    big = 500_000
    async with bridge.websocket("/camera", max_queue=1) as slow, bridge.websocket("/camera") as quick:
        await wait_until(lambda: "camera" in robot.subscriptions[-1].channels)
        for number in range(100):
            await robot.send(picture(bytes([number]) * big))
            while (await received(quick))[0] != number:
                pass
        numbers = [(await received(slow))[0]]
        while numbers[-1] != 99:
            numbers.append((await received(slow))[0])
    assert numbers == sorted(numbers)
    assert len(numbers) < 50


async def test_the_camera_takes_no_messages(bridge, closing):
    async with bridge.websocket("/camera") as camera:
        await camera.send("faster")
        assert await closing(camera) == (1008, "The camera takes no messages.")


async def test_the_camera_wants_a_login_and_our_own_page(bridge):
    for options, status in (({"token": None, "origin": bridge.origin}, 401), ({"origin": "https://evil.example"}, 403)):
        with pytest.raises(InvalidStatus) as refusal:
            async with bridge.websocket("/camera", **options):
                pass
        assert refusal.value.response.status_code == status


async def test_a_camera_whose_login_is_revoked_is_closed(bridge, robot, closing, wait_until):
    async with bridge.websocket("/camera", token=bridge.token(Role.VIEWER, "Vera")) as camera:
        tokens.revoke(bridge.settings.data_dir, "Vera")
        assert (await closing(camera))[0] == 4401
    await wait_until(lambda: "camera" not in robot.subscriptions[-1].channels)
