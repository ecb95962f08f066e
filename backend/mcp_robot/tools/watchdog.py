"""The watchdog: whoever moves the robot must be heard, all the time; a client gone or silent is a motion ended.

A connection that breaks is seen at once. One that stands is no proof: behind a half-open line, a proxy, or a process
that is stopped, the kernel goes on to acknowledge. So the client's program itself has to be heard:

- under the handshake protocols the server sends it MCP's `ping`, which every client answers;
- protocol 2026-07-28 forbids that. There a client may name itself (`_meta` key CALLER) and promise to call some tool as
  often as the tools' `_meta` SIGN_OF_LIFE asks; each call that carries the name is a sign of life;
- one that does neither gives no sign, and may move the robot for a limited time only.

Silence counts only while this process runs: while a busy computer let it stand, it could not have heard anybody.

Here nothing halts: silence is an exception in the task of the tool call, whose motion ends with it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from typing import Any

from mcp.server.mcpserver import Context
from mcp.shared.exceptions import MCPError
from mcp.shared.message import ServerMessageMetadata
from mcp_types import CONNECTION_CLOSED, EmptyResult, PingRequest

from backend import meta as keys
from backend.config import Limits
from backend.mcp_robot.refusal import Refusal

MAX_NAME = 200
SHARE = 0.25
"""Part of the time allowed that passes before the next question; the rest is for the answer."""
LOOKS = 10
"""Looks at the clock within a limit. However late one comes, no more than two of these parts count for it."""


class Silence:
    """How long somebody has not been heard, until that is `limit` s."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._part = limit / LOOKS
        self._seconds = 0.0  # grows at each look
        self._looked = asyncio.get_running_loop().time()

    def broken(self) -> None:
        """Somebody was heard: it begins anew."""
        self._seconds = -self._since_look()

    async def end(self) -> None:
        """Return once it has lasted for its limit, of the time in which this process ran."""
        while (left := self._limit - self._seconds) > 0:
            self._looked = asyncio.get_running_loop().time()
            await asyncio.sleep(min(left, self._part))
            self._seconds += self._since_look()

    def _since_look(self) -> float:
        return min(asyncio.get_running_loop().time() - self._looked, 2 * self._part)


class Callers:
    """Clients that named themselves, while something of theirs goes on."""

    def __init__(self) -> None:
        self._silences: dict[str, set[Silence]] = {}  # of each, one for every call of theirs

    def hear(self, name: str) -> None:
        """A call with this name came in. Only those that are listened for matter."""
        for silence in self._silences.get(name, ()):
            silence.broken()

    async def listen(self, name: str, limit: float) -> None:
        """Return when nothing has come from `name` for `limit` seconds."""
        silence = Silence(limit)
        silences = self._silences.setdefault(name, set())
        silences.add(silence)
        try:
            await silence.end()
        finally:
            silences.discard(silence)
            if not silences:
                self._silences.pop(name, None)


def caller(meta: Mapping[str, Any] | None) -> str | None:
    """How a client names itself in a request's `_meta`; None for a name that cannot be one."""
    name = (meta or {}).get(keys.CALLER)
    return name if isinstance(name, str) and 0 < len(name) <= MAX_NAME else None


def admit(context: Context[Any, Any], limits: Limits) -> None:
    """Before anything begins: the client of this call can be listened for, or may go unheard for a while."""
    if not (limits.unheard_motion or context.session.can_send_request or caller(context.request_context.meta)):
        raise Refusal(
            "no_sign_of_life",
            f"Nothing moves for a client that cannot be heard. Name yourself under {keys.CALLER} in the _meta of the "
            f"call and call get_robot_status with it every {limits.client_silence / 2:g} s.",
        )


async def watch(context: Context[Any, Any], callers: Callers, limits: Limits) -> None:
    """Listen for the client of this call. Raises `Refusal` when it is silent; never returns."""
    name = caller(context.request_context.meta)
    if context.session.can_send_request:
        await _until_unanswered(lambda: _ping(context), limits.client_silence)
    elif name:
        await callers.listen(name, limits.client_silence)
    else:
        await asyncio.sleep(limits.unheard_motion)
        raise Refusal(
            "no_sign_of_life",
            f"This client gives no sign of life, and may act for {limits.unheard_motion:g} s at once; the robot has "
            "halted. Ask again for the rest.",
        )
    raise Refusal("silent", f"The client has been silent for {limits.client_silence:g} s, and the robot has halted.")


async def _until_unanswered(ask: Callable[[], Coroutine[Any, Any, None]], limit: float) -> None:
    """Ask again and again; return when there was no answer within `limit` seconds of the last one."""
    while True:
        answer = asyncio.create_task(ask())
        silence = asyncio.create_task(Silence((1 - SHARE) * limit).end())
        try:
            await asyncio.wait({answer, silence}, return_when=asyncio.FIRST_COMPLETED)
            if not answer.done():
                return
            answer.result()
        except TimeoutError:
            return
        finally:
            for task in (answer, silence):
                task.cancel()
            await asyncio.gather(answer, silence, return_exceptions=True)
        await asyncio.sleep(SHARE * limit)


async def _ping(context: Context[Any, Any]) -> None:
    beside = ServerMessageMetadata(related_request_id=context.request_context.request_id)
    try:
        await context.session.send_request(PingRequest(), EmptyResult, metadata=beside)
    except MCPError as error:
        if error.error.code == CONNECTION_CLOSED:
            raise TimeoutError from None
        # A client that does not know the question has answered all the same.
