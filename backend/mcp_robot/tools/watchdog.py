"""The watchdog: the client that moves the robot has to give signs of life; when it is silent, its motion ends.

A connection that breaks is noticed at once. One that stands proves nothing: behind a half-open connection, a proxy or a
stopped process, the kernel goes on to acknowledge. So the client's program itself has to answer:

- under the handshake versions of the MCP protocol the server sends MCP's `ping`, which every client answers;
- protocol 2026-07-28 forbids a server to ask. There a client may name itself (`_meta` key CALLER) and promise to call
  some tool as often as the tools' `_meta` SIGN_OF_LIFE says; each call that carries the name is a sign of life;
- a client that does neither gives no sign of life, and may move the robot for a limited time only.

Silence counts only while this process runs: while a busy computer suspended it, it could not have received anything.

It stands among the tools and not in the motion room, because it judges the client of a tool call by MCP's messages, and
motion knows no MCP. It halts nothing: silence is an exception in the task of the tool call, whose motion ends with it.
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
"""Characters of the name that a client gives itself."""
PAUSE_SHARE = 0.25
"""Share of the allowed silence that passes before the next ping; the rest is for its answer."""
CHECKS = 10
"""How often the clock is read within a limit. However late a reading comes, it counts for two intervals at most."""


class Silence:
    """Measures how long a client has been silent, until that is `limit` s."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._interval = limit / CHECKS
        self._seconds = 0.0  # of silence so far, grows at each reading of the clock
        self._read_at = asyncio.get_running_loop().time()  # when the clock was read last

    def broken(self) -> None:
        """The client gave a sign of life: the silence begins anew."""
        self._seconds = -self._since_reading()

    async def end(self) -> None:
        """Return once it has lasted for its limit, counting only the time in which this process ran."""
        while (left := self._limit - self._seconds) > 0:
            self._read_at = asyncio.get_running_loop().time()
            await asyncio.sleep(min(left, self._interval))
            self._seconds += self._since_reading()

    def _since_reading(self) -> float:
        return min(asyncio.get_running_loop().time() - self._read_at, 2 * self._interval)


class Callers:
    """The clients that have named themselves, while one of their calls acts."""

    def __init__(self) -> None:
        self._silences: dict[str, set[Silence]] = {}  # name -> one silence for each of the client's calls that act

    def hear(self, name: str) -> None:
        """Note that a call with this name came in. Names without a call that acts are ignored."""
        for silence in self._silences.get(name, ()):
            silence.broken()

    async def listen(self, name: str, limit: float) -> None:
        """Return when no call has come in from `name` for `limit` seconds."""
        silence = Silence(limit)
        silences = self._silences.setdefault(name, set())
        silences.add(silence)
        try:
            await silence.end()
        finally:
            silences.discard(silence)
            if not silences:
                self._silences.pop(name, None)


def announced(limits: Limits) -> dict[str, Any]:
    """The sign of life that the server asks for, as the `_meta` of a tool that acts."""
    return {keys.SIGN_OF_LIFE: {"within": limits.client_silence, "tool": "get_robot_status"}}


def caller(meta: Mapping[str, Any] | None) -> str | None:
    """The name that a client gives itself in a request's `_meta`; None without one that can be used."""
    name = (meta or {}).get(keys.CALLER)
    return name if isinstance(name, str) and 0 < len(name) <= MAX_NAME else None


def admit(context: Context[Any, Any], limits: Limits) -> None:
    """The rule before anything begins: the client can give signs of life, or may act without them for a while. Raises
    `Refusal` (no_sign_of_life)."""
    if not (limits.unheard_motion or context.session.can_send_request or caller(context.request_context.meta)):
        raise Refusal(
            "no_sign_of_life",
            f"Nothing moves for a client that cannot be heard. Name yourself under {keys.CALLER} in the _meta of the "
            f"call and call get_robot_status with it every {limits.client_silence / 2:g} s.",
        )


async def watch(context: Context[Any, Any], callers: Callers, limits: Limits) -> None:
    """Watch the client of this call. Never returns; raises `Refusal` (silent, no_sign_of_life)."""
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
    """Ask again and again. Return when an answer is missing: `limit` seconds after the answer before it."""
    while True:
        answer = asyncio.create_task(ask())
        silence = asyncio.create_task(Silence((1 - PAUSE_SHARE) * limit).end())
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
        await asyncio.sleep(PAUSE_SHARE * limit)


async def _ping(context: Context[Any, Any]) -> None:
    """Return when the client has answered, be it with an error. Raises `TimeoutError` when its connection is gone."""
    # Without the related request, a server over HTTP has no stream on which the ping could reach the client.
    on_this_call = ServerMessageMetadata(related_request_id=context.request_context.request_id)
    try:
        await context.session.send_request(PingRequest(), EmptyResult, metadata=on_this_call)
    except MCPError as error:
        if error.error.code == CONNECTION_CLOSED:
            raise TimeoutError from None
        # Any other error is an answer: the client lives, and does not know the question.
