"""Wrong logins: how many are answered as such, from one address and in all, before the answer is to wait.

It limits load and noise, and guards no secret: nobody guesses a signed token or a code of 128 bits. So a login that is
right must never be refused here, whoever else sends wrong ones from the same address; callers check the token first.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from backend.audit import Audit
from backend.connections_before_login import network_of
from backend.rates import Buckets, TokenBucket

PER_MINUTE = 30
IN_ALL = 10
"""All addresses together may send so many times as many as one."""
TOO_MANY = "Too many wrong logins from this address."
_QUIET_S = 60.0
"""After so many seconds without a limited login, the next one is a new flood: it is logged."""

log = logging.getLogger(__name__)


class WrongLogins:
    """Counts the refused logins of one process. `per_minute` is of one address, with as many at once."""

    def __init__(
        self, per_minute: int = PER_MINUTE, audit: Audit | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._audit = audit
        self._clock = clock
        self._by_address = Buckets(per_minute / 60, per_minute)
        self._in_all = TokenBucket(IN_ALL * per_minute / 60, IN_ALL * per_minute)
        self._limited_at = float("-inf")  # when a login was answered with a wait last

    def count(self, host: str | None, why: str) -> float:
        """Count a refused login from `host`. Returns the seconds that its sender should wait; 0 within the limit.

        The audit log has each one within the limit, and a flood once.
        """
        now = self._clock()
        wait = self._by_address.take(network_of(host), now) or self._in_all.take(now)
        if not wait:
            self._record(host, why)
            return 0.0
        if now - self._limited_at > _QUIET_S:
            log.warning("many wrong logins, at present from %s: they are answered with a time to wait", host)
            self._record(host, "too many wrong logins; further ones are not recorded")
        self._limited_at = now
        return wait

    def _record(self, host: str | None, why: str) -> None:
        if self._audit is not None:
            self._audit.record("login_refused", address=host, reason=why)
