"""Whether this is a deep run, in which tests that draw cases draw all of them, with fresh seeds: `./test.sh --deep`."""

from __future__ import annotations

import os

DEEP = os.environ.get("ROBOT_ACP_TEST_DEEP") == "1"
