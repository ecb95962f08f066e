"""How fast the bridge reads the WebSockets of one login. Nothing is refused or dropped here: a sender has to wait."""

from __future__ import annotations

import time

from backend.config import BridgeRequests
from backend.rates import TokenBucket

BYTES_PER_MESSAGE = 4096
"""So many bytes count as one message more."""
LONGEST_PAUSE_S = 1.0
_LOGINS = 1024
"""Beyond so many, logins that read nothing at present are forgotten."""


class ReadingPace:
    """The pace of all logins."""

    def __init__(self, settings: BridgeRequests | None = None) -> None:
        self._settings = settings or BridgeRequests()
        self._logins: dict[str, TokenBucket] = {}

    def of(self, login: str) -> TokenBucket:
        """The messages of one login, over all its connections."""
        bucket = self._logins.get(login)
        if bucket is None:
            if len(self._logins) >= _LOGINS:
                now = time.monotonic()
                self._logins = {key: kept for key, kept in self._logins.items() if not kept.is_full(now)}
            bucket = TokenBucket(self._settings.messages_per_second, self._settings.messages_burst)
            self._logins[login] = bucket
        return bucket
