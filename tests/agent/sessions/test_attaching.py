"""Who watches a session, while replays wait for slow readers and people leave, log out, log in and cancel meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from backend.agent.acp.abilities import Abilities
from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.operations import Operations
from backend.agent.acp.people import People
from backend.agent.acp.request_limits import RequestLimits
from backend.agent.control.lease import Lease
from backend.agent.control.policy import Policy
from backend.agent.robot.mcp_client import McpClient, Tool
from backend.agent.robot.robot_client import RobotClient
from backend.agent.robot.server_addresses import AllowList
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.retention import Retention
from backend.agent.sessions.session import Session
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Store
from backend.agent.sessions.usage import Usage
from backend.agent.turns.environment import TurnEnvironment
from backend.agent.turns.model import OFFLINE_MODEL
from backend.agent.wiring import Wiring
from backend.audit import Audit
from backend.chat.link import RefusedError
from backend.config import Settings
from backend.identity import Role
from backend.robot_server import RobotServerClient
from backend.tokens import Registry
from backend.wrong_logins import WrongLogins
from tests.processes import PATIENCE_S, Client, eventually, free_port, token_of, trusted


class Reader(ClientConnection):
    """A connection that takes no more of a replay than one event, until it `may_go_on`."""

    may_go_on: asyncio.Event

    async def wait_for_space(self) -> None:
        await self.may_go_on.wait()


class Silent(McpClient):
    """A robot that never says what it can do."""

    async def tools(self) -> dict[str, Tool]:
        await asyncio.Event().wait()
        return {}


@dataclass
class Place:
    """An agent in this process, with two sessions of somebody's, and one client of it."""

    data: Path
    sessions: Sessions
    client: Client
    long: Session
    other: Session
    may_go_on: asyncio.Event
    loads: list[asyncio.Task[Any]] = field(default_factory=list)

    async def load(self, session: Session) -> None:
        """Begin to load; it waits, for the reader or for its turn."""
        params = {"sessionId": session.id, "cwd": "/", "mcpServers": []}
        self.loads.append(self.client.later(self.client.link.request("session/load", params)))
        await self.client.link.request("session/list", {})  # messages are handled in their order

    async def two_loads(self) -> None:
        """One in the middle of its replay, and one behind it."""
        await self.load(self.long)
        await eventually(lambda: self.seen(self.long), "the replay to begin")
        await self.load(self.other)

    async def loads_end(self) -> None:
        self.may_go_on.set()
        async with asyncio.timeout(PATIENCE_S):
            await asyncio.gather(*self.loads, return_exceptions=True)

    async def tell(self, session: Session, text: str) -> int:
        """Record an event and return its number."""
        session.record({"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": text}})
        number = session.seq
        await session.flushed()
        return number

    def seen(self, session: Session) -> list[int]:
        events = [event for event in self.client.events if event["sessionId"] == session.id]
        return [event["_meta"]["robot-acp/seq"] for event in events]

    async def heard(self, session: Session) -> list[int]:
        """What the client has of a session once all that was on its way has arrived."""
        with contextlib.suppress(RefusedError):
            await self.client.link.request("session/list", {})
        return self.seen(session)

    @property
    def watched(self) -> list[Session]:
        return [session for session in self.sessions.open_sessions if session.watching]

    async def authenticate(self, name: str, role: Role) -> None:
        login = {
            "methodId": "token",
            "_meta": {"robot-acp/token": token_of(self.data, name, role, 60.0)},
        }
        await self.client.link.request("authenticate", login)


@contextlib.asynccontextmanager
async def a_place(data: Path) -> AsyncIterator[Place]:
    nowhere = McpClient(f"http://127.0.0.1:{free_port()}/mcp", absent="There is no robot.")
    store = Store(f"sqlite:///{data / 'sessions.db'}")
    await store.open()
    journal = Journal(store)
    keeping = asyncio.create_task(journal.run())
    sessions = Sessions(store, journal, nowhere, "get_current_pose", 1.0)
    link, may_go_on = RobotClient(RobotServerClient(None)), asyncio.Event()
    silent = Silent("http://127.0.0.1:1/mcp", absent="There is no robot.")
    audit = Audit(data, "agent")
    environment = TurnEnvironment("Sancho", silent, Policy(), link, store, Lease(), 1.0, 5, 1.0, audit=audit)
    wiring = Wiring(
        settings=Settings(),
        tokens=Registry(data),
        sessions=sessions,
        journal=journal,
        retention=Retention(store, sessions, Usage(), Settings().agent.storage),
        link=link,
        turns=environment,
        models=(OFFLINE_MODEL,),
        offers=AllowList([]),
        abilities=Abilities(silent, "get_scene_graph"),
        people=People(),
        requests=RequestLimits(Settings().agent.requests),
        audit=audit,
        wrong_logins=WrongLogins(),
    )

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = Reader(reader, writer, trusted=trusted, max_outbox_bytes=2**20)
        connection.may_go_on = may_go_on
        server = Operations(wiring, connection)
        try:
            await connection.serve(server.router())
        finally:
            server.close()

    listening = await asyncio.start_server(accept, "127.0.0.1", 0)
    client = await Client.open(f"tcp://127.0.0.1:{listening.sockets[0].getsockname()[1]}")
    long, other = [await sessions.create("local", "/", "supervised", OFFLINE_MODEL) for _ in range(2)]
    place = Place(data, sessions, client, long, other, may_go_on)
    await place.tell(long, "one")
    await place.tell(other, "one")
    yield place
    may_go_on.set()
    await client.close()
    await eventually(lambda: not place.watched, "everybody to be gone")
    listening.close()
    await sessions.close()
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
    await store.close()


@pytest.mark.parametrize("method", ["_robot/leave", "session/close", "logout"])
async def test_one_who_leaves_while_a_load_waits_does_not_watch(tmp_path: Path, method: str) -> None:
    async with a_place(tmp_path) as place:
        await place.two_loads()
        await place.client.link.request(method, {"sessionId": place.other.id})
        await place.loads_end()
        assert place.watched == ([] if method == "logout" else [place.long])
        await place.tell(place.other, "two")
        assert await place.heard(place.other) == []


async def test_one_who_is_gone_watches_nothing(tmp_path: Path) -> None:
    async with a_place(tmp_path) as place:
        await place.two_loads()
        await place.client.link.request("_robot/leave", {"sessionId": place.other.id})
        await place.loads_end()
        await place.client.link.close()
        await eventually(lambda: not place.watched, "nobody to watch")


@pytest.mark.parametrize("method", ["_robot/leave", "logout"])
async def test_what_happened_during_a_replay_is_not_shown_to_one_who_left(tmp_path: Path, method: str) -> None:
    async with a_place(tmp_path) as place:
        await place.load(place.long)
        await eventually(lambda: place.seen(place.long), "the replay to begin")
        await place.tell(place.long, "two")
        await place.client.link.request(method, {"sessionId": place.long.id})
        await place.loads_end()
        assert await place.heard(place.long) == [1]


async def test_one_who_leaves_a_replay_and_prompts_sees_what_comes_once_and_in_order(tmp_path: Path) -> None:
    async with a_place(tmp_path) as place:
        await place.tell(place.long, "two")
        await place.load(place.long)
        await eventually(lambda: place.seen(place.long), "the replay to begin")
        await place.client.link.request("_robot/leave", {"sessionId": place.long.id})
        place.client.session = place.long.id
        turn = place.client.later(place.client.prompt("where are you?"))
        await eventually(lambda: place.long.watching, "the prompt to attach it again")
        later = await place.tell(place.long, "later")
        await place.loads_end()
        await place.client.cancel()
        async with asyncio.timeout(PATIENCE_S):
            assert await turn == "cancelled"
        seen = place.seen(place.long)
        assert 2 not in seen, "the replay went on"
        assert later in seen
        assert seen == sorted(set(seen))


async def test_a_login_that_may_see_less_watches_less(tmp_path: Path) -> None:
    async with a_place(tmp_path) as place:
        place.may_go_on.set()
        await place.load(place.long)
        await place.loads_end()
        await place.authenticate("Vera", Role.VISITOR)
        await place.tell(place.long, "two")
        assert await place.heard(place.long) == [1]
        with pytest.raises(RefusedError, match="There is no session"):
            await place.client.load(place.long.id)


async def test_a_login_that_may_see_less_gets_nothing_of_a_load_that_waits(tmp_path: Path) -> None:
    async with a_place(tmp_path) as place:
        await place.two_loads()
        await place.authenticate("Vera", Role.VISITOR)
        await place.loads_end()
        assert place.watched == []
        assert await place.heard(place.other) == []


async def test_a_prompt_that_waits_for_no_replay_is_cancelled(tmp_path: Path) -> None:
    async with a_place(tmp_path) as place:
        await place.load(place.long)
        await eventually(lambda: place.seen(place.long), "the replay to begin")
        place.client.session = place.other.id
        turn = place.client.later(place.client.prompt("go to the kitchen"))
        await place.client.link.request("session/list", {})  # the prompt is with the agent
        await place.client.cancel()
        async with asyncio.timeout(PATIENCE_S):
            assert await turn == "cancelled"
        assert not place.other.busy
