"""The panel below the map, against what really happened: the agent's measure, a second client's events, the robot."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Page, expect

from backend.identity import Role
from tests.end_to_end import screens
from tests.end_to_end.conftest import Opener, Running, at_work
from tests.end_to_end.test_dashboard import login, ready, until
from tests.end_to_end.test_papers_session import ask
from tests.processes import Client, Robot

PAPERS_PROMPT = "Go to lab 2.3.7 and tell them that the meeting is at noon"
PHASES = ("thought", "inference", "navigation", "speech", "person")
SIZES = {
    "wide": {"width": 1440, "height": 900},
    "medium": {"width": 820, "height": 1180},
    "phone": {"width": 390, "height": 844},
}


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The three processes at the robot's real speed, so that a drive takes longest of all, however slow the machine."""
    with at_work(Robot(tmp_path_factory.mktemp("data"))) as running:
        yield running


async def begin(page: Page) -> None:
    """A session of its own."""
    await ready(page)
    await screens.new_session(page)


async def archive(up: Running, page: Page) -> list[dict[str, Any]]:
    """The session's events as a second client gets them over TCP, as lines of a log."""
    client = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}", answer=None)
    found = re.search(r"#/s/(\w+)", page.url)
    assert found
    await client.load(found[1])
    await client.close()
    return [
        {"seq": e["_meta"]["robot-acp/seq"], "at": e["_meta"]["robot-acp/at"], "update": e["update"]}
        for e in client.events
    ]


async def measured(page: Page) -> dict[str, float]:
    """The totals that the page shows, once they are the agent's."""
    await expect(page.get_by_test_id("phases")).to_have_attribute("data-state", "measured")
    rows = page.get_by_test_id("phases").locator("[data-seconds]")
    found: list[list[str]] = await rows.evaluate_all("all => all.map(row => [row.dataset.testid, row.dataset.seconds])")
    return {name.removeprefix("phase-"): float(seconds) for name, seconds in found}


async def rows(page: Page) -> list[int]:
    found: list[str] = await page.get_by_test_id("log-row").evaluate_all("all => all.map(row => row.dataset.seq)")
    return [int(seq) for seq in found]


async def test_the_timeline_of_the_papers_prompt_is_what_the_agent_measured(
    up: Running, open_plain: Opener, pictures: Path
) -> None:
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await begin(page)
    await ask(page, PAPERS_PROMPT)
    table = page.get_by_test_id("phases")
    await expect(table).to_have_attribute("data-state", "running")
    driving = page.get_by_test_id("phase-navigation")

    async def seconds_of_driving() -> float:
        return float(await driving.get_attribute("data-seconds") or 0)

    await expect(driving).to_be_visible()
    first = await seconds_of_driving()

    async def grown() -> bool:
        return await seconds_of_driving() > first + 0.5

    await until(grown, "the segment to grow while the robot drives")
    await page.screenshot(path=pictures / "activity-driving.png")
    await expect(page.get_by_test_id("permission")).to_be_visible(timeout=90_000)
    await expect(page.get_by_test_id("phase-person")).to_be_visible()
    await page.get_by_test_id("permission-allow").click()
    shown = await measured(page)
    events = await archive(up, page)
    told = events[-1]["update"]["_meta"]["robot-acp/phases"]
    assert shown == {name: seconds for name, seconds in told.items() if seconds > 0}
    assert set(PHASES) <= set(shown)
    assert shown["total"] == pytest.approx(sum(shown.values()) - shown["total"], abs=0.01)
    assert shown["navigation"] == max(seconds for name, seconds in shown.items() if name != "total")
    # The bar is drawn from the times of the events: another way to the same answer.
    parts: list[list[Any]] = await page.get_by_test_id("timeline-part").evaluate_all(
        "all => all.map(part => [part.dataset.phase, Number(part.style.flexGrow)])"
    )
    for phase in ("navigation", "speech", "person"):
        drawn = sum(seconds for name, seconds in parts if name == phase)
        assert drawn == pytest.approx(shown[phase], abs=0.5), phase
    assert sum(seconds for _, seconds in parts) == pytest.approx(shown["total"], abs=0.5)
    for phase in PHASES:
        await expect(page.get_by_test_id(f"phase-{phase}")).to_contain_text(re.compile(r"\d\.\d\d s"))


async def test_the_log_is_the_session_and_the_file_is_the_log(up: Running, open_plain: Opener, tmp_path: Path) -> None:
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await begin(page)
    await page.get_by_test_id("log-tab").click()
    await ask(page, "where are you?")
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I am at x")
    await ask(page, "say hello")
    await page.get_by_test_id("permission-allow").click()
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I said")
    await expect(page.locator("[data-testid=log-row][data-kind=ended]")).to_have_count(2)

    events = await archive(up, page)
    assert await rows(page) == [event["seq"] for event in events]
    # What the person here wrote is in it, although the agent does not send that back to this page.
    asked = page.locator("[data-testid=log-row][data-kind=asked]")
    await expect(asked).to_have_count(2)
    await expect(asked.last).to_contain_text("Sue: say hello")

    async def only(*kinds: str) -> list[str]:
        for name in ("talk", "thoughts", "tools", "permissions", "system"):
            button = page.get_by_test_id(f"log-filter-{name}")
            if (await button.get_attribute("aria-pressed") == "true") != (name in kinds):
                await button.click()
        found: list[str] = await page.get_by_test_id("log-row").evaluate_all("all => all.map(r => r.dataset.kind)")
        return found

    assert set(await only("talk")) == {"asked", "said"}
    assert set(await only("permissions")) == {"question", "allowed"}
    assert set(await only("thoughts")) <= {"thought", "plan"}
    assert len(await only("talk", "thoughts", "tools", "permissions", "system")) == len(events)
    await page.get_by_role("searchbox", name="Search the log").fill("allowed sue")
    await expect(page.get_by_test_id("log-row")).to_have_count(1)
    await page.get_by_test_id("log-row").get_by_role("button").click()
    await expect(page.get_by_test_id("log-details")).to_contain_text("allow_once")
    await page.get_by_role("searchbox", name="Search the log").fill("")

    async with page.expect_download() as downloading:
        await page.get_by_test_id("log-export").click()
    download = await downloading.value
    assert re.fullmatch(r"sancho-\d{4}-\d\d-\d\d-where-are-you\.jsonl", download.suggested_filename)
    await download.save_as(tmp_path / "log.jsonl")
    assert [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()] == events


async def test_the_plots_move_with_the_robot(up: Running, open_plain: Opener) -> None:
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await begin(page)
    plot = page.get_by_test_id("plot-speed")
    await expect(plot).to_contain_text("0.0 m/s")
    line = plot.locator(".plot-line")
    still = await line.get_attribute("d")
    await ask(page, "go to lab 2.3.9")

    async def moving() -> bool:
        return float(await plot.get_attribute("data-now") or 0) > 0.3

    await until(moving, "the plot to tell that the robot drives")
    await expect(plot).to_contain_text(re.compile(r"0\.0 m/s to 0\.[3-9] m/s|0\.0 m/s to 1\.\d m/s"))
    assert await line.get_attribute("d") != still
    await expect(page.get_by_test_id("plot-battery")).to_contain_text("%")
    await expect(page.get_by_test_id("plot-link")).to_contain_text("ms")
    await expect(page.get_by_test_id("agent-message").last).to_contain_text("I am at lab 2.3.9", timeout=90_000)


async def test_the_panel_is_folded_by_keyboard_and_stays_as_it_was_left(up: Running, open_plain: Opener) -> None:
    page = await open_plain(login(up, "Vic", Role.VIEWER))
    await ready(page)
    fold = page.get_by_test_id("activity-fold")
    await expect(page.get_by_test_id("timeline")).to_be_visible()
    await fold.focus()
    await page.keyboard.press("Enter")
    await expect(page.get_by_test_id("timeline")).to_have_count(0)
    await page.reload()
    await expect(fold).to_have_attribute("aria-expanded", "false")
    await fold.focus()
    await page.keyboard.press("Space")
    await expect(page.get_by_test_id("timeline")).to_be_visible()
    tabs = page.get_by_role("tablist", name="What to look at")
    await tabs.get_by_role("tab", name="Timeline").focus()
    await page.keyboard.press("ArrowRight")
    await expect(tabs.get_by_role("tab", name="Log")).to_have_attribute("aria-selected", "true")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("scheme", "language"), [("light", "en"), ("dark", "es")])
async def test_it_fits_every_screen(
    up: Running, open_plain: Opener, pictures: Path, size: str, scheme: str, language: str
) -> None:
    options = {"viewport": SIZES[size], "color_scheme": scheme, "locale": language, "has_touch": size != "wide"}
    page = await open_plain(login(up, "Sue", Role.SUPERVISOR), **options)
    await expect(page.get_by_test_id("stop")).to_be_in_viewport(ratio=1)
    if size == "phone":
        await page.get_by_role("navigation").get_by_role("button", name=re.compile("Log|Registro")).tap()
    if size == "medium":
        await page.get_by_test_id("activity-fold").tap()
    await expect(page.get_by_test_id("plot-speed")).to_contain_text("m/s")
    await page.screenshot(path=pictures / f"activity-{size}-{scheme}-{language}.png")
    await page.get_by_test_id("log-tab").click()
    await expect(page.get_by_test_id("log-row").first).to_be_visible()
    await page.screenshot(path=pictures / f"log-{size}-{scheme}-{language}.png")
    await expect(page.get_by_test_id("stop")).to_be_in_viewport(ratio=1)
    overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert await page.evaluate(overflow) == 0
