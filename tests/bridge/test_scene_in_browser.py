"""The scene as a browser shows it: embedded, without the focus, under our content security policy."""

from __future__ import annotations

import io
import shutil
from collections.abc import AsyncIterator

import numpy as np
import pytest
from PIL import Image
from playwright.async_api import ConsoleMessage, Page, async_playwright

from backend.identity import Role

ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
SECONDS = 30.0
"""A software renderer takes its time."""


@pytest.fixture
async def page() -> AsyncIterator[Page]:
    """A page in the distribution's Chromium, else in Playwright's own."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        context = await browser.new_context(viewport={"width": 390, "height": 400})
        yield await context.new_page()
        await browser.close()


async def test_the_embedded_scene_is_a_picture_that_says_when_it_stands_still_and_comes_back(
    bridge_with, page, wait_until
):
    complaints: list[str] = []

    def hear(said: ConsoleMessage) -> None:
        if said.type == "error" and "/scene" in said.location["url"]:
            complaints.append(said.text)

    page.on("console", hear)
    page.on("pageerror", lambda error: complaints.append(str(error)))

    async with bridge_with() as bridge:
        port, origin = bridge.port, bridge.origin
        token = bridge.token(Role.VIEWER, lifetime_s=600)
        await page.context.add_cookies([{"name": "robot_acp", "value": token, "url": origin}])
        await page.goto(f"{origin}/api/health")  # any page of ours, to embed it in
        await page.set_content(
            "<body style='margin:0'><input autofocus><br>"
            f"<iframe src='{origin}/scene/' style='border:0;width:390px;height:360px'></iframe>"
        )
        scene = await (await page.wait_for_selector("iframe")).content_frame()

        async def connected() -> bool:
            return await scene.locator(".tabler-icon-cloud-check").count() == 1

        async def notice() -> bool:
            shown = await scene.evaluate("getComputedStyle(document.body, '::after')['content']")
            return "not connected" in shown

        async def drawn() -> bool:
            picture = Image.open(io.BytesIO(await page.screenshot())).convert("RGB")
            return len(np.unique(np.asarray(picture)[40:].reshape(-1, 3), axis=0)) > 20

        await wait_until(connected, SECONDS)
        await page.focus("input")
        await wait_until(drawn, SECONDS)
        assert not await notice()
        assert not await scene.locator(".mantine-Paper-root").first.is_visible()
        assert complaints == []

    await wait_until(notice, SECONDS)
    async with bridge_with(bridge={"port": port}):
        await wait_until(connected, SECONDS)
        assert not await notice()
        assert await page.evaluate("document.activeElement.tagName") == "INPUT"
