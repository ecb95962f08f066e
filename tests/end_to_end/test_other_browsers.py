"""The two screens in Firefox, and in WebKit as on every iPad: in a deep run, where the machine has them.

All other tests of pages use Chromium. These two look for what differs: a page that stays empty, a control that does not
answer, a connection that does not come up.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator

import pytest
import pytest_asyncio
from playwright.async_api import Browser, Page, expect

from backend.identity import Role
from tests.browsers import Other, running_other
from tests.deep import DEEP
from tests.end_to_end import screens
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.screens import ARRIVES_MS
from tests.end_to_end.test_papers_session import ask
from tests.processes import Robot

pytestmark = pytest.mark.skipif(not DEEP, reason="other browsers are tested by ./test.sh --deep")


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with at_work(Robot(tmp_path_factory.mktemp("data")), "--time-scale", "2") as running:
        yield running


@pytest_asyncio.fixture(loop_scope="session", scope="module", params=["firefox", "webkit"])
async def browser(request: pytest.FixtureRequest) -> AsyncIterator[Browser]:
    """In place of the Chromium of all other tests."""
    name: Other = request.param
    async with running_other(name) as other:
        if other is None:
            pytest.skip(f"this machine has no {name} (python -m playwright install {name})")
        yield other


async def stopped(up: Running, page: Page, band: str) -> None:
    """Press Stop in mid-drive: the robot stands, and the page says so."""
    async with up.robot.watched() as watched:
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
        await page.get_by_test_id("stop").click()
        await watched.until(lambda: watched.speed == 0, "the robot to halt")
        await expect(page.get_by_test_id(band)).to_be_visible()


async def test_a_supervisor_is_asked_and_stops_a_drive(up: Running, open_page: Opener) -> None:
    page = await open_page(f"{up.base}/#token={up.robot.token('Sue', Role.SUPERVISOR)}")
    await expect(page.get_by_test_id("robot-state")).to_contain_text("ready")
    await ask(page, "say that lunch is ready")
    await screens.allowed(page)
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I said: “Lunch is ready.”")
    await ask(page, "go to lab 2.3.9")
    await stopped(up, page, "stop-band")
    await screens.released(page)


async def test_a_visitor_is_driven_and_stops_the_robot(up: Running, open_page: Opener) -> None:
    page = await open_page(f"{up.base}/kiosk?map=off#token={up.robot.token('Kiosk', Role.VISITOR)}")
    await page.get_by_test_id("kiosk-suggestion").filter(has_text="Take me to the kitchen").click()
    await expect(page.get_by_test_id("kiosk-answer")).to_contain_text("I am at the kitchen", timeout=ARRIVES_MS)
    await page.get_by_test_id("kiosk-field").fill("go to reception")
    await page.get_by_test_id("kiosk-send").click()
    await stopped(up, page, "kiosk-stopped")
