"""Several people at one robot, each on a page of their own: who is here, who has the robot, whose session is whose."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from playwright.async_api import Locator, Page, expect

from backend.agent.sessions.sessions import PAGE
from backend.identity import Role
from tests.end_to_end import screens
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.processes import Client, Robot, eventually

AXE = Path(__file__).parents[2] / "web/node_modules/axe-core/axe.min.js"
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A robot that is slow, so that a drive lasts for as long as several pages on a busy machine may take."""
    slow = {"ROBOT_ACP_ROBOT__LIMITS__MAX_SPEED": "0.3"}
    with at_work(Robot(tmp_path_factory.mktemp("data"), slow)) as running:
        yield running


@pytest_asyncio.fixture(loop_scope="session")
async def terminal(up: Running) -> AsyncIterator[Callable[[str, Role], Awaitable[Client]]]:
    """Opens clients without a screen."""
    clients: list[Client] = []

    async def opened(name: str, role: Role) -> Client:
        client = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}")
        meta = {"robot-acp/token": up.robot.token(name, role)}
        await client.link.request("authenticate", {"methodId": "token", "_meta": meta})
        clients.append(client)
        return client

    yield opened
    for client in clients:
        await client.close()


def login(up: Running, name: str, role: Role) -> str:
    return f"{up.base}/#token={up.robot.token(name, role)}"


async def ask(page: Page, text: str) -> None:
    """As somebody does who has no mouse."""
    await page.get_by_test_id("composer").focus()
    await page.keyboard.type(text)
    await expect(page.get_by_test_id("send")).to_be_enabled()
    await page.keyboard.press("Enter")
    await expect(page.get_by_test_id("user-message").last).to_contain_text(text)


async def press(page: Page, button: Locator) -> None:
    """Press a button with the keyboard."""
    await button.focus()
    await page.keyboard.press("Enter")


async def violations(page: Page) -> list[Any]:
    """What axe-core finds on the page as it is, the scene's own page left out."""
    await page.evaluate(f"() => {{ if (window.axe === undefined) {{ {AXE.read_text()} }} }}")
    options = {"runOnly": {"type": "tag", "values": RULES}, "iframes": False, "resultTypes": ["violations"]}
    found = await page.evaluate("options => axe.run(document, options)", options)
    return [(rule["id"], [node["html"] for node in rule["nodes"]]) for rule in found["violations"]]


def person(page: Page, name: str) -> Locator:
    return page.get_by_test_id("person").and_(page.locator(f'[data-name="{name}"]'))


async def test_who_is_here_is_told_with_the_role_until_they_leave(
    up: Running, open_plain: Opener, terminal: Callable[[str, Role], Awaitable[Client]]
) -> None:
    sue = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await expect(sue.get_by_test_id("people")).to_have_accessible_name("1 person here")
    vic = await open_plain(login(up, "Vic", Role.VIEWER))
    await terminal("Ana", Role.OPERATOR)
    kiosk = await terminal("Kiosk", Role.VISITOR)
    await expect(sue.get_by_test_id("people")).to_have_accessible_name("4 people here")
    await press(sue, sue.get_by_test_id("people"))
    menu = sue.get_by_role("dialog", name="4 people here")
    await expect(menu).to_be_focused()
    await expect(person(sue, "Sue")).to_contain_text("(you)")
    for name, role in (("Sue", "supervisor"), ("Ana", "operator"), ("Vic", "viewer"), ("Kiosk", "visitor")):
        await expect(person(sue, name)).to_contain_text(role)
    await kiosk.new()
    await kiosk.prompt("where are you?")
    await expect(person(sue, "Kiosk")).to_contain_text("Watches a session")
    assert await violations(sue) == []
    await kiosk.close()
    await expect(person(sue, "Kiosk")).to_have_count(0)
    await terminal("Ana", Role.OPERATOR)
    await expect(person(sue, "Ana")).to_contain_text("2 devices")
    await expect(vic.get_by_test_id("robot-state")).to_contain_text("ready")
    await expect(vic.get_by_test_id("people")).to_have_count(0)
    await sue.keyboard.press("Escape")
    await expect(menu).to_have_count(0)
    await expect(sue.get_by_test_id("people")).to_be_focused()


async def test_a_supervisor_who_waits_takes_over_and_is_next(up: Running, open_plain: Opener) -> None:
    ana = await open_plain(login(up, "Ana", Role.OPERATOR))
    ben = await open_plain(login(up, "Ben", Role.OPERATOR))
    sue = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    for page in (ana, ben, sue):
        await screens.new_session(page)
    async with up.robot.watched() as watched:
        await ask(ana, "go to lab 2.3.9")
        await watched.until(lambda: watched.state.motion, "the robot to drive")
        await expect(ana.get_by_test_id("status-holder")).to_contain_text("held by you")
        await ask(ben, "turn left by 20 degrees")
        await expect(ben.get_by_test_id("robot-awaited")).to_contain_text("Waiting: Ana has Sancho")
        await expect(ben.get_by_test_id("take-over-here")).to_have_count(0)
        await ask(sue, "go to the kitchen")
        await expect(sue.get_by_test_id("robot-awaited")).to_contain_text("Waiting: Ana has Sancho")
        await press(sue, sue.get_by_test_id("take-over-here"))
        question = sue.get_by_role("alertdialog", name="Take Sancho over?")
        await expect(question).to_contain_text("Ana’s drive ends. Sancho stops, and then does what you asked for.")
        await expect(question.get_by_role("button", name="Leave it")).to_be_focused()
        assert await violations(sue) == []
        assert watched.state.motion is not None
        assert watched.state.motion.place == "lab 2.3.9"
        asked_at = len(watched.states)
        await sue.keyboard.press("Tab")
        await sue.keyboard.press("Enter")
        await watched.until(
            lambda: any(state.motion is None and state.twist.linear == 0 for _, state in watched.states[asked_at:]),
            "the robot to stand",
        )
        await watched.until(lambda: watched.state.motion and watched.state.motion.place == "kitchen", "the next drive")
        await expect(ana.get_by_test_id("taken-over")).to_contain_text("Sue took Sancho over.")
        await expect(ana.get_by_test_id("turn-note")).to_have_count(0)
        await expect(ana.get_by_test_id("cancel")).to_have_count(0)
        await expect(sue.get_by_test_id("robot-awaited")).to_have_count(0)
        await expect(sue.get_by_test_id("status-holder")).to_contain_text("held by you")
        await expect(ben.get_by_test_id("robot-awaited")).to_contain_text("Waiting: Sue has Sancho")
        await press(sue, sue.get_by_test_id("cancel"))
        await expect(ben.get_by_test_id("agent-message").last).to_contain_text("I turned left by 20°.")


async def test_a_supervisor_takes_over_from_the_menu_and_the_robot_waits(up: Running, open_plain: Opener) -> None:
    ana = await open_plain(login(up, "Ana", Role.OPERATOR))
    sue = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    ben = await open_plain(login(up, "Ben", Role.OPERATOR))
    await screens.new_session(ana)
    async with up.robot.watched() as watched:
        await ask(ana, "go to lab 2.3.9")
        await watched.until(lambda: watched.state.motion, "the robot to drive")
        await expect(ben.get_by_test_id("status-holder")).to_contain_text("held by Ana")
        await press(ben, ben.get_by_test_id("people"))
        await expect(person(ben, "Ana")).to_contain_text("has Sancho")
        await expect(ben.get_by_test_id("take-over")).to_have_count(0)
        await press(sue, sue.get_by_test_id("people"))
        await press(sue, sue.get_by_test_id("take-over"))
        question = sue.get_by_role("alertdialog")
        await expect(question).to_contain_text("Ana’s drive ends. Sancho stops and waits for you.")
        await sue.keyboard.press("Escape")
        await expect(question).to_have_count(0)
        await expect(sue.get_by_test_id("people")).to_be_focused()
        assert watched.state.motion is not None, "Escape takes nothing over"
        await sue.keyboard.press("Enter")
        await press(sue, sue.get_by_test_id("take-over"))
        await press(sue, sue.get_by_test_id("take-over-confirm"))
        await watched.until(lambda: watched.speed == 0 and watched.state.motion is None, "the robot to stand")
        await expect(ana.get_by_test_id("taken-over")).to_be_visible()
        lost = ana.get_by_role("region", name="Notices").or_(ana.locator(".toasts"))
        await expect(lost.first).to_contain_text("Sue took Sancho over. What you asked for has ended.")
        await expect(sue.get_by_test_id("status-holder")).to_have_count(0)
        assert watched.state.motion is None
        assert watched.state.stop is None


async def test_a_search_reaches_sessions_of_others_beyond_the_first_page(
    up: Running, open_plain: Opener, terminal: Callable[[str, Role], Awaitable[Client]]
) -> None:
    ana, ben = await terminal("Ana", Role.OPERATOR), await terminal("Ben", Role.OPERATOR)
    await ana.new()
    await ana.prompt("Where is the emergency exit?")
    for _ in range(PAGE):
        await ben.new()
        await ben.prompt("/where")
    sue = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    items = sue.get_by_test_id("session-item")
    await expect(items).to_have_count(PAGE)
    await expect(items.filter(has_text="emergency")).to_have_count(0)
    await sue.get_by_test_id("session-search").focus()
    await sue.keyboard.type("EXIT ana")
    await expect(items).to_have_count(1)
    await expect(items).to_contain_text("Where is the emergency exit?")
    await expect(items).to_contain_text("Ana")
    assert await violations(sue) == []
    await press(sue, items)
    await expect(sue.get_by_test_id("user-message")).to_contain_text("Where is the emergency exit?")
    await sue.get_by_test_id("session-search").focus()
    await sue.keyboard.type(" of the moon")
    await expect(sue.get_by_text("No session has “EXIT ana of the moon”")).to_be_visible()
    await sue.keyboard.press("Escape")
    await expect(sue.get_by_test_id("session-search")).to_have_value("")
    await expect(sue.get_by_test_id("session-search")).to_be_focused()
    await expect(items).to_have_count(PAGE)

    visitor = await open_plain(login(up, "Guest", Role.VISITOR))
    await visitor.get_by_test_id("session-search").fill("exit")
    await expect(visitor.get_by_text("No session has “exit”")).to_be_visible()


async def test_a_session_in_which_the_robot_works_is_marked_for_everybody(
    up: Running, open_plain: Opener, terminal: Callable[[str, Role], Awaitable[Client]]
) -> None:
    ana = await terminal("Ana", Role.OPERATOR)
    await ana.new()
    drive = ana.later(ana.prompt("go to lab 2.3.9"))
    await eventually(lambda: "progress" in str(ana.updates), "the drive")
    sue = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    item = sue.get_by_test_id("session-item").filter(has_text="go to lab 2.3.9").first
    await expect(item).to_contain_text("Ana")
    await expect(item).to_contain_text("working")
    await ana.cancel()
    assert await drive == "cancelled"
    await expect(item).not_to_contain_text("working")
