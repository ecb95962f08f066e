"""The tool calls of one turn, each from its announcement to its end.

Whether a call may run is decided in `permission.py`, whether a motion is safe in the robot server. Every call that is
announced here also ends here, and a call that acts runs only while the turn has the control lease.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from backend.agent.acp import updates
from backend.agent.control import preview
from backend.agent.control.lease import Claim
from backend.agent.control.permission import Permission, ToolCall, Verdict
from backend.agent.robot.mcp_client import Progress, Tool, ToolResult
from backend.agent.sessions.history import PLAN_TOOL
from backend.agent.sessions.session import Listener, Session
from backend.agent.turns import elicitation, model, prompts
from backend.agent.turns.environment import TurnEnvironment
from backend.agent.turns.phases import Phases, phase_of
from backend.agent.turns.plan import Plan

PROGRESS_EVERY_S = 0.5


@dataclass(eq=False)
class ToolCalls:
    """The calls of the turn `turn_id`, which `asker` started over the connection `origin`."""

    environment: TurnEnvironment
    session: Session
    turn_id: str
    asker: str
    origin: Listener | None
    permission: Permission
    phases: Phases
    acted: bool = field(default=False, init=False)
    """Whether a call that acts has begun, so that the robot may be moving."""
    revoked: str | None = field(default=None, init=False)
    """Why the lease was revoked, as the first half of a sentence; None while it was not."""
    _claim: Claim | None = field(default=None, init=False)
    _open: dict[str, str] = field(default_factory=dict, init=False)
    """The ids of the calls that were announced and have not ended, and the kind of each, which is its phase."""
    _number: int = field(default=0, init=False)
    _plan: Plan = field(default_factory=Plan, init=False)

    @property
    def taken_by(self) -> str | None:
        """The name of the person who took the robot over from this turn; None where nobody did."""
        return self._claim.taken_by if self._claim else None

    async def run(self, proposed: model.Call, tools: dict[str, Tool]) -> None:
        """Run a call that the model proposes, and record how it ends."""
        if proposed.name == PLAN_TOOL and self._show_plan(proposed.arguments):
            return
        if proposed.name == prompts.ASK_TOOL and await self._ask_person(proposed.arguments):
            return
        tool = tools.get(proposed.name)
        if tool is None or proposed.arguments is None:
            self._refuse_malformed(proposed, tool, tools)
            return
        call = self._announced(tool, proposed.arguments)
        acts = not call.only_plans and tool.read_only is not True
        if acts:
            await self._take_control(call)
        try:
            verdict = await self.permission.verdict(call)
            if verdict.allowed:
                if verdict.outcome is not None:
                    self.session.record(updates.tool_status(call.id, "in_progress", outcome=verdict.outcome))
                await self._execute(call, acts)
            else:
                self._end_refused(call, verdict)
        finally:
            await self.permission.forget_preview()

    def close(self, why: str) -> None:
        """End every open call as failed, for the reason `why`."""
        for call_id in list(self._open):
            self._end(call_id, updates.tool_status(call_id, "failed", why))

    def release(self) -> None:
        """Give the control lease back, or leave its queue."""
        if self._claim:
            self.environment.lease.release(self._claim)

    def _next_id(self, kind: str) -> str:
        self._number += 1
        call_id = f"{self.turn_id}.{self._number}"
        self._open[call_id] = kind
        return call_id

    def _announced(self, tool: Tool, arguments: dict[str, Any]) -> ToolCall:
        only_plans = self.environment.policy.previews(self.session.row.mode, tool.traits)
        if only_plans and tool.preview:
            arguments = arguments | {tool.preview: True}
        reads = only_plans or tool.read_only is True
        phase = phase_of(tool.traits, reads)
        call = ToolCall(self._next_id(phase), tool, arguments, only_plans)
        status: updates.ToolStatus = "in_progress" if reads else "pending"
        self.session.record(updates.tool_call(call.id, tool, arguments, status, phase))
        return call

    def _refuse_malformed(self, proposed: model.Call, tool: Tool | None, tools: dict[str, Tool]) -> None:
        why = "The arguments are not what the tool takes."
        if proposed.name not in (*tools, PLAN_TOOL, prompts.ASK_TOOL):
            why = f"There is no tool {proposed.name}."
        shown = tool or Tool(proposed.name, "", {}, proposed.name, None, None)
        call_id = self._next_id(phase_of(shown.traits, shown.read_only is True))
        self.session.record(updates.tool_call(call_id, shown, proposed.arguments or {}, "pending"))
        self._end(call_id, updates.tool_status(call_id, "failed", why))

    async def _take_control(self, call: ToolCall) -> None:
        """Take the control lease at the first call that acts; the turn has it to its end. Where another turn has the
        lease, say whose, and wait.

        This comes before the permission, so that people allow what happens now, and a mode that is changed during the
        wait counts.
        """
        if self._claim is not None or self.permission.decide(call.tool) == "deny":
            return  # a call that is denied needs no robot
        lease = self.environment.lease
        holder = lease.holder
        self._claim = Claim(self.session.id, self.asker, self._revoke)
        if not lease.ask(self._claim):
            owner = f"{holder.by} has" if holder else "somebody else has"
            why = f"waiting for the robot, which {owner} now"
            self.session.record(updates.tool_waits(call.id, why, {"for": "robot"}))
            with self.phases.during("waiting"):
                await lease.wait(self._claim)

    def _revoke(self, why: str) -> None:
        self.revoked = why
        self.session.cancel()

    async def _execute(self, call: ToolCall, acts: bool) -> None:
        if acts:
            self.acted = True
            self.session.record(updates.tool_status(call.id, "in_progress"))
        shown_at = 0.0

        def show(progress: Progress) -> None:
            nonlocal shown_at
            now = time.monotonic()
            if now - shown_at >= PROGRESS_EVERY_S and call.id in self._open:
                shown_at = now
                self.session.record(updates.tool_progress(call.id, progress))

        with self.phases.during(phase_of(call.tool.traits, not acts)):
            if call.tool.server is None:
                meta = self._drawing(call.id) if call.only_plans else None
                result = await self.environment.tools.call(call.tool.name, call.arguments, show, meta)
            else:
                result = await self.session.client_servers.call(call.tool.name, call.arguments, show)
        self._end(call.id, updates.tool_result(call.id, result))

    def _drawing(self, call_id: str) -> dict[str, Any] | None:
        """The `_meta` of a call that only plans, so that the robot draws the path. None while another turn has the
        robot: people may be asked about that turn's path, and this one must not be drawn over it."""
        free = self.environment.lease.holder in (None, self._claim)
        return preview.draw_path(call_id) if free else None

    def _end_refused(self, call: ToolCall, verdict: Verdict) -> None:
        if verdict.robot_refusal is not None:
            self._end(call.id, updates.tool_result(call.id, verdict.robot_refusal))
        else:
            self._end(call.id, updates.tool_status(call.id, "failed", verdict.reason, verdict.outcome))

    def _end(self, call_id: str, update: updates.Update) -> None:
        self._plan.call_ended(self._open.pop(call_id), failed=update["status"] == "failed")
        self.session.record(update)

    async def _ask_person(self, arguments: dict[str, Any] | None) -> bool:
        """Let a person choose one of several options; false when the arguments are no such question."""
        question, options = (arguments or {}).get("question"), (arguments or {}).get("options")
        if not isinstance(question, str) or not isinstance(options, list) or len(options) < 2:
            return False
        options = [str(option) for option in options]
        call_id = self._next_id("person")
        asking = Tool(prompts.ASK_TOOL, "", {}, question, None, True)
        announced = updates.tool_call(call_id, asking, {}, "in_progress", "person")
        self.session.record(announced | {"rawInput": {"question": question, "options": options}})
        try:
            with self.phases.during("person"):
                answer, by = await elicitation.choose(
                    self.session, self.origin, question, options, self.environment.answer_timeout_s
                )
        except elicitation.NoAnswerError as no_answer:
            self._end(call_id, updates.tool_status(call_id, "failed", str(no_answer)))
        else:
            result = ToolResult(False, [updates.text_block(answer)], {"answer": answer, "by": by})
            self._end(call_id, updates.tool_result(call_id, result))
        return True

    def _show_plan(self, arguments: dict[str, Any] | None) -> bool:
        """Show a plan; false when the arguments are no plan, so that the model is told."""
        plan = updates.plan((arguments or {}).get("entries"))
        if plan is not None:
            self.session.record(plan | {"entries": self._plan.revised(plan["entries"])})
        return plan is not None
