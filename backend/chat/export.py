"""`/export` of the terminal: writes a session's log into the folder in which the terminal was started.

The log is read page by page from the agent, so it may be longer than a message. No path comes from elsewhere.
"""

from __future__ import annotations

import os
from pathlib import Path

import orjson

from backend.chat.link import Link


async def save_log(link: Link, session: str, folder: Path) -> Path:
    """Write the events of a session as JSON Lines, and return the file, which only its owner may read.

    Raises `RefusedError`, `LinkError`, `OSError`.
    """
    name = "".join(letter for letter in session if letter.isalnum() or letter in "-_")[:64]
    file = folder / f"robot-acp-{name}.jsonl"
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW
    with os.fdopen(os.open(file, flags, 0o600), "wb") as out:
        after, last = 0, 1
        while after < last:
            page = await link.request("_robot/events", {"sessionId": session, "after": after})
            last = page["last"]
            if not page["events"]:
                break
            for event in page["events"]:
                after = event["seq"]
                line = {"seq": event["seq"], "time": event["at"], "update": event["update"]}
                out.write(orjson.dumps(line, option=orjson.OPT_APPEND_NEWLINE))
    return file
