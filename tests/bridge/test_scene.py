"""What the scene draws for the robot's telemetry, as a page receives it."""

from __future__ import annotations

from collections.abc import AsyncIterator

import msgspec
import pytest

from backend.telemetry import Motion, Path, Picture, Pose, Scan, Stop, Zone
from tests.bridge.scenes import HALL, MAP, TOO_SHORT, person, state
from tests.bridge.viser_page import ViserPage, dial, viser_page


@pytest.fixture
async def page(scene) -> AsyncIterator[ViserPage]:
    """A page of that scene."""
    async with viser_page(dial(await scene.port())) as page:
        yield page


async def test_the_scene_shows_what_the_telemetry_says(robot, page, wait_until):
    await robot.send(MAP, state())
    await wait_until(lambda: page.visible("/robot"))
    assert page.nodes["/robot"]["position"] == (1.0, 2.0, 0.0)
    assert page.nodes["/robot/name"]["text"] == "Sancho"
    assert page.labels("/places/") == ["kitchen"]
    assert page.nodes["/map/walls"]["vertices"].max() == pytest.approx(4.0)
    assert not page.visible("/notice")
    assert not page.visible("/goal")

    goal = Motion("navigate", Pose(3.0, 1.0, 0.0), "kitchen", 2.0, 4.0)
    await robot.send(Path(1.0, [(1, 2), (3, 1)]), state(motion=goal))
    await wait_until(lambda: page.visible("/goal"))
    assert page.nodes["/goal"]["position"] == (3.0, 1.0, 0.0)
    assert page.visible("/path")

    await robot.send(Path(1.0, [(1, 2), (2, 2)], preview=True), state())
    await wait_until(lambda: page.visible("/preview") and not page.visible("/goal"))
    assert not page.visible("/path")

    await robot.send(state(speaking="The meeting is at noon."))
    await wait_until(lambda: page.nodes["/robot/name"]["text"] == "Sancho: “The meeting is at noon.”")
    await robot.send(state(stop=Stop("Ana", 1.0)))
    await wait_until(lambda: page.nodes["/robot/name"]["text"] == "Sancho ■ Ana")

    await robot.send(Scan(1.0, Pose(0.5, 0.5, 0.0), 0.0, 0.1, 10.0, [1.0, 2.0, 10.0]))
    await wait_until(lambda: len(page.points("/laser")) == 2)
    assert page.points("/laser")[0] == pytest.approx([1.5, 0.5, 0.3])


async def test_standing_still_costs_viser_nothing(robot, page, wait_until):
    await robot.send(MAP, state())
    await wait_until(lambda: page.visible("/robot"))
    page.changes.clear()
    await robot.send(*[state(time=float(i)) for i in range(50)], MAP, state(stop=Stop("Ana", 1.0)))
    await wait_until(lambda: page.nodes["/robot/name"]["text"] == "Sancho ■ Ana")
    tinted = [("SceneNodeUpdateMessage", f"/robot/{part}") for part in ("name", "heading", "glow")]
    assert sorted(page.changes) == sorted(tinted)  # neither its position, nor the map, nor the trail


async def test_standing_still_with_people_about_costs_what_they_move_and_no_more(scene, robot, page, wait_until):
    await robot.send(HALL, state(pose=Pose(5.0, 5.0, 0.0)), person(7.0))
    await wait_until(lambda: any(page.visible(name) for name in page.nodes if name.startswith("/obstacles/")))
    page.changes.clear()
    await robot.send(*[person(7.0) for _ in range(50)], state(pose=Pose(5.0, 5.0, 0.1)))
    await wait_until(lambda: page.nodes["/robot"]["wxyz"][3] > 0)
    assert page.changes == [("SetOrientationMessage", "/robot")]

    async def replayed() -> int:
        async with viser_page(dial(await scene.port())) as newcomer:
            return newcomer.replayed

    before = await replayed()
    await robot.send(*[person(7.0 + i / 50) for i in range(50)], state(pose=Pose(5.0, 5.0, 0.2)))
    await wait_until(lambda: page.nodes["/robot"]["wxyz"][3] > 0.09)
    assert await replayed() <= before + 4  # what viser keeps for a new page does not grow


async def test_the_noise_of_the_laser_changes_nothing(robot, page, wait_until):
    async def drawn(x: float, turn: float) -> float:
        """Where the nearest point is drawn after this scan; the robot's heading shows that the scan was drawn."""
        await robot.send(person(x), state(pose=Pose(5.0, 5.0, turn)))
        await wait_until(lambda: page.nodes["/robot"]["wxyz"][3] > turn / 2.05)
        return float(page.points("/laser")[2][0])

    await robot.send(HALL)
    assert await drawn(7.0, 0.1) == pytest.approx(6.8, abs=0.01)
    assert await drawn(7.05, 0.2) == pytest.approx(6.8, abs=0.01)
    assert await drawn(7.12, 0.3) == pytest.approx(6.92, abs=0.01)
    await robot.send(Scan(1.0, Pose(5.0, 5.0, 0.0), -0.06, 0.03, 10.0, [10.0] * 5))
    assert await drawn(7.12, 0.4) == pytest.approx(6.92, abs=0.01)
    await robot.hang_up()
    await wait_until(lambda: not page.visible("/laser"))
    await wait_until(lambda: robot.connections == 2)
    assert await drawn(7.12, 0.5) == pytest.approx(6.92, abs=0.01)
    assert page.visible("/laser")


async def test_who_the_laser_sees_is_a_post_that_is_hidden_when_the_robot_is_gone(robot, page, wait_until):
    await robot.send(HALL, state(pose=Pose(5.0, 5.0, 0.0)), person(7.0))
    posts = [name for name in page.nodes if name.startswith("/obstacles/")]
    (post,) = await wait_until(lambda: [name for name in posts if page.visible(name)])
    assert page.nodes[post]["position"] == pytest.approx((7.0, 5.0, 0.0), abs=0.15)
    await robot.hang_up()
    await wait_until(lambda: not page.visible(post))


async def test_the_trail_is_drawn_and_another_map_clears_it(robot, page, wait_until):
    await robot.send(HALL, *[state(pose=Pose(2.0 + i * 0.3, 5.0, 0.0)) for i in range(5)])
    await wait_until(lambda: page.visible("/trail/0") and len(page.points("/trail/0")) == 2 * 4)
    assert page.points("/trail/0")[-1][:2] == pytest.approx([3.2, 5.0])
    await robot.send(MAP)
    await wait_until(lambda: not page.visible("/trail/0"))


async def test_zones_are_named(robot, page, wait_until):
    await robot.send(msgspec.structs.replace(MAP, zones=[Zone("store", [(1, 1), (2, 1), (2, 2), (1, 2)])]))
    await wait_until(lambda: page.labels("/zones/") == ["× store"])
    assert page.labels("/places/") == ["kitchen"]


async def test_the_cameras_view_is_shown_while_somebody_watches_through_it(scene, robot, page, wait_until):
    await robot.send(MAP, state())
    picture = Picture(1.0, Pose(1.0, 2.0, 1.5), 640, 360, b"jpeg")
    with scene.pictures() as pictures:
        await robot.send(picture)
        await wait_until(lambda: page.visible("/robot/camera"))
        assert page.nodes["/robot/camera"]["aspect"] == pytest.approx(16 / 9)
        assert await pictures.take() == [b"jpeg"]
    await robot.send(picture, state(time=2.0))
    await wait_until(lambda: not page.visible("/robot/camera"))


async def test_while_the_robot_is_gone_the_scene_says_so_and_comes_back(robot, page, wait_until):
    await robot.send(state())
    await wait_until(lambda: not page.visible("/notice"))
    await robot.hang_up()
    await wait_until(lambda: page.visible("/notice"))
    assert page.nodes["/notice"]["text"] == "Sancho ?"
    await wait_until(lambda: robot.connections == 2)
    await robot.send(state())
    await wait_until(lambda: not page.visible("/notice"))


async def test_a_message_that_cannot_be_drawn_does_not_end_the_scene(robot, page, wait_until, caplog):
    await robot.send(TOO_SHORT, state())
    await wait_until(lambda: page.visible("/robot"))
    assert "a Map message cannot be drawn" in caplog.text


async def test_an_invalid_message_is_dropped_and_the_next_one_shown(robot, page, wait_until, caplog):
    await robot.send_bytes(b"\xc1")
    await robot.send_bytes(msgspec.msgpack.encode({"type": "state"}))
    await robot.send(state())
    await wait_until(lambda: page.visible("/robot"))
    assert caplog.text.count("dropped a telemetry message") == 2
