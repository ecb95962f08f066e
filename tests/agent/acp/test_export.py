"""A session's log as a file at the client: handed to those who watch the session, and nobody waits for them long."""

from __future__ import annotations

import asyncio
from typing import Any

import orjson
import pytest

from backend import wire
from backend.agent.acp import export
from backend.agent.sessions.store import Event, SessionRow, Store, as_json
from tests.agent.conftest import Opener, client_of_an_impatient_agent
from tests.databases import Database
from tests.processes import PATIENCE_S, Robot, eventually

FILES = {"fs": {"writeTextFile": True}}


async def test_export_hands_the_log_to_a_client_that_takes_files(connect: Opener) -> None:
    written: list[dict[str, object]] = []
    client = await connect(capabilities={"fs": {"writeTextFile": True}})
    await client.new()
    await client.prompt("where are you?")
    seen = len(client.updates)
    export = client.later(client.prompt("/export"))
    await eventually(lambda: "fs/write_text_file" in str(client.heard), "the file")
    request = next(m for m in client.heard if m["method"] == "fs/write_text_file")
    written = [orjson.loads(line) for line in request["params"]["content"].splitlines()]
    await client.link.respond(request["id"], {})
    assert await export == "end_turn"
    assert [line["update"] for line in written][1 : seen + 1] == client.updates[:seen]
    assert f"robot-acp-{client.session}.jsonl" in client.said


async def test_the_file_is_written_into_the_folder_of_whoever_asks_and_never_of_the_owner(connect: Opener) -> None:
    ana, ben, cleo = [await connect(capabilities=FILES) for _ in range(3)]
    opened = {"cwd": "/home/ana/secrets", "mcpServers": []}
    session = (await ana.link.request("session/new", opened))["sessionId"]
    ana.session = ben.session = cleo.session = session
    await ben.link.request("session/load", {"sessionId": session, "cwd": "/home/ben", "mcpServers": []})
    exporting = ben.later(ben.prompt("/export"))
    await eventually(lambda: "fs/write_text_file" in str(ben.heard), "the file")
    asked = next(m for m in ben.heard if m["method"] == "fs/write_text_file")
    assert asked["params"]["path"] == f"/home/ben/robot-acp-{session}.jsonl"
    await ben.link.respond(asked["id"], {})
    assert await exporting == "end_turn"
    assert await cleo.prompt("/export") == "end_turn"  # attached by its prompt, and named no folder
    assert "fs/write_text_file" not in str(cleo.heard)
    assert "named no folder" in cleo.said


async def test_a_fork_has_the_folder_of_whoever_made_it(connect: Opener) -> None:
    ana, ben = await connect(), await connect()
    session = (await ana.link.request("session/new", {"cwd": "/home/ana", "mcpServers": []}))["sessionId"]
    ana.session = session
    await ana.prompt("/where")
    fork = await ben.link.request("session/fork", {"sessionId": session, "cwd": "/home/ben", "mcpServers": []})
    listed = (await ben.link.request("session/list", {}))["sessions"]
    folders = {one["sessionId"]: one["cwd"] for one in listed}
    assert (folders[session], folders[fork["sessionId"]]) == ("/home/ana", "/home/ben")


async def test_a_client_that_never_answers_keeps_no_session_busy(robot: Robot) -> None:
    async with client_of_an_impatient_agent(robot, capabilities=FILES) as client:
        async with asyncio.timeout(PATIENCE_S):
            assert await client.prompt("/export") == "end_turn"
            assert await client.prompt("where are you?") == "end_turn"
        assert "Your program did not write" in client.said


async def test_the_log_is_not_handed_to_one_who_has_logged_out(connect: Opener) -> None:
    client, other = await connect(capabilities=FILES), await connect(answer=None)
    await other.load(await client.new())
    first = other.later(other.prompt("say hello"))
    await eventually(lambda: client.questions and other.questions, "the question")
    assert await first == "end_turn"
    client.answer = None
    second = other.later(other.prompt("say hello again"))
    await eventually(lambda: len(other.questions) == 2, "the next question")
    exporting = client.later(client.prompt("/export"))
    await client.link.request("session/list", {})  # once this has come back, the prompt is with the session
    await client.link.request("logout", {})
    await other.decide("allow_once")
    assert (await second, await exporting) == ("end_turn", "end_turn")
    assert "fs/write_text_file" not in [message["method"] for message in client.heard]
    assert "no longer here" in other.said


class Program:
    """A client that takes files."""

    can_write_files = True

    def __init__(self) -> None:
        self.asked: list[str] = []

    def folder_of(self, session_id: str) -> str | None:
        return "/home/ana"

    async def request(self, method: str, params: dict[str, Any]) -> Any:
        self.asked.append(method)
        return {}


class Kept:
    """A session of which only the log counts."""

    def __init__(self, row: SessionRow, *watching: Program) -> None:
        self.row, self.id, self.watching = row, row.id, watching

    async def flushed(self) -> None:
        """All is kept."""


@pytest.mark.parametrize(("quotes", "asked"), [(100, ["fs/write_text_file"]), (30_000, [])])
async def test_a_log_that_fits_into_no_frame_is_not_sent(
    database: Database, monkeypatch: pytest.MonkeyPatch, quotes: int, asked: list[str]
) -> None:
    monkeypatch.setattr(wire, "MAX_FRAME_BYTES", 128 * 1024)
    store = Store(database.url)
    await store.open()
    row = SessionRow("s1", "Ana", None, "/", "supervised", "offline/commands", None, 0.0, 0.0)
    await store.add_session(row)
    await store.append([Event("s1", 1, 0.0, as_json({"text": '"' * quotes}))])  # each is four bytes on the wire
    program = Program()
    told = await export.hand_over(Kept(row, program), store, program, 1.0)  # type: ignore[arg-type] # the parts in use
    assert program.asked == asked
    assert ("`robot-acp sessions export s1` prints the log." in told) == (not asked)
    await store.close()
