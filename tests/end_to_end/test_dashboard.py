"""What people do in the dashboard beside the paper's session: log in, stop, lose the connection, use a phone."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import pytest
from PIL import Image, ImageChops
from playwright.async_api import Page, expect

from backend.identity import Role
from tests.end_to_end import screens
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.cut import cable_to
from tests.end_to_end.test_papers_session import ask
from tests.processes import Robot

PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The three processes, faster than real, and slow enough to be stopped in mid-drive on a busy machine."""
    with at_work(Robot(tmp_path_factory.mktemp("data")), "--time-scale", "2") as running:
        yield running


def login(up: Running, name: str, role: Role, seconds: float = 3600) -> str:
    return f"{up.base}/#token={up.robot.token(name, role, seconds)}"


async def until(condition: Callable[[], Awaitable[bool]], what: str, seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not await condition():
        assert time.monotonic() < deadline, f"waited {seconds:g} s for {what}"


async def ready(page: Page) -> None:
    await expect(page.get_by_test_id("robot-state")).to_contain_text("ready")


@pytest.mark.parametrize("address", ["/", "/#token=forged", "expired"])
async def test_without_a_valid_token_the_page_says_what_to_do(up: Running, open_page: Opener, address: str) -> None:
    url = login(up, "Late", Role.OPERATOR, -1) if address == "expired" else up.base + address
    page = await open_page(url)
    await expect(page.get_by_role("textbox")).to_be_visible()
    await expect(page.locator("main")).to_contain_text("./run.sh")
    await expect(page.get_by_test_id("composer")).to_have_count(0)
    assert (await page.request.get(f"{up.base}/api/me")).status == 401
    assert (await page.request.get(f"{up.base}/scene/")).status == 401


async def test_stop_is_one_click_and_holds_until_a_supervisor_releases_it(up: Running, open_plain: Opener) -> None:
    supervisor = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    viewer = await open_plain(login(up, "Vic", Role.VIEWER))
    await ready(supervisor)
    await ready(viewer)
    async with up.robot.watched() as watched:
        await ask(supervisor, "go to lab 2.3.9")
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
        await viewer.get_by_test_id("stop").click()
        await watched.until(lambda: watched.speed == 0 and watched.state.stop, "the stop")
        assert watched.state.stop is not None
        assert watched.state.stop.by == "Vic"
        await expect(supervisor.get_by_text("Vic").first).to_be_visible()
        await expect(viewer.get_by_test_id("release")).to_have_count(0)
        await expect(supervisor.get_by_test_id("agent-message").last).to_contain_text("Stopped by Vic")
        await supervisor.get_by_test_id("release").click()
        await supervisor.get_by_role("alertdialog").get_by_role("button", name=re.compile("Release", re.I)).click()
        await watched.until(lambda: watched.state.stop is None, "the release")
        await expect(supervisor.get_by_test_id("release")).to_have_count(0)
        standing = watched.state.pose
        await ask(supervisor, "where are you?")
        await expect(supervisor.get_by_test_id("agent-message").last).to_contain_text("I am at x")
        assert watched.state.pose == standing, "a release must not start any motion again"


async def test_a_lost_connection_is_told_and_the_session_comes_back_as_it_was(up: Running, open_plain: Opener) -> None:
    async with cable_to(up.robot.bridge_port) as cable:
        page = await open_plain(f"http://127.0.0.1:{cable.port}/#token={up.robot.token('Sue', Role.SUPERVISOR)}")
        await ready(page)
        await screens.new_session(page)
        await ask(page, "go to lab 2.3.9 and then say hello")
        driving = page.get_by_test_id("tool-card").filter(has_text="Drive to")
        await expect(driving).to_contain_text("to go")
        await cable.cut()
        await expect(page.get_by_test_id("connection-band")).to_be_visible()
        await expect(page.get_by_test_id("user-message").last).to_contain_text("go to lab 2.3.9")
        await expect(page.get_by_test_id("stop")).to_be_in_viewport()
        await cable.plug_in()
        await expect(page.get_by_test_id("connection-band")).to_have_count(0)
        await expect(driving).to_have_count(1)
        await page.get_by_test_id("permission-allow").click(timeout=60_000)
        await expect(page.get_by_test_id("agent-message").last).to_contain_text("I said: “Hello.”")
        await expect(page.get_by_test_id("user-message")).to_have_count(1)
        await expect(page.get_by_test_id("tool-card")).to_have_count(3)


async def test_what_the_robot_said_can_be_heard(up: Running, open_plain: Opener) -> None:
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await screens.new_session(page)
    await screens.asked(page)
    await screens.allowed(page)
    card = page.get_by_test_id("tool-card").last
    sound = card.locator("audio")
    await expect(sound).to_have_js_property("paused", True)
    await card.get_by_role("button", name="Play the sound").click()

    async def heard() -> bool:
        return bool(await sound.evaluate("audio => audio.ended && audio.currentTime > 0.5"))

    await until(heard, "the sentence to be played to its end")


async def test_a_reload_shows_the_session_as_it_was(up: Running, open_plain: Opener) -> None:
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await ready(page)
    await screens.new_session(page)
    await ask(page, "take a photo")
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("Here is what I see.")
    await screens.idle(page)
    before = await page.get_by_test_id("conversation").inner_text()
    await expect(page.get_by_test_id("tool-card").get_by_role("img").first).to_be_visible()
    await page.reload()
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("Here is what I see.")
    await expect(page.get_by_test_id("conversation")).to_have_text(before, use_inner_text=True)


async def test_an_unknown_place_and_a_goal_in_a_wall_are_answered_in_words(up: Running, open_plain: Opener) -> None:
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await ready(page)
    await ask(page, "go to lab 9")
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("No place called lab 9. Known places:")
    await ask(page, "go to (0.05, 0.05)")
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("inside a wall")


async def test_on_a_phone_nothing_is_cut_off_and_stop_and_the_question_are_in_sight(
    up: Running, open_page: Opener, pictures: Path
) -> None:
    page = await open_page(login(up, "Sue", Role.SUPERVISOR), viewport=PHONE, has_touch=True)
    await ready(page)
    await ask(page, "say that lunch is ready")
    await expect(page.get_by_test_id("permission")).to_be_in_viewport()
    await page.screenshot(path=pictures / "phone-question.png")
    for tab in ("Map", "Sessions", "Talk"):
        await page.get_by_role("navigation").get_by_role("button", name=tab).tap()
        await expect(page.get_by_test_id("stop")).to_be_in_viewport(ratio=1)
        overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert await page.evaluate(overflow) == 0
    for name in ("permission-allow", "permission-reject", "stop"):
        box = await page.get_by_test_id(name).bounding_box()
        assert box is not None
        assert min(box["width"], box["height"]) >= 44, name
    await page.get_by_test_id("permission-reject").tap()
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I did not say")


async def test_the_scene_shows_the_map_and_the_robot_moving_on_it(up: Running, open_page: Opener) -> None:
    page = await open_page(login(up, "Sue", Role.SUPERVISOR))
    await ready(page)
    await page.get_by_test_id("camera").click()  # its picture lies over the map and changes, too
    await expect(page.get_by_test_id("camera-view")).to_have_count(0)
    canvas = page.frame_locator("iframe").locator("canvas").first
    await expect(canvas).to_be_visible()

    async def picture() -> Image.Image:
        return Image.open(io.BytesIO(await canvas.screenshot())).convert("RGB")

    async def drawn() -> bool:
        return len((await picture()).getcolors(maxcolors=2**24) or []) > 200

    await until(drawn, "the map to be drawn")
    before = await picture()
    await ask(page, "go to lab 2.3.4")
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I am at lab 2.3.4", timeout=90_000)

    async def changed() -> bool:
        difference = ImageChops.difference(before, await picture()).convert("L")
        return sum(difference.histogram()[40:]) > 200

    await until(changed, "the robot to be drawn elsewhere")


async def test_a_stray_enter_approves_nothing(up: Running, open_plain: Opener) -> None:
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await ready(page)
    await screens.new_session(page)
    async with up.robot.watched() as watched:
        await ask(page, "say hello")
        await expect(page.get_by_test_id("permission-reject")).to_be_focused()

        async def refused() -> bool:
            """In the first moment a key was meant for something else, and counts for nothing."""
            await page.keyboard.press("Enter")
            return await page.get_by_test_id("permission").count() == 0

        await until(refused, "the refusal")
        await expect(page.get_by_test_id("agent-message").last).to_contain_text("I did not say")
        assert watched.spoken == []


async def test_a_robot_server_that_is_gone_is_told_and_the_page_recovers(tmp_path: Path, open_plain: Opener) -> None:
    robot = Robot(tmp_path)
    with robot.running("agent", port=robot.agent_port), robot.running("bridge", port=robot.bridge_port):
        page = await open_plain(f"http://127.0.0.1:{robot.bridge_port}/#token={robot.token('Sue', Role.SUPERVISOR)}")
        await expect(page.get_by_test_id("robot-state")).to_contain_text("not reachable")
        await ask(page, "where are you?")
        await expect(page.get_by_test_id("agent-message").last).to_contain_text("Start it with robot-acp robot")
        with robot.running("robot", port=robot.robot_port):
            await ready(page)
            await ask(page, "where are you?")
            await expect(page.get_by_test_id("agent-message").last).to_contain_text("I am at x")
