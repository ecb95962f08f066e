"""Takes pictures of every screen, in three sizes, light and dark, in English and Spanish, with a robot of its own.

    .venv/bin/python scripts/pictures.py --out DIR                     all of them, some minutes
    .venv/bin/python scripts/pictures.py --out DIR --only '*-390-*'    some of them
    .venv/bin/python scripts/pictures.py --docs                        those of docs/, made small, into docs/images

Names are SCREEN-WIDTH-COLOURS-LANGUAGE.png. What is shown is brought about as in the end-to-end tests, in the real
processes; the web app must have been built (`./run.sh` does that). It judges nothing: look at what it made.
"""

from __future__ import annotations

import argparse
import asyncio
import fnmatch
import io
import itertools
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from playwright.async_api import Browser, Page, expect

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from backend.identity import Role  # noqa: E402
from tests.browsers import running_chromium  # noqa: E402
from tests.end_to_end import screens  # noqa: E402
from tests.end_to_end.accessible import PHONE, TABLET, WIDE  # noqa: E402
from tests.end_to_end.stage import Stage  # noqa: E402
from tests.processes import Client  # noqa: E402

SIZES = (WIDE, TABLET, PHONE)
LANGUAGES = {"en": "en-US", "es": "es-ES"}
COLOURS = ("light", "dark")
IMAGES = ROOT / "docs" / "images"
FAR = itertools.cycle(["lab 2.3.9", "lab 2.3.1"])
"""Places at both ends of the corridor: whichever is next, the robot is not there."""
LARGEST = 150_000
"""Bytes of a picture in docs/."""
DOCS = {
    "dashboard": "dashboard-driving-1440-light-en",
    "dashboard-question": "dashboard-question-1440-dark-en",
    "dashboard-stopped-es": "dashboard-stopped-1440-light-es",
    "phone-battery": "dashboard-battery-390-light-en",
    "dashboard-log": "dashboard-log-1440-light-en",
    "dashboard-people": "dashboard-people-1440-dark-en",
    "phone-go-here": "dashboard-go-here-390-light-en",
    "tablet": "dashboard-talking-820-light-en",
    "phone": "dashboard-question-390-light-en",
    "phone-map": "dashboard-map-390-dark-en",
    "kiosk": "kiosk-greeting-820-light-en",
    "kiosk-driving": "kiosk-driving-390-light-en",
    "kiosk-waiting-es": "kiosk-waiting-1440-dark-es",
}
"""What docs/ shows, by its name there."""

Step = Callable[[Page], Awaitable[None]]


async def nothing(_: Page) -> None:
    """A screen that is there by itself, or needs nothing to go away."""


async def always(_: Page) -> bool:
    """A screen that does not end by itself."""
    return True


async def is_driving(page: Page) -> bool:
    return await page.get_by_test_id("robot-state").get_attribute("data-state") == "driving"


@dataclass(frozen=True)
class Screen:
    """How a screen comes to be (again, where that ended by itself), and how it goes away."""

    name: str
    come: Step = nothing
    go: Step = nothing
    sizes: tuple[dict[str, int], ...] = SIZES
    holds: Callable[[Page], Awaitable[bool]] = always


class Dashboard:
    """The screens of a supervisor, in an order in which each begins where the one before left the robot."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._talked = False  # whether there is something to see in the conversation of this page
        self._down = False  # whether this ended the robot server
        self._low = False  # whether this robot has little charge
        self._ana: Client | None = None  # who drives the robot beside this page
        self._drives: asyncio.Task[str] | None = None

    @property
    def screens(self) -> list[Screen]:
        return [
            Screen("login", come=self._log_out, go=self._log_in),
            Screen("empty", come=screens.new_session),
            Screen("talking", come=self._talk),
            Screen("menu", come=self._menu, go=self._shut),
            Screen("sessions", come=self._drawer, go=self._shut, sizes=(TABLET,)),
            Screen("question", come=self._ask, go=screens.refused),
            Screen("driving", come=self._drive, holds=is_driving),
            Screen("map", come=self._look, go=screens.talking, sizes=(PHONE,), holds=is_driving),
            Screen("go-here", come=self._point, go=self._point_no_more),
            Screen("log", come=self._log, go=self._log_no_more),
            Screen("people", come=self._people, go=self._people_leave, holds=self._held),
            Screen("stopped", come=self._stop, go=screens.released),
            Screen("battery", come=self._drain, go=self._charge),
            Screen("robot-down", come=self._lose, go=self._find),
        ]

    async def _log_out(self, page: Page) -> None:
        await page.context.clear_cookies()
        await page.goto(self._stage.base)
        await expect(page.get_by_test_id("login-problem")).to_be_visible()

    async def _log_in(self, page: Page) -> None:
        await page.goto(self._stage.page("Sue", Role.SUPERVISOR))
        await screens.online(page)

    async def _talk(self, page: Page) -> None:
        if not self._talked:
            await screens.talked(page)
            self._talked = True

    async def _menu(self, page: Page) -> None:
        await self._talk(page)
        if await page.locator("[role=menu], [role=dialog]").count() == 0:
            await page.locator("header [aria-haspopup]:visible").last.click()

    async def _drawer(self, page: Page) -> None:
        await self._talk(page)
        if await page.get_by_role("dialog").count() == 0:
            await page.locator("header button").first.click()

    async def _shut(self, page: Page) -> None:
        await page.keyboard.press("Escape")

    async def _ask(self, page: Page) -> None:
        await self._talk(page)
        if await page.get_by_test_id("permission").count() == 0:
            await screens.asked(page)

    async def _drive(self, page: Page) -> None:
        await self._talk(page)
        if not await is_driving(page):
            await screens.idle(page)
            await screens.driving(page, next(FAR))

    async def _look(self, page: Page) -> None:
        await screens.talking(page)
        await self._drive(page)
        await screens.on_the_map(page)

    async def _point(self, page: Page) -> None:
        if await page.get_by_test_id("go-here-bar").count() == 0:
            await screens.idle(page)
            await screens.on_the_map(page)
            await page.get_by_test_id("go-here").click()
        await page.get_by_test_id("go-here-place").select_option("lab 2.3.7")

    async def _point_no_more(self, page: Page) -> None:
        await page.get_by_test_id("go-here-cancel").click()
        await screens.talking(page)

    async def _log(self, page: Page) -> None:
        await self._talk(page)
        await screens.log_open(page)

    async def _log_no_more(self, page: Page) -> None:
        await screens.log_shut(page)

    async def _people(self, page: Page) -> None:
        """Somebody else's drive goes on, and it is seen who that is and how to take over."""
        if self._ana is None:
            self._ana = await self._stage.somebody("Ana")
        if not await self._held(page):
            await screens.idle(page)
            self._drives = self._ana.later(self._ana.prompt(f"go to {next(FAR)}"))
            await expect(page.get_by_test_id("status-holder")).to_be_visible()
        if await page.get_by_test_id("people-menu").count() == 0:
            await page.get_by_test_id("people").click()
        await expect(page.get_by_test_id("take-over")).to_be_visible()

    async def _held(self, page: Page) -> bool:
        return await page.get_by_test_id("take-over").count() > 0

    async def _people_leave(self, page: Page) -> None:
        await self._shut(page)
        if self._ana is not None and self._drives is not None:
            await self._ana.cancel()
            await self._drives  # a cancel that is cut off with its connection is lost
            await self._ana.close()
            self._ana = None
        await expect(page.get_by_test_id("status-holder")).to_have_count(0)

    async def _drain(self, page: Page) -> None:
        await self._talk(page)
        if not self._low:
            self._stage.restart("robot", ROBOT_ACP_ROBOT__SIMULATOR__BATTERY="0.16")
            self._low = True
            await expect(page.get_by_test_id("robot-state")).to_have_attribute("data-state", "charging")
            await screens.driving(page, "reception")  # away from its dock
            await screens.idle(page)
        await expect(page.get_by_test_id("battery-band")).to_be_visible()

    async def _charge(self, page: Page) -> None:
        self._stage.restart("robot")
        self._low = False
        await expect(page.get_by_test_id("battery-band")).to_have_count(0)

    async def _stop(self, page: Page) -> None:
        await self._talk(page)
        if await page.get_by_test_id("stop-band").count() == 0:
            await screens.stopped(page)
            await screens.idle(page)

    async def _lose(self, page: Page) -> None:
        await self._talk(page)
        if not self._down:
            self._stage.end("robot")
            self._down = True
        await expect(page.get_by_test_id("robot-band")).to_be_visible()

    async def _find(self, page: Page) -> None:
        self._stage.start("robot")
        self._down = False
        await expect(page.get_by_test_id("robot-band")).to_have_count(0)


class Kiosk:
    """The screens of a visitor. Somebody of staff is at a dashboard, or nobody could be waited for."""

    def __init__(self, staff: Page) -> None:
        self._staff = staff

    @property
    def screens(self) -> list[Screen]:
        return [
            Screen("greeting", come=self._start_over),
            Screen("driving", come=self._drive, go=self._start_over),
            Screen("waiting", come=self._wait, go=self._start_over),
            Screen("stopped", come=self._stop, go=self._release),
        ]

    async def _start_over(self, page: Page) -> None:
        if await page.get_by_test_id("kiosk-start-over").count() > 0:
            await page.get_by_test_id("kiosk-start-over").click()
        await expect(page.get_by_test_id("kiosk-suggestion")).to_have_count(6)

    async def _wish(self, page: Page, words: Callable[[], str], doing: str) -> None:
        status = page.get_by_test_id("kiosk-status")
        if await status.count() > 0 and await status.get_attribute("data-doing") == doing:
            return
        await self._start_over(page)
        await page.get_by_test_id("kiosk-field").fill(words())
        await page.get_by_test_id("kiosk-send").click()
        await expect(status).to_have_attribute("data-doing", doing)

    async def _drive(self, page: Page) -> None:
        await self._wish(page, lambda: f"Take me to {next(FAR)}", "driving")
        await expect(page.locator(".kiosk-detail")).to_be_visible()

    async def _wait(self, page: Page) -> None:
        await self._wish(page, lambda: "Say hello", "permission")

    async def _stop(self, page: Page) -> None:
        if await page.get_by_test_id("kiosk-stopped").count() == 0:
            await screens.stopped(page)

    async def _release(self, page: Page) -> None:
        await screens.released(self._staff)
        await expect(page.get_by_test_id("kiosk-stopped")).to_have_count(0)


class Camera:
    """Takes the pictures that are wanted."""

    def __init__(self, folder: Path, patterns: list[str]) -> None:
        self._folder = folder
        self._patterns = patterns
        self.made: list[Path] = []

    def _names(self, where: str, screen: Screen, size: dict[str, int], language: str) -> dict[str, str]:
        """The wanted pictures of a screen, by their colours."""
        names = {scheme: f"{where}-{screen.name}-{size['width']}-{scheme}-{language}" for scheme in COLOURS}
        return {k: v for k, v in names.items() if any(fnmatch.fnmatch(v, pattern) for pattern in self._patterns)}

    def wants(self, where: str, all_screens: list[Screen], size: dict[str, int], language: str) -> bool:
        return any(self._names(where, one, size, language) for one in all_screens if size in one.sizes)

    async def take(
        self, page: Page, where: str, all_screens: list[Screen], size: dict[str, int], language: str
    ) -> None:
        for screen in all_screens:
            names = self._names(where, screen, size, language) if size in screen.sizes else {}
            for scheme, name in names.items():
                await page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
                self.made.append(self._folder / f"{name}.png")
                holds = False
                while not holds:  # what ended while the map was drawn is begun again
                    await screen.come(page)
                    await drawn(page)
                    await page.mouse.move(0, 0)
                    await page.screenshot(path=self.made[-1])
                    holds = await screen.holds(page)
                print(self.made[-1], flush=True)
            if names:
                await screen.go(page)


async def drawn(page: Page) -> None:
    """The map, where one is in sight, is there in the size that it has on the page; so is the camera's picture."""
    camera = page.get_by_test_id("camera-view").filter(visible=True)
    if await camera.count() > 0 and await page.get_by_test_id("robot-band").count() == 0:
        await expect(camera).to_have_attribute("data-state", "live")
    frame = page.locator("iframe:visible")
    canvas = page.frame_locator("iframe:visible").locator("canvas").first
    async with asyncio.timeout(60):
        while await frame.count() > 0:
            picture = Image.open(io.BytesIO(await canvas.screenshot())).convert("RGB")
            box = await frame.first.bounding_box()
            right = box is not None and abs(picture.width - box["width"] * await scale(page)) < 4
            if right and len(picture.getcolors(maxcolors=2**24) or []) > 200:
                return


async def scale(page: Page) -> float:
    return float(await page.evaluate("devicePixelRatio"))


@asynccontextmanager
async def opened(browser: Browser, url: str, size: dict[str, int], language: str) -> AsyncIterator[Page]:
    """A page of its own person, on a device of this size."""
    small = size != WIDE
    context = await browser.new_context(
        viewport=size, locale=LANGUAGES[language], has_touch=small, device_scale_factor=2 if size == PHONE else 1
    )
    page = await context.new_page()
    await page.goto(url)
    yield page
    await context.close()


async def take_all(stage: Stage, browser: Browser, camera: Camera) -> None:
    for language in LANGUAGES:
        for size in SIZES:
            dashboard = Dashboard(stage)
            if camera.wants("dashboard", dashboard.screens, size, language):
                async with opened(browser, stage.page("Sue", Role.SUPERVISOR), size, language) as page:
                    await screens.online(page)
                    await camera.take(page, "dashboard", dashboard.screens, size, language)
                    await screens.idle(page)
            async with opened(browser, stage.page("Sue", Role.SUPERVISOR), PHONE, "en") as staff:
                kiosk = Kiosk(staff)
                if camera.wants("kiosk", kiosk.screens, size, language):
                    url = stage.page("Kiosk, hall", Role.VISITOR, f"/kiosk?lang={language}")
                    async with opened(browser, url, size, language) as page:
                        await camera.take(page, "kiosk", kiosk.screens, size, language)


def smaller(picture: Path, target: Path) -> None:
    """The same picture with a palette, small enough for docs/."""
    full = Image.open(picture).convert("RGB")
    for colours in (256, 128, 64, 32):
        full.quantize(colours, dither=Image.Dither.NONE).save(target, optimize=True)
        if target.stat().st_size <= LARGEST:
            break
    print(f"{target}: {target.stat().st_size} bytes")


async def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder of the pictures; default: one that is thrown away")
    parser.add_argument("--only", action="append", metavar="PATTERN", help="as kiosk-*; may be given several times")
    parser.add_argument("--docs", action="store_true", help="put those that docs/ shows into docs/images")
    told = parser.parse_args()
    if told.out is None and not told.docs:
        parser.error("say where to, with --out DIR or --docs")
    patterns = told.only or (["*"] if told.out else list(DOCS.values()))
    with tempfile.TemporaryDirectory() as spare:
        folder = told.out or Path(spare)
        folder.mkdir(parents=True, exist_ok=True)
        camera = Camera(folder, patterns)
        data = Path(spare) / "data"
        with Stage(data, ROBOT_ACP_LOG_LEVEL="error") as stage:
            async with running_chromium() as browser:
                await take_all(stage, browser, camera)
        if told.docs:
            for name, picture in DOCS.items():
                if folder / f"{picture}.png" in camera.made:
                    smaller(folder / f"{picture}.png", IMAGES / f"{name}.png")
    print(f"{len(camera.made)} pictures")


if __name__ == "__main__":
    asyncio.run(main())
