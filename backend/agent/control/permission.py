"""THE PERMISSION RULE: may this tool call run? Read `Permission.verdict` from top to bottom.

Its parts are `policy.py`, the tables of what a mode allows; `approvers.py`, the request to people; `preview.py`, what
people see before they answer. The language model takes no part in any of them. Nothing but an "allow" of the policy or
of a person lets a call run, and whoever calls this must run no call without its verdict.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

from backend.agent.acp import updates
from backend.agent.control import preview
from backend.agent.control.approvers import Outcome
from backend.agent.control.policy import Decision, Policy, mode_info
from backend.agent.robot.mcp_client import McpClient, Tool, ToolResult
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.session import Session
from backend.agent.turns.phases import Phases
from backend.audit import Audit
from backend.identity import Identity

_TWO_PEOPLE = (
    "refused: two people have to agree on this, and nobody knows who asked. Log in with a token of your own, then ask "
    "again"
)


@dataclass(frozen=True)
class ToolCall:
    """A tool call that the model proposes. `only_plans` says that the arguments let the robot plan a path and not move,
    as the policy wants it in the mode "plan"."""

    id: str
    tool: Tool
    arguments: dict[str, Any]
    only_plans: bool = False


@dataclass(frozen=True)
class Verdict:
    """Whether a tool call may run, and why not.

    `reason` tells in words for people and the model why not. It is None where the call may run, and where the robot
    itself refused the preview: `robot_refusal` is then the robot's answer. `outcome` is the people's answer, given now
    or remembered; None where they were not asked.
    """

    allowed: bool
    reason: str | None = None
    outcome: Outcome | None = None
    robot_refusal: ToolResult | None = None


@dataclass(eq=False)
class Permission:
    """Decides on the tool calls of one turn, which `asker` started in `session`.

    `four_eyes` are the names of the tools that somebody other than the asker has to allow each time, in every mode;
    tokens have to prove both. `previews` says whether people see what a call would do before they answer. `audit` is
    told every answer.
    """

    session: Session
    asker: Identity
    policy: Policy
    four_eyes: Collection[str]
    previews: bool
    robot_tools: McpClient
    robot: RobotClient
    phases: Phases
    audit: Audit
    _drawn: str | None = field(default=None, init=False)
    """The id of the call whose path the robot may be drawing for people who are asked; None otherwise."""

    async def verdict(self, call: ToolCall) -> Verdict:
        """Whether `call` may run."""
        if call.only_plans:
            return Verdict(True)  # it moves nothing
        # 1. The policy decides.
        decision = self.decide(call.tool)
        if decision == "deny":
            return Verdict(False, f"not allowed in the mode {mode_info(self.session.row.mode).name}")
        if decision == "allow":
            return Verdict(True)
        # 2. It says "ask": an answer that counts for the whole session is used, or else people are asked.
        if self._needs_two(call.tool) and not self.asker.proven:
            return Verdict(False, _TWO_PEOPLE)
        try:
            outcome = self._remembered(call.tool)
            if outcome is None:
                outcome = await self._ask(call)
                self._record(call.tool, outcome)
        except preview.RefusedByRobot as refused:
            return Verdict(False, robot_refusal=refused.result)
        if not outcome.allowed:
            return Verdict(False, outcome.refusal, outcome)
        # 3. The policy decides again: the mode can have been changed while people thought about it.
        if self.decide(call.tool) == "deny":
            return Verdict(False, "the mode was changed meanwhile", outcome)
        self._drawn = None  # a motion that is allowed replaces its preview
        return Verdict(True, outcome=outcome)

    def decide(self, tool: Tool) -> Decision:
        """The policy's decision on a tool, for this asker and the settings that the session has now. No mode and no
        setting of a session allows a tool of four eyes without asking."""
        row = self.session.row
        decision = self.policy.decide(row.mode, tool.traits, self.asker.role, row.motion_asks)
        return "ask" if decision == "allow" and self._needs_two(tool) else decision

    def _needs_two(self, tool: Tool) -> bool:
        return tool.name in self.four_eyes

    async def forget_preview(self) -> None:
        """Let the robot draw no path any longer for a call that was asked about and is not allowed.

        To be called once for each call, after its verdict, also where the verdict was cancelled.
        """
        call_id, self._drawn = self._drawn, None
        if call_id is not None:
            await self.robot.forget_preview(call_id)

    def _remembered(self, tool: Tool) -> Outcome | None:
        """The answer that was chosen for the rest of the session, for this very tool: not for another server under the
        same name, nor for other parameters. An "allow" never counts for a tool of four eyes."""
        allowed = self.session.history.answer_for(tool.fingerprint)
        if allowed is None or (allowed and self._needs_two(tool)):
            return None
        return Outcome(allowed, "remembered", "allow_always" if allowed else "reject_always")

    async def _ask(self, call: ToolCall) -> Outcome:
        """Ask people, who see what the call would do. Raises `RefusedByRobot`; nobody has been asked then."""
        requests, tool = self.session.permission_requests, call.tool
        other_than = self.asker if self._needs_two(tool) else None
        if self.robot.state and self.robot.state.stop:
            # The stop may have been released already: the state that the telemetry brought can be older than that.
            preview.refuse_if_stopped(tool, await self.robot.anew())
        if not requests.has_approver(other_than):
            return Outcome(False, "nobody")
        path = await self._preview(call)
        # People who are not asked, for instance the visitor who started the turn, see why nothing happens.
        waits = {"for": "permission", "timeout_s": requests.timeout_s}
        self.session.record(updates.tool_waits(call.id, "waiting for somebody who may allow it", waits))
        await self.session.flushed()  # the request must not overtake the announcement of its call
        announced = updates.tool_call(call.id, tool, call.arguments, "pending")
        del announced["sessionUpdate"]
        with self.phases.during("person"):
            outcome = await requests.ask(self.session.id, announced, tool.title, self.asker.name, other_than, path)
        if outcome.option is not None and outcome.option.endswith("_always"):
            return replace(outcome, fingerprint=tool.fingerprint)
        return outcome

    def _record(self, tool: Tool, outcome: Outcome) -> None:
        self.audit.record(
            "permission",
            outcome.identity or outcome.by,
            tool=tool.name,
            answer=outcome.option or outcome.reason,
            asked_by=self.asker.name,
            asked_by_token=self.asker.token_id,
            session=self.session.id,
        )

    async def _preview(self, call: ToolCall) -> dict[str, Any] | None:
        """What people are told of the path; None where the tool has no preview. Raises `RefusedByRobot`."""
        if not (self.previews and call.tool.can_preview):
            return None
        self._drawn = call.id
        with self.phases.during("tools"):
            return await preview.compute(self.robot_tools, call.tool, call.arguments, call.id)
