"""A viewer's control beside the scene's page: views, clicks, and what is refused."""

from __future__ import annotations

import asyncio
import json
import re
import uuid
from contextlib import asynccontextmanager
from typing import Any

import msgspec
import pytest
from websockets.exceptions import InvalidStatus

from backend import tokens
from backend.bridge.scene.drawing.camera_views import follow_view, map_view, top_view
from backend.identity import Role
from backend.telemetry import Pose
from tests.bridge.scenes import MAP, PATIENCE, received, state
from tests.bridge.viser_page import CAMERA, CLICK, SUBPROTOCOL

EXTENT = (0.0, 0.0, 4.0, 3.0)
ASPECT = CAMERA["image_width"] / CAMERA["image_height"]
NOT_UNDERSTOOD = {"error": 'Send {"view": "map"}, "top" or "follow", or {"pick": true} or false.'}


@pytest.fixture
async def bridge(bridge_with, robot, wait_until):
    """A bridge whose robot is the peer, and has told its map and where it is."""
    async with bridge_with(robot={"port": robot.port}) as running:
        await wait_until(lambda: robot.subscriptions)
        await robot.send(state(), MAP)
        async with Watcher(running).page() as page:
            await reports(page)
            while await put(page) != map_view(EXTENT, ASPECT).position:
                pass  # before the map came
        yield running


class Watcher:
    """One viewer: its page, its control, and the id that both carry."""

    def __init__(self, bridge, role: Role = Role.OPERATOR, name: str = "Ana") -> None:
        self.id = str(uuid.uuid4())
        self._bridge = bridge
        self.token = bridge.token(role, name)

    def control(self):
        return self._bridge.websocket(f"/scene/{self.id}/control", token=self.token)

    def page(self, identifier: str = ""):
        path = f"/scene/{identifier or self.id}"
        return self._bridge.websocket(path, token=self.token, subprotocols=[SUBPROTOCOL])

    @asynccontextmanager
    async def both(self):
        async with self.control() as control, self.page() as page:
            assert await heard(control) == {"view": "map"}
            await reports(page)
            assert await put(page) == map_view(EXTENT, ASPECT).position
            yield control, page


async def heard(control) -> dict[str, Any]:
    async with asyncio.timeout(PATIENCE):
        return json.loads(await control.recv())


async def wish(control, **asked: Any) -> None:
    await control.send(json.dumps(asked))


async def reports(page, position=CAMERA["position"], look_at=CAMERA["look_at"]) -> None:
    await page.send(msgspec.msgpack.encode(CAMERA | {"position": position, "look_at": look_at}))


async def put(page) -> tuple[float, ...]:
    """Where the bridge puts the page's camera next."""
    return tuple((await received(page, "SetCameraPositionMessage"))["position"])


async def click(page, x: float, y: float) -> None:
    await page.send(msgspec.msgpack.encode(CLICK | {"ray_origin": (x, y, 9.0), "ray_direction": (0.0, 0.0, -1.0)}))


async def test_a_viewer_chooses_what_to_see(bridge):
    async with Watcher(bridge).both() as (control, page):
        await wish(control, view="top")
        assert await heard(control) == {"view": "top"}
        assert await put(page) == top_view(EXTENT, ASPECT).position
        await wish(control, view="map")
        assert await heard(control) == {"view": "map"}
        assert await put(page) == map_view(EXTENT, ASPECT).position


async def test_whoever_follows_moves_with_the_robot_until_the_camera_is_taken_in_hand(bridge, robot):
    ana = Watcher(bridge)
    async with ana.both() as (control, page), bridge.http(ana.token) as http:
        await wish(control, view="follow")
        assert await heard(control) == {"view": "follow"}
        assert await put(page) == follow_view(Pose(1.0, 2.0, 1.5), ASPECT).position
        await robot.send(state(pose=Pose(1.2, 2.0, 1.5)))
        assert await put(page) == follow_view(Pose(1.2, 2.0, 1.5), ASPECT).position

        assert (await http.post(f"/scene/{ana.id}/moved")).status_code == 204
        assert await heard(control) == {"view": "free"}
        await robot.send(state(pose=Pose(1.4, 2.0, 1.5)))
        await wish(control, view="top")  # the next that the page hears is this, and not the robot's way
        assert await put(page) == top_view(EXTENT, ASPECT).position


async def test_one_viewers_wish_moves_nobody_elses_camera(bridge):
    async with Watcher(bridge).both() as (control, page), Watcher(bridge).both() as (others_control, others_page):
        await wish(control, view="top")
        assert await put(page) == top_view(EXTENT, ASPECT).position
        await wish(others_control, view="follow")
        assert await heard(others_control) == {"view": "follow"}
        assert await put(others_page) == follow_view(Pose(1.0, 2.0, 1.5), ASPECT).position


async def test_a_click_is_told_while_picking_is_on_and_to_that_viewer_alone(bridge):
    async with Watcher(bridge).both() as (control, page), Watcher(bridge).both() as (others, _):
        await wish(others, pick=True)
        await click(page, 3.0, 2.5)  # nobody picks here
        await wish(control, pick=True)
        assert (await received(page, "ScenePointerEnableMessage"))["modifiers"] == [None]
        await click(page, 2.0, 2.75)
        assert await heard(control) == {"picked": {"x": 2.0, "y": 2.75, "place": None}}
        await click(page, 1.25, 1.0)
        assert await heard(control) == {"picked": {"x": 1.25, "y": 1.0, "place": "kitchen"}}
        await click(page, 50.0, 1.0)  # beside the map
        await wish(control, pick=False)
        assert (await received(page, "ScenePointerEnableMessage"))["modifiers"] == []
        await click(page, 2.0, 2.75)
        await wish(control, view="map")
        assert await heard(control) == {"view": "map"}
        await wish(others, view="map")
        assert await heard(others) == {"view": "map"}


async def test_a_page_that_connects_again_still_reports_clicks(bridge):
    ana = Watcher(bridge)
    async with ana.control() as control:
        await wish(control, pick=True)
        await wish(control, view="top")
        while await heard(control) != {"view": "top"}:
            pass  # the view that it began with, if that was not replaced yet
        async with ana.page() as page:
            assert (await received(page, "ScenePointerEnableMessage"))["modifiers"] == [None]
            await reports(page)
            assert await put(page) == top_view(EXTENT, ASPECT).position


async def test_whoever_only_watches_gets_no_clicks(bridge):
    async with Watcher(bridge, Role.VIEWER, "Vera").both() as (control, page):
        await wish(control, pick=True)
        said = await heard(control)
        assert said == {"error": "You watch only: a click here cannot become a request to the robot."}
        await click(page, 2.0, 2.75)
        await wish(control, view="top")
        assert await heard(control) == {"view": "top"}


async def test_wishes_that_make_no_sense_are_answered_and_change_nothing(bridge):
    async with Watcher(bridge).control() as control:
        assert await heard(control) == {"view": "map"}
        for nonsense in (
            "",
            "no json",
            "[]",
            "null",
            "{}",
            '{"view": "moon"}',
            '{"view": "free"}',
            '{"pick": "yes"}',
            '{"drive": true}',
            b"\xff\xfe",
        ):
            await control.send(nonsense)
            assert await heard(control) == NOT_UNDERSTOOD
        await wish(control, view="top")
        assert await heard(control) == {"view": "top"}


async def test_a_huge_wish_ends_the_control(bridge, closing):
    async with Watcher(bridge).control() as control:
        await control.send("x" * 5000)
        assert await closing(control) == (1009, "A message of this socket has at most 1024 bytes.")


async def test_of_two_controls_of_one_viewer_the_newer_counts(bridge, closing):
    ana = Watcher(bridge)
    async with ana.control() as first, ana.control() as second, ana.page() as page:
        assert await closing(first) == (4409, "Another page took this viewer's place.")
        assert await heard(second) == {"view": "map"}
        await reports(page)
        await wish(second, view="top")
        assert await heard(second) == {"view": "top"}


async def test_of_two_pages_of_one_viewer_the_newer_counts(bridge):
    ana = Watcher(bridge)
    async with ana.page() as first, ana.both() as (control, second):
        await reports(first, (9.0, 9.0, 9.0))
        await click(first, 2.0, 2.0)
        await wish(control, view="top")
        assert await heard(control) == {"view": "top"}
        assert await put(second) == top_view(EXTENT, ASPECT).position


async def test_another_person_with_the_same_id_is_another_viewer(bridge):
    ana, eve = Watcher(bridge), Watcher(bridge, name="Eve")
    eve.id = ana.id
    async with ana.both() as (control, page), eve.control() as eves, bridge.http(eve.token) as http:
        assert await heard(eves) == {"view": "map"}
        await wish(eves, view="top")
        assert await heard(eves) == {"view": "top"}
        assert (await http.post(f"/scene/{ana.id}/moved")).status_code == 204
        await wish(control, view="follow")
        assert await heard(control) == {"view": "follow"}
        assert await put(page) == follow_view(Pose(1.0, 2.0, 1.5), ASPECT).position


@pytest.mark.parametrize("identifier", ["me", "x%2e", "3f2b8c1e7d544c8e9a350c6f1e2d4b5a", "%00"])
async def test_an_id_that_is_none_is_refused(bridge, identifier):
    sentence = "The id of a viewer is a UUID, such as 3f2b8c1e-7d54-4c8e-9a35-0c6f1e2d4b5a."
    async with bridge.http(bridge.token()) as http:
        answers = [
            await http.get(f"/scene/{identifier}/"),
            await http.get(f"/scene/{identifier}"),
            await http.post(f"/scene/{identifier}/moved"),
        ]
    assert [(answer.status_code, answer.json()) for answer in answers] == [(404, {"error": sentence})] * 3
    for path in (f"/scene/{identifier}", f"/scene/{identifier}/control"):
        with pytest.raises(InvalidStatus) as refusal:
            async with bridge.websocket(path):
                pass
        assert refusal.value.response.status_code == 404


async def test_the_page_of_a_viewer_is_the_scene(bridge):
    viewer = uuid.uuid4()
    async with bridge.http(bridge.token(Role.VIEWER)) as http:
        moved = await http.get(f"/scene/{viewer}")
        assert (moved.status_code, moved.headers["location"]) == (308, f"/scene/{viewer}/")
        own, other = (await http.get(f"/scene/{viewer}/")).text, (await http.get("/scene/")).text
        ticket = re.compile(r'sceneTicket = "[^"]+"')
        assert ticket.sub("", own) == ticket.sub("", other)


async def test_control_and_its_post_want_a_login_and_our_own_page(bridge):
    viewer = uuid.uuid4()
    for options, status in (({"token": None, "origin": bridge.origin}, 401), ({"origin": "https://evil.example"}, 403)):
        with pytest.raises(InvalidStatus) as refusal:
            async with bridge.websocket(f"/scene/{viewer}/control", **options):
                pass
        assert refusal.value.response.status_code == status
    async with bridge.http() as http:
        own = await http.post(f"/scene/{viewer}/moved", headers={"Origin": bridge.origin})
        assert own.status_code == 401
        strange = await http.post(f"/scene/{viewer}/moved", headers={"Origin": "https://evil.example"})
        assert strange.status_code == 403


async def test_a_control_whose_login_is_revoked_is_closed(bridge, closing):
    async with Watcher(bridge, Role.VIEWER, "Vera").control() as control:
        tokens.revoke(bridge.settings.data_dir, "Vera")
        assert (await closing(control))[0] == 4401
