"""`robot-acp up` as a person starts it, and Chromium pages on it."""

from __future__ import annotations

import contextlib
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
import pytest_asyncio
from playwright.async_api import Browser, BrowserContext, Page, expect

from backend.identity import Role
from tests.browsers import running_chromium
from tests.processes import STARTS_S, Robot, end, listens, wait_until

PATIENCE_MS = 30_000
EMPTY_MAP = "<!doctype html><html lang=en><title>map</title>"
expect.set_options(timeout=PATIENCE_MS)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """These tests share one browser, and with it its event loop."""
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents and pytest_asyncio.is_async_test(item):
            item.add_marker(pytest.mark.asyncio(loop_scope="session"), append=False)


@dataclass
class Running:
    """A robot at work, and the token of a supervisor."""

    robot: Robot
    token: str

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.robot.bridge_port}"

    @property
    def login_url(self) -> str:
        return f"{self.base}/#token={self.token}"


@dataclass
class Up(Running):
    """A running `robot-acp up`: its process, and what it printed."""

    process: subprocess.Popen[str]
    printed: list[str] = field(default_factory=list)

    @property
    def printed_url(self) -> str:
        """The address with the one-time code, once it has been printed."""
        found = re.search(r"http://\S+/#token=\S+", "".join(self.printed))
        return found[0] if found else ""


def start(robot: Robot, *arguments: str) -> Up:
    process = robot.start("up", *arguments, stdout=subprocess.PIPE)
    up = Up(robot, "", process)
    assert process.stdout is not None
    threading.Thread(target=lambda: up.printed.extend(process.stdout or ()), daemon=True).start()
    try:
        url = wait_until(lambda: up.printed_url, "the address of the dashboard", STARTS_S)
        assert url.startswith(f"{up.base}/#token=")
        up.token = robot.token("supervisor", Role.SUPERVISOR)
        # On a busy machine a ROS robot may take longer than `up` waits before it says what is missing.
        wait_until(lambda: listens(robot.robot_port), "the robot server", STARTS_S)
        wait_until(lambda: listens(robot.agent_port), "the agent", STARTS_S)
    except BaseException:
        end(process, signal.SIGINT)  # nobody else knows of it yet
        raise
    return up


@contextlib.contextmanager
def at_work(robot: Robot, *arguments: str) -> Iterator[Running]:
    """The three processes of a robot, without `up`: for all that is not about starting them."""
    with robot.at_work(*arguments):
        yield Running(robot, robot.token("supervisor", Role.SUPERVISOR))


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The three processes at the robot's real speed."""
    with at_work(Robot(tmp_path_factory.mktemp("data"))) as running:
        yield running


@pytest_asyncio.fixture(loop_scope="session", scope="session")
async def browser() -> AsyncIterator[Browser]:
    """One Chromium for the whole run: a launch costs more than a second of the processor."""
    async with running_chromium() as browser:
        yield browser


Opener = Callable[..., Awaitable[Page]]


@pytest_asyncio.fixture(loop_scope="session")
async def open_page(browser: Browser) -> AsyncIterator[Opener]:
    """Opens a page of its own person: every call has cookies of its own. Errors on the page fail the test."""
    errors: list[str] = []

    async def opened(url: str, **options: Any) -> Page:
        context = await browser.new_context(viewport=options.pop("viewport", {"width": 1440, "height": 900}), **options)
        opened_contexts.append(context)
        page = await context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.goto(url)
        return page

    opened_contexts: list[BrowserContext] = []
    yield opened
    for context in opened_contexts:
        await context.close()
    assert errors == []


@pytest_asyncio.fixture(loop_scope="session")
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
