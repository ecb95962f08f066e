"""The network between two screens and the bridge is cut in mid-turn, while a third screen stays connected.

What counts is what the robot did meanwhile, and that afterwards every screen shows what the log has.
"""

from __future__ import annotations

import json
import time
from collections.abc import AsyncIterator, Iterator

import pytest
import pytest_asyncio
from playwright.async_api import Page, WebSocket, expect

from backend.identity import Role
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.cut import Cable, cable_to
from tests.end_to_end.test_kiosk import PHONE, answered, doing, kiosk, open_kiosk
from tests.end_to_end.test_three_clients import Dashboard, the_log
from tests.processes import Client, Robot, eventually

CUT_S = 30.0
"""Really so long, because that is what people were promised: shorter than `agent.unattended_after`, longer than a page
waits for an answer before it takes its connection for dead, and long enough for its pauses between attempts to grow."""
WISH = "go to lab 2.3.6, take a photo, say hello and then go to lab 2.3.2 and then go to lab 2.3.9"


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The three processes at the robot's real speed, so that a turn lasts longer than the cut."""
    with at_work(Robot(tmp_path_factory.mktemp("data"))) as running:
        yield running


@pytest_asyncio.fixture(loop_scope="session")
async def cable(up: Running) -> AsyncIterator[Cable]:
    """The network of those who are cut off."""
    async with cable_to(up.robot.bridge_port) as cable:
        yield cable


class Screen(Dashboard):
    """A page, what came over its connections, and how often it has asked for a whole session."""

    def __init__(self, page: Page) -> None:
        super().__init__(page)
        self.loads = 0

    def _follow(self, wire: WebSocket) -> None:
        super()._follow(wire)
        if wire.url.endswith("/acp"):
            wire.on("framesent", self._sent)

    def _sent(self, frame: str | bytes) -> None:
        self.loads += json.loads(frame).get("method") == "session/load"

    @classmethod
    async def of_page(cls, page: Page) -> Screen:
        """Follow a page from the first frame on."""
        screen = cls(page)
        await page.reload()
        return screen


async def dashboard(up: Running, open_page: Opener, name: str, port: int) -> Screen:
    """A supervisor's dashboard, at a port of the bridge or of a cable to it."""
    url = f"http://127.0.0.1:{port}/#token={up.robot.token(name, Role.SUPERVISOR)}"
    page = await open_page(url, viewport=PHONE)  # which draws no map before it is looked at
    await ready(page)
    return await Screen.of_page(page)


async def ready(page: Page) -> None:
    await expect(page.get_by_test_id("robot-state")).to_contain_text("ready")


async def shows(screen: Screen, session: str) -> None:
    """Have a dashboard show a session."""
    await screen.page.evaluate("session => { location.hash = `/s/${session}` }", session)
    await eventually(lambda: screen.shows(session), "the session on the dashboard")


async def newest_session(up: Running) -> str:
    client = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}", answer=None)
    listed = (await client.link.request("session/list", {}))["sessions"]
    await client.close()
    return str(listed[0]["sessionId"])


async def offline(visitor: Screen, far: Screen) -> None:
    await doing(visitor.page, "offline")
    await expect(far.page.get_by_test_id("connection-band")).to_be_visible()


async def test_after_a_cut_of_30_s_in_mid_turn_every_screen_is_complete(
    up: Running, open_page: Opener, cable: Cable
) -> None:
    near = await dashboard(up, open_page, "Sue", up.robot.bridge_port)
    far = await dashboard(up, open_page, "Fay", cable.port)
    visitor = await Screen.of_page(await open_kiosk(open_page, kiosk(up, base=f"http://127.0.0.1:{cable.port}")))
    async with up.robot.watched() as watched:
        await visitor.page.get_by_test_id("kiosk-field").fill(WISH)
        await visitor.page.get_by_test_id("kiosk-send").tap()
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
        session = await newest_session(up)
        for screen in (near, far):
            await shows(screen, session)

        loads = [screen.loads for screen in (near, far, visitor)]
        cut_at = time.monotonic()
        await cable.cut()
        await offline(visitor, far)
        # Somebody who may operate the robot is still there, so it goes on: it asks her, and she decides.
        await near.page.get_by_test_id("permission-allow").click()
        await watched.until(lambda: watched.spoken == ["Hello."], "the word that was allowed")
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive on")
        await eventually(lambda: time.monotonic() - cut_at >= CUT_S, "the end of the cut", CUT_S + 1)
        await offline(visitor, far)
        await watched.until(lambda: watched.state.motion, "the robot to drive: the turn is to outlast the cut")
        await cable.plug_in()

        await expect(far.page.get_by_test_id("connection-band")).to_have_count(0)
        await answered(visitor.page, "I am at lab 2.3.9")
        await watched.until(lambda: watched.distance_to(21.0, 4.0) < 0.3, "the robot to be there")
        assert watched.spoken == ["Hello."]
        assert all(state.stop is None for _, state in watched.states)

    log = await the_log(up, session)
    assert [number for number, _ in log] == list(range(1, len(log) + 1))
    # Whoever stayed heard it live after what was there already; whoever came back heard the rest. Nobody saw anything
    # twice, and the visitor's own words come back to the others alone.
    mine = [event for event in log if event[1]["sessionUpdate"] == "user_message_chunk"]
    assert len(mine) == 1
    for screen, whole in ((near, log), (far, log), (visitor, [event for event in log if event not in mine])):
        await eventually(lambda here=screen, all=whole: here.events(session) == all, "all of the log, in its order")
    assert [screen.loads for screen in (near, far, visitor)] == loads
    seen = await conversation(far.page)
    await expect(near.page.get_by_test_id("conversation")).to_have_text(seen, use_inner_text=True)
    far.heard.clear()
    await far.page.reload()
    await eventually(lambda: far.events(session) == log, "the session after a reload")
    await expect(far.page.get_by_test_id("conversation")).to_have_text(seen, use_inner_text=True)


async def conversation(page: Page) -> str:
    """What a dashboard's conversation says, once its turn is over."""
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I am at lab 2.3.9")
    await expect(page.get_by_test_id("cancel")).to_have_count(0)
    return await page.get_by_test_id("conversation").inner_text()


async def test_a_stop_that_somebody_pressed_during_the_cut_is_shown_after_it(
    up: Running, open_page: Opener, cable: Cable
) -> None:
    near = await dashboard(up, open_page, "Sue", up.robot.bridge_port)
    far = await dashboard(up, open_page, "Fay", cable.port)
    visitor = await Screen.of_page(await open_kiosk(open_page, kiosk(up, base=f"http://127.0.0.1:{cable.port}")))
    async with up.robot.watched() as watched:
        await visitor.page.get_by_test_id("kiosk-field").fill("go to the reception")
        await visitor.page.get_by_test_id("kiosk-send").tap()
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
        await cable.cut()
        await offline(visitor, far)
        await near.page.get_by_test_id("stop").click()
        await watched.until(lambda: watched.speed == 0 and watched.state.stop, "the stop")
        await expect(far.page.get_by_test_id("stop-band")).to_have_count(0)
        await cable.plug_in()
        await expect(far.page.get_by_test_id("stop-band")).to_contain_text("Stopped by Sue at")
        await expect(visitor.page.get_by_test_id("kiosk-stopped")).to_contain_text("Sancho is stopped.")
        await answered(visitor.page, "Stopped by Sue")
        standing = watched.state.pose
        await near.page.get_by_test_id("release").click()
        await near.page.get_by_test_id("release-confirm").click()
        await expect(far.page.get_by_test_id("stop-band")).to_have_count(0)
        await expect(visitor.page.get_by_test_id("kiosk-stopped")).to_have_count(0)
        await watched.until(lambda: watched.state.stop is None, "the release")
        assert watched.state.pose == standing, "a release must not start any motion again"
