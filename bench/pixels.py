"""What Chromium paints, and when: an event at the agent to pixels, and the first load of the dashboard.

    python bench/pixels.py [-n 40] [--loads 10]

The three processes as `robot-acp up` starts them, and the dashboard: on a phone's screen without the map, wide with the
map and the camera, and the same while the robot drives for somebody else; all is drawn in software on the same cores.
A program over TCP prompts in the session that the page shows, and the next prompt comes only when the page shows
the answer to the one before, so that no event waits for another. The moment of an event is the one in the session's
log, taken before it is written; the moment of the pixels is two animation frames after the change of the page: the
second begins when the first has been painted. Both clocks are this machine's.

A first load is one without a cache, from the begin of the navigation until the robot's state is shown and the field to
write in takes words. The bytes of script are counted on the wire, without those of viser's page.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import statistics
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from playwright.async_api import Browser, Page
from shared import Robot, Up, browser, machine, report, turn_over, up

from tests.processes import Client

WIDE = {"width": 1440, "height": 900}
PHONE = {"width": 390, "height": 844}
"""A phone draws no scene until somebody looks at it, so the difference is what drawing it in software costs."""
MAP = "iframe[src^='/scene/']"
CONNECTED = ".tabler-icon-cloud-check"
SETTLING = 5.0
"""Seconds until a map that has been loaded is drawn, and all that is drawn but once."""
KINDS = {"user_message_chunk": "user-message", "tool_call": "tool-card", "agent_message_chunk": "agent-message"}
"""The events whose first appearance is a new element of the page, and the test id of that element."""

WATCH_PAINTING = """(names) => {
  const painted = [];
  const known = new WeakSet();
  const fresh = () => names.flatMap((name) =>
    [...document.querySelectorAll(`[data-testid=${name}]`)].filter((one) => !known.has(one)).map((one) => [name, one]));
  for (const [, one] of fresh()) known.add(one);
  new MutationObserver(() => {
    const came = fresh();
    if (came.length === 0) return;
    for (const [, one] of came) known.add(one);
    requestAnimationFrame(() => requestAnimationFrame(() => {
      const at = Date.now() / 1000;
      for (const [name] of came) painted.push([name, at]);
    }));
  }).observe(document.body, { childList: true, subtree: true });
  window.benchPainted = painted;
  window.benchAnswers = async (count) => {
    while (painted.filter(([name]) => name === 'agent-message').length < count) {
      await new Promise(requestAnimationFrame);
    }
  };
}"""

WATCH_LOADING = """(() => {
  if (window.top !== window) return;
  const usable = () => {
    const state = document.querySelector('[data-testid=robot-state]')?.dataset.state ?? 'unknown';
    const field = document.querySelector('[data-testid=composer]');
    return !['unknown', 'unreachable'].includes(state) && field !== null && !field.disabled;
  };
  window.benchUsable = new Promise((done) => {
    const look = () => {
      if (usable()) requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now())));
      else requestAnimationFrame(look);
    };
    look();
  });
})()"""


def logged(running: Up, session: str) -> list[dict[str, Any]]:
    """The log of a session, with the time of each event."""
    command = running.robot.command("sessions", "export", session)
    told = subprocess.run(command, env=running.robot.variables, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in told.stdout.splitlines()]


def appearances(log: list[dict[str, Any]]) -> dict[str, list[float]]:
    """When the agent made what is one element on the page: a message is its first chunk."""
    made: dict[str, list[float]] = defaultdict(list)
    before = ""
    for event in log:
        kind = event["update"]["sessionUpdate"]
        if kind in KINDS and not (kind == before == "agent_message_chunk"):
            made[KINDS[kind]].append(event["time"])
        before = kind
    return made


async def events_to_pixels(running: Up, page: Page, where: str, prompts: int) -> None:
    """Have somebody else prompt in the session that the page shows."""
    client = await Client.open(f"tcp://127.0.0.1:{running.robot.agent_port}", answer=None)
    session = await client.new()
    await page.evaluate("session => { location.hash = `/s/${session}` }", session)
    await page.get_by_test_id("conversation").get_by_text("What can").or_(page.locator(".empty")).first.wait_for()
    await page.evaluate(WATCH_PAINTING, list(KINDS.values()))
    for number in range(prompts + 1):
        await client.prompt("where are you?")
        await page.evaluate("count => benchAnswers(count)", number + 1)
        await turn_over(page)
    painted: dict[str, list[float]] = defaultdict(list)
    for name, at in await page.evaluate("window.benchPainted"):
        painted[name].append(at)
    made = appearances(logged(running, session))
    await client.close()
    everything: list[float] = []
    for name in KINDS.values():
        assert len(made[name]) == len(painted[name]), f"{name}: {len(made[name])} events, {len(painted[name])} painted"
        took = [seen - at for at, seen in zip(made[name], painted[name], strict=True)]
        took = took[len(took) // (prompts + 1) :]  # the first prompt warms up
        report(f"event to pixels, {where}, {name}", took)
        everything += took
    report(f"event to pixels, {where}, all", everything)


@contextlib.asynccontextmanager
async def driving(running: Up) -> AsyncIterator[None]:
    """Somebody else has the robot drive to and fro, in a session of their own."""
    client = await Client.open(f"tcp://127.0.0.1:{running.robot.agent_port}")
    await client.new()

    async def drive() -> None:
        while True:
            for place in ("lab 2.3.9", "lab 2.3.2"):
                await client.prompt(f"go to {place}")

    task = asyncio.create_task(drive())
    try:
        yield
    finally:
        task.cancel()
        await client.close()


async def first_load(running: Up, opened: Browser, url: str) -> tuple[float, int]:
    """Seconds until the page is of use, and bytes of script on the wire."""
    context = await opened.new_context(viewport=WIDE)
    page = await context.new_page()
    await page.add_init_script(WATCH_LOADING)
    wire = await context.new_cdp_session(page)
    scripts: set[str] = set()
    sizes: dict[str, int] = {}

    def came(answer: dict[str, Any]) -> None:
        kind, address = answer["response"]["mimeType"], answer["response"]["url"]
        if "javascript" in kind and address.startswith(running.base) and "/scene" not in address:
            scripts.add(answer["requestId"])

    wire.on("Network.responseReceived", came)
    wire.on("Network.loadingFinished", lambda end: sizes.update({end["requestId"]: end["encodedDataLength"]}))
    await wire.send("Network.enable")
    await page.goto(url, wait_until="commit")
    took = await page.evaluate("window.benchUsable") / 1000
    counted = -1
    while counted != len(scripts) or scripts - sizes.keys():  # what comes later counts too
        counted = len(scripts)
        await asyncio.sleep(1.0)
    await context.close()
    return took, sum(int(size) for request, size in sizes.items() if request in scripts)


async def measure(running: Up, prompts: int, loads: int) -> None:
    """All of it, in one Chromium."""
    async with browser() as opened:
        took, sizes = zip(
            *[await first_load(running, opened, running.login_url) for _ in range(loads + 1)], strict=True
        )
        report("first load to a page of use", took[1:])
        print(f"{'compressed script without viser':44} {statistics.median(sizes) / 1000:.0f} kB on the wire")
        page = await dashboard(opened, running, PHONE)
        await events_to_pixels(running, page, "phone", prompts)
        await page.close()
        page = await dashboard(opened, running, WIDE)
        await page.frame_locator(MAP).locator(CONNECTED).wait_for(state="attached")
        await asyncio.sleep(SETTLING)
        await events_to_pixels(running, page, "map and camera", prompts)
        async with driving(running):
            await page.get_by_test_id("robot-state").get_by_text("driving").wait_for()
            await events_to_pixels(running, page, "driving", prompts)


async def dashboard(opened: Browser, running: Up, viewport: Any) -> Page:
    """A dashboard that shows the robot's state."""
    page = await opened.new_page(viewport=viewport)
    await page.goto(running.login_url)
    await page.get_by_test_id("robot-state").get_by_text("ready").wait_for()
    return page


def main() -> None:
    """Parse the arguments and measure."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("-n", type=int, default=40, help="counted prompts, of about four events each (default: 40)")
    arguments.add_argument("--loads", type=int, default=10, help="counted first loads (default: 10)")
    asked = arguments.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory() as folder, up(Robot(Path(folder))) as running:
        asyncio.run(measure(running, asked.n, asked.loads))


if __name__ == "__main__":
    main()
