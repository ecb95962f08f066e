"""What the connections of one agent share: settings, sessions, the robot's tools and state, what turns work with."""

from __future__ import annotations

from dataclasses import dataclass

from backend.agent.journal import Journal
from backend.agent.offers import AllowList
from backend.agent.people import People
from backend.agent.robot_link import RobotLink
from backend.agent.sessions import Sessions
from backend.agent.turn import Workbench
from backend.config import Settings
from backend.tokens import Registry


@dataclass(frozen=True)
class House:
    """One agent. `models` are the names that people may choose, the default first; `offers`
    judges the MCP servers that clients bring."""

    settings: Settings
    tokens: Registry
    sessions: Sessions
    journal: Journal
    link: RobotLink
    bench: Workbench
    models: tuple[str, ...]
    offers: AllowList
    people: People
