"""The bridge's fixed limits and timers in one place. They are no settings: people have no reason to change them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Times are in s."""

    first_frame_seconds: float = 25.0
    """A client that has not sent `initialize` by then is disconnected; a little sooner than the agent would do it."""
    stall_seconds: float = 15.0
    """A side that takes nothing of what waits for it during this time is disconnected."""
    agent_exit_seconds: float = 2.0
    """How long an agent on stdio may take to exit, first after its stdin is closed, then after SIGTERM."""
    health_age_seconds: float = 1.0
    """How old the answer of `/api/health` may be."""
    pages_per_login: int = 32
    """More than one person opens, so that one login alone never takes all the room."""
