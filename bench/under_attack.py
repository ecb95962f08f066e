"""What an operator notices while strangers attack: answers, cancel, stop, and the memory of the three processes.

    python bench/under_attack.py [--minutes 5] [--quiet]

The robot server, the agent and the bridge run with the simulator. Another process attacks without a pause, as a
visitor and from connections without a login, with all kinds at once: texts on which patterns could backtrack, 100,000
empty blocks, long folders, floods of requests, half-sent requests and lines without an end, prompts of 500 kB. The
operator goes on: she asks where the robot is, drives and cancels, drives and presses Stop. Times are the wall's, from
the moment at which her message is sent: to the answer of the prompt, to zero velocity in the robot's own telemetry (50
states a second), to the first state with the stop set. With `--quiet` nobody attacks, for comparison.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
from shared import ROOT, Process, machine, percentile
from stopping import DRIVING, ENDS, SETTINGS, far_end, rests

from backend.identity import Role
from tests.attack import access, floods, messages
from tests.attack.target import Attack, Target
from tests.processes import STARTS_S, Client, Robot, Watched, end, eventually, listens, wait_until

ATTACKS = (
    (messages.backtracking, messages.invisible),
    (messages.empty_blocks, messages.long_text),
    (messages.long_cwd, messages.long_fields),
    (floods.lists, floods.notifications, floods.prompts, floods.abilities),
    (floods.no_newline, floods.half_requests, floods.half_bodies, access.odd_requests),
    (floods.quota, floods.sessions, floods.reads_nothing),
)
"""Each line goes on by itself, beside the others."""
SAMPLE_S = 2.0


async def attack(target: Target) -> None:
    """All attacks at once, each line in a circle, until this process is ended."""

    async def circle(line: tuple[object, ...]) -> None:
        while True:
            for run in line:
                with contextlib.suppress(Exception):  # whatever the instance answers, the next one follows
                    await Attack("", run).run(target)  # type: ignore[arg-type] # a tuple of attacks
                await asyncio.sleep(0.01)

    await asyncio.gather(*(circle(line) for line in ATTACKS))


@dataclass
class Operator:
    """One person at work, and how long everything took, in s."""

    robot: Robot
    client: Client
    watched: Watched
    http: httpx.AsyncClient
    answers: list[float] = field(default_factory=list)
    cancels: list[float] = field(default_factory=list)
    stops: list[float] = field(default_factory=list)
    halts: list[float] = field(default_factory=list)
    _end: str = next(iter(ENDS))

    async def work(self, until: float) -> None:
        """Ask, drive and cancel, drive and stop, until the monotonic time `until`."""
        while time.monotonic() < until:
            for _ in range(3):
                await self._ask()
            await self._cancel()
            await self._ask()
            await self._stop()

    async def _ask(self) -> None:
        began = time.monotonic()
        await self.client.prompt("where are you?")
        self.answers.append(time.monotonic() - began)

    @contextlib.asynccontextmanager
    async def _driving(self) -> AsyncIterator[None]:
        self._end = far_end(self.watched, self._end)
        turn = self.client.later(self.client.prompt(f"go to the {self._end}"))
        await eventually(lambda: self.watched.state.motion and self.watched.speed > DRIVING, "the robot to drive", 60)
        yield
        await turn
        del self.watched.states[:-1]

    async def _cancel(self) -> None:
        async with self._driving():
            began = time.monotonic()
            await self.client.cancel()
            await eventually(lambda: rests(self.watched.state), "zero velocity")
            self.cancels.append(self.watched.states[-1][0] - began)

    async def _stop(self) -> None:
        async with self._driving():
            seen, began = len(self.watched.states), time.monotonic()
            await self.http.post("/api/stop")
            self.stops.append(time.monotonic() - began)
            await eventually(lambda: self.watched.state.stop and rests(self.watched.state), "zero velocity")
            after = self.watched.states[seen:]
            self.halts.append(next(at for at, state in after if rests(state)) - began)
            await self.client.cancel()
        await self.http.post("/api/release")


async def sample(processes: dict[str, Process], into: dict[str, list[tuple[float, int]]]) -> None:
    """The memory of the processes, again and again."""
    while True:
        for name, process in processes.items():
            into.setdefault(name, []).append((time.monotonic(), process.memory))
        await asyncio.sleep(SAMPLE_S)


def line(what: str, seconds: list[float]) -> None:
    """One line of the table."""
    p50, p95, p99 = statistics.median(seconds), percentile(seconds, 0.95), percentile(seconds, 0.99)
    print(f"{what:34} n={len(seconds):4}  p50 {p50 * 1000:5.0f} ms  p95 {p95 * 1000:5.0f} ms  p99 {p99 * 1000:5.0f} ms")


def memory(samples: list[tuple[float, int]]) -> str:
    """Memory after the first minute, at the end, and the median slope between any two samples in between."""
    begin = samples[0][0] + min(60.0, (samples[-1][0] - samples[0][0]) / 3)
    kept = [(at, size / 2**20) for at, size in samples if at >= begin]
    slopes = [(b - a) / (t - s) * 60 for i, (s, a) in enumerate(kept) for t, b in kept[i + 1 :]]
    slope = statistics.median(slopes) if slopes else 0.0
    largest = max(size for _, size in kept)
    return (
        f"{kept[0][1]:4.0f} MB, at the end {kept[-1][1]:4.0f} MB, largest {largest:4.0f} MB, {slope:+5.1f} MB a minute"
    )


async def measure(robot: Robot, processes: dict[str, Process], minutes: float, quiet: bool) -> None:
    """The operator's work for so long, beside the attack."""
    url = f"http://127.0.0.1:{robot.bridge_port}"
    token = robot.token("Ana", Role.SUPERVISOR)
    attacker: asyncio.subprocess.Process | None = None
    memory_of: dict[str, list[tuple[float, int]]] = {}
    client = await Client.open(f"ws://127.0.0.1:{robot.bridge_port}/acp", token)
    await client.new()
    async with (
        robot.watched() as watched,
        httpx.AsyncClient(base_url=url, headers={"Authorization": f"Bearer {token}"}, timeout=30) as http,
    ):
        operator = Operator(robot, client, watched, http)
        if not quiet:
            visitor = robot.token("Mallory", Role.VISITOR)
            command = [sys.executable, __file__, "--attack", url, visitor, str(robot.agent_port)]
            attacker = await asyncio.create_subprocess_exec(*command, cwd=ROOT)
        sampling = asyncio.create_task(sample(processes, memory_of))
        try:
            await operator.work(time.monotonic() + minutes * 60)
        finally:
            sampling.cancel()
            if attacker is not None:
                attacker.kill()
                await attacker.wait()
    await client.close()
    print(f"{machine()}, {minutes:g} minutes, {'nobody attacks' if quiet else 'under attack'}")
    line("prompt to its answer", operator.answers)
    line("cancel to zero velocity", operator.cancels)
    line("Stop to the robot's answer", operator.stops)
    line("Stop to zero velocity", operator.halts)
    for name, samples in memory_of.items():
        print(f"memory of the {name:8} after the first minute {memory(samples)}")


def main() -> None:
    """Read the arguments and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--quiet", action="store_true", help="nobody attacks")
    parser.add_argument("--attack", nargs=3, metavar=("URL", "TOKEN", "PORT"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.attack:
        url, token, port = asked.attack
        asyncio.run(attack(Target(url, token, token, "visitor", ("127.0.0.1", int(port)))))
        return
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as running:
        robot = Robot(Path(folder), dict(SETTINGS))
        ports = {"robot": robot.robot_port, "agent": robot.agent_port, "bridge": robot.bridge_port}
        processes = {}
        for name, port in ports.items():
            started = robot.start(name)
            running.callback(end, started)
            processes[name] = Process(started.pid)
            wait_until(lambda port=port: listens(port), name, STARTS_S)  # type: ignore[misc] # one port each
        asyncio.run(measure(robot, processes, asked.minutes, asked.quiet))


if __name__ == "__main__":
    main()
