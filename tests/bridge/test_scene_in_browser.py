"""The scene as a browser shows it: embedded, without the focus, under our content security policy, in one's hand."""

from __future__ import annotations

import asyncio
import io
import json
import shutil
import uuid
from collections.abc import AsyncIterator

import numpy as np
import pytest
from PIL import Image
from playwright.async_api import ConsoleMessage, Page, async_playwright

from backend.identity import Role
from backend.telemetry import Map, Pose, Zone
from tests.bridge.scenes import state

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


HALL = Map(
    0.1, 120, 100, 0.0, 0.0, bytes(12000), [], [Zone("store", [(7.0, 6.0), (11.0, 6.0), (11.0, 9.0), (7.0, 9.0)])]
)


async def test_a_viewer_sees_a_zone_where_it_is_picks_a_point_of_it_follows_and_takes_the_camera_in_hand(
    bridge_with, robot, page, wait_until
):
    viewer = uuid.uuid4()

    async def reddish() -> np.ndarray:
        """The pixels (N, 2) of the zone: x and y in the page."""
        picture = np.asarray(Image.open(io.BytesIO(await page.screenshot())).convert("RGB")).astype(int)
        found = np.argwhere((picture[..., 0] > 200) & (picture[..., 0] - picture[..., 1] > 20))
        return found[:, ::-1] if len(found) > 500 else found[:0]

    async with bridge_with(robot={"port": robot.port}) as bridge:
        token = bridge.token(Role.OPERATOR, lifetime_s=600)
        await wait_until(lambda: robot.asked)
        await robot.send(state(pose=Pose(3.0, 3.0, 0.0)), HALL)
        await page.context.add_cookies([{"name": "robot_acp", "value": token, "url": bridge.origin}])
        async with bridge.websocket(f"/scene/{viewer}/control", token=token) as control:

            async def heard(kind: str) -> object:
                async with asyncio.timeout(SECONDS):
                    while True:
                        said = json.loads(await control.recv())
                        if kind in said:
                            return said[kind]

            assert await heard("view") == "map"
            await page.goto(f"{bridge.origin}/scene/{viewer}/")
            await control.send(json.dumps({"view": "top", "pick": True}))
            assert await heard("view") == "top"

            async def picked() -> object:
                """Where the middle of the zone is, once the page shows it from above and reports clicks."""
                pixels = await reddish()
                if not len(pixels):
                    return None
                await page.mouse.click(*(pixels.min(axis=0) + pixels.max(axis=0)) / 2)
                try:
                    async with asyncio.timeout(1.0):
                        point = await heard("picked")
                except TimeoutError:
                    return None
                return point if abs(point["x"] - 9.0) < 0.2 and abs(point["y"] - 7.5) < 0.2 else None

            assert (await wait_until(picked, SECONDS))["place"] is None

            before = await page.screenshot()
            await control.send(json.dumps({"view": "follow", "pick": False}))
            assert await heard("view") == "follow"
            await wait_until(lambda: differs(page, before), SECONDS)
            await page.mouse.move(200, 200)
            await page.mouse.down()
            await page.mouse.move(260, 220, steps=4)
            await page.mouse.up()
            assert await heard("view") == "free"


async def differs(page: Page, before: bytes) -> bool:
    return await page.screenshot() != before
