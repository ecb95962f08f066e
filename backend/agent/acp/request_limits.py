"""How much one person may ask for: requests a second, requests at once, and messages that are read.

A person has one account for all logins and connections, over TCP and through the bridge. A connection without a token
has an account of its own. A cancel and a stop are never refused and wait for no other request (`is_urgent`).
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from typing import Any

from acp.exceptions import RequestError

from backend import wire
from backend.agent.acp.content_limits import is_stop
from backend.config import AgentRequests
from backend.identity import Identity
from backend.rates import TokenBucket

BYTES_PER_MESSAGE = 4096
"""A message counts as one more for each so many bytes: reading it takes so much longer."""
TURN = 4
"""After so many messages the reader of a connection lets everybody else have their turn."""
LONGEST_PAUSE_S = 1.0
_ACCOUNTS = 1024
"""Beyond so many, accounts that a new one would equal are forgotten."""

Clock = Callable[[], float]


class Account:
    """What one person asks for at present, over all connections."""

    def __init__(self, settings: AgentRequests, clock: Clock) -> None:
        self.pending = 0
        """Requests and notifications that are being handled."""
        self._settings = settings
        self._clock = clock
        self._requests = TokenBucket(settings.per_second, settings.burst)
        self._messages = TokenBucket(settings.messages_per_second, settings.messages_burst)

    def charge(self, pending_on_connection: int) -> None:
        """Count a request or notification. Raises `RequestError` where it is one too many."""
        most = self._settings
        if pending_on_connection >= most.pending_per_connection or self.pending >= most.pending_per_login:
            raise too_many("Too many requests of this login wait for their answers.", 1.0)
        if wait := self._requests.take(self._clock()):
            raise too_many("This login sends too many requests.", wait)

    def pause_after(self, message_bytes: int) -> float:
        """Count a message that was read, and return how many seconds its connection should not be read."""
        return self._messages.spend(self._clock(), 1 + message_bytes / BYTES_PER_MESSAGE)

    @property
    def is_untouched(self) -> bool:
        """Whether a new account would be the same."""
        now = self._clock()
        return self.pending == 0 and self._requests.is_full(now) and self._messages.is_full(now)


class RequestLimits:
    """The accounts of all persons of one agent."""

    def __init__(self, settings: AgentRequests | None = None, clock: Clock = time.monotonic) -> None:
        self.settings = settings or AgentRequests()
        self._clock = clock
        self._accounts: dict[str, Account] = {}

    def new(self) -> Account:
        """The account of a connection that has no login."""
        return Account(self.settings, self._clock)

    def of(self, who: Identity) -> Account | None:
        """The account of a person, over all logins; None for an identity without a token."""
        if who.token_id is None:
            return None
        account = self._accounts.get(who.person)
        if account is None:
            if len(self._accounts) >= _ACCOUNTS:
                self._accounts = {key: kept for key, kept in self._accounts.items() if not kept.is_untouched}
            account = self._accounts[who.person] = self.new()
        return account


class ReadingPace:
    """When one connection may read its next message."""

    def __init__(self) -> None:
        self._read = 0
        self._pause = 0.0

    def count(self, account: Account, message_bytes: int) -> None:
        """A message was read. It is handled at once, whatever it costs: only the next one waits."""
        self._read += 1
        self._pause = min(account.pause_after(message_bytes), LONGEST_PAUSE_S)

    async def wait(self) -> None:
        """Wait until the next message may be read."""
        if self._pause or self._read % TURN == 0:
            await asyncio.sleep(self._pause)
        self._pause = 0.0


def is_urgent(frame: wire.Frame) -> bool:
    """Whether a message cancels a turn or stops the robot: `session/cancel`, `_robot/stop`, the prompt `/stop`."""
    if frame.method == "session/cancel":
        return frame.kind == "notification"
    if frame.kind != "request":
        return False
    return frame.method == "_robot/stop" or (frame.method == "session/prompt" and _is_stop(frame.body.get("params")))


def too_many(sentence: str, wait: float) -> RequestError:
    """The error for a request beyond a limit; `wait` is in s."""
    seconds = max(1, math.ceil(wait))
    return RequestError(wire.LIMIT_EXCEEDED, f"{sentence} Try again in {seconds} s.", {"retryAfter": seconds})


def _is_stop(params: Any) -> bool:
    blocks = params.get("prompt") if isinstance(params, dict) else None
    return isinstance(blocks, list) and is_stop(blocks)
