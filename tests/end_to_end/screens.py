"""Brings the states of the screens about, as people do: for tests of how they look, and for pictures of them.

Every function works on a page in any language and leaves the window's size as it found it. Nothing here judges.
"""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

from playwright.async_api import Page, expect

from tests.end_to_end.accessible import WIDE
from tests.end_to_end.test_papers_session import ask

ARRIVES_MS = 90_000


@contextlib.asynccontextmanager
async def wide(page: Page) -> AsyncIterator[None]:
    """Everything of the dashboard is on the screen, whatever its size was."""
    before = page.viewport_size
    await page.set_viewport_size(WIDE)
    await expect(page.locator("[data-layout=wide]")).to_have_count(1)
    yield
    if before is not None and before != WIDE:
        await page.set_viewport_size(before)
        await expect(page.locator("[data-layout=wide]")).to_have_count(0)


async def online(page: Page) -> None:
    """Somebody may write: the session is open."""
    await expect(page.get_by_test_id("composer")).to_be_enabled()
    await expect(page.locator("#composer-hint")).not_to_have_attribute("data-reason", "opening")
    await expect(page.get_by_test_id("conversation")).to_have_attribute("aria-busy", "false")
    await expect(page.get_by_test_id("robot-state")).not_to_have_attribute("data-state", "unknown")


async def new_session(page: Page) -> None:
    """An empty session, for whoever may have one."""
    async with wide(page):
        await online(page)
        await page.get_by_test_id("new-session").click()
        await expect(page.get_by_test_id("user-message")).to_have_count(0)


async def idle(page: Page) -> None:
    """Whatever was asked for is over."""
    await expect(page.get_by_test_id("cancel")).to_have_count(0, timeout=ARRIVES_MS)


async def asked(page: Page, words: str = "say that the meeting is at noon") -> None:
    """A question is pending that only a person can answer."""
    await ask(page, words)
    await expect(page.get_by_test_id("permission-allow")).to_be_enabled(timeout=ARRIVES_MS)


async def allowed(page: Page) -> None:
    """The pending question is answered with yes, and what follows is over."""
    await page.get_by_test_id("permission-allow").click()
    await idle(page)


async def refused(page: Page) -> None:
    await page.get_by_test_id("permission-reject").click()
    await idle(page)


async def talked(page: Page) -> None:
    """A conversation with a plan, a drive, a picture and a sentence that somebody allowed."""
    await new_session(page)
    await asked(page, "go to reception, then take a photo, then say that the meeting is at noon")
    await allowed(page)
    await expect(page.get_by_test_id("tool-card").get_by_role("img").first).to_be_visible()


async def driving(page: Page, place: str = "lab 2.3.9") -> None:
    """The robot is under way and has some way to go."""
    await ask(page, f"go to {place}")
    await expect(page.get_by_test_id("robot-state")).to_have_attribute("data-state", "driving")
    await expect(page.get_by_test_id("tool-card").last.get_by_role("progressbar")).to_be_visible()


async def cancelled(page: Page) -> None:
    await page.get_by_test_id("cancel").click()
    await idle(page)


async def stopped(page: Page) -> None:
    """Somebody pressed Stop; it holds."""
    await page.get_by_test_id("stop").click()
    await expect(page.locator("[data-testid=stop-band], [data-testid=kiosk-stopped]")).to_be_visible()


async def released(page: Page) -> None:
    """A supervisor lets the robot go again."""
    await page.get_by_test_id("release").click()
    await page.get_by_test_id("release-confirm").click()
    await expect(page.get_by_test_id("stop-band")).to_have_count(0)


async def view(page: Page, at: int) -> None:
    """One of a phone's views, by its place in the bar; on a larger screen all are there."""
    tabs = page.locator(".tabs").get_by_role("button")
    if await tabs.count() > 0:
        await tabs.nth(at).click()
        await expect(tabs.nth(at)).to_have_attribute("aria-current", "page")


async def talking(page: Page) -> None:
    """The conversation is in sight."""
    await view(page, 0)


async def on_the_map(page: Page) -> None:
    """The map is in sight."""
    await view(page, 1)


async def log_open(page: Page) -> None:
    """The log of the session is in sight, with what is in it."""
    await view(page, 2)
    fold = page.get_by_test_id("activity-fold")
    if await fold.count() > 0 and await fold.get_attribute("aria-expanded") == "false":
        await fold.click()
    await page.get_by_test_id("log-tab").click()
    await expect(page.get_by_test_id("log-row").first).to_be_visible()


async def log_shut(page: Page) -> None:
    """The panel shows the turn again, and a phone the conversation."""
    await page.get_by_role("tab").first.click()
    await talking(page)
