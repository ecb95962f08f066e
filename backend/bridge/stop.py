"""A stop from a browser: to the robot's server at once, and where that may not suffice, to the agent as well.

Our robot server keeps a stop, so the agent has nothing to add. Of any other robot, and after a stop that failed, the
agent is asked to cancel the turns of all sessions. A stop waits for nothing else, and its answer comes within a few
seconds. It never says that the robot has stopped unless the robot's own server has said so.
"""

from __future__ import annotations

import asyncio
from typing import Any

import orjson

from backend import dial, wire
from backend import meta as keys
from backend.bridge.login import Login
from backend.robot_server import OWN_STOP, NotStopped, RobotError, RobotServerClient

_AGENT_SECONDS = 2.5
_NO_AGENT = "The agent does not answer, so its turns were not cancelled either."
_OTHER_AGENT = "This agent cannot cancel the turns of all people; cancel in each session."


class RobotStop:
    """The stop of one robot. `agent` is the address of the agent that drives it: `tcp://HOST:PORT`, or a command, which
    is started for each client and so cannot cancel for others."""

    def __init__(self, robot: RobotServerClient, agent: str) -> None:
        self._robot = robot
        self._agent = dial.Address.parse(agent, None) if agent.startswith("tcp:") else None

    async def press(self, login: Login) -> dict[str, Any]:
        """Stop the robot: `{"stopped": {by, at}}`. Raises `RobotError` with a sentence for the person who pressed."""
        if self._robot.is_ours:
            try:
                return await self._robot.stop(login.identity.name)
            except NotStopped as failed:
                return _settled(failed, await self._through_agent(login))
        told = asyncio.ensure_future(self._through_agent(login))
        try:
            stopped = await self._robot.stop(login.identity.name)
        except NotStopped as failed:
            return _settled(failed, await told)
        await told  # its turns are to end also when the robot has stopped: it may not stay stopped
        return stopped

    async def _through_agent(self, login: Login) -> dict[str, Any] | str:
        """The agent's stop, or a sentence that says why there is none."""
        if self._agent is None:
            return _OTHER_AGENT
        try:
            async with asyncio.timeout(_AGENT_SECONDS):
                stream = await dial.dial(self._agent)
                try:
                    return await _ask(stream, login.token)
                finally:
                    await stream.close()
        except (OSError, TimeoutError, dial.Lost, wire.BadFrame):
            return _NO_AGENT


async def _ask(stream: dial.Stream, token: str) -> dict[str, Any] | str:
    about = {"protocolVersion": 1, "clientCapabilities": {}, "_meta": {keys.TOKEN: token}}
    for request_id, method, params in ((1, "initialize", about), (2, "_robot/stop", {})):
        request = {"jsonrpc": "2.0", "id": request_id, "method": method, "params": params}
        await stream.send(orjson.dumps(request))
        while (answer := wire.check(await stream.receive())).kind != "response" or answer.id != request_id:
            pass
        if "error" in answer.body:
            break
    result, error = answer.body.get("result"), answer.body.get("error")
    if isinstance(result, dict) and isinstance(result.get("stopped"), dict):
        return {"stopped": result["stopped"]}
    if isinstance(error, dict) and isinstance(error.get("data"), dict) and "cancelled" in error["data"]:
        raise RobotError(str(error.get("message")))
    return _OTHER_AGENT


def _settled(failed: NotStopped, told: dict[str, Any] | str) -> dict[str, Any]:
    """The agent's stop in place of ours, which failed. Raises `RobotError` where the agent has none, either."""
    if isinstance(told, dict):
        return told
    raise RobotError(f"{failed.reason} {told} {OWN_STOP}") from failed
