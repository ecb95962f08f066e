"""Somebody else's agent: a sweeper, written with the official SDK alone, on stdin and stdout.

It knows nothing of robot-acp. `sweep` asks for permission first; `wait` goes on until it is cancelled.
"""

from __future__ import annotations

import asyncio
import sys
from typing import Any

from acp import PROTOCOL_VERSION, run_agent, start_tool_call, update_agent_message_text, update_tool_call
from acp.interfaces import Client
from acp.schema import (
    AgentCapabilities,
    AllowedOutcome,
    InitializeResponse,
    NewSessionResponse,
    PermissionOption,
    PromptResponse,
    ToolCallUpdate,
)

OPTIONS = [
    PermissionOption(option_id="yes", name="Sweep", kind="allow_once"),
    PermissionOption(option_id="no", name="Leave it", kind="reject_once"),
]


class Sweeper:
    client: Client

    def __init__(self) -> None:
        self.cancelled = asyncio.Event()

    def on_connect(self, conn: Client) -> None:
        self.client = conn

    async def initialize(self, protocol_version: int, **_kwargs: Any) -> InitializeResponse:
        return InitializeResponse(protocol_version=PROTOCOL_VERSION, agent_capabilities=AgentCapabilities())

    async def new_session(self, cwd: str, **_kwargs: Any) -> NewSessionResponse:
        return NewSessionResponse(session_id="floor")

    async def prompt(self, session_id: str, prompt: list[Any], **_kwargs: Any) -> PromptResponse:
        text = prompt[0].text
        if text == "wait":
            await self.say(session_id, "Waiting.")
            await self.cancelled.wait()
            return PromptResponse(stop_reason="cancelled")
        await self.client.session_update(session_id, start_tool_call("c1", "Sweep the floor"))
        call = ToolCallUpdate(tool_call_id="c1", title="Sweep the floor")
        answer = await self.client.request_permission(session_id=session_id, tool_call=call, options=OPTIONS)
        swept = isinstance(answer.outcome, AllowedOutcome) and answer.outcome.option_id == "yes"
        status = "completed" if swept else "failed"
        await self.client.session_update(session_id, update_tool_call("c1", status=status))
        await self.say(session_id, "The floor is clean." if swept else "Then it stays dirty.")
        return PromptResponse(stop_reason="end_turn")

    async def cancel(self, session_id: str, **_kwargs: Any) -> None:
        self.cancelled.set()

    async def say(self, session_id: str, text: str) -> None:
        await self.client.session_update(session_id, update_agent_message_text(text))


if __name__ == "__main__":
    print("sweeper ready", file=sys.stderr)
    asyncio.run(run_agent(Sweeper()))  # type: ignore[arg-type]
