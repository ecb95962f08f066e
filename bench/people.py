"""What people wait for, in the real processes and Chromium: start to page, prompt to first thought, Cancel to halt.

Run `.venv/bin/python bench/people.py` after `./test.sh` has installed what tests need. It prints a line for each
figure: the median and the 95th percentile of the counted runs, in ms of wall time. It judges nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

from playwright.async_api import Page
from shared import ROOT, Robot, dashboard, end, machine, report, turn_over, up

from tests.processes import Watched

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


async def cancel_and_time(page: Page, watched: Watched) -> float:
    """Click Cancel, and return the seconds of wall time until the robot itself says that it stands."""
    clicked_at = await page.get_by_test_id("cancel").evaluate(
        "button => { const t = Date.now(); button.click(); return t }"
    )
    await watched.until(lambda: watched.speed == 0, "the robot to halt")
    # Both clocks are this machine's; the states carry the time of their arrival.
    offset = time.time() - time.monotonic()
    halted_at = next(at for at, state in watched.states if at + offset > clicked_at / 1000 and state.twist.linear == 0)
    return halted_at + offset - clicked_at / 1000


async def in_browser(runs: int) -> None:
    """The figures that need a page."""
    with tempfile.TemporaryDirectory() as folder, up(Robot(Path(folder))) as running:
        async with dashboard(running.login_url) as page:
            thoughts: list[float] = []
            for run in range(runs + 1):
                took = await page.evaluate(FIRST_THOUGHT, "where are you?")
                await turn_over(page)
                if run:
                    thoughts.append(took / 1000)
            report("prompt to first thought on the page", thoughts)
            halts: list[float] = []
            async with running.robot.watched() as watched:
                for _ in range(max(runs // 2, 5)):
                    place = "lab 2.3.9" if watched.state.pose.x < 12 else "the dock"
                    await page.get_by_test_id("composer").fill(f"go to {place}")
                    await page.get_by_test_id("send").click()
                    await watched.until(lambda: watched.speed > 0.5, "the robot to drive")
                    halts.append(await cancel_and_time(page, watched))
                    await turn_over(page)
            report("click on Cancel to robot at zero", halts)


def main() -> None:
    """Parse the arguments and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=20, help="counted runs in the browser (default: 20)")
    parser.add_argument("--starts", type=int, default=5, help="counted starts (default: 5)")
    options = parser.parse_args()
    print(machine())
    report("./run.sh to a page that answers", start_to_page(options.starts))
    asyncio.run(in_browser(options.n))


if __name__ == "__main__":
    main()
