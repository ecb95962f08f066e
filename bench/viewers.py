"""What many viewers cost the robot: 200 dashboards, 50 of them with the scene, and how long a cancel takes meanwhile.

    python bench/viewers.py [--repetitions 100] [--dashboards 200] [--scenes 50] [--each]

The three processes as `robot-acp up` starts them. A program drives in a session by prompts and cancels each one. Every
dashboard is somebody's own login; it watches that session, and has the scene's control and the robot's camera open as
the page does. The viewers are programs that speak as the pages do (crowd.py), in processes of their own that give way
to all others: in life they sit at other computers, and their cost is printed apart. What is left on two cores is the
cost of sending to them.

Two figures for each cancel: the robot server's own, as in stopping.py, and the wall's time from sending the cancel to
the agent until the robot stands still.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shared import ROOT, Process, Robot, Up, machine, percentile, processes_of, up
from stopping import DRIVING, ENDS, SETTINGS, Halt, far_end, report, timed

from backend import config
from backend.identity import Role
from tests.processes import Client, Watched

SPLIT = 50
"""Dashboards a process at most, so that a crowd's own core does not slow it down."""


@dataclass
class Driver:
    """Drives by prompts in one session, and cancels."""

    client: Client
    watched: Watched
    limits: config.Limits = field(default_factory=config.Limits)
    _end: str = next(iter(ENDS))

    async def cancelled(self) -> tuple[Halt, float]:
        """Drive and cancel: the robot server's figure, and the wall's seconds."""
        self._end = far_end(self.watched, self._end)
        turn = self.client.later(self.client.prompt(f"go to the {self._end}"))
        await self.watched.until(lambda: self.watched.state.motion and self.watched.speed > DRIVING, "the drive", 60)
        begun = time.monotonic()
        halt = await timed(self.watched, self.limits, self.client.cancel, lambda state: state.motion is None)
        wall = time.monotonic() - begun
        assert await turn == "cancelled"
        self.client.heard.clear()
        return halt, wall


@contextlib.asynccontextmanager
async def crowd(running: Up, dashboards: int, scenes: int, session: str) -> AsyncIterator[list[dict[str, Any]]]:
    """So many dashboards, some with the scene, while the context lasts; what came to them is in the list afterwards."""
    told: list[dict[str, Any]] = []
    url = f"ws://127.0.0.1:{running.robot.bridge_port}"
    script = str(Path(__file__).with_name("crowd.py"))
    tokens = [running.robot.token(f"Viewer {number}", Role.VIEWER) for number in range(dashboards)]
    parts = -(-dashboards // SPLIT)
    processes = [
        await asyncio.create_subprocess_exec(
            *(sys.executable, script, url, session, str(len(range(part, scenes, parts)))),
            env=running.robot.variables | {"PYTHONPATH": str(ROOT)},
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
        )
        for part in range(parts)
    ]
    try:
        for part, process in enumerate(processes):
            process.stdin.write(" ".join(tokens[part::parts]).encode() + b"\n")
        for process in processes:
            assert await process.stdout.readline() == b"ready\n", "the dashboards did not connect"
        for process in processes:
            process.stdin.write(b"count\n")
        yield told
        for process in processes:
            process.stdin.write(b"end\n")
            told.append(json.loads(await process.stdout.readline()))
    finally:
        for process in processes:
            if process.returncode is None:
                process.stdin.close()
                await process.wait()


async def phase(running: Up, driver: Driver, what: str, repetitions: int) -> None:
    """Cancel so often, and tell what it took and what the processes cost meanwhile."""
    processes = processes_of(running) | {"(this program)": Process(os.getpid())}
    before = {name: process.cpu for name, process in processes.items()}
    begun = time.monotonic()
    halts, walls = zip(*[await driver.cancelled() for _ in range(repetitions)], strict=True)
    seconds = time.monotonic() - begun
    report(f"{what}: robot server", list(halts))
    p50, p99 = statistics.median(walls), percentile(walls, 0.99)
    print(f"{what + ': cancel sent to rest':28} p50 {p50 * 1000:4.0f} ms  p99 {p99 * 1000:4.0f} ms")
    for name, process in processes.items():
        share = (process.cpu - before[name]) / seconds
        print(f"    {name:16} {share:6.1%} of a core   {process.memory / 1e6:6.0f} MB", flush=True)


def tell(told: list[dict[str, Any]]) -> None:
    """What came to a crowd, by the kind of socket, and what it cost itself."""
    if not told:
        return
    seconds = sum(came["seconds"] for came in told) / len(told)
    total = {
        what: sum((Counter(came[what]) for came in told), Counter[str]()) for what in ("sockets", "frames", "bytes")
    }
    for kind, sockets in total["sockets"].items():
        each = sockets * seconds
        frames, size = total["frames"][kind] / each, total["bytes"][kind] / each / 1000
        print(f"    {sockets:3} {kind + ' sockets':16} {frames:5.1f} frames, {size:6.1f} kB a second each")
    telemetry = sum(came["telemetry"] for came in told) / (total["sockets"]["acp"] * seconds)
    lost, cpu = sum(came["lost"] for came in told), sum(came["cpu"] for came in told) / seconds
    print(f"    {telemetry:.2f} telemetry a second each, {lost} lost; own cost {cpu:.1%} of a core", flush=True)


async def measure(running: Up, asked: argparse.Namespace) -> None:
    """Without viewers, with dashboards that show no scene if asked for, and with all."""
    client = await Client.open(f"tcp://127.0.0.1:{running.robot.agent_port}", answer=None)
    session = await client.new()
    crowds = [("without viewers", 0, 0)]
    if asked.each:
        crowds.append((f"{asked.dashboards} dashboards", asked.dashboards, 0))
    crowds.append((f"{asked.dashboards}, {asked.scenes} scenes", asked.dashboards, asked.scenes))
    async with running.robot.watched() as watched:
        driver = Driver(client, watched)
        for what, dashboards, scenes in crowds:
            async with crowd(running, dashboards, scenes, session) as told:
                await phase(running, driver, what, asked.repetitions)
            tell(told)
    await client.close()


def main() -> None:
    """Parse the arguments and measure."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--repetitions", type=int, default=100, help="cancels in each phase (default: 100)")
    arguments.add_argument("--dashboards", type=int, default=200)
    arguments.add_argument("--scenes", type=int, default=50, help="dashboards that show the scene (default: 50)")
    arguments.add_argument("--each", action="store_true", help="also without scenes")
    asked = arguments.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory() as folder, up(Robot(Path(folder), dict(SETTINGS))) as running:
        asyncio.run(measure(running, asked))


if __name__ == "__main__":
    main()
