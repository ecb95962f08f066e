"""What a visitor does at the kiosk, with a member of staff at a dashboard: ask, be driven, wait, stop, go away.

What counts is what the robot did: its own telemetry says where it drove and what it said.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.async_api import Page, expect

from backend.identity import Role
from tests.end_to_end.accessible import accessible
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.cut import cable_to
from tests.end_to_end.screens import ARRIVES_MS
from tests.processes import Client, Robot

COLUMN = {"width": 1080, "height": 1920}
PHONE = {"width": 390, "height": 844}
NAME = "Kiosk, hall"

accessible = partial(accessible, smallest=64)
"""Large enough for whoever stands before it, walks past it, or is in a hurry."""


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The three processes, faster than real, and slow enough for whoever looks at a drive to find it under way."""
    with at_work(Robot(tmp_path_factory.mktemp("data")), "--time-scale", "2") as running:
        yield running


@pytest.fixture(autouse=True)
def released(up: Running) -> None:
    """A test that failed while the robot was stopped takes no other with it."""
    address = f"http://127.0.0.1:{up.robot.robot_port}/release"
    httpx.post(address, params={"by": "the next test"}, headers=up.robot.robot_headers).raise_for_status()


def kiosk(up: Running, query: str = "map=off", role: Role = Role.VISITOR, base: str | None = None) -> str:
    return f"{base or up.base}/kiosk?{query}#token={up.robot.token(NAME, role)}"


async def open_kiosk(open_page: Opener, url: str, **options: Any) -> Page:
    page = await open_page(url, viewport=options.pop("viewport", COLUMN), has_touch=True, **options)
    await expect(page.get_by_test_id("kiosk-suggestion")).to_have_count(6)
    return page


async def open_dashboard(up: Running, open_page: Opener, **options: Any) -> Page:
    """Staff have a phone in their pocket, which draws no map before it is looked at."""
    url = f"{up.base}/#token={up.robot.token('Sue', Role.SUPERVISOR)}"
    page = await open_page(url, **{"viewport": PHONE, **options})
    await expect(page.get_by_test_id("robot-state")).to_contain_text("ready")
    return page


async def wish(page: Page, words: str) -> None:
    await page.get_by_test_id("kiosk-suggestion").filter(has_text=words).tap()


async def doing(page: Page, what: str) -> None:
    await expect(page.get_by_test_id("kiosk-status")).to_have_attribute("data-doing", what)


async def answered(page: Page, words: str) -> None:
    await expect(page.get_by_test_id("kiosk-answer")).to_contain_text(words, timeout=ARRIVES_MS)
    await expect(page.get_by_test_id("kiosk-field")).to_be_visible()


async def place(up: Running, name: str) -> tuple[float, float]:
    client = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}", answer=None)
    await client.new()
    await client.prompt("/places")
    told = next(u["rawOutput"] for u in client.of("tool_call_update") if "nodes" in (u.get("rawOutput") or {}))
    where = next(node["position"] for node in told["nodes"] if node["name"] == name)
    await client.close()
    return where["x"], where["y"]


async def test_a_visitor_is_driven_to_the_kitchen_and_sees_what_the_robot_sees(up: Running, open_page: Opener) -> None:
    await open_dashboard(up, open_page)
    page = await open_kiosk(open_page, kiosk(up))
    assert "token" not in page.url
    await expect(page.get_by_role("heading", name="Hello, I am Sancho.")).to_be_visible()
    await accessible(page, "greeting")
    kitchen = await place(up, "kitchen")
    async with up.robot.watched() as watched:
        assert watched.distance_to(*kitchen) > 3
        await wish(page, "Take me to the kitchen")
        await doing(page, "driving")
        await expect(page.get_by_test_id("kiosk-status")).to_have_text("I am driving to the kitchen.")
        await expect(page.locator(".kiosk-detail")).to_contain_text("m to go, about")
        await accessible(page, "driving")
        await answered(page, "I am at the kitchen")
        assert watched.distance_to(*kitchen) < 0.3
    await wish(page, "What do you see?")
    await expect(page.get_by_test_id("kiosk-picture")).to_have_js_property("complete", True)
    await answered(page, "Here is what I see.")
    await accessible(page, "picture")


async def test_what_staff_have_to_allow_waits_and_is_said_when_they_do(up: Running, open_page: Opener) -> None:
    supervisor = await open_dashboard(up, open_page)
    page = await open_kiosk(open_page, kiosk(up))
    async with up.robot.watched() as watched:
        await wish(page, "Say hello")
        await doing(page, "permission")
        await expect(page.get_by_test_id("kiosk-status")).to_have_text(
            "A member of staff has to allow this — one moment."
        )
        await expect(page.locator("main")).to_contain_text("I would like to say: “Hello.”")
        await expect(page.get_by_test_id("permission-allow")).to_have_count(0)
        await accessible(page, "waiting")
        # Whoever may decide is asked, although the visitor's session is not the one on that screen.
        question = supervisor.get_by_test_id("permission")
        await expect(question).to_contain_text("Say aloud: “Hello.”")
        await expect(question).to_contain_text(f"asked by {NAME}")
        assert watched.spoken == []
        await supervisor.get_by_test_id("permission-allow").click()
        await answered(page, "I said: “Hello.”")
        await watched.until(lambda: watched.spoken == ["Hello."], "the greeting")

        await page.get_by_test_id("kiosk-field").fill("say that the cake is a lie")
        await page.get_by_test_id("kiosk-send").tap()
        await doing(page, "permission")
        await supervisor.get_by_test_id("permission-reject").click()
        await answered(page, "refused by Sue")
        assert watched.spoken == ["Hello."]


async def test_a_kiosk_never_answers_a_question_whoever_is_logged_in(up: Running, open_page: Opener) -> None:
    page = await open_kiosk(open_page, kiosk(up, role=Role.SUPERVISOR))
    await expect(page.locator("header")).to_contain_text(f"Logged in as {NAME}, supervisor")
    await wish(page, "Say hello")
    await doing(page, "permission")
    await expect(page.get_by_role("button", name=re.compile("allow|release", re.I))).to_have_count(0)
    supervisor = await open_dashboard(up, open_page)
    await supervisor.get_by_test_id("permission-reject").click()
    await answered(page, "refused by Sue")


async def test_stop_at_the_kiosk_holds_until_staff_release_it(up: Running, open_page: Opener) -> None:
    supervisor = await open_dashboard(up, open_page)
    page = await open_kiosk(open_page, kiosk(up))
    async with up.robot.watched() as watched:
        await page.get_by_test_id("kiosk-field").fill("go to lab 2.3.9")
        await page.keyboard.press("Enter")
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
        await page.get_by_test_id("stop").tap()
        await watched.until(lambda: watched.speed == 0 and watched.state.stop, "the stop")
        assert watched.state.stop is not None
        assert watched.state.stop.by == NAME
        stopped = page.get_by_test_id("kiosk-stopped")
        await expect(stopped).to_contain_text("Sancho is stopped. It was stopped here at")
        await expect(stopped).to_contain_text("A member of staff will release it.")
        await expect(stopped.get_by_role("button")).to_have_count(0)
        await answered(page, "Stopped by Kiosk, hall")
        await accessible(page, "stopped")
        refused = await page.request.post(f"{up.base}/api/release", headers={"Origin": up.base}, data={})
        assert refused.status == 403
        # A stop outlives the visit.
        await page.get_by_test_id("kiosk-start-over").tap()
        await expect(stopped).to_be_visible()
        await supervisor.get_by_test_id("release").click()
        await supervisor.get_by_test_id("release-confirm").click()
        await watched.until(lambda: watched.state.stop is None, "the release")
        await expect(stopped).to_have_count(0)
        assert watched.speed == 0


@pytest.mark.parametrize("who", ["nobody", "somebody else"])
async def test_a_visit_ends_with_its_login_when_that_is_given_up_on_this_device(
    up: Running, open_page: Opener, who: str
) -> None:
    staff = await open_dashboard(up, open_page)
    page = await open_kiosk(open_page, kiosk(up))
    async with up.robot.watched() as watched:
        far = ["go to lab 2.3.9", "go to lab 2.3.1"]
        await page.get_by_test_id("kiosk-field").fill(" and then ".join(far * 3))
        await page.keyboard.press("Enter")
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
        await expect(staff.get_by_test_id("people")).to_have_attribute("data-held", "true")
        # As from a dashboard in another tab.
        if who == "nobody":
            await page.request.post(f"{up.base}/api/logout", headers={"Origin": up.base})
        else:
            token = {"token": up.robot.token("Kiosk, stairs", Role.VISITOR)}
            await page.request.post(f"{up.base}/api/login", headers={"Origin": up.base}, data=token)
        await expect(page.get_by_test_id("kiosk-start-over")).to_have_count(0)
        assert "lab 2.3.9" not in await page.content()
        await expect(staff.get_by_test_id("people")).to_have_attribute("data-held", "false")
        await watched.until(lambda: watched.state.motion is None and watched.speed == 0, "the robot to halt")
        # Stop would be another thing: staff would have to release it.
        assert watched.state.stop is None


async def test_after_a_minute_untouched_nothing_of_the_visitor_is_left(up: Running, open_page: Opener) -> None:
    staff = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}", answer=None)
    page = await open_page("about:blank", viewport=COLUMN, has_touch=True)
    await page.clock.install()
    await page.goto(kiosk(up))
    await expect(page.get_by_test_id("kiosk-suggestion")).to_have_count(6)
    before = (await staff.link.request("session/list", {}))["sessions"]
    async with up.robot.watched() as watched:
        await page.get_by_test_id("language-es").tap()
        await page.get_by_test_id("kiosk-field").fill("go to lab 2.3.9 and then go to lab 2.3.4")
        await page.get_by_test_id("kiosk-send").tap()
        await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
        # Who walks with the robot touches nothing.
        await page.clock.fast_forward(120_000)
        await expect(page.get_by_test_id("kiosk-status")).to_have_attribute("data-doing", "driving")
        await page.get_by_test_id("kiosk-cancel").tap()
    await expect(page.get_by_test_id("kiosk-end")).to_have_text("De acuerdo, lo dejo.")
    # The page's clock runs on meanwhile: the times leave room for a machine that is slow.
    await page.clock.fast_forward(20_000)
    await expect(page.get_by_test_id("kiosk-still")).to_have_count(0)
    await page.clock.fast_forward(21_000)
    await expect(page.get_by_test_id("kiosk-still")).to_contain_text("¿Sigue ahí?")
    await expect(page.get_by_role("button", name="Sigo aquí")).to_be_focused()
    await page.get_by_role("button", name="Sigo aquí").tap()
    await expect(page.get_by_test_id("kiosk-still")).to_have_count(0)
    await page.get_by_test_id("kiosk-field").fill("a secret of mine")
    await page.clock.fast_forward(41_000)
    await expect(page.get_by_test_id("kiosk-still")).to_be_visible()
    await accessible(page, "still there")
    await page.clock.fast_forward(61_000)
    await expect(page.get_by_role("heading", name="Hello, I am Sancho.")).to_be_visible()
    await expect(page.get_by_test_id("kiosk-field")).to_have_value("")
    for trace in ("lab 2.3.9", "secret", "leave it", "dejo"):
        assert trace not in await page.content()
    stored = "JSON.stringify([{...localStorage}, {...sessionStorage}, location.href, history.length, history.state])"
    kept = json.loads(await page.evaluate(stored))
    assert kept[:2] == [{}, {}]
    assert kept[2] == f"{up.base}/kiosk?map=off"
    # A kiosk at rest makes no sessions: there is the one of this visit, and that is closed.
    await page.clock.fast_forward(3_600_000)
    after = (await staff.link.request("session/list", {}))["sessions"]
    assert len(after) == len(before) + 1
    await staff.close()


async def test_spanish(up: Running, open_page: Opener, pictures: Path) -> None:
    supervisor = await open_dashboard(up, open_page)
    page = await open_kiosk(open_page, kiosk(up), locale="es-ES", color_scheme="dark")
    await expect(page.get_by_role("heading", name="Hola, soy Sancho.")).to_be_visible()
    assert await page.evaluate("document.documentElement.lang") == "es"
    await accessible(page, "greeting in Spanish, dark")
    async with up.robot.watched() as watched:
        start_pose = watched.state.pose
        await wish(page, "Lléveme a: reception")
        await doing(page, "driving")
        await expect(page.get_by_test_id("kiosk-status")).to_have_text("Voy de camino a: reception.")
        await answered(page, "I am at reception.")
        assert watched.distance_to(start_pose.x, start_pose.y) > 1
    await expect(page.locator(".kiosk-asked")).to_contain_text("Lléveme a: reception")
    await wish(page, "Salude")
    await doing(page, "permission")
    await page.screenshot(path=pictures / "kiosk-waiting-es.png")
    await supervisor.get_by_test_id("permission-allow").click()
    await answered(page, "I said: “Hola.”")
    await page.get_by_test_id("language-en").tap()
    await expect(page.get_by_test_id("stop")).to_have_text("Stop")
    await page.get_by_test_id("kiosk-start-over").tap()
    await expect(page.get_by_role("heading", name="Hola, soy Sancho.")).to_be_visible()


async def test_the_dashboard_speaks_spanish_and_remembers_it(up: Running, open_page: Opener) -> None:
    page = await open_dashboard(up, open_page, viewport={"width": 1440, "height": 900})
    await page.get_by_role("button", name="You are Sue").click()
    await page.get_by_role("menuitemradio", name="Español").click()
    await expect(page.get_by_test_id("stop")).to_have_text("Parar")
    # What the agent calls by a name that the page knows, too.
    await page.get_by_test_id("select-mode").click()
    supervised = page.get_by_role("menuitemradio", name="Supervisado")
    await expect(supervised).to_contain_text("pregunta antes de hablar")
    await expect(supervised).to_have_attribute("aria-checked", "true")
    await page.keyboard.press("Escape")
    await page.set_viewport_size(PHONE)
    await page.reload()
    await expect(page.get_by_test_id("robot-state")).to_contain_text("listo")
    await page.get_by_role("button", name="Ajustes").click()
    await expect(page.get_by_role("button", name="Español")).to_have_attribute("aria-pressed", "true")
    # What the dashboard remembers is not the kiosk's language.
    await page.goto(f"{up.base}/kiosk?map=off")
    await expect(page.get_by_role("heading", name="Hello, I am Sancho.")).to_be_visible()


async def test_a_lost_connection_is_told_and_the_visit_goes_on(up: Running, open_page: Opener) -> None:
    await open_dashboard(up, open_page)
    async with cable_to(up.robot.bridge_port) as cable:
        page = await open_kiosk(open_page, kiosk(up, base=f"http://127.0.0.1:{cable.port}"), viewport=PHONE)
        await accessible(page, "greeting on a phone")
        await wish(page, "Take me to lab 2.3.1")
        await doing(page, "driving")
        await cable.cut()
        await doing(page, "offline")
        await accessible(page, "offline")
        await cable.plug_in()
        await answered(page, "I am at lab 2.3.1")
        await expect(page.locator(".kiosk-asked")).to_contain_text("Take me to lab 2.3.1")


async def test_without_a_login_the_kiosk_says_who_can_help(up: Running, open_page: Opener) -> None:
    page = await open_page(f"{up.base}/kiosk", viewport=COLUMN)
    await expect(page.get_by_role("heading", name="This screen is not set up yet")).to_be_visible()
    await expect(page.get_by_test_id("login-problem")).to_contain_text("A member of staff can set it up")
    await expect(page.get_by_test_id("kiosk-suggestion")).to_have_count(0)
    await page.get_by_role("textbox").fill(up.robot.token(NAME, Role.VIEWER))
    await page.get_by_role("button", name="Open").click()
    await expect(page.locator("main")).to_contain_text("This screen may only watch.")
    await expect(page.get_by_test_id("kiosk-field")).to_have_count(0)
    await expect(page.get_by_test_id("stop")).to_be_visible()


@pytest.mark.parametrize(("query", "there"), [("map=off", False), ("map=off&voice=on", True)])
async def test_the_microphone_is_there_only_when_the_address_says_so(
    up: Running, open_page: Opener, query: str, there: bool
) -> None:
    page = await open_kiosk(open_page, kiosk(up, query))
    assert await page.evaluate("'webkitSpeechRecognition' in window || 'SpeechRecognition' in window")
    await expect(page.get_by_test_id("kiosk-voice")).to_have_count(int(there))


MICROPHONE = """
window.recordings = [];
window.SpeechRecognition = window.webkitSpeechRecognition = class extends EventTarget {
  start() { recordings.push(this); }
  abort() { this.aborted = true; }
};
window.hear = (words) => {
  const result = Object.assign(new Event('result'), { results: [[{ transcript: words }]] });
  for (const one of recordings) one.dispatchEvent(result);
};
"""
"""Speech recognition as Chromium has it, without its server; it may still hear something after its end."""


async def test_the_microphone_ends_with_the_request_and_with_the_visitor(up: Running, open_page: Opener) -> None:
    page = await open_page("about:blank", viewport=COLUMN, has_touch=True)
    await page.add_init_script(MICROPHONE)
    await page.goto(kiosk(up, "map=off&voice=on"))
    field = page.get_by_test_id("kiosk-field")
    await page.get_by_test_id("kiosk-voice").tap()
    await page.evaluate("hear('where are you')")
    await expect(field).to_have_value("where are you")
    await page.get_by_test_id("kiosk-send").tap()
    await page.evaluate("hear('a secret')")
    await answered(page, "I am at")
    await expect(field).to_have_value("")
    await page.get_by_test_id("kiosk-voice").tap()
    await page.evaluate("hear('another secret')")
    await page.get_by_test_id("kiosk-start-over").tap()
    await page.evaluate("hear('a third secret')")
    await expect(field).to_have_value("")
    assert await page.evaluate("recordings.length === 2 && recordings.every((one) => one.aborted)")
