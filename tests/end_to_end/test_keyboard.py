"""The whole approval flow without a pointer, from the login to what the robot says, as a screen reader tells it."""

from __future__ import annotations

import re
from pathlib import Path

from playwright.async_api import Locator, Page, expect

from backend.identity import Role
from tests.end_to_end import screens
from tests.end_to_end.conftest import Opener
from tests.end_to_end.stage import Stage

MOST_STOPS = 60
STOP = """() => {
  const one = document.activeElement;
  if (one === null || one === document.body || one.tagName === 'IFRAME') return null;
  const shows = (element) => {
    const style = getComputedStyle(element);
    return style.outlineStyle !== 'none' || style.boxShadow !== 'none';
  };
  const box = one.getBoundingClientRect();
  const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
  return {
    html: one.outerHTML.slice(0, 120),
    visible: shows(one) || shows(one.parentElement),
    covered: top === null || !(one.contains(top) || top.contains(one)),
  };
}"""


async def tab_to(page: Page, target: Locator) -> None:
    """Press Tab until something has the focus."""
    for _ in range(MOST_STOPS):
        await page.keyboard.press("Tab")
        if await target.evaluate("element => element === document.activeElement"):
            return
    raise AssertionError(f"Tab does not lead to {target}")


async def test_from_the_login_to_what_the_robot_says(tmp_path: Path, open_plain: Opener) -> None:
    with Stage(tmp_path, ROBOT_ACP_AGENT__PERMISSION_TIMEOUT="600") as stage:
        page = await open_plain(stage.base)
        await tab_to(page, page.get_by_role("textbox", name="Link or token"))
        await page.keyboard.insert_text(stage.robot.token("Sue", Role.SUPERVISOR))
        await page.keyboard.press("Enter")
        await screens.online(page)

        await tab_to(page, page.get_by_role("link", name="Skip to the conversation"))
        address = page.url
        assert "#/s/" in address
        await page.keyboard.press("Enter")
        assert page.url == address, "it names the session"
        await expect(page.get_by_role("log", name="Conversation")).to_be_focused()
        await tab_to(page, page.get_by_role("textbox", name="Message to Sancho"))
        await page.keyboard.type("say that the meeting is at noon")
        await page.keyboard.press("Enter")

        # A dialog that takes the focus is told with its name, its text and the button that has the focus.
        question = page.get_by_test_id("permission")
        await expect(page.get_by_test_id("permission-reject")).to_be_focused()
        await expect(question).to_have_role("alertdialog")
        await expect(question).to_have_accessible_name("Sancho asks")
        await expect(question).to_have_accessible_description(re.compile("Say aloud: “The meeting is at noon.”"))
        await expect(question).to_match_aria_snapshot("""
            - alertdialog "Sancho asks":
              - heading "Sancho asks" [level=2]
              - paragraph: "Say aloud: “The meeting is at noon.”"
              - button "Don’t"
              - button "Allow"
        """)
        # In the first moment Allow is dead: Tab would pass it by.
        await expect(page.get_by_test_id("permission-allow")).to_be_enabled()
        async with stage.robot.watched() as watched:
            await tab_to(page, page.get_by_test_id("permission-allow"))
            assert (await page.evaluate(STOP))["visible"]
            await page.keyboard.press("Space")
            await watched.until(lambda: watched.spoken, "the robot to speak")
            assert watched.spoken == ["The meeting is at noon."]

        # What comes is read out, politely, and the keyboard is back where the next words are written.
        log = page.get_by_role("log", name="Conversation")
        await expect(log).to_have_attribute("aria-live", "polite")
        await expect(log).to_match_aria_snapshot("""
            - log "Conversation":
              - article:
                - paragraph: say that the meeting is at noon
              - 'article "Say aloud: “The meeting is at noon.”"':
                - paragraph: Allowed by Sue
              - article "Sancho":
                - paragraph: /I said/
        """)
        await expect(page.get_by_role("textbox", name="Message to Sancho")).to_be_focused()


async def test_every_stop_of_the_keyboard_shows_and_is_not_covered(tmp_path: Path, open_plain: Opener) -> None:
    with Stage(tmp_path, ROBOT_ACP_AGENT__PERMISSION_TIMEOUT="600") as stage:
        page = await open_plain(stage.page("Sue", Role.SUPERVISOR))
        await screens.talked(page)
        await screens.asked(page, "say that lunch is ready")
        await expect(page.get_by_test_id("permission-reject")).to_be_focused()  # a question takes the focus, once
        await page.get_by_role("link", name="Skip to the conversation").focus()
        seen = []
        while (stop := await page.evaluate(STOP)) is not None and len(seen) < MOST_STOPS:
            seen.append(stop)
            await page.keyboard.press("Tab")
        assert len(seen) > 10
        assert [stop for stop in seen if not stop["visible"] or stop["covered"]] == []
        for name in ("stop", "permission-reject", "permission-allow", "composer"):
            assert any(f'data-testid="{name}"' in stop["html"] for stop in seen), name
