"""The three processes of a robot, each of which can be ended, started otherwise, or held still, alone.

`robot-acp up` starts the same three, but brings back at once what has ended: here a robot that is down stays down for
as long as its screen is looked at.
"""

from __future__ import annotations

import contextlib
import dataclasses
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

from backend.identity import Role
from tests.processes import Client, Robot, end, listens, wait_until


class Stage:
    """A robot whose parts come and go while the context lasts."""

    def __init__(self, data: Path, **environment: str) -> None:
        self.robot = Robot(data, dict(environment))
        self._running: dict[str, subprocess.Popen[str]] = {}

    def __enter__(self) -> Stage:
        try:
            for name in ("robot", "agent", "bridge"):
                self.start(name)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.ExitStack() as ends:  # one that does not end keeps no other
            for name in list(self._running):
                ends.callback(self.end, name)

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.robot.bridge_port}"

    def start(self, name: str, **environment: str) -> None:
        """Start a part, and wait until it listens; `environment` is laid over the robot's own."""
        told = dataclasses.replace(self.robot, environment=self.robot.environment | environment)
        self._running[name] = told.spawn(name)
        wait_until(lambda: listens(getattr(self.robot, f"{name}_port")), f"the {name} to listen")

    def end(self, name: str) -> None:
        end(self._running.pop(name))

    def restart(self, name: str, **environment: str) -> None:
        self.end(name)
        self.start(name, **environment)

    @contextlib.contextmanager
    def without(self, name: str) -> Iterator[None]:
        """A part is gone while the context lasts."""
        self.end(name)
        try:
            yield
        finally:
            self.start(name)

    @contextlib.contextmanager
    def held(self, name: str) -> Iterator[None]:
        """A part neither answers nor ends while the context lasts."""
        process = self._running[name]
        process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            process.send_signal(signal.SIGCONT)

    def page(self, name: str, role: Role, path: str = "/", base: str | None = None) -> str:
        """The address that logs somebody in."""
        return f"{base or self.base}{path}#token={self.robot.token(name, role)}"

    async def somebody(self, name: str, role: Role = Role.OPERATOR) -> Client:
        """Somebody else, at a terminal, in a session of their own."""
        token = self.robot.token(name, role)
        client = await Client.open(f"ws://127.0.0.1:{self.robot.bridge_port}/acp", token, answer=None)
        await client.new()
        return client
