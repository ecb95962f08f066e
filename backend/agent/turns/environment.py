"""What every turn of the agent works with. Nothing in it belongs to one session or one turn."""

from __future__ import annotations

from dataclasses import dataclass, field

from backend.agent.control.lease import Lease
from backend.agent.control.policy import Policy
from backend.agent.robot.mcp_client import McpClient
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.store import Store
from backend.agent.turns import providers
from backend.agent.turns.inferences import Infer
from backend.audit import Audit


@dataclass(frozen=True)
class TurnEnvironment:
    """One for the whole agent. Times are in seconds."""

    robot_name: str
    tools: McpClient
    """The robot's own tools."""
    policy: Policy
    link: RobotClient
    store: Store
    lease: Lease
    thought_timeout_s: float
    max_steps: int
    """Inferences of one turn at most, the preliminary thought not counted."""
    answer_timeout_s: float
    """The time that a person has to answer a question of the model, or to take a file."""
    four_eyes: frozenset[str] = frozenset()
    """The tools that somebody other than the asker must allow."""
    preview: bool = True
    """Whether people see what a call would do before they are asked to allow it."""
    infer: Infer = providers.stream
    audit: Audit = field(kw_only=True)
    """Is told who allowed and refused which tool call."""
