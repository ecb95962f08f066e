"""axe-core on every screen and state of the dashboard, in every size, light and dark; test_kiosk.py has the kiosk's.

The states are brought about by what causes them in life: people, the network, and processes that end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Locator, Page, expect

from backend import tokens
from backend.identity import Role
from tests.end_to_end import screens
from tests.end_to_end.accessible import PHONE, TABLET, WIDE, accessible, everywhere
from tests.end_to_end.conftest import Opener
from tests.end_to_end.cut import cable_to
from tests.end_to_end.stage import Stage
from tests.end_to_end.test_papers_session import ask

SPANISH = {"locale": "es-ES"}
"""The longer words."""


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Three processes at the robot's real speed: a drive and a question last for as long as they are looked at."""
    with Stage(tmp_path_factory.mktemp("data"), ROBOT_ACP_AGENT__PERMISSION_TIMEOUT="600") as running:
        yield running


async def open_dashboard(stage: Stage, open_plain: Opener, **options: Any) -> Page:
    """Sue's page, with the session that she was in, or the newest."""
    page = await open_plain(stage.page("Sue", Role.SUPERVISOR, base=options.pop("base", None)), **options)
    await screens.online(page)
    return page


async def test_the_login(stage: Stage, open_plain: Opener) -> None:
    page = await open_plain(stage.base)
    problem = page.get_by_test_id("login-problem")
    await expect(problem).to_be_visible()
    await everywhere(page, "no login", stop=False)
    await page.get_by_role("textbox").fill("forged")
    await page.keyboard.press("Enter")
    await expect(problem).to_have_role("alert")
    await everywhere(page, "an invalid login", PHONE, stop=False)
    async with cable_to(stage.robot.bridge_port) as cable:
        base = f"http://127.0.0.1:{cable.port}"
        page = await open_plain(stage.page("Eve", Role.OPERATOR, base=base))
        problem = page.get_by_test_id("login-problem")
        await screens.online(page)
        tokens.revoke(stage.robot.data, "Eve")
        await expect(problem).to_have_role("alert")
        await everywhere(page, "a login that has ended", PHONE, stop=False)
        await cable.cut()
        await page.goto(f"{base}/#token=any")
        await expect(page.get_by_role("textbox")).to_have_count(0)
        await everywhere(page, "nobody answers", PHONE, stop=False)


async def test_the_first_visit(stage: Stage, open_plain: Opener, tmp_path: Path) -> None:
    stage.restart("agent", ROBOT_ACP_AGENT__DATABASE=f"sqlite:///{tmp_path / 'empty.db'}")
    viewer = await open_plain(stage.page("Vic", Role.VIEWER))
    await expect(viewer.get_by_test_id("conversation").get_by_role("heading")).to_be_visible()
    await everywhere(viewer, "a viewer, and no session yet")
    page = await open_dashboard(stage, open_plain)
    await expect(page.get_by_test_id("conversation").get_by_role("listitem").first).to_be_visible()
    await everywhere(page, "an empty session")


async def test_a_conversation_with_all_that_can_be_in_it(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, **SPANISH)
    await screens.talked(page)
    await everywhere(page, "a conversation")
    folded = page.get_by_test_id("conversation").locator("button[aria-expanded=false]:not([aria-haspopup])")
    while await folded.count() > 0:
        await folded.first.click()
    await expect(page.get_by_test_id("conversation").locator("audio")).to_have_count(1)
    await everywhere(page, "a conversation, everything unfolded")
    await page.get_by_test_id("tool-card").locator("button:has(img)").click()
    await expect(page.get_by_role("dialog")).to_be_visible()
    await everywhere(page, "a large picture")


async def test_a_question_a_turn_and_its_end(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, **SPANISH)
    await screens.new_session(page)
    await screens.asked(page)
    await everywhere(page, "a question")
    await page.get_by_test_id("permission").get_by_role("checkbox").click()
    await everywhere(page, "a question, for the whole session", PHONE)
    await screens.refused(page)
    await everywhere(page, "refused", WIDE)
    await screens.driving(page)
    await everywhere(page, "driving")
    with stage.held("agent"):
        await page.get_by_test_id("cancel").click()
        await expect(page.get_by_test_id("cancel")).to_be_disabled()
        await everywhere(page, "cancelling")
    await screens.idle(page)
    await everywhere(page, "cancelled", WIDE)


async def test_stop_and_release(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, **SPANISH)
    await screens.stopped(page)
    await everywhere(page, "stopped")
    await page.get_by_test_id("release").click()
    await expect(page.get_by_role("alertdialog")).to_be_visible()
    await everywhere(page, "shall it be released?")
    await page.keyboard.press("Escape")
    viewer = await open_plain(stage.page("Vic", Role.VIEWER))
    await expect(viewer.get_by_test_id("stop-band")).to_be_visible()
    await everywhere(viewer, "stopped, for a viewer", PHONE)
    await viewer.close()
    await screens.released(page)
    with stage.without("robot"):
        await page.get_by_test_id("stop").click()
        await expect(page.get_by_test_id("stop-failed")).to_be_visible()
        await everywhere(page, "a stop that did not get through")


async def test_what_is_cut_off(stage: Stage, open_plain: Opener) -> None:
    async with cable_to(stage.robot.bridge_port) as cable:
        page = await open_dashboard(stage, open_plain, base=f"http://127.0.0.1:{cable.port}", **SPANISH)
        with stage.without("robot"):
            await expect(page.get_by_test_id("robot-band")).to_be_visible()
            await everywhere(page, "the robot is down")
        await expect(page.get_by_test_id("robot-band")).to_have_count(0)
        with stage.held("agent"):
            await expect(page.get_by_test_id("silent-band")).to_be_visible()
            await expect(page.get_by_test_id("robot-state")).to_have_attribute("data-state", "unreachable")
            await everywhere(page, "nothing is heard of the robot", WIDE, PHONE)
        await expect(page.get_by_test_id("silent-band")).to_have_count(0)
        with stage.without("agent"):
            await expect(page.get_by_test_id("connection-band")).to_be_visible()
            await everywhere(page, "the agent is down")
        await expect(page.get_by_test_id("connection-band")).to_have_count(0)
        await cable.cut()
        await expect(page.get_by_test_id("connection-band")).to_be_visible()
        await everywhere(page, "offline")
        with stage.held("agent"):
            await cable.plug_in()
            await page.get_by_test_id("connection-band").get_by_role("button").click()
            await everywhere(page, "it connects again", WIDE, PHONE)
        await screens.online(page)


async def resized(page: Page, size: dict[str, int]) -> None:
    """The page has the layout of another device, too."""
    await page.set_viewport_size(size)
    layout = {WIDE["width"]: "wide", TABLET["width"]: "medium", PHONE["width"]: "phone"}[size["width"]]
    await expect(page.locator(".app")).to_have_attribute("data-layout", layout)


async def test_the_activity_of_a_session(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, **SPANISH)
    await screens.talked(page)
    for size in (WIDE, TABLET, PHONE):
        await resized(page, size)
        await screens.log_open(page)
        await everywhere(page, "the log", size)
        await page.get_by_test_id("log-row").first.get_by_role("button").click()
        await expect(page.get_by_test_id("log-details")).to_be_visible()
        await page.get_by_test_id("log-filter-tools").click()
        await page.get_by_test_id("activity").get_by_role("searchbox").fill("noon")
        await expect(page.get_by_test_id("log-filter-tools")).to_have_attribute("aria-pressed", "false")
        await everywhere(page, "the log, filtered, an event unfolded", size)
        await page.get_by_test_id("activity").get_by_role("searchbox").fill("nothing has these words")
        await expect(page.get_by_test_id("log-row")).to_have_count(0)
        await everywhere(page, "nothing found in the log", size)
        await page.get_by_role("tab").first.click()
        await expect(page.get_by_test_id("phases")).to_have_attribute("data-state", "measured")
        await expect(page.get_by_test_id("plot-battery")).to_be_visible()
        await everywhere(page, "timeline and plots", size)
    await screens.talking(page)
    await screens.driving(page)
    await screens.view(page, 2)
    await expect(page.get_by_test_id("phases")).to_have_attribute("data-state", "running")
    await everywhere(page, "the timeline of a turn that runs", PHONE)
    await screens.talking(page)
    await screens.cancelled(page)


async def test_people_and_taking_over(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, **SPANISH)
    await screens.new_session(page)
    ana = await stage.somebody("Ana Fernández de Córdoba")
    ben = await stage.somebody("Ben")
    turn = ana.later(ana.prompt("say that lunch is ready"))
    await expect(page.get_by_test_id("permission")).to_be_visible()  # she has the robot until somebody answers
    await expect(page.get_by_test_id("status-holder")).to_be_visible()
    waits = ben.later(ben.prompt("go to reception"))
    await page.get_by_test_id("people").click()
    await expect(page.locator("[data-holding=waits]")).to_be_visible()
    for size in (WIDE, TABLET, PHONE):
        await resized(page, size)
        await expect(page.get_by_test_id("take-over")).to_be_visible()
        await everywhere(page, "who is here", size)
    await page.get_by_test_id("take-over").click()
    await expect(page.get_by_role("alertdialog", name="¿Tomar el control de Sancho?")).to_be_visible()
    await everywhere(page, "shall it be taken over?")
    await page.keyboard.press("Escape")
    await ben.cancel()
    await ana.cancel()
    await waits
    await turn
    await ben.close()
    await ana.close()


async def test_the_map_with_camera_and_go_here(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, **SPANISH)
    await screens.new_session(page)
    camera = page.get_by_test_id("camera-picture")
    for size in (WIDE, TABLET, PHONE):
        await resized(page, size)
        await screens.on_the_map(page)
        await expect(camera).to_be_visible()
        await everywhere(page, "the camera in its corner", size)
        await page.get_by_test_id("go-here").click()
        await everywhere(page, "where to?", size)
        await page.get_by_test_id("go-here-place").select_option("lab 2.3.7")
        await expect(page.get_by_test_id("go-here-go")).to_be_enabled()
        await everywhere(page, "a place is chosen", size)
        await page.get_by_test_id("go-here-cancel").click()
        await page.get_by_test_id("camera-size").click()
        await everywhere(page, "the camera, large", size)
        await page.get_by_test_id("camera-size").click()
    with stage.without("robot"):
        await expect(camera).to_have_count(0)
        await everywhere(page, "no picture from the camera")


async def test_other_people_and_a_low_battery(stage: Stage, open_plain: Opener) -> None:
    stage.restart("robot", ROBOT_ACP_ROBOT__SIMULATOR__BATTERY="0.16")
    page = await open_dashboard(stage, open_plain, **SPANISH)
    await screens.new_session(page)
    ana = await stage.somebody("Ana Fernández de Córdoba")
    turn = ana.later(ana.prompt("go to lab 2.3.9, then go to lab 2.3.4, then go to lab 2.3.9"))
    await expect(page.get_by_test_id("status-holder")).to_be_visible()
    await ask(page, "go to reception")
    await expect(page.get_by_test_id("tool-card").last).to_have_attribute("data-status", "pending")
    await everywhere(page, "somebody else holds the robot, and there is a queue")
    viewer = await open_plain(stage.page("Vic", Role.VIEWER))
    await expect(viewer.get_by_test_id("robot-state")).to_be_visible()  # the login has been taken
    await viewer.goto(f"{stage.base}/#/s/{ana.session}")
    await expect(viewer.get_by_test_id("tool-card").first).to_be_visible()
    await expect(viewer.get_by_test_id("status-battery")).to_have_attribute("data-tone", "danger")
    await everywhere(viewer, "read-only, with a low battery")
    await expect(page.get_by_test_id("battery-band")).to_be_visible()
    await everywhere(page, "the battery is low")
    await ana.cancel()
    await turn
    await ana.close()
    await screens.idle(page)
    stage.restart("robot")


async def opened(page: Page, trigger: Locator, what: str) -> None:
    """What a button opens is open, is looked at light and dark, and goes away with Escape."""
    name = f"{what} {await trigger.get_attribute('aria-label')}"
    popups = page.locator("[role=menu], [role=dialog]")
    before = await popups.count()
    await trigger.click()
    await expect(popups).to_have_count(before + 1)
    size = page.viewport_size
    assert size is not None
    await everywhere(page, name, size)
    for inner in await popups.last.locator("[aria-haspopup]").all():
        await opened(page, inner, f"{name}, in it")
    await page.keyboard.press("Escape")
    await expect(popups).to_have_count(before)


async def test_menus_and_dialogs(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain)
    await screens.talked(page)
    opens = page.locator("header [aria-haspopup]:visible")
    for size, layout in ((WIDE, "wide"), (TABLET, "medium"), (PHONE, "phone")):
        await page.set_viewport_size(size)
        await expect(page.locator(".app")).to_have_attribute("data-layout", layout)
        await expect(opens.first).to_be_visible()
        for trigger in await opens.all():
            await opened(page, trigger, f"{size['width']} px:")


async def test_the_sessions(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain)
    await screens.talked(page)
    await page.set_viewport_size(TABLET)
    await page.get_by_role("button", name="sessions").click()
    drawer = page.get_by_role("dialog")
    await expect(drawer.get_by_test_id("session-item").first).to_be_visible()
    await everywhere(page, "the drawer", TABLET)
    await drawer.get_by_role("searchbox").fill("nothing has this name")
    await expect(drawer.get_by_test_id("session-item")).to_have_count(0)
    await everywhere(page, "no session found", TABLET)
    await drawer.get_by_role("searchbox").fill("Sue")
    await expect(drawer.get_by_test_id("session-item").first).to_be_visible()
    await everywhere(page, "sessions found", TABLET)
    await page.keyboard.press("Escape")
    await page.keyboard.press("Escape")
    await expect(drawer).to_have_count(0)
    await page.set_viewport_size(WIDE)
    await page.get_by_role("button", name=re.compile("^Delete")).first.click()
    await expect(page.get_by_role("alertdialog")).to_be_visible()
    await everywhere(page, "shall it be deleted?", WIDE)


async def test_the_views_of_a_phone(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, viewport=PHONE, has_touch=True, **SPANISH)
    await screens.talked(page)
    await screens.asked(page, "say that lunch is ready")
    tabs = page.get_by_role("navigation", name="Vistas").get_by_role("button")
    for tab in await tabs.all():
        await tab.tap()
        await expect(tab).to_have_attribute("aria-current", "page")
        await everywhere(page, f"the view {await tab.inner_text()}", PHONE)
        await accessible(page, f"the view {await tab.inner_text()}, for fingers", smallest=44)
    await tabs.first.tap()
    await screens.refused(page)


async def test_with_less_motion_nothing_moves_by_itself(stage: Stage, open_plain: Opener) -> None:
    page = await open_dashboard(stage, open_plain, reduced_motion="reduce")
    await screens.new_session(page)
    await screens.driving(page)
    assert await page.evaluate("document.getAnimations().length") == 0
    await page.emulate_media(reduced_motion="no-preference")
    assert await page.evaluate("document.getAnimations().length") > 0
    await screens.cancelled(page)
