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

from backend.bridge.scene.viser_internals import patched_page
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
COUNT_FENCES = """
  window.fences = 0;
  const { fenceSync } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.fenceSync = function (...all) { fences += 1; return fenceSync.apply(this, all); };
"""
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
    await page.add_init_script(COUNT_FENCES)

    async with bridge_with() as bridge:
        port, origin = bridge.port, bridge.origin
        token = bridge.token(Role.VIEWER, lifetime_s=600)
        await page.context.add_cookies([{"name": "robot_acp", "value": token, "url": origin}])
        await page.goto(f"{origin}/api/health")  # any page of ours, to embed it in
        await page.set_content(
            "<body style='margin:0'><input autofocus><br>"
            f"<iframe src='{origin}/scene/' sandbox='allow-scripts' style='border:0;width:390px;height:360px'></iframe>"
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
        assert await scene.evaluate("fences") > 0, "viser's frames are timed"

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
        await wait_until(lambda: robot.subscriptions)
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


SLOW_DRAWING = """
  // A frame is drawn `cost` ms after it was begun, on the page's clock, which the test moves.
  window.cost = 0;
  Object.assign(WebGL2RenderingContext.prototype, {
    fenceSync: () => ({ begun: performance.now() }),
    deleteSync: () => undefined,
    getSyncParameter(fence) {
      return performance.now() < fence.begun + cost ? this.UNSIGNALED : this.SIGNALED;
    },
  });
"""
DRAWING = """<!doctype html><html lang="en"><head></head><body><canvas></canvas><script>
  document.querySelector("canvas").getContext("webgl2");
  window.drawn = [];
  const always = () => {
    drawn.push(performance.now());
    window.next = requestAnimationFrame(always);
  };
  always();
</script>"""
ADDRESS = "http://robot.test/scene/"
HTML = "text/html; charset=utf-8"


@pytest.fixture
async def drawing(page: Page) -> Page:
    """A page with our head that draws without end, on a clock that stands still but for `frames`."""
    await page.clock.install(time=0)
    await page.add_init_script(SLOW_DRAWING)
    await page.route(ADDRESS, lambda route: route.fulfill(content_type=HTML, body=patched_page(DRAWING)))
    await page.goto(ADDRESS)
    await page.clock.pause_at(3_600_000)
    return page


async def granted(page: Page, count: int) -> None:
    """Wait for so many frames of a page."""
    await page.evaluate(
        "count => new Promise(done => { (function go() { count-- > 0 ? requestAnimationFrame(go) : done() })() })",
        count,
    )


async def frames(drawing: Page, cost: int) -> int:
    """How many frames are drawn in ten seconds when drawing one takes `cost` ms."""
    await drawing.evaluate("ms => { cost = ms }", cost)
    await drawing.clock.run_for(10_000)  # what was slow before has been drawn
    await drawing.evaluate("drawn = []")
    await drawing.clock.run_for(10_000)
    return int(await drawing.evaluate("drawn.length"))


async def test_quick_frames_pass_as_they_come_and_slow_ones_leave_others_half_of_the_time(drawing):
    free = await frames(drawing, cost=0)
    assert free > 500
    assert await frames(drawing, cost=12) == free
    assert 15 < await frames(drawing, cost=200) <= 25
    assert 1 <= await frames(drawing, cost=4000) <= 2
    assert await frames(drawing, cost=12) == free


async def test_a_hand_on_the_map_has_every_frame_that_the_browser_grants(drawing):
    paced = await frames(drawing, cost=200)
    moving = await drawing.evaluate(
        "setInterval(() => dispatchEvent(new PointerEvent('pointermove', { buttons: 1 })), 100)"
    )
    assert await frames(drawing, cost=200) > 500
    await drawing.evaluate("moving => clearInterval(moving)", moving)
    assert await frames(drawing, cost=200) == paced


async def test_what_is_drawn_now_and_then_is_not_slow_and_what_was_cancelled_is_not_drawn(drawing):
    await drawing.evaluate(
        """() => {
          cancelAnimationFrame(next);
          cost = 12;
          drawn = [];
          window.late = [];
          setInterval(() => {
            const asked = performance.now();
            const one = requestAnimationFrame(() => {
              cancelAnimationFrame(other);
              late.push(performance.now() - asked);
            });
            const other = requestAnimationFrame(() => drawn.push("what another one cancelled"));
            cancelAnimationFrame(requestAnimationFrame(() => drawn.push("what was cancelled at once")));
          }, 1000);
        }"""
    )
    await drawing.clock.run_for(10_500)
    late = await drawing.evaluate("late")
    assert len(late) == 10
    assert max(late) < 50
    assert await drawing.evaluate("drawn") == []


@pytest.mark.parametrize(
    ("renderer", "smooth"),
    [
        ("ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero)), SwiftShader driver)", False),
        ("llvmpipe (LLVM 15.0.6, 256 bits)", False),
        ("ANGLE (Microsoft, Microsoft Basic Render Driver (0x0000008C) Direct3D11)", False),
        ("ANGLE (Intel, Mesa Intel(R) UHD Graphics 620 (KBL GT2), OpenGL 4.6)", True),
        ("Apple GPU", True),
    ],
)
async def test_only_a_graphics_chip_has_to_smooth_edges(page, renderer, smooth):
    await page.add_init_script(f"WebGL2RenderingContext.prototype.getParameter = () => {json.dumps(renderer)}")
    await page.route(ADDRESS, lambda route: route.fulfill(content_type=HTML, body=patched_page(DRAWING)))
    await page.goto(ADDRESS)
    assert (
        await page.evaluate("document.querySelector('canvas').getContext('webgl2').getContextAttributes().antialias")
        is smooth
    )


OUTER_PAGE = """<script>
  setInterval(() => {
    const frame = document.querySelector("iframe");
    const covered = !frame.checkVisibility({ visibilityProperty: true });
    const message = { type: "scene-frame", lang: document.documentElement.lang, covered };
    frame.contentWindow.postMessage(message, "*");
  }, 20);
</script>"""
"""What the dashboard tells the map in its frame."""
FRAME = f"<iframe src='{ADDRESS}' sandbox='allow-scripts'></iframe>"


async def test_a_covered_map_is_not_drawn(page, wait_until):
    around = f"<!doctype html><body>{FRAME}{OUTER_PAGE}"
    await page.route(ADDRESS, lambda route: route.fulfill(content_type=HTML, body=patched_page(DRAWING)))
    await page.route("http://robot.test/", lambda route: route.fulfill(content_type=HTML, body=around))
    await page.goto("http://robot.test/")
    scene = await (await page.wait_for_selector("iframe")).content_frame()
    await scene.wait_for_function("drawn.length > 10")
    await page.evaluate("document.body.style.visibility = 'hidden'")
    # Frames of the page around it are granted all the while; one that was granted before may still be drawn.
    await scene.wait_for_function("outerPage.covered")
    await granted(page, 5)
    before = await scene.evaluate("drawn.length")
    await granted(page, 60)
    assert await scene.evaluate("drawn.length") == before
    await page.evaluate("document.body.style.visibility = 'visible'")
    await scene.wait_for_function("before => drawn.length > before + 10", arg=before)


async def test_the_notice_speaks_the_language_of_the_page_around_it(page, wait_until):
    await page.route(ADDRESS, lambda route: route.fulfill(content_type=HTML, body=patched_page(DRAWING)))
    await page.route(
        "http://robot.test/",
        lambda route: route.fulfill(content_type=HTML, body=f"<!doctype html><html lang=es><body>{FRAME}{OUTER_PAGE}"),
    )
    await page.goto("http://robot.test/")
    scene = await (await page.wait_for_selector("iframe")).content_frame()

    async def says(words: str) -> bool:
        return words in await scene.evaluate("getComputedStyle(document.body, '::after')['content']")

    await wait_until(lambda: says("El mapa no está conectado"), SECONDS)
    await page.evaluate("document.documentElement.lang = 'en-GB'")
    await wait_until(lambda: says("The map is not connected"), SECONDS)


async def differs(page: Page, before: bytes) -> bool:
    return await page.screenshot() != before
