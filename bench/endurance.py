"""Whether memory stays flat: one long, busy session, watched by a dashboard in Chromium.

    python bench/endurance.py [--minutes 120] [--time-scale 20] [--samples FILE]

`robot-acp up` at a high time scale, in the mode that asks nobody. A program prompts in one session without a pause, for
drives, speech and photos; the dashboard shows it, with its scene. Every 10 s of wall time: the resident memory of the
three processes; of the page its JavaScript heap after a forced collection and its DOM nodes. Printed are the medians of
the first and the last quarter, and the median slope between any two samples of the second half: there caches are full,
and what still grows is a leak.
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


async def work(client: Client, watched: Watched) -> None:
    """Prompt until cancelled."""
    for prompt in itertools.cycle(PROMPTS):
        await client.prompt(prompt)
        if watched.state.battery.level < LOW:
            await client.prompt("go to the dock")
            await watched.until(lambda: watched.state.battery.level > FULL, "the battery to be charged", 600)
        # What this program keeps of it is no part of what is measured.
        client.heard.clear()
        del watched.states[:-1]


async def sample(processes: dict[str, Process], page: CDPSession) -> Sample:
    """What everything holds at this moment, in MB, and the DOM nodes."""
    await page.send("HeapProfiler.collectGarbage")
    heap = (await page.send("Runtime.getHeapUsage"))["usedSize"]
    nodes = (await page.send("Memory.getDOMCounters"))["nodes"]
    resident = {f"{name} (MB)": process.memory / 1e6 for name, process in processes.items()}
    return resident | {"page's heap (MB)": heap / 1e6, "page's DOM (nodes)": nodes}


def typical_slope(times: list[float], values: list[float]) -> float:
    """The median slope between any two (Theil and Sen): one odd sample does not tilt it."""
    pairs = itertools.combinations(zip(times, values, strict=True), 2)
    slopes = [(later - earlier) / (to - since) for (since, earlier), (to, later) in pairs]
    return statistics.median(slopes) if slopes else 0.0


def report(times: list[float], samples: list[Sample]) -> None:
    """First and last quarter, and the slope of the second half."""
    quarter, half = max(len(samples) // 4, 1), len(samples) // 2
    print(f"{'':20} {'first quarter':>14} {'last quarter':>14} {'slope an hour':>14}")
    for name in samples[0]:
        values = [one[name] for one in samples]
        slope = typical_slope(times[half:], values[half:]) * 3600
        first, last = statistics.median(values[:quarter]), statistics.median(values[-quarter:])
        print(f"{name:20} {first:14.1f} {last:14.1f} {slope:+14.1f}", flush=True)


async def measure(running: Up, minutes: float, keep: TextIO) -> None:
    """Work, and look."""
    client = await Client.open(f"tcp://127.0.0.1:{running.robot.agent_port}")
    session = await client.new()
    times: list[float] = []
    samples: list[Sample] = []
    async with running.robot.watched() as watched, dashboard(running.login_url) as page:
        await page.evaluate("session => { location.hash = `/s/${session}` }", session)
        wire = await page.context.new_cdp_session(page)
        processes = processes_of(running)
        working = client.later(work(client, watched))
        begun = time.monotonic()
        while (at := time.monotonic() - begun) < minutes * 60 and not working.done():
            times.append(at)
            samples.append(await sample(processes, wire))
            keep.write(json.dumps({"seconds": round(at)} | samples[-1]) + "\n")
            keep.flush()
            await asyncio.wait([working], timeout=EVERY_S - (time.monotonic() - begun - at))
        if working.done():
            working.result()
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)
        seen = await page.evaluate("document.querySelectorAll('[data-testid=user-message]').length")
    await client.close()
    print(f"{times[-1] / 60:.0f} minutes, {len(samples)} samples, {seen} prompts on the page")
    report(times, samples)


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
