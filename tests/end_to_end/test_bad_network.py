"""What is between a page and the bridge answers wrongly, late or never: Stop says the truth, and the page goes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.async_api import Page, expect

from backend.identity import Role
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.proxy import Proxy, proxy_to
from tests.end_to_end.test_dashboard import ready
from tests.processes import Robot, eventually


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with at_work(Robot(tmp_path_factory.mktemp("data"))) as running:
        yield running


@pytest.fixture(autouse=True)
def released(up: Running) -> None:
    """A test that failed while the robot was stopped takes no other with it."""
    address = f"http://127.0.0.1:{up.robot.robot_port}/release"
    httpx.post(address, params={"by": "the next test"}, headers=up.robot.robot_headers).raise_for_status()


def login(up: Running, proxy: Proxy) -> str:
    return f"http://127.0.0.1:{proxy.port}/#token={up.robot.token('Sue', Role.SUPERVISOR)}"


async def stopped(page: Page) -> None:
    await page.get_by_test_id("stop").click()
    await expect(page.get_by_test_id("stop-band")).to_contain_text("Stopped by you at")


async def test_a_portal_that_answers_stop_with_a_page_is_told(up: Running, open_plain: Opener, pictures: Path) -> None:
    async with proxy_to(up.robot.bridge_port) as proxy, up.robot.watched() as watched:
        page = await open_plain(login(up, proxy))
        await ready(page)
        proxy.portal = ("/api/stop",)
        await page.get_by_test_id("stop").click()
        failed = page.get_by_test_id("stop-failed")
        await expect(failed).to_contain_text("something else answered in place of the robot's server")
        await expect(failed).to_contain_text("Use the stop button on the robot.")
        await expect(page.get_by_test_id("stop-band")).to_have_count(0)
        await page.screenshot(path=pictures / "stop-portal.png")
        assert watched.state.stop is None
        proxy.portal = ()
        await failed.get_by_role("button", name="Stop again").click()
        await expect(page.get_by_test_id("stop-band")).to_be_visible()
        await expect(failed).to_have_count(0)
        await watched.until(lambda: watched.state.stop, "the stop")


async def test_stop_waits_behind_no_request_that_is_never_answered(up: Running, open_page: Opener) -> None:
    async with proxy_to(up.robot.bridge_port) as proxy:
        proxy.kept = ("/scene",)
        page = await open_page("about:blank")
        await page.clock.install()
        await page.goto(login(up, proxy))
        await ready(page)
        await eventually(lambda: proxy.waiting, "a request for the map")
        for _ in range(12):
            await page.clock.run_for(5000)
        proxy.kept = ("/scene", "/api/health", "/api/me")
        for _ in range(4):
            await page.clock.run_for(5000)
        # Over HTTP/1.1 a browser sends six requests at a time to one server.
        await stopped(page)
        assert proxy.most_waiting <= 3


async def test_a_part_that_cannot_be_loaded_fails_alone_and_comes_back(
    up: Running, open_plain: Opener, pictures: Path
) -> None:
    async with proxy_to(up.robot.bridge_port) as proxy:
        proxy.missing = ("/assets/activity-body",)
        page = await open_plain(login(up, proxy))
        await ready(page)
        failed = page.get_by_test_id("activity").get_by_test_id("pane-failed")
        await expect(failed).to_contain_text("This part of the screen could not be loaded: Activity.")
        await page.screenshot(path=pictures / "pane-failed.png")
        await expect(page.get_by_test_id("composer")).to_be_enabled()
        proxy.missing = ()
        await failed.get_by_role("button", name="Try again").click()
        await expect(page.get_by_test_id("timeline")).to_be_visible()
        await stopped(page)


async def test_a_screen_that_cannot_be_loaded_has_a_stop_that_says_whether_it_worked(
    up: Running, open_plain: Opener, pictures: Path
) -> None:
    async with proxy_to(up.robot.bridge_port) as proxy, up.robot.watched() as watched:
        proxy.missing = ("/assets/dashboard",)
        page = await open_plain(login(up, proxy))
        await expect(page.get_by_role("heading", name="This screen could not be loaded.")).to_be_visible()
        proxy.portal = ("/api/stop",)
        await page.get_by_test_id("stop").click()
        await expect(page.get_by_test_id("stop-failed")).to_contain_text("Use the stop button on the robot.")
        await page.screenshot(path=pictures / "crash-stop-failed.png")
        await page.set_viewport_size({"width": 390, "height": 844})
        await page.screenshot(path=pictures / "crash-stop-failed-phone.png")
        proxy.portal = ()
        await page.get_by_test_id("stop").click()
        await expect(page.get_by_test_id("crash-stopped")).to_contain_text("Stopped by Sue at")
        await watched.until(lambda: watched.state.stop, "the stop")
        proxy.missing = ()
        await page.get_by_role("button", name="Load again").click()
        await expect(page.get_by_test_id("stop-band")).to_be_visible()
