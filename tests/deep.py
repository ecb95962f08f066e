"""How much the tests try: `./test.sh --deep` sets ROBOT_ACP_TEST_DEEP=1, and generated cases are all of them then.

A seed is fresh in each deep run and printed; ROBOT_ACP_TEST_SEED repeats one.
"""

from __future__ import annotations

import os
import random

DEEP = os.environ.get("ROBOT_ACP_TEST_DEEP") == "1"


def seed(default: int) -> int:
    """The seed of generated cases: the one that is asked for, a fresh one in a deep run, else `default`. It is
    printed, so that a test that fails shows it."""
    named = os.environ.get("ROBOT_ACP_TEST_SEED")
    chosen = int(named) if named else random.SystemRandom().randrange(2**32) if DEEP else default
    print(f"ROBOT_ACP_TEST_SEED={chosen}")
    return chosen
