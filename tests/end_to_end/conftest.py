"""`robot-acp up` as a person starts it, and Chromium pages on it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Browser, Page, async_playwright, expect

from tests.processes import STARTS_S, Robot, end, listens, wait_until

CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
]
PATIENCE_MS = 30_000
EMPTY_MAP = "<!doctype html><html lang=en><title>map</title>"
expect.set_options(timeout=PATIENCE_MS)


@dataclass
class Up:
    """A running `robot-acp up`: its process, its addresses, and what it printed."""

    robot: Robot
    process: subprocess.Popen[str]
    printed: list[str] = field(default_factory=list)

    @property
    def login_url(self) -> str:
        """The address with the token, once it has been printed."""
        found = re.search(r"http://\S+/#token=\S+", "".join(self.printed))
        return found[0] if found else ""

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.robot.bridge_port}"


def start(robot: Robot, *arguments: str) -> Up:
    process = robot.spawn("up", *arguments, stdout=subprocess.PIPE)
    up = Up(robot, process)
    assert process.stdout is not None
    threading.Thread(target=lambda: up.printed.extend(process.stdout or ()), daemon=True).start()
    try:
        wait_until(lambda: up.login_url, "the address of the dashboard", STARTS_S)
        # On a busy machine a ROS robot may take longer than `up` waits before it says what is missing.
        wait_until(lambda: listens(robot.robot_port), "the robot server", STARTS_S)
        wait_until(lambda: listens(robot.agent_port), "the agent", STARTS_S)
    except BaseException:
        end(process, signal.SIGINT)  # nobody else knows of it yet
        raise
    return up


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Up]:
    """The three processes at the robot's real speed."""
    running = start(Robot(tmp_path_factory.mktemp("data")))
    yield running
    assert end(running.process, signal.SIGINT) == 0


@pytest.fixture
async def browser() -> AsyncIterator[Browser]:
    async with async_playwright() as playwright:
        chromium = os.environ.get("ROBOT_ACP_TEST_CHROMIUM") or None
        browser = await playwright.chromium.launch(executable_path=chromium, args=CHROMIUM_FLAGS)
        yield browser
        await browser.close()


Opener = Callable[..., Awaitable[Page]]


@pytest.fixture
async def open_page(browser: Browser) -> Opener:
    """Opens a page of its own person: every call has cookies of its own. Errors on the page fail the test."""

    async def opened(url: str, **options: Any) -> Page:
        context = await browser.new_context(viewport=options.pop("viewport", {"width": 1440, "height": 900}), **options)
        page = await context.new_page()
        page.on("pageerror", lambda error: pytest.fail(f"an error on the page: {error}"))
        await page.goto(url)
        return page

    return opened


@pytest.fixture
async def open_plain(open_page: Opener) -> Opener:
    """Opens a page with an empty map: viser's page is not ours, and drawing it takes most of a small machine."""

    async def opened(url: str, **options: Any) -> Page:
        page = await open_page("about:blank", **options)
        await page.route("**/scene/**", lambda route: route.fulfill(content_type="text/html", body=EMPTY_MAP))
        await page.goto(url)
        return page

    return opened


@pytest.fixture(scope="session")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where screenshots go: the folder that ROBOT_ACP_TEST_PICTURES names, else one that pytest keeps a while."""
    named = os.environ.get("ROBOT_ACP_TEST_PICTURES")
    folder = Path(named) if named else tmp_path_factory.mktemp("pictures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
