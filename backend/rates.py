"""Token buckets: how often something may happen. Plain arithmetic, without a clock: the time is passed in."""

from __future__ import annotations


class TokenBucket:
    """Holds up to `burst` tokens and gains `rate` tokens a second; it begins full.

    `now` is in s of any clock that never goes back.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self._rate = rate
        self._burst = burst
        self._tokens = burst  # below 0 after `spend` on credit
        self._refilled_at = float("-inf")

    def take(self, now: float) -> float:
        """Take one token and return 0; without a whole one, take nothing and return the seconds until there is one."""
        self._refill(now)
        if self._tokens < 1:
            return (1 - self._tokens) / self._rate
        self._tokens -= 1
        return 0.0

    def spend(self, now: float, tokens: float) -> float:
        """Take tokens, if need be on credit, and return the seconds until the debt is paid: 0 without a debt."""
        self._refill(now)
        self._tokens -= tokens
        return max(0.0, -self._tokens / self._rate)

    def is_full(self, now: float) -> bool:
        """Whether nothing was taken, or all has been gained again: a new bucket would be the same."""
        self._refill(now)
        return self._tokens >= self._burst

    def _refill(self, now: float) -> None:
        if self._refilled_at > float("-inf"):
            self._tokens = min(self._burst, self._tokens + (now - self._refilled_at) * self._rate)
        self._refilled_at = now


class Buckets:
    """A token bucket for each key. At most `most` are kept: full ones are forgotten first, then the oldest."""

    def __init__(self, rate: float, burst: float, most: int = 1024) -> None:
        self._rate = rate
        self._burst = burst
        self._most = most
        self._buckets: dict[str, TokenBucket] = {}

    def take(self, key: str, now: float) -> float:
        """As `TokenBucket.take`, of the bucket of `key`."""
        bucket = self._buckets.get(key)
        if bucket is None:
            if len(self._buckets) >= self._most:
                self._buckets = {key: kept for key, kept in self._buckets.items() if not kept.is_full(now)}
            if len(self._buckets) >= self._most:
                del self._buckets[next(iter(self._buckets))]
            bucket = self._buckets[key] = TokenBucket(self._rate, self._burst)
        return bucket.take(now)
