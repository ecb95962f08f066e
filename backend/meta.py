"""The names of our `_meta` entries, as they stand on the wire: each is written here and nowhere else.

ACP and MCP leave `_meta` to implementations. Every key of ours begins with `robot-acp/`. docs/extensions.md says what
each one carries; tests/test_meta.py compares the two lists. Nothing here reads or writes a message.
"""

from __future__ import annotations

from typing import Final

CAPABILITIES: Final = "robot-acp"
"""In the capabilities that `initialize` answers: extensions, robot, role and name."""
PREFIX: Final = "robot-acp/"
"""Every key below begins with it. The bridge removes what a client itself put under it in `initialize`."""

# ACP: who and when
TOKEN: Final = "robot-acp/token"  # noqa: S105 - the name of a field
SEQ: Final = "robot-acp/seq"
AT: Final = "robot-acp/at"
BY: Final = "robot-acp/by"
OWNER: Final = "robot-acp/owner"

# ACP: requests of a client, and what it subscribes to
AFTER: Final = "robot-acp/after"
SEARCH: Final = "robot-acp/search"
PEOPLE: Final = "robot-acp/people"
TELEMETRY: Final = "robot-acp/telemetry"

# ACP: turns and sessions
TURN: Final = "robot-acp/turn"
PHASES: Final = "robot-acp/phases"
FORKED: Final = "robot-acp/forked"
TAKEN_OVER: Final = "robot-acp/taken_over"
REMEMBERED: Final = "robot-acp/remembered"

# ACP: tool calls
TOOL: Final = "robot-acp/tool"
PHASE: Final = "robot-acp/phase"
PROGRESS: Final = "robot-acp/progress"
WAITING: Final = "robot-acp/waiting"
DECISION: Final = "robot-acp/decision"

# ACP: permission requests
EXPIRES: Final = "robot-acp/expires"
TIMEOUT_S: Final = "robot-acp/timeout_s"
ASKER: Final = "robot-acp/asker"
SUBJECT: Final = "robot-acp/subject"

# MCP: tools and calls of the robot server. A permission request carries PREVIEW too.
PREVIEW: Final = "robot-acp/preview"
TITLE: Final = "robot-acp/title"
SIGN_OF_LIFE: Final = "robot-acp/sign-of-life"
CALLER: Final = "robot-acp/caller"
