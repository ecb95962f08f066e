"""What people wait for, in the real processes and Chromium: start to page, prompt to first thought, Cancel to halt.

Run `.venv/bin/python bench/people.py` after `./test.sh` has installed what tests need. It prints a line for each
figure: the median and the 95th percentile of the counted runs, in ms of wall time. It judges nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import asynccontextmanager
from pathlib import Path

from playwright.async_api import Page, async_playwright

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from tests.end_to_end.conftest import CHROMIUM_FLAGS, start  # noqa: E402
from tests.end_to_end.test_papers_session import cancel_and_time  # noqa: E402
from tests.processes import Robot, end  # noqa: E402

FIRST_THOUGHT = """async (text) => {
  const thoughts = () => document.querySelectorAll('[data-testid=thought]').length;
  const before = thoughts();
  const box = document.querySelector('[data-testid=composer]');
  const set = Object.getOwnPropertyDescriptor(HTMLTextAreaElement.prototype, 'value').set;
  set.call(box, text);
  box.dispatchEvent(new Event('input', { bubbles: true }));
  const send = document.querySelector('[data-testid=send]');
  while (send.disabled) await new Promise(requestAnimationFrame);
  const began = performance.now();
  const shown = new Promise((done) => {
    const seen = new MutationObserver(() => {
      if (thoughts() > before) { seen.disconnect(); done(performance.now() - began); }
    });
    seen.observe(document.body, { childList: true, subtree: true });
  });
  send.click();
  return await shown;
}"""


def report(what: str, seconds: list[float]) -> None:
    """One line: the median and the 95th percentile of `seconds`."""
    ranked = sorted(seconds)
    p95 = ranked[min(len(ranked) - 1, round(0.95 * (len(ranked) - 1)))]
    print(f"{what:34} median {statistics.median(ranked) * 1000:7.1f} ms   p95 {p95 * 1000:7.1f} ms   n={len(ranked)}")


def start_to_page(runs: int) -> list[float]:
    """Seconds from `./run.sh` to the first answer of the dashboard's address."""
    took: list[float] = []
    for run in range(runs + 1):
        with tempfile.TemporaryDirectory() as folder:
            robot = Robot(Path(folder))
            began = time.monotonic()
            process = subprocess.Popen(
                [str(ROOT / "run.sh")],
                env=robot.variables,
                text=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            while True:
                try:
                    urllib.request.urlopen(f"http://127.0.0.1:{robot.bridge_port}/", timeout=1).read()
                    break
                except OSError:
                    time.sleep(0.01)
            if run:  # the first one warms up
                took.append(time.monotonic() - began)
            end(process, signal.SIGINT)
    return took


@asynccontextmanager
async def dashboard(url: str):
    """A dashboard in Chromium."""
    chromium = os.environ.get("ROBOT_ACP_TEST_CHROMIUM") or shutil.which("chromium")
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium, args=CHROMIUM_FLAGS)
        page = await browser.new_page(viewport={"width": 1440, "height": 900})
        await page.goto(url)
        await page.get_by_test_id("robot-state").get_by_text("ready").wait_for()
        yield page
        await browser.close()


async def turn_over(page: Page) -> None:
    """Wait until no turn runs."""
    await page.get_by_test_id("cancel").wait_for(state="detached")


async def in_browser(runs: int) -> None:
    """The figures that need a page."""
    with tempfile.TemporaryDirectory() as folder:
        up = start(Robot(Path(folder)))
        try:
            async with dashboard(up.login_url) as page:
                thoughts: list[float] = []
                for run in range(runs + 1):
                    took = await page.evaluate(FIRST_THOUGHT, "where are you?")
                    await turn_over(page)
                    if run:
                        thoughts.append(took / 1000)
                report("prompt to first thought on the page", thoughts)
                halts: list[float] = []
                async with up.robot.watched() as watched:
                    for _ in range(max(runs // 2, 5)):
                        place = "lab 2.3.9" if watched.state.pose.x < 12 else "the dock"
                        await page.get_by_test_id("composer").fill(f"go to {place}")
                        await page.get_by_test_id("send").click()
                        await watched.until(lambda: watched.speed > 0.5, "the robot to drive")
                        halts.append(await cancel_and_time(page, watched))
                        await turn_over(page)
                report("click on Cancel to robot at zero", halts)
        finally:
            end(up.process, signal.SIGINT)


def main() -> None:
    """Parse the arguments and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=20, help="counted runs in the browser (default: 20)")
    parser.add_argument("--starts", type=int, default=5, help="counted starts (default: 5)")
    options = parser.parse_args()
    report("./run.sh to a page that answers", start_to_page(options.starts))
    asyncio.run(in_browser(options.n))


if __name__ == "__main__":
    main()
