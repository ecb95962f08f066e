"""One prompt turn: the ReAct loop of thought, inference and tool calls, until the model has nothing left to do.

The loop proposes and never decides: whether a call may run is decided in `permission.py`, whether a motion is safe in
the robot server. The session starts, queues and cancels turns. However a turn ends, every tool call that it announced
has ended before, and a robot that it moved is at rest.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from dataclasses import dataclass, field
from typing import Any

from backend.agent.acp import commands, export, updates
from backend.agent.control import rest
from backend.agent.control.permission import Permission
from backend.agent.control.policy import mode_info
from backend.agent.robot.mcp_client import ServerUnavailable, Tool
from backend.agent.sessions.session import Listener, Session
from backend.agent.turns import model, prompts, providers
from backend.agent.turns.environment import TurnEnvironment
from backend.agent.turns.inferences import Inferences
from backend.agent.turns.phases import Phases
from backend.agent.turns.tool_calls import ToolCalls
from backend.identity import Identity
from backend.visible import visible

log = logging.getLogger(__name__)

_TITLE_CHARS = 78
_CUT: dict[model.CutReason, str] = {
    "max_tokens": "I stopped here: the model's answer got longer than it may be. Ask for a smaller part.",
    "refusal": "The model refused to go on with this.",
}


@dataclass(eq=False)
class Turn:
    """A prompt of `asker` to a session, sent over the connection `origin`. `work` may be called once."""

    environment: TurnEnvironment
    session: Session
    asker: Identity
    prompt: list[dict[str, Any]]
    origin: Listener | None
    stopped: str | None = None
    """For the prompt `/stop`: the result of the stop, in words. The robot was stopped before the turn began."""
    id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    _new_title: str | None = field(default=None, init=False)
    """The title that this prompt gives the session; None where it has one."""
    # The next four begin with the work, for which the turn may have waited.
    _phases: Phases = field(init=False)
    _inferences: Inferences = field(init=False)
    _permission: Permission = field(init=False)
    _calls: ToolCalls = field(init=False)

    async def work(self) -> str:
        """Run the turn to its end and return ACP's stop reason."""
        self._begin()
        for block in self.prompt:
            self.session.record(updates.user_message(block, self.asker.name, self.id), self.origin)
        self._new_title = self._name_session()
        command = commands.named_in(self.prompt)
        if own := await self._own_command(command):
            self.session.record(updates.message(own))
            return "end_turn"
        if command is not None:
            self._inferences.other_model = model.OFFLINE_MODEL
        tools = await self.environment.tools.tools()
        if command is None:  # a command is the robot's own business
            tools = await self.session.client_servers.beside(tools)
        # Just after the start this takes seconds, which do not count as the preliminary thought's.
        with self._phases.during("inference"):
            await providers.ready(self._inferences.model_name)
        situation = self._situation(tools)
        wants_thought = self.session.row.thought and command is None
        thinking = asyncio.create_task(self._think(situation, wants_thought), name="preliminary thought")
        try:
            reason = await self._loop(tools, thinking)
            # At the end: between a question and its answer, a model would take this for its own words.
            if news := self.session.client_servers.news():
                self.session.record(updates.message(f"\n\n{news}"))
            return reason
        finally:
            thinking.cancel()
            await asyncio.gather(thinking, return_exceptions=True)

    async def halt(self, error: BaseException) -> str:
        """End every open tool call, tell people why, wait until the robot is at rest, and return the stop reason."""
        reason = "end_turn"
        said: str | None = None
        if isinstance(error, asyncio.CancelledError):
            reason = why = "cancelled"
        elif isinstance(error, ServerUnavailable | model.ModelError):
            why = said = str(error)
        else:
            # The text of an unknown error can hold anything, so only the log gets it.
            log.error("turn %s failed", self.id, exc_info=error)
            why, said = "internal error", "Something went wrong inside the agent; its log says what. Try again."
        self._calls.close(why)
        if said is not None:
            self.session.record(updates.message(said))
        if self._calls.acted:  # the next turn must not get a robot that still moves
            with self._phases.during("navigation"):
                await rest.until_at_rest(self.environment.link, self._say_apart)
        if self._calls.revoked is not None:
            text = f"{self._calls.revoked}, so I stopped here."
            self.session.record(updates.lease_revoked(text, self._calls.taken_by))
        return reason

    def _say_apart(self, sentence: str) -> None:
        """Show people a sentence as a paragraph of its own."""
        self.session.record(updates.message(f"\n\n{sentence}\n\n"))

    def close(self) -> None:
        """Free the robot for other turns, and record how much of the model's context is in use."""
        self._calls.release()
        if self._inferences.usage:
            self.session.record(self._inferences.usage)

    def seconds(self) -> dict[str, float]:
        """How long the turn has taken, in seconds by phase."""
        return self._phases.seconds()

    def _begin(self) -> None:
        environment, session = self.environment, self.session
        self._phases = Phases()
        self._inferences = Inferences(session, environment.infer, environment.thought_timeout_s, self._phases)
        self._permission = Permission(
            session=session,
            asker=self.asker,
            policy=environment.policy,
            four_eyes=environment.four_eyes,
            previews=environment.preview,
            robot_tools=environment.tools,
            robot=environment.link,
            phases=self._phases,
            audit=environment.audit,
        )
        self._calls = ToolCalls(
            environment, session, self.id, self.asker.name, self.origin, self._permission, self._phases
        )

    async def _loop(self, tools: dict[str, Tool], thinking: asyncio.Task[None]) -> str:
        schemas = [tool.schema for tool in tools.values()] + [prompts.PLAN_TOOL_SCHEMA, prompts.ASK_TOOL_SCHEMA]
        for _ in range(self.environment.max_steps):
            # The situation is read anew for each step: the mode may have changed in mid-turn.
            calls, cut = await self._inferences.step(self._situation(tools), schemas, thinking)
            if cut is not None:
                # No call of an incomplete answer is run: the rest could have changed its meaning.
                self.session.record(updates.message(_CUT[cut]))
                return cut
            if not calls:
                return "end_turn"
            for call in calls:
                await self._calls.run(call, tools)
        self.session.record(updates.message("I stopped here: this took more steps than I am allowed in one turn."))
        return "max_turn_requests"

    async def _own_command(self, command: str | None) -> str | None:
        """The result of `/stop` or `/export`, which the agent itself runs, in words; None for anything else."""
        if command == "export":
            return await export.hand_over(
                self.session, self.environment.store, self.origin, self.environment.answer_timeout_s
            )
        return self.stopped

    async def _think(self, situation: model.Situation, wanted: bool) -> None:
        """Make the preliminary thought where it is `wanted`, then show the session's new title."""
        if wanted:
            await self._inferences.think(situation)
        if self._new_title:  # only now, so that the thought is the first thing that people see of the turn
            self.session.record(updates.title(self._new_title))

    def _situation(self, tools: dict[str, Tool]) -> model.Situation:
        row = self.session.row
        mode = mode_info(row.mode)
        decisions = {
            name: self._permission.decide(tool)
            for name, tool in tools.items()
            if not self.environment.policy.previews(row.mode, tool.traits)
        }
        return model.Situation(
            robot=self.environment.robot_name,
            mode=mode.name,
            mode_text=mode.description,
            asks=tuple(name for name, decision in decisions.items() if decision == "ask"),
            denied=tuple(name for name, decision in decisions.items() if decision == "deny"),
            start=model.StartPose.of(row.start_pose),
        )

    def _name_session(self) -> str | None:
        """Name a session that has no title after its first prompt, and return the title; None where it has one."""
        text = " ".join(block["text"] for block in self.prompt if block.get("type") == "text")
        text = " ".join(text[: 10 * _TITLE_CHARS].split())
        if self.session.row.title is not None or not text:
            return None
        title = visible(text if len(text) <= _TITLE_CHARS else text[: _TITLE_CHARS - 1] + "…")
        self.session.change(title=title)
        return title
