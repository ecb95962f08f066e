"""A turn that moved the robot and ended early gives it on at rest, and not before.

Where the robot does not come to rest, or cannot say so, its stop is set and people are told. The turn keeps the control
lease all the time. Nothing here may give up while the robot could still be moving.
"""

from __future__ import annotations

from collections.abc import Callable

from backend.agent.robot.robot_client import RobotClient, RobotError

STOPPED_BY = "the agent"
"""Who set the stop, as people read it: “Stopped by the agent”."""

_UNKNOWN = "This robot does not report its motion. Check that it stands still."
_MOVES = "I still move, although I had to halt"
_SILENT = "I cannot tell whether I stand still, because my telemetry is missing"
_STOP_SET = "so I set the stop. A supervisor has to release it."
_STOP_SENT = "so I sent a stop. Check that it stands still."
_NO_STOP = "and the stop could not be set. Use the robot's own stop button."
_STOP_IGNORED = "I still move, although the stop is set. Use the robot's own stop button."


async def until_at_rest(robot: RobotClient, say: Callable[[str], None]) -> None:
    """Return when the robot's telemetry says that it stands still.

    As long as it does not, the stop is set again and again. `say` shows people a sentence; each is said once. A robot
    server of another make has neither telemetry nor a stop: people are asked to check, and this returns.
    """
    if not robot.reports_motion:
        say(_UNKNOWN)
        return
    said: set[str] = set()
    while not await robot.at_rest():
        sentence = await _set_stop(robot)
        if sentence not in said:
            said.add(sentence)
            say(sentence)


async def _set_stop(robot: RobotClient) -> str:
    """Set the robot's stop, and return the sentence that says so."""
    if robot.state is not None and robot.state.stop is not None:
        return _STOP_IGNORED
    trouble = _SILENT if robot.state is None else _MOVES
    try:
        await robot.stop(STOPPED_BY)
    except RobotError:
        return f"{trouble}, {_NO_STOP}"
    return f"{trouble}, {_STOP_SET if robot.keeps_a_stop else _STOP_SENT}"
