"""The terminal client in a process of its own, as a test drives it."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from tests.end_to_end.conftest import Up


class Terminal:
    """`robot-acp chat --json` in a process of its own, joined to a session."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self.heard: list[dict[str, Any]] = []
        self._reader = asyncio.create_task(self._read())

    @classmethod
    async def join(cls, up: Up, session: str) -> Terminal:
        process = await asyncio.create_subprocess_exec(
            *up.robot.command("chat", f"tcp://127.0.0.1:{up.robot.agent_port}", "--session", session, "--json"),
            env=up.robot.variables,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=2**26,
        )
        return cls(process)

    async def _read(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            self.heard.append(json.loads(line))

    async def say(self, line: str) -> None:
        """Type a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(line.encode() + b"\n")
        await self.process.stdin.drain()

    def of(self, method: str) -> list[dict[str, Any]]:
        """What the agent sent by this method."""
        return [message for message in self.heard if message.get("method") == method]

    @property
    def events(self) -> list[tuple[int, dict[str, Any]]]:
        updates = [m["params"] for m in self.of("session/update") if "_meta" in m["params"]]
        return [(p["_meta"]["robot-acp/seq"], p["update"]) for p in updates]

    def turn_ends(self) -> list[str]:
        metas = [update.get("_meta") or {} for _, update in self.events]
        turns = [meta["robot-acp/turn"] for meta in metas if "robot-acp/turn" in meta]
        return [turn["stopReason"] for turn in turns if turn["state"] == "ended"]

    async def leave(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        await self.process.wait()
        await self._reader
