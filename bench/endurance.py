"""Whether memory stays flat: one long, busy session, watched by a dashboard in Chromium.

    python bench/endurance.py [--minutes 120] [--time-scale 20] [--samples FILE]

`robot-acp up` at a high time scale, in the mode that asks nobody. A program prompts in one session without a pause, for
drives, speech and photos; the dashboard shows it, with its scene. Every 10 s of wall time: the resident memory of the
three processes; of the page, with the scene in it, its JavaScript heap after a forced collection, its DOM nodes and its
listeners. Printed are the medians of the first and the last quarter, the median slope between any two samples of the
second half, and what each quarter grew by per 1,000 turns. That tells the two kinds of growth apart: a leak grows as
much in every quarter, a cache that fills up less and less.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import os
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from playwright.async_api import CDPSession
from shared import Process, Robot, Up, dashboard, machine, processes_of, up
from stopping import SETTINGS

from tests.processes import Client, Watched

EVERY_S = 10.0
PROMPTS = (
    "go to lab 2.3.9",
    "take a photo",
    "say that the tour begins here",
    "go to the kitchen and then go to lab 2.3.4",
    "where are you?",
    "go to the dock",
    "what is the battery level?",
)
LOW, FULL = 0.4, 0.8
"""It charges when the battery is lower than the one, until it is higher than the other."""
Sample = dict[str, float]


@dataclass
class Work:
    """Prompts until cancelled; `turns` is how many are over."""

    client: Client
    watched: Watched
    turns: int = 0

    async def run(self) -> None:
        """One prompt after the other."""
        for prompt in itertools.cycle(PROMPTS):
            await self._turn(prompt)
            if self.watched.state.battery.level < LOW:
                await self._turn("go to the dock")
                await self.watched.until(lambda: self.watched.state.battery.level > FULL, "a charged battery", 600)

    async def _turn(self, prompt: str) -> None:
        await self.client.prompt(prompt)
        self.turns += 1
        # What this program keeps of it is no part of what is measured.
        self.client.heard.clear()
        self.watched.spoken.clear()
        del self.watched.states[:-1]


async def sample(processes: dict[str, Process], page: CDPSession) -> Sample:
    """What everything holds at this moment, in MB, and the page's DOM nodes and listeners."""
    await page.send("HeapProfiler.collectGarbage")
    heap = (await page.send("Runtime.getHeapUsage"))["usedSize"]
    dom = await page.send("Memory.getDOMCounters")
    resident = {f"{name} (MB)": process.memory / 1e6 for name, process in processes.items()}
    counted = {"page's DOM (nodes)": dom["nodes"], "page's listeners": dom["jsEventListeners"]}
    return resident | {"page's heap (MB)": heap / 1e6} | counted


def typical_slope(along: list[float], values: list[float]) -> float:
    """The median slope between any two (Theil and Sen): one odd sample does not tilt it."""
    pairs = itertools.combinations(zip(along, values, strict=True), 2)
    slopes = [(later - earlier) / (to - since) for (since, earlier), (to, later) in pairs if to > since]
    return statistics.median(slopes) if slopes else 0.0


def report(times: list[float], turns: list[float], samples: list[Sample]) -> None:
    """First and last quarter, the slope of the second half, and the growth in each quarter by the turns in it."""
    quarters = [slice(len(samples) * n // 4, len(samples) * (n + 1) // 4) for n in range(4)]
    half = slice(len(samples) // 2, None)
    print(f"{'':20} {'first':>9} {'last':>9} {'slope':>9}   grown per 1,000 turns, by quarter")
    print(f"{'':20} {'quarter':>9} {'quarter':>9} {'an hour':>9} {'1st':>9} {'2nd':>9} {'3rd':>9} {'4th':>9}")
    for name in samples[0]:
        values = [one[name] for one in samples]
        first, last = (statistics.median(values[quarter]) for quarter in (quarters[0], quarters[3]))
        slope = typical_slope(times[half], values[half]) * 3600
        grown = [typical_slope(turns[quarter], values[quarter]) * 1000 for quarter in quarters]
        by_quarter = " ".join(f"{one:+9.2f}" for one in grown)
        print(f"{name:20} {first:9.1f} {last:9.1f} {slope:+9.2f} {by_quarter}", flush=True)


async def measure(running: Up, minutes: float, keep: TextIO) -> None:
    """Work, and look."""
    client = await Client.open(f"tcp://127.0.0.1:{running.robot.agent_port}")
    session = await client.new()
    times: list[float] = []
    turns: list[float] = []
    samples: list[Sample] = []
    async with running.robot.watched() as watched, dashboard(running.login_url) as page:
        await page.evaluate("session => { location.hash = `/s/${session}` }", session)
        wire = await page.context.new_cdp_session(page)
        processes = processes_of(running)
        work = Work(client, watched)
        working = client.later(work.run())
        begun = time.monotonic()
        while (at := time.monotonic() - begun) < minutes * 60 and not working.done():
            times.append(at)
            turns.append(work.turns)
            samples.append(await sample(processes, wire))
            keep.write(json.dumps({"seconds": round(at), "turns": work.turns} | samples[-1]) + "\n")
            keep.flush()
            await asyncio.wait([working], timeout=EVERY_S - (time.monotonic() - begun - at))
        if working.done():
            working.result()
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)
        seen = await page.evaluate("document.querySelectorAll('[data-testid=user-message]').length")
    await client.close()
    print(f"{times[-1] / 60:.0f} minutes, {work.turns} turns, {len(samples)} samples, {seen} prompts on the page")
    report(times, turns, samples)


def main() -> None:
    """Parse the arguments and measure."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--minutes", type=float, default=120, help="of wall time (default: 120)")
    arguments.add_argument("--time-scale", default="20")
    arguments.add_argument("--samples", type=Path, help="also write each sample there, as JSON Lines")
    asked = arguments.parse_args()
    print(machine())
    settings = SETTINGS | {"ROBOT_ACP_AGENT__DEFAULT_MODE": "autonomous"}
    with (
        tempfile.TemporaryDirectory() as folder,
        open(asked.samples or os.devnull, "w") as keep,
        up(Robot(Path(folder), settings), "--time-scale", asked.time_scale) as running,
    ):
        asyncio.run(measure(running, asked.minutes, keep))


if __name__ == "__main__":
    main()
