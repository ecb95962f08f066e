"""What the measurements share: the `backend` and `tests` of this tree, a dashboard in Chromium, processes, table lines.

Import it before `backend` and `tests`: it puts the tree that it stands in before any that is installed.
"""

from __future__ import annotations

import os
import shutil
import signal
import statistics
import sys
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from playwright.async_api import Browser, Page, async_playwright

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from tests.end_to_end.conftest import Up, start  # noqa: E402
from tests.processes import Robot, end  # noqa: E402

FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-gpu-rasterization", "--disable-gpu-compositing"]
"""The map is drawn in software, and the page is not drawn through it, as it is in the tests: that costs the page more
than the map does, and the tests can wait."""

__all__ = ["ROOT", "Process", "Robot", "Up", "browser", "dashboard", "end", "machine", "percentile", "processes_of"]
__all__ += ["report", "turn_over", "up"]

TICKS = os.sysconf("SC_CLK_TCK")
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def percentile(values: Sequence[float], share: float) -> float:
    """The value below which `share` of them lie."""
    ranked = sorted(values)
    return ranked[round(share * (len(ranked) - 1))]


def report(what: str, seconds: Sequence[float]) -> None:
    """One line: the median and the 95th percentile of `seconds`."""
    if not seconds:
        print(f"{what:44} not measured")
        return
    median, p95 = statistics.median(seconds), percentile(seconds, 0.95)
    print(f"{what:44} median {median * 1000:7.1f} ms   p95 {p95 * 1000:7.1f} ms   n={len(seconds)}", flush=True)


def machine() -> str:
    """What was measured on, and how busy it was."""
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"


@asynccontextmanager
async def browser() -> AsyncIterator[Browser]:
    """Chromium on a computer without a graphics card."""
    chromium = os.environ.get("ROBOT_ACP_TEST_CHROMIUM") or shutil.which("chromium")
    async with async_playwright() as playwright:
        opened = await playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        try:
            yield opened
        finally:
            await opened.close()


@asynccontextmanager
async def dashboard(url: str) -> AsyncIterator[Page]:
    """A dashboard in Chromium, once it shows the robot's state."""
    async with browser() as opened:
        page = await opened.new_page(viewport={"width": 1440, "height": 900})
        await page.goto(url)
        await page.get_by_test_id("robot-state").get_by_text("ready").wait_for()
        yield page


async def turn_over(page: Page) -> None:
    """Wait until no turn runs."""
    await page.get_by_test_id("cancel").wait_for(state="detached")


@contextmanager
def up(robot: Robot, *arguments: str) -> Iterator[Up]:
    """`robot-acp up`, ended as Ctrl-C ends it."""
    running = start(robot, *arguments)
    try:
        yield running
    finally:
        end(running.process, signal.SIGINT)


@dataclass(frozen=True)
class Process:
    """A process as the kernel counts it."""

    pid: int

    @property
    def cpu(self) -> float:
        """Seconds of CPU time so far."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICKS

    @property
    def memory(self) -> int:
        """Bytes of memory that it holds (resident set)."""
        return int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * PAGE_BYTES


def processes_of(running: Up) -> dict[str, Process]:
    """The robot server, the agent and the bridge of an `up`, by name."""
    parent = running.process.pid
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    named = {}
    for pid in children:
        command = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        named[command[command.index("backend.cli") + 1]] = Process(int(pid))
    return {name: named[name] for name in ("robot", "agent", "bridge")}
