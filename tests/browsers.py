"""The browsers of the tests: which there are, and how they are started. `pytest PATH` alone finds them."""

from __future__ import annotations

import os
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Literal

from playwright.async_api import Browser, async_playwright

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
FLAGS = (
    "--no-sandbox",
    # Pages are painted by the processor, without a detour through a simulated graphics chip; only what draws in three
    # dimensions, the scene, has one. The same tests take a third of the time of Chromium that they took with one.
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
)


def chromium() -> str | None:
    """The program: the one that ROBOT_ACP_TEST_CHROMIUM names, else the machine's; None for Playwright's own."""
    named = os.environ.get("ROBOT_ACP_TEST_CHROMIUM")
    return named or next((found for name in NAMES if (found := shutil.which(name))), None)


@asynccontextmanager
async def running_chromium() -> AsyncIterator[Browser]:
    """A Chromium that runs while the context lasts."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        try:
            yield browser
        finally:
            await browser.close()


Other = Literal["firefox", "webkit"]


@asynccontextmanager
async def running_other(name: Other) -> AsyncIterator[Browser | None]:
    """Playwright's own Firefox or WebKit; None where it is not installed. It cannot drive those of a system: it speaks
    a protocol to them that only its own builds have."""
    async with async_playwright() as playwright:
        kind = getattr(playwright, name)
        if not os.path.exists(kind.executable_path):  # noqa: ASYNC240 - nothing else runs yet
            yield None
            return
        browser = await kind.launch()
        try:
            yield browser
        finally:
            await browser.close()
