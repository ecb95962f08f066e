"""How long a stop takes until its answer: through the agent, through the bridge, and straight to the robot server.

    python bench/stop_request.py [--repetitions 40] [--pause 6]

Three real processes on this machine. Between two stops nothing is asked for `--pause` seconds, as between two presses
of people: longer than the 5 s after which the robot server closes a connection that nobody uses. Each figure is the
wall's time of one request, on a connection to the agent or bridge that is open.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import httpx

sys.path.insert(0, str(Path(__file__).parent.parent))
from backend.identity import Role
from tests.processes import Client, Robot

Press = Callable[[], Awaitable[object]]


async def measure(robot: Robot, repetitions: int, pause: float) -> None:
    """Press all three, one after the other, and print the medians."""
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
    bearer = {"Authorization": f"Bearer {robot.token('bench', Role.SUPERVISOR)}"}
    kept = httpx.Limits(keepalive_expiry=None)
    bridge = httpx.AsyncClient(
        base_url=f"http://127.0.0.1:{robot.bridge_port}", headers=bearer, trust_env=False, limits=kept
    )
    server = httpx.AsyncClient(
        base_url=f"http://127.0.0.1:{robot.robot_port}", headers=robot.robot_headers, trust_env=False
    )
    presses: dict[str, Press] = {
        "through the agent": lambda: client.link.request("_robot/stop", {}),
        "through the bridge": lambda: bridge.post("/api/stop"),
        "straight": lambda: server.post("/stop", params={"by": "bench"}),
    }
    times: dict[str, list[float]] = {name: [] for name in presses}
    for _ in range(repetitions):
        await asyncio.sleep(pause)
        for name, press in presses.items():
            begun = time.perf_counter()
            await press()
            times[name].append(1000 * (time.perf_counter() - begun))
        await server.post("/release", params={"by": "bench"})
    for name, all_ms in times.items():
        print(
            f"{name:20} p50 {statistics.median(all_ms):6.1f} ms  max {max(all_ms):6.1f} ms  first {all_ms[0]:6.1f} ms"
        )
    await client.close()
    await bridge.aclose()
    await server.aclose()


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--repetitions", type=int, default=40)
    arguments.add_argument("--pause", type=float, default=6.0)
    asked = arguments.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        robot = Robot(Path(folder), {"ROBOT_ACP_LOG_LEVEL": "error"})
        with robot.at_work():
            asyncio.run(measure(robot, asked.repetitions, asked.pause))


if __name__ == "__main__":
    main()
