"""The web app can be installed: the browser finds the manifest, and every icon is what the manifest says it is."""

from __future__ import annotations

import io
import json
from pathlib import Path
from urllib.parse import urljoin

import pytest_asyncio
from PIL import Image
from playwright.async_api import Page

from tests.end_to_end.conftest import Opener
from tests.processes import Robot


@pytest_asyncio.fixture(loop_scope="session")
async def page(tmp_path: Path, open_page: Opener):
    """The page as somebody without a login finds it, behind a bridge that is all alone."""
    robot = Robot(tmp_path)
    with robot.running("bridge", port=robot.bridge_port):
        yield await open_page(f"http://127.0.0.1:{robot.bridge_port}/")


async def picture(page: Page, address: str, kind: str) -> Image.Image:
    answer = await page.request.get(urljoin(page.url, address))
    assert answer.status == 200, address
    assert answer.headers["content-type"] == kind, address
    return Image.open(io.BytesIO(await answer.body()))


async def test_the_browser_finds_nothing_wrong_with_the_manifest(page: Page) -> None:
    devtools = await page.context.new_cdp_session(page)
    read = await devtools.send("Page.getAppManifest")
    assert read["errors"] == []
    assert json.loads(read["data"])["name"] == "robot-acp"
    wrong = (await devtools.send("Page.getInstallabilityErrors"))["installabilityErrors"]
    # Every page of a test is a private window, and nothing can be installed from there.
    assert {error["errorId"] for error in wrong} <= {"in-incognito"}


async def test_the_manifest_and_each_icon_are_what_they_say(page: Page) -> None:
    answer = await page.request.get(urljoin(page.url, await page.locator("link[rel=manifest]").get_attribute("href")))
    assert answer.headers["content-type"].startswith("application/manifest+json")
    icons = json.loads(await answer.body())["icons"]
    pictures = [icon for icon in icons if icon["type"] == "image/png"]
    assert {(icon["sizes"], icon["purpose"]) for icon in pictures} == {
        (size, purpose) for size in ("192x192", "512x512") for purpose in ("any", "maskable")
    }
    for icon in pictures:
        drawn = await picture(page, icon["src"], "image/png")
        assert "{}x{}".format(*drawn.size) == icon["sizes"]
        # Where a system cuts its own shape, the ground reaches into the corners; else the sign has round ones.
        corner = drawn.convert("RGBA").getpixel((0, 0))[3]
        assert corner == (255 if icon["purpose"] == "maskable" else 0), icon["src"]


async def test_an_apple_device_finds_an_icon_too(page: Page) -> None:
    address = await page.locator("link[rel=apple-touch-icon]").get_attribute("href")
    assert (await picture(page, address or "", "image/png")).size == (180, 180)
