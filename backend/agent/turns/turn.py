"""One prompt turn: the ReAct loop of thought, inference and tool calls, until the model has nothing left to do.

The loop proposes, it never decides: whether a call may run is `policy` and `permissions`, whether it is safe is the
robot server. However a turn ends, every tool call that it announced has ended before.
"""

from __future__ import annotations

import asyncio
import logging
import time
import uuid
from dataclasses import dataclass, field
from typing import Any

from backend.agent.acp import commands, export, updates
from backend.agent.control import preview
from backend.agent.control.lease import Claim, Lease
from backend.agent.control.permissions import Verdict
from backend.agent.control.policy import MODES, Decision, Policy
from backend.agent.robot.mcp_client import McpClient, Progress, ServerUnavailable, Tool, ToolResult
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.history import PLAN_TOOL
from backend.agent.sessions.session import Listener, Session
from backend.agent.sessions.store import Store
from backend.agent.turns import elicitation, model, prompts
from backend.agent.turns.inferences import Infer, Inferences
from backend.agent.turns.phases import Phase, Phases, phase_of
from backend.identity import Identity

log = logging.getLogger(__name__)

PROGRESS_EVERY_S = 0.5
_CUT: dict[model.CutReason, str] = {
    "max_tokens": "I stopped here: the model's answer got longer than it may be. Ask for a smaller part.",
    "refusal": "The model refused to go on with this.",
}


@dataclass(frozen=True)
class TurnEnvironment:
    """What every turn works with; one for the whole agent."""

    robot_name: str
    tools: McpClient
    """The robot's own."""
    policy: Policy
    link: RobotClient
    store: Store
    lease: Lease
    thought_timeout_s: float
    max_steps: int
    answer_timeout_s: float
    four_eyes: frozenset[str] = frozenset()
    """Tools that somebody else than the asker must approve."""
    preview: bool = True
    """Whether a tool that can shows what it would do before people are asked."""
    infer: Infer = model.stream


@dataclass(eq=False)
class Turn:
    """A prompt of `asker` to a session. `run` may be called once."""

    environment: TurnEnvironment
    session: Session
    asker: Identity
    prompt: list[dict[str, Any]]
    origin: Listener | None
    stopped: str | None = None
    """What came of the stop, in words, where the prompt is `/stop`: it was made before the turn."""
    id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    _open: list[str] = field(default_factory=list)
    _calls: int = 0
    _acted: bool = False
    _claim: Claim | None = None
    _lost: str | None = None
    """Why the robot was taken away, as the first half of a sentence."""
    _named: str | None = None
    _rehearsed: bool = False
    """Whether the robot may draw a way for people who are asked about the call at hand."""
    _phases: Phases = field(init=False)
    """Begins with the turn, which may have waited for others before."""
    _inferences: Inferences = field(init=False)

    async def run(self) -> str:
        """Run to the end and return ACP's stop reason. Being cancelled is one of the ends: it returns "cancelled"
        once the robot is at rest."""
        self.session.turn_id, self.session.turn_by = self.id, self.asker.name
        self._phases = Phases()
        environment = self.environment
        self._inferences = Inferences(self.session, environment.infer, environment.thought_timeout_s, self._phases)
        reason = "cancelled"
        try:
            reason = await self._to_the_end()
        finally:
            # Whatever happened: the robot is free for others, and everybody sees that the turn is over.
            if self._claim:
                self.environment.lease.release(self._claim)
            if self._inferences.usage:
                self.session.record(self._inferences.usage)
            self.session.turn_id = self.session.turn_by = None
            self.session.record(updates.turn_ended(self.id, reason, self._phases.seconds()))
        return reason

    async def _to_the_end(self) -> str:
        for block in self.prompt:
            self.session.record(updates.user_message(block, self.asker.name, self.id), self.origin)
        self._named = self._name_session()
        reason, why, said = "end_turn", "cancelled", None
        try:
            return await self._work()
        except asyncio.CancelledError:
            reason = "cancelled"
        except (ServerUnavailable, model.ModelError) as error:
            why = said = str(error)
        except Exception:
            # The text of an unknown error is for the log: it can hold anything.
            log.exception("turn %s failed", self.id)
            why, said = "internal error", "Something went wrong inside the agent; its log says what. Try again."
        self.session.halting()
        self._close_calls(why)
        if said is not None:
            self.session.record(updates.message(said))
        if self._acted:  # the next turn must not get a robot that still moves
            with self._phases.during("navigation"):
                await self.environment.link.at_rest()
        if self._lost is not None:
            taken_by = self._claim.taken_by if self._claim else None
            self.session.record(updates.lost(f"{self._lost}, so I stopped here.", taken_by))
        return reason

    async def _work(self) -> str:
        command = commands.named_in(self.prompt)
        if own := await self._own_command(command):
            self.session.record(updates.message(own))
            return "end_turn"
        if command is not None:
            self._inferences.other_model = model.OFFLINE_MODEL
        tools = await self.environment.tools.tools()
        if command is None:  # a command is the robot's own business
            tools = await self.session.offered.beside(tools)
        # The first use of litellm takes seconds, which are not the thought's.
        with self._phases.during("inference"):
            await model.ready(self._inferences.model_name)
        situation = self._situation(tools)
        wants_thought = self.session.row.thought and command is None
        thinking = asyncio.create_task(self._think(situation, wants_thought), name="preliminary thought")
        try:
            reason = await self._loop(tools, thinking)
            # At the end: it must not stand between a question and its answer, where a model would take it for its own.
            if news := self.session.offered.news():
                self.session.record(updates.message(f"\n\n{news}"))
            return reason
        finally:
            thinking.cancel()
            await asyncio.gather(thinking, return_exceptions=True)

    async def _loop(self, tools: dict[str, Tool], thinking: asyncio.Task[None]) -> str:
        schemas = [tool.schema for tool in tools.values()] + [prompts.PLAN_TOOL_SCHEMA, prompts.ASK_TOOL_SCHEMA]
        for _ in range(self.environment.max_steps):
            # The situation is read anew for each step: the mode may have changed in mid-turn.
            calls, cut = await self._inferences.step(self._situation(tools), schemas, thinking)
            if cut is not None:
                # Nothing of an answer that is not whole is done: the rest could have changed its sense.
                self.session.record(updates.message(_CUT[cut]))
                return cut
            if not calls:
                return "end_turn"
            for call in calls:
                await self._run(call, tools)
        self.session.record(updates.message("I stopped here: this took more steps than I am allowed in one turn."))
        return "max_turn_requests"

    async def _own_command(self, command: str | None) -> str | None:
        """What came of `/stop` or `/export`, which are the agent's own, in words; None for anything else."""
        if command == "export":
            return await export.hand_over(
                self.session, self.environment.store, self.origin, self.environment.answer_timeout_s
            )
        return self.stopped

    async def _think(self, situation: model.Situation, wanted: bool) -> None:
        """The preliminary thought, and the session's name."""
        if wanted:
            await self._inferences.think(situation)
        if self._named:  # only now, so that the thought is the first thing that people see of the turn
            self.session.record(updates.title(self._named))

    async def _run(self, call: model.Call, tools: dict[str, Tool]) -> None:
        if call.name == PLAN_TOOL and self._show_plan(call.arguments):
            return
        if call.name == prompts.ASK_TOOL and await self._ask_person(call.arguments):
            return
        tool = tools.get(call.name)
        self._calls += 1
        call_id = f"{self.id}.{self._calls}"
        self._open.append(call_id)
        if tool is None or call.arguments is None:
            tool = tool or Tool(call.name, "", {}, call.name, None, None)
            known = "The arguments are not what the tool takes."
            if call.name not in (*tools, PLAN_TOOL, prompts.ASK_TOOL):
                known = f"There is no tool {call.name}."
            self.session.record(updates.tool_call(call_id, tool, call.arguments or {}, "pending"))
            self._end(call_id, updates.tool_status(call_id, "failed", known))
            return
        arguments = call.arguments
        mode = self.session.row.mode
        shows = self.environment.policy.previews(mode, tool.traits)
        if shows and tool.preview:
            arguments = arguments | {tool.preview: True}
        looks = shows or tool.read_only is True
        status: updates.ToolStatus = "in_progress" if looks else "pending"
        phase = phase_of(tool.traits, looks)
        self.session.record(updates.tool_call(call_id, tool, arguments, status, phase))
        if not looks:
            await self._take_control(call_id, tool)
        try:
            if shows or await self._allowed(call_id, tool, arguments):
                self._rehearsed = False  # a motion takes the place of what was only computed
                await self._execute(call_id, tool, arguments, phase, looks, self._drawn(call_id) if shows else None)
        finally:
            if self._rehearsed:  # however the question ended
                self._rehearsed = False
                await self.environment.link.forget_preview(call_id)

    def _drawn(self, call_id: str) -> dict[str, Any] | None:
        """The `_meta` of a call that only shows its way: while another turn has the robot, people may be asked about
        that one's, and this must not be drawn over it."""
        free = self.environment.lease.holder in (None, self._claim)
        return preview.drawn_for(call_id) if free else None

    async def _take_control(self, call_id: str, tool: Tool) -> None:
        """Hold the robot from the first action to the end of the turn; wait, and say for whom, while another has it.

        This comes before the question to people, so that they allow what happens now, and before the mode is looked
        at for good, so that one that changed meanwhile counts.
        """
        if self._claim is not None or self._decide(tool) == "deny":
            return  # a call that is denied needs no robot
        lease = self.environment.lease
        holder = lease.holder
        self._claim = Claim(self.session.id, self.asker.name, self._lose)
        if not lease.ask(self._claim):
            owner = f"{holder.by} has" if holder else "somebody else has"
            why = f"waiting for the robot, which {owner} now"
            self.session.record(updates.tool_waits(call_id, why, {"for": "robot"}))
            with self._phases.during("waiting"):
                await lease.wait(self._claim)

    async def _allowed(self, call_id: str, tool: Tool, arguments: dict[str, Any]) -> bool:
        """Whether the call may run; if not, it has been ended with the reason."""
        mode = self.session.row.mode
        decision = self._decide(tool)
        if decision == "deny":
            name = next(m.name for m in MODES if m.id == mode)
            self._end(call_id, updates.tool_status(call_id, "failed", f"not allowed in the mode {name}"))
            return False
        if decision == "allow":
            return True
        try:
            verdict = self._remembered(tool) or await self._ask(call_id, tool, arguments)
        except preview.Refused as refused:
            self._end(call_id, updates.tool_result(call_id, refused.result))
            return False
        if not verdict.allowed:
            self._end(call_id, updates.tool_status(call_id, "failed", verdict.refusal, verdict))
            return False
        # A mode that was changed while people thought about it counts.
        if self._decide(tool) == "deny":
            self._end(call_id, updates.tool_status(call_id, "failed", "the mode was changed meanwhile", verdict))
            return False
        self.session.record(updates.tool_status(call_id, "in_progress", verdict=verdict))
        return True

    def _decide(self, tool: Tool) -> Decision:
        row = self.session.row
        return self.environment.policy.decide(row.mode, tool.traits, self.asker.role, row.motion_asks)

    def _remembered(self, tool: Tool) -> Verdict | None:
        remembered = self.session.remembered.get(tool.name)
        if remembered is None or (remembered and tool.name in self.environment.four_eyes):
            return None
        return Verdict(remembered, "remembered", "allow_always" if remembered else "reject_always")

    async def _ask(self, call_id: str, tool: Tool, arguments: dict[str, Any]) -> Verdict:
        """What people say to the call, who see what it would do. Raises `preview.Refused`, and then asks nobody."""
        environment = self.environment
        shown = updates.tool_call(call_id, tool, arguments, "pending")
        del shown["sessionUpdate"]
        asker = self.asker.name
        not_by = asker if tool.name in environment.four_eyes else None
        desk = self.session.desk
        if (
            environment.link.state and environment.link.state.stop
        ):  # a release that was answered counts before it is heard of
            preview.not_stopped(tool, await environment.link.anew())
        if not desk.attended(not_by):
            return Verdict(False, "nobody")
        way: dict[str, Any] | None = None
        if environment.preview and tool.can_preview:
            self._rehearsed = True
            with self._phases.during("tools"):
                way = await preview.rehearsed(environment.tools, tool, arguments, call_id)
        # Those who are not asked, as the visitor who wants it, see why nothing happens.
        waits = {"for": "permission", "timeout_s": desk.timeout_s}
        self.session.record(updates.tool_waits(call_id, "waiting for somebody who may allow it", waits))
        # A question must not overtake the announcement of the call that it is about.
        await self.session.flushed()
        with self._phases.during("person"):
            return await desk.ask(self.session.id, shown, tool.title, asker, not_by, way)

    async def _execute(
        self,
        call_id: str,
        tool: Tool,
        arguments: dict[str, Any],
        phase: Phase,
        looks: bool,
        meta: dict[str, Any] | None,
    ) -> None:
        if not looks:
            self._acted = True
            self.session.record(updates.tool_status(call_id, "in_progress"))
        last = 0.0

        def show(progress: Progress) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last >= PROGRESS_EVERY_S and call_id in self._open:
                last = now
                self.session.record(updates.tool_progress(call_id, progress))

        with self._phases.during(phase):
            if tool.server is None:
                result = await self.environment.tools.call(tool.name, arguments, show, meta)
            else:
                result = await self.session.offered.call(tool.name, arguments, show)
        self._end(call_id, updates.tool_result(call_id, result))

    def _lose(self, why: str) -> None:
        self._lost = why
        self.session.cancel()

    def _end(self, call_id: str, update: updates.Update) -> None:
        self._open.remove(call_id)
        self.session.record(update)

    def _close_calls(self, why: str) -> None:
        for call_id in list(self._open):
            self._end(call_id, updates.tool_status(call_id, "failed", why))

    async def _ask_person(self, arguments: dict[str, Any] | None) -> bool:
        """Let a person choose; false when the arguments are no question."""
        question, options = (arguments or {}).get("question"), (arguments or {}).get("options")
        if not isinstance(question, str) or not isinstance(options, list) or len(options) < 2:
            return False
        options = [str(option) for option in options]
        self._calls += 1
        call_id = f"{self.id}.{self._calls}"
        self._open.append(call_id)
        asking = Tool(prompts.ASK_TOOL, "", {}, question, None, True)
        shown = updates.tool_call(call_id, asking, {}, "in_progress", "person")
        self.session.record(shown | {"rawInput": {"question": question, "options": options}})
        try:
            with self._phases.during("person"):
                answer, by = await elicitation.choose(
                    self.session, self.origin, question, options, self.environment.answer_timeout_s
                )
        except elicitation.NoAnswerError as nobody:
            self._end(call_id, updates.tool_status(call_id, "failed", str(nobody)))
        else:
            result = ToolResult(False, [updates.text_block(answer)], {"answer": answer, "by": by})
            self._end(call_id, updates.tool_result(call_id, result))
        return True

    def _show_plan(self, arguments: dict[str, Any] | None) -> bool:
        """Show a plan; false when it is none, so that the model is told."""
        shown = updates.plan((arguments or {}).get("entries"))
        if shown is not None:
            self.session.record(shown)
        return shown is not None

    def _situation(self, tools: dict[str, Tool]) -> model.Situation:
        row = self.session.row
        mode = next(m for m in MODES if m.id == row.mode)
        judged = {
            name: self._decide(tool)
            for name, tool in tools.items()
            if not self.environment.policy.previews(row.mode, tool.traits)
        }
        return model.Situation(
            robot=self.environment.robot_name,
            mode=mode.name,
            mode_text=mode.description,
            asks=tuple(name for name, decision in judged.items() if decision == "ask"),
            denied=tuple(name for name, decision in judged.items() if decision == "deny"),
            start=model.StartPose.of(row.start_pose),
        )

    def _name_session(self) -> str | None:
        """Name a session that has no name after its first prompt."""
        text = " ".join(block["text"] for block in self.prompt if block.get("type") == "text")
        text = text.replace("\0", "").strip()  # PostgreSQL takes none in a title
        if self.session.row.title is not None or not text:
            return None
        name = (text[:77] + "…") if len(text) > 78 else text
        self.session.change(title=name)
        return name
