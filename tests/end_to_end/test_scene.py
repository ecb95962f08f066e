"""The map as people use it: views, going where somebody points, and the camera, in the processes that people start.

What counts is what the robot did, by its own telemetry, and what the page draws.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image, ImageChops
from playwright.async_api import Error as PlaywrightError
from playwright.async_api import Locator, Page, expect

from backend.identity import Role
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.tap import tap_on
from tests.end_to_end.test_dashboard import PHONE, login, until
from tests.end_to_end.test_papers_session import ask
from tests.processes import Robot, Watched, eventually

ALIKE = 0.03
"""The share of two pictures of the same that may differ: viser draws more coarsely the slower the machine is."""
CORRIDOR = (6.4, 7.6)
"""m: between which y the robot can stand in the simulator's corridor."""
FRAMES = "() => new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))"
"""Until the page has drawn what was under way, however long one frame takes it."""


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The three processes at the robot's real speed, so that a drive lasts while a page draws slowly."""
    with at_work(Robot(tmp_path_factory.mktemp("data"))) as running:
        yield running


def view(page: Page, name: str) -> Locator:
    return page.get_by_test_id(f"view-{name}")


async def look(page: Page, name: str) -> None:
    await view(page, name).click()
    await expect(view(page, name)).to_have_attribute("aria-pressed", "true")


async def drawn(page: Page, seen: str = "map") -> None:
    """Until all of the map is there and its camera stands where the page says; the robot must be at rest."""
    await expect(view(page, seen)).to_have_attribute("aria-pressed", "true")
    canvas = page.frame_locator("iframe").locator("canvas").first
    before = Image.new("RGB", (1, 1))
    equal = 0

    async def settled() -> bool:
        nonlocal before, equal
        # A busy machine may not have drawn yet between two pictures: frames of the map's own are waited for.
        await canvas.evaluate(FRAMES)
        last, before = before, await picture(canvas)
        same = len(before.getcolors(maxcolors=2**24) or []) > 200 and changed(last, before) < ALIKE
        equal = equal + 1 if same else 0
        return equal >= 2

    await until(settled, "the map to be drawn", 90)


async def picture(shown: Locator) -> Image.Image:
    return Image.open(io.BytesIO(await shown.screenshot())).convert("RGB")


def changed(one: Image.Image, other: Image.Image) -> float:
    """The share of the picture that is another one."""
    if one.size != other.size:
        return 1.0
    different = ImageChops.difference(one, other).convert("L").histogram()
    return sum(different[24:]) / (one.width * one.height)


async def cancel(page: Page, watched: Watched) -> None:
    """End the drive: a map that shows one takes most of a small machine."""
    await page.get_by_test_id("cancel").click()
    await watched.until(lambda: watched.state.motion is None, "the robot to be at rest")


async def close_camera(page: Page) -> None:
    await page.get_by_role("button", name="Close the camera").click()
    await expect(page.get_by_test_id("camera-view")).to_have_count(0)


async def test_the_view_that_follows_moves_with_the_robot_and_the_map_stays(up: Running, open_page: Opener) -> None:
    page = await open_page(login(up, "Sue", Role.SUPERVISOR))
    await close_camera(page)
    await drawn(page)
    canvas = page.frame_locator("iframe").locator("canvas").first
    async with up.robot.watched() as watched:

        async def drive(place: str) -> Image.Image:
            """Until the robot is elsewhere; returns the picture before."""
            before, (x, y) = await picture(canvas), (watched.state.pose.x, watched.state.pose.y)
            await ask(page, f"go to {place}")
            await watched.until(lambda: watched.distance_to(x, y) > 4, "the robot to be elsewhere")
            return before

        before = await drive("lab 2.3.7")
        assert changed(before, await picture(canvas)) < 0.1
        await cancel(page, watched)
        await look(page, "follow")
        await drawn(page, "follow")
        before = await drive("lab 2.3.9")

        async def moved() -> bool:
            return changed(before, await picture(canvas)) > 0.3

        await until(moved, "the map to move")
        await expect(view(page, "follow")).to_have_attribute("aria-pressed", "true")
        await cancel(page, watched)


async def point_at_the_corridor(page: Page) -> tuple[float, float]:
    """Click into the corridor, which from above lies across the middle, until the bar offers a point of it."""
    offered = page.get_by_test_id("go-here-place").locator("option:checked")
    frame = await page.locator(".scene-map").bounding_box()
    assert frame is not None

    async def clicked() -> bool:
        await page.mouse.click(frame["x"] + 0.65 * frame["width"], frame["y"] + 0.5 * frame["height"])
        with contextlib.suppress(AssertionError):  # a page that draws slowly may not listen for clicks yet
            await expect(offered).to_contain_text("the point", timeout=3000)
        return "the point" in await offered.inner_text()

    await until(clicked, "the bar to offer a point")
    point = re.search(r"the point (-?[\d.]+), (-?[\d.]+)", await offered.inner_text())
    assert point is not None
    assert CORRIDOR[0] < float(point[2]) < CORRIDOR[1]
    return float(point[1]), float(point[2])


async def test_a_click_on_the_floor_and_a_go_send_the_robot_there_as_an_ordinary_prompt(
    up: Running, open_page: Opener
) -> None:
    page = await open_page(login(up, "Sue", Role.SUPERVISOR))
    await close_camera(page)
    await drawn(page)
    await look(page, "top")
    await page.get_by_test_id("go-here").click()
    async with up.robot.watched() as watched:
        x, y = await point_at_the_corridor(page)
        assert watched.state.motion is None, "a click alone moves nothing"
        await page.get_by_test_id("go-here-go").click()
        await expect(page.get_by_test_id("user-message").last).to_contain_text(f"Go to the point x {x}, y {y}")
        await expect(page.get_by_test_id("go-here")).to_be_focused()
        await watched.until(lambda: watched.distance_to(x, y) < 0.3 and watched.speed == 0, "the robot to be there", 90)


async def test_a_place_of_the_list_needs_no_pointer_and_waits_while_the_robot_is_at_work(
    up: Running, open_page: Opener
) -> None:
    page = await open_page(login(up, "Sue", Role.SUPERVISOR))
    await drawn(page)
    async with up.robot.watched() as watched:
        await page.get_by_test_id("go-here").focus()
        await page.keyboard.press("Enter")
        await expect(page.get_by_test_id("go-here-place")).to_be_focused()
        await page.get_by_test_id("go-here-place").select_option(label="Go to kitchen")
        await page.keyboard.press("Tab")
        await page.keyboard.press("Tab")
        await expect(page.get_by_test_id("go-here-go")).to_be_focused()
        await page.keyboard.press("Enter")
        await watched.until(lambda: watched.state.motion and watched.state.motion.place == "kitchen", "the drive")
        await page.get_by_test_id("go-here").click()
        await page.get_by_test_id("go-here-place").select_option(label="Go to lab 2.3.7")
        await expect(page.get_by_test_id("go-here-bar")).to_contain_text("at work")
        await expect(page.get_by_test_id("go-here-go")).to_be_disabled()
        await page.keyboard.press("Escape")
        await expect(page.get_by_test_id("go-here")).to_be_focused()
        await cancel(page, watched)


async def test_who_only_watches_gets_views_and_the_camera_but_no_way_to_send_the_robot(
    up: Running, open_page: Opener
) -> None:
    page = await open_page(login(up, "Vic", Role.VIEWER))
    await drawn(page)
    await look(page, "top")
    await expect(page.get_by_test_id("camera-picture")).to_be_visible()
    await expect(page.get_by_test_id("go-here")).to_have_count(0)


async def fits(page: Page, names: list[str]) -> None:
    for name in names:
        box = await page.get_by_test_id(name).bounding_box()
        assert box is not None
        assert min(box["width"], box["height"]) >= 44, name
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= PHONE["width"], name


@pytest.mark.parametrize("language", ["en-GB", "es-ES"])
async def test_on_a_phone_every_button_of_the_map_is_in_sight_and_large_enough(
    up: Running, open_page: Opener, language: str
) -> None:
    page = await open_page(login(up, "Sue", Role.SUPERVISOR), viewport=PHONE, has_touch=True, locale=language)
    await page.get_by_role("navigation").get_by_role("button").nth(1).tap()
    await fits(page, ["view-follow", "view-top", "view-map", "go-here", "camera"])
    await page.get_by_test_id("camera").tap()
    await fits(page, ["camera-size"])
    await page.get_by_test_id("go-here").tap()
    await fits(page, ["go-here-place", "go-here-cancel", "go-here-go"])


async def test_the_kiosk_has_the_plain_map(up: Running, open_page: Opener) -> None:
    url = f"{up.base}/kiosk#token={up.robot.token('Kiosk', Role.VISITOR)}"
    page = await open_page(url, viewport={"width": 1080, "height": 1920})
    await expect(page.locator("iframe")).to_have_attribute("src", "/scene/")
    for name in ("view-map", "go-here", "camera"):
        await expect(page.get_by_test_id(name)).to_have_count(0)


async def test_the_camera_shows_other_pictures_as_the_robot_drives(up: Running, open_page: Opener) -> None:
    page = await open_page(login(up, "Sue", Role.SUPERVISOR))
    shown = page.get_by_role("img", name="What Sancho sees now")
    await expect(shown).to_be_visible()
    await page.get_by_test_id("camera-size").click()
    await expect(page.get_by_test_id("camera-size")).to_have_accessible_name("Back to the map")
    before = await picture(shown)
    await ask(page, "go to lab 2.3.2")

    async def another() -> bool:
        return changed(before, await picture(shown)) > 0.3

    await until(another, "another picture of the camera", 60)
    await page.get_by_test_id("camera-size").focus()
    await page.keyboard.press("Escape")
    await expect(page.get_by_test_id("camera-size")).to_have_accessible_name("Enlarge the camera’s picture")


async def test_the_robot_is_asked_for_pictures_only_while_somebody_looks(tmp_path: Path, open_page: Opener) -> None:
    robot = Robot(tmp_path)
    with contextlib.ExitStack() as processes:
        processes.enter_context(robot.running("robot", port=robot.robot_port))
        processes.enter_context(robot.running("agent", port=robot.agent_port))
        async with tap_on(robot) as tap:
            tapped = replace(robot, robot_port=tap.port)
            with tapped.running("bridge", port=robot.bridge_port):
                url = f"http://127.0.0.1:{robot.bridge_port}/#token={robot.token('Sue', Role.SUPERVISOR)}"
                page = await open_page(url, viewport=PHONE, has_touch=True)
                tabs = page.get_by_role("navigation")
                await tabs.get_by_role("button", name="Map").tap()
                await expect(view(page, "map")).to_be_enabled()
                await eventually(lambda: "scan" in tap.channels, "the map to be watched")
                assert "camera" not in tap.channels, "on a phone the camera is shown when somebody asks for it"
                await page.get_by_test_id("camera").tap()
                await expect(page.get_by_test_id("camera-picture")).to_be_visible()
                assert "camera" in tap.channels
                await tabs.get_by_role("button", name="Talk").tap()
                await eventually(lambda: "camera" not in tap.channels, "nobody to look")
                await tabs.get_by_role("button", name="Map").tap()
                await eventually(lambda: "camera" in tap.channels, "somebody to look again")
                await page.get_by_test_id("camera").tap()
                await eventually(lambda: "camera" not in tap.channels, "nobody to look")
                await page.reload()
                await tabs.get_by_role("button", name="Map").tap()
                await expect(page.get_by_test_id("camera")).to_have_attribute("aria-pressed", "false")


async def test_after_a_restart_of_the_bridge_the_map_comes_back_with_the_view_that_was_chosen(
    tmp_path: Path, open_page: Opener
) -> None:
    robot = Robot(tmp_path)
    with contextlib.ExitStack() as processes:
        processes.enter_context(robot.running("robot", port=robot.robot_port))
        processes.enter_context(robot.running("agent", port=robot.agent_port))
        with robot.running("bridge", port=robot.bridge_port):
            page = await open_page(f"http://127.0.0.1:{robot.bridge_port}/#token={robot.token('Sue', Role.SUPERVISOR)}")
            await expect(page.get_by_test_id("camera-picture")).to_be_visible()
            await close_camera(page)
            await drawn(page)
            canvas = page.frame_locator("iframe").locator("canvas").first
            oblique = await picture(canvas)
            await look(page, "top")

            async def above() -> bool:
                return changed(oblique, await picture(canvas)) > 0.2

            await until(above, "the map from above")
            before = await picture(canvas)
        await expect(view(page, "top")).to_be_disabled()
        with robot.running("bridge", port=robot.bridge_port):
            await expect(view(page, "top")).to_have_attribute("aria-pressed", "true")

            async def as_before() -> bool:
                try:
                    now = await picture(canvas)  # labels and the laser may be drawn a little later
                except PlaywrightError:
                    return False  # the map is just being loaded anew
                return changed(before, now) < changed(oblique, now) / 2

            await until(as_before, "the map from above, as before")
            await page.get_by_test_id("camera").click()
            await expect(page.get_by_test_id("camera-picture")).to_be_visible()
