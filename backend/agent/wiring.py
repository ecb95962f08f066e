"""The parts of one agent that its connections share. Only `server` makes one; nothing is decided here."""

from __future__ import annotations

from dataclasses import dataclass

from backend.agent.acp.abilities import Abilities
from backend.agent.acp.people import People
from backend.agent.acp.request_limits import RequestLimits
from backend.agent.robot.robot_client import RobotClient
from backend.agent.robot.server_addresses import AllowList
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.retention import Retention
from backend.agent.sessions.sessions import Sessions
from backend.agent.turns.environment import TurnEnvironment
from backend.audit import Audit
from backend.config import Settings
from backend.tokens import Registry
from backend.wrong_logins import WrongLogins


@dataclass(frozen=True)
class Wiring:
    """One agent. `models` are the names of the models that people may choose, the default first. `offers` decides which
    MCP servers a client may bring. `link` carries the robot's state, its stop and its release. `requests` limits what a
    login may ask for. `audit` is told who logged in, stopped, released and changed what. `local_token` is what the
    commands of the agent's own user bring where the system does not list users (`local_user`), else None.
    `wrong_logins` counts refused tokens.
    """

    settings: Settings
    tokens: Registry
    sessions: Sessions
    journal: Journal
    retention: Retention
    link: RobotClient
    turns: TurnEnvironment
    models: tuple[str, ...]
    offers: AllowList
    abilities: Abilities
    people: People
    requests: RequestLimits
    audit: Audit
    wrong_logins: WrongLogins
    local_token: str | None = None
