"""A question cannot be missed and tells what exactly happens; and what everybody has to know stands at the top."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from backend.identity import Role
from tests.end_to_end import screens
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.test_dashboard import PHONE, login, ready, until
from tests.end_to_end.test_papers_session import ask
from tests.processes import Client, Robot

LISTEN = """
window.heard = { notifications: [], tones: 0, closed: 0 };
window.Notification = class {
  static permission = "granted";
  static requestPermission = async () => "granted";
  constructor(title, options) {
    window.heard.notifications.push([title, options.body]);
    window.latest = this;
  }
  close() { window.heard.closed++; }
};
const begin = OscillatorNode.prototype.start;
OscillatorNode.prototype.start = function (...at) { window.heard.tones++; begin.apply(this, at); };
"""
"""Records notifications, which nobody can look at in a headless browser, in place of showing them; counts the tones."""
AWAY = "document.hasFocus = () => false"
DRIVES_ASK = {"supervised": {"navigate_to_place": "ask", "navigate_to_pose": "ask"}}


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A robot that asks before it drives, has little charge left, and finds the door of one lab closed."""
    settings = {
        "ROBOT_ACP_AGENT__POLICY": json.dumps(DRIVES_ASK),
        "ROBOT_ACP_ROBOT__SIMULATOR__BATTERY": "0.12",
        "ROBOT_ACP_ROBOT__SIMULATOR__CLOSED_DOORS": '["lab-2.3.6"]',
    }
    with at_work(Robot(tmp_path_factory.mktemp("data"), settings), "--time-scale", "2") as running:
        yield running


async def supervisor(up: Running, open_plain: Opener, *, listening: bool = False, **options: object) -> Page:
    """Sue's page, in a session of its own."""
    page = await open_plain("about:blank", **options)
    if listening:
        await page.add_init_script(LISTEN)
    await page.goto(login(up, "Sue", Role.SUPERVISOR))
    await ready(page)
    if "viewport" not in options:
        await screens.new_session(page)
    return page


async def heard(page: Page, what: str) -> None:
    await until(lambda: page.evaluate(f"heard.{what}"), f"heard.{what}")


async def test_a_robot_that_stopped_by_itself_is_told_until_somebody_has_read_it(
    up: Running, open_plain: Opener, pictures: Path
) -> None:
    page = await supervisor(up, open_plain)
    await ask(page, "go to lab 2.3.6")
    await page.get_by_test_id("permission-allow").click()
    band = page.get_by_role("alert").and_(page.get_by_test_id("halted-band"))
    await expect(band).to_contain_text("Sancho stopped by itself at", timeout=90_000)
    await expect(band).to_contain_text("Something is in the way")
    await page.screenshot(path=pictures / "halted.png")
    await band.get_by_role("button", name="Hide this").click()
    await expect(band).to_have_count(0)
    phone = await supervisor(up, open_plain, viewport=PHONE)
    await expect(phone.get_by_test_id("halted-band")).to_be_visible()
    await ask(page, "turn left by 5 degrees")
    await expect(phone.get_by_test_id("halted-band")).to_have_count(0)


async def test_a_battery_that_is_low_is_told_away_from_the_dock(up: Running, open_plain: Opener) -> None:
    page = await supervisor(up, open_plain)
    staff = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}")
    await staff.new()
    await staff.prompt("go to the reception")  # at its dock it charges
    await staff.close()
    async with up.robot.watched() as watched:
        await watched.until(lambda: not watched.state.battery.charging, "the robot to be away from its dock")
        assert watched.state.battery.level <= 0.2
    band = page.get_by_role("status").and_(page.get_by_test_id("battery-band"))
    await expect(band).to_contain_text("Battery low:")
    await expect(page.get_by_test_id("alerts").locator(".band")).to_have_count(1)
    await band.get_by_role("button", name="Hide this").click()
    await expect(band).to_have_count(0)


async def test_the_way_is_shown_before_it_is_driven_and_gone_after_a_no(
    up: Running, open_plain: Opener, pictures: Path
) -> None:
    page = await supervisor(up, open_plain)
    async with up.robot.watched() as watched:
        await ask(page, "go to lab 2.3.7")
        await expect(page.get_by_test_id("permission")).to_contain_text("Drive to lab 2.3.7")
        told = re.compile(r"\d+\.\d m, about \d+ s, the way is drawn on the map")
        await expect(page.get_by_test_id("permission-preview")).to_have_text(told)
        await watched.until(lambda: watched.preview, "the way")
        assert watched.preview[-1] == pytest.approx((11.8, 4.0), abs=0.01)
        await page.screenshot(path=pictures / "question-drive.png")
        await page.get_by_test_id("permission-reject").click()
        await watched.until(lambda: not watched.preview, "the way to go")
        await expect(page.get_by_test_id("permission")).to_have_count(0)
        assert all(state.motion is None for _, state in watched.states)


async def test_nobody_is_asked_for_a_drive_into_a_wall(up: Running, open_plain: Opener) -> None:
    page = await supervisor(up, open_plain)
    await ask(page, "go to (0.05, 0.05)")
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("inside a wall")
    card = page.get_by_test_id("tool-card").filter(has_text="Drive to (0.05, 0.05)")
    await expect(card).to_contain_text("did not work")
    await expect(card).not_to_contain_text("Refused by")


async def test_a_question_calls_with_a_sound_and_a_notification_when_the_page_is_not_in_front(
    up: Running, open_plain: Opener
) -> None:
    page = await supervisor(up, open_plain, listening=True)
    await ask(page, "say hello")
    await expect(page.get_by_test_id("permission")).to_be_visible()
    await heard(page, "tones === 2")
    assert await page.evaluate("heard.notifications") == []  # the page is in front
    await page.get_by_test_id("permission-reject").click()
    await page.evaluate(AWAY)
    await ask(page, "say hello")
    await heard(page, "notifications.length === 1")
    assert await page.evaluate("heard.notifications") == [["Sancho asks", "Say aloud: “Hello.”"]]
    await page.get_by_test_id("composer").focus()
    await page.evaluate("latest.onclick()")
    await expect(page.get_by_test_id("permission-reject")).to_be_focused()
    await page.get_by_test_id("permission-sound").click()
    await page.get_by_test_id("permission-reject").click()
    await heard(page, "closed >= 1")
    await heard(page, "tones === 4")
    await ask(page, "say hello")
    await heard(page, "notifications.length === 2")
    assert await page.evaluate("heard.tones") == 4, "it was muted"
    await page.get_by_test_id("permission-reject").click()
    await page.reload()
    await page.get_by_test_id("question-settings").click()
    await expect(page.get_by_test_id("setting-sound")).not_to_be_checked()


async def test_a_question_is_answered_with_the_keyboard_alone(up: Running, open_plain: Opener) -> None:
    page = await supervisor(up, open_plain)
    async with up.robot.watched() as watched:
        await page.get_by_test_id("composer").focus()
        await page.keyboard.type("say hello")
        await page.keyboard.press("Enter")
        await expect(page.get_by_role("alertdialog", name="Sancho asks")).to_be_visible()
        await expect(page.get_by_test_id("permission-reject")).to_be_focused()
        await expect(page.get_by_test_id("permission-allow")).to_be_enabled()
        await page.keyboard.press("Tab")
        await expect(page.get_by_role("button", name="Allow", exact=True)).to_be_focused()
        await page.keyboard.press("Space")
        await watched.until(lambda: watched.spoken == ["Hello."], "the greeting")


async def test_what_is_remembered_is_said_before_and_can_be_read_afterwards(up: Running, open_plain: Opener) -> None:
    page = await supervisor(up, open_plain)
    await ask(page, "say hello")
    await expect(page.get_by_test_id("permission-rule")).to_have_text("This answer counts once.")
    await page.get_by_test_id("permission-every").click()
    await expect(page.get_by_test_id("permission-rule")).to_contain_text("“Say something aloud”")
    await page.get_by_role("button", name="Always allow").click()
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I said: “Hello.”")
    for _ in ("now", "after a reload"):
        await page.get_by_test_id("question-settings").click()
        await expect(page.get_by_test_id("remembered")).to_have_text("Say something aloud: always allowed")
        await page.reload()
        await ready(page)
    await screens.new_session(page)
    await page.get_by_test_id("question-settings").click()
    await expect(page.get_by_test_id("setting-sound")).to_be_visible()
    await expect(page.get_by_test_id("remembered")).to_have_count(0)


async def test_on_a_phone_an_answer_opens_no_keyboard(up: Running, open_plain: Opener) -> None:
    page = await supervisor(up, open_plain, viewport=PHONE, has_touch=True, is_mobile=True)
    await screens.new_session(page)
    await ask(page, "say hello")
    await expect(page.get_by_test_id("permission-reject")).to_be_focused()
    await page.get_by_test_id("permission-reject").tap()
    await expect(page.get_by_test_id("permission")).to_have_count(0)
    await expect(page.get_by_test_id("conversation")).to_be_focused()
    await screens.idle(page)


async def test_a_question_that_is_withdrawn_leaves_the_focus_where_one_goes_on(up: Running, open_plain: Opener) -> None:
    page = await supervisor(up, open_plain)
    await ask(page, "say hello")
    await expect(page.get_by_test_id("permission-reject")).to_be_focused()
    other = await open_plain(login(up, "Tom", Role.SUPERVISOR))  # who watches the session that controls the robot
    await other.get_by_test_id("permission-reject").click()
    await expect(page.get_by_test_id("permission")).to_have_count(0)
    await expect(page.get_by_test_id("composer")).to_be_focused()


async def test_what_people_approve_is_what_they_read(up: Running, open_plain: Opener, pictures: Path) -> None:
    page = await supervisor(up, open_plain)
    await ask(page, "say that the \u202etoof\u202c is at\u200b noon")
    question = page.get_by_test_id("permission")
    await expect(question).to_contain_text("‹U+202E›toof‹U+202C› is at‹U+200B› noon")
    await expect(page.get_by_test_id("user-message").last).to_contain_text("‹U+202E›toof")
    await expect(page.get_by_test_id("session-item").first).to_contain_text("‹U+202E›toof")
    assert "\u202e" not in await page.locator("body").inner_text()
    await page.screenshot(path=pictures / "question-marks.png")
    await page.set_viewport_size(PHONE)
    await page.screenshot(path=pictures / "question-marks-phone.png")
    await page.get_by_test_id("permission-reject").click()
    await screens.idle(page)
