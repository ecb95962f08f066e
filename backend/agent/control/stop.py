"""A stop from an ACP client: the robot's own stop, and where that may not suffice, the end of every turn.

Our robot server keeps a stop until somebody releases it, and refuses motion meanwhile; so turns need not end. Nobody
knows that of another robot, and of no robot after a stop that failed. Then the turns of all sessions are cancelled, and
with them their tool calls. Nothing here claims that a robot has stopped: only its own server can say so.
"""

from __future__ import annotations

from typing import Any

from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.sessions import Sessions
from backend.audit import Audit
from backend.identity import Identity
from backend.robot_server import OWN_STOP, NotStopped, RobotError


class StopFailed(RobotError):
    """The robot has not confirmed the stop; the text says what was cancelled instead. `cancelled` counts the turns."""

    def __init__(self, reason: str, cancelled: int) -> None:
        super().__init__(f"{reason} {_in_words(cancelled)} {OWN_STOP}")
        self.cancelled = cancelled


async def stop(robot: RobotClient, sessions: Sessions, by: Identity, audit: Audit) -> dict[str, Any]:
    """Stop the robot in the name of `by`: `{"stopped": {by, at}}`. Raises `StopFailed`."""
    confirmed = False
    cancelled = 0 if robot.keeps_a_stop else sessions.cancel_all()
    try:
        stopped = await robot.stop(by.name)
        confirmed = True
        return stopped
    except NotStopped as failed:
        if robot.keeps_a_stop:
            cancelled = sessions.cancel_all()
        raise StopFailed(failed.reason, cancelled) from failed
    finally:  # also where the person who pressed has gone meanwhile
        audit.record("stop", by, confirmed=confirmed)


def _in_words(turns: int) -> str:
    if turns == 0:
        return "No turn was running."
    if turns == 1:
        return "The turn that ran was cancelled, and with it its call to the robot."
    return f"All {turns} turns were cancelled, and with them their calls to the robot."
