"""Token buckets, with a clock of the test's."""

from __future__ import annotations

import pytest

from backend.rates import Buckets, TokenBucket


def test_a_burst_passes_and_then_one_at_a_time() -> None:
    bucket = TokenBucket(rate=2.0, burst=3)
    assert [bucket.take(100.0) for _ in range(4)] == [0, 0, 0, 0.5]
    assert bucket.take(100.25) == pytest.approx(0.25)
    assert [bucket.take(100.5), bucket.take(100.5)] == [0, 0.5]


def test_no_more_than_a_burst_is_ever_saved() -> None:
    bucket = TokenBucket(rate=2.0, burst=3)
    bucket.take(0.0)
    assert [bucket.take(1e9) for _ in range(4)] == [0, 0, 0, 0.5]


def test_a_debt_has_to_be_paid_first() -> None:
    bucket = TokenBucket(rate=2.0, burst=3)
    assert bucket.spend(0.0, 3) == 0
    assert bucket.spend(0.0, 4) == 2
    assert bucket.take(2.0) == 0.5
    assert bucket.take(2.5) == 0


def test_a_bucket_is_full_again_when_all_is_gained() -> None:
    bucket = TokenBucket(rate=2.0, burst=3)
    assert bucket.is_full(0.0)
    bucket.spend(0.0, 5)
    assert not bucket.is_full(2.4)
    assert bucket.is_full(2.5)


def test_each_key_has_a_bucket_of_its_own() -> None:
    buckets = Buckets(rate=1.0, burst=2)
    assert [buckets.take("a", 0.0) for _ in range(3)] == [0, 0, 1]
    assert buckets.take("b", 0.0) == 0


def test_of_many_keys_those_with_a_full_bucket_and_then_the_oldest_are_forgotten() -> None:
    buckets = Buckets(rate=1.0, burst=1, most=2)
    buckets.take("a", 0.0)
    buckets.take("b", 0.5)
    assert buckets.take("c", 1.0) == 0  # in place of a, whose bucket is full
    assert buckets.take("b", 1.0) == 0.5
    assert buckets.take("d", 1.0) == 0  # in place of b
    assert buckets.take("c", 1.0) == 1.0
