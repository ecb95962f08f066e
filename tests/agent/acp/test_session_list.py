"""The list of sessions: whose they are, which of them work, and those that have the words that somebody looks for."""

from __future__ import annotations

from typing import Any

import pytest

from backend.agent.sessions.sessions import PAGE
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.agent.conftest import Opener, holds_the_robot
from tests.processes import Client, Robot


async def listed(client: Client, search: object = None) -> list[dict[str, Any]]:
    """The whole list, read page by page."""
    found: list[dict[str, Any]] = []
    asked: dict[str, Any] = {"_meta": {"robot-acp/search": search}} if search is not None else {}
    while True:
        page = await client.link.request("session/list", asked)
        found += page["sessions"]
        if not (cursor := page.get("nextCursor")):
            return found
        asked |= {"cursor": cursor}


async def titles(client: Client, search: str) -> list[str]:
    return [session["title"] for session in await listed(client, search)]


async def begin(client: Client, *prompts: str) -> None:
    """A session for each of the prompts, named for it."""
    for prompt in prompts:
        await client.new()
        await client.prompt(prompt)


async def test_a_search_finds_the_words_in_titles_and_in_names_of_owners(robot: Robot, connect: Opener) -> None:
    ana = await connect(robot.token("Ana María", Role.OPERATOR))
    ben = await connect(robot.token("Ben", Role.SUPERVISOR))
    kiosk = await connect(robot.token("Kiosk", Role.VISITOR))
    await begin(ana, "Where is the CAFETERÍA?")
    await begin(ben, "where are you?", "100% sure_of it")
    await begin(kiosk, "Where is the exit?")
    assert await titles(ben, "where") == ["Where is the exit?", "where are you?", "Where is the CAFETERÍA?"]
    assert await titles(ben, "  ana   WHERE ") == ["Where is the CAFETERÍA?"]
    assert await titles(ben, "cafetería") == ["Where is the CAFETERÍA?"]
    assert await titles(ben, "% sure_") == ["100% sure_of it"]
    assert await titles(ben, "nothing of the kind") == []
    assert await titles(kiosk, "where") == ["Where is the exit?"]
    assert await listed(ben, "") == await listed(ben)
    for nonsense in (5, ["where"], {"words": "where"}):
        with pytest.raises(RefusedError, match="must be text"):
            await listed(ben, nonsense)


async def test_what_is_found_comes_in_pages_too(robot: Robot, connect: Opener) -> None:
    client = await connect(robot.token("Pat", Role.OPERATOR))
    await begin(client, *["/places"] * (PAGE + 2), "/battery")
    page = await client.link.request("session/list", {"_meta": {"robot-acp/search": "pat places"}})
    assert len(page["sessions"]) == PAGE
    found = await listed(client, "pat places")
    assert len({session["sessionId"] for session in found}) == PAGE + 2


async def test_the_list_says_whose_a_session_is_and_which_one_works(robot: Robot, connect: Opener) -> None:
    ana = await connect(robot.token("Ana", Role.OPERATOR), answer=None)
    ben = await connect(robot.token("Ben", Role.OPERATOR))
    working = await holds_the_robot(ana)

    async def shown() -> dict[str, Any]:
        return next(one["_meta"] for one in await listed(ben) if one["sessionId"] == ana.session)

    during = await shown()
    await ana.cancel()
    assert await working == "cancelled"
    ended = next(turn for u in ana.updates if (turn := (u.get("_meta") or {}).get("robot-acp/turn")))
    assert during == {"robot-acp/owner": "Ana", "robot-acp/turn": {"id": ended["id"], "state": "running"}}
    assert await shown() == {"robot-acp/owner": "Ana"}
