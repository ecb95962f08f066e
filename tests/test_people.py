"""A person is a subject of the list of tokens, not a name: namesakes have nothing of each other's."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import jwt
import msgspec
import pytest

from backend import identity, tokens
from backend.agent.sessions.store import SessionRow, Store
from backend.chat.link import RefusedError
from backend.cli import main
from backend.identity import Identity, Role, person_named
from backend.tokens import Registry, RegistryError
from tests.processes import Client, Robot


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path / "data")


def subjects(data: Path) -> list[str]:
    return [record.subject for record in tokens.records(data)]


def test_a_name_that_somebody_has_is_refused_with_what_to_do(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    create = ["--data-dir", str(robot.data), "token", "create", "--role", "operator", "--name"]
    assert main([*create, "Ana"]) == 0
    capsys.readouterr()
    for name in ("Ana", "ana", " ANA ", "Ａna"):
        assert main([*create, name]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert "There is 'Ana' already: operator, token" in said.err
        assert "add --same-person" in said.err
    tokens.revoke(robot.data, "Ana")
    assert main([*create, "Ana"]) == 2  # what the log says of the first must not be about another
    assert main([*create, "Ana", "--same-person"]) == 0
    assert len(set(subjects(robot.data))) == 1


def further(data: Path, name: str, role: Role) -> str:
    return tokens.create(data, name, role, 3600, same_person=True)


def test_a_further_token_is_of_the_same_person_and_role(robot: Robot) -> None:
    first, second = (further(robot.data, "Ana", Role.VIEWER) for _ in range(2))
    registry = Registry(robot.data)
    assert registry.verify(first).person == registry.verify(second).person
    with pytest.raises(RegistryError, match=r"'Ana' is viewer, and a person has one role. Revoke the token"):
        further(robot.data, "Ana", Role.SUPERVISOR)
    tokens.revoke(robot.data, "Ana")
    assert Registry(robot.data).verify(further(robot.data, "Ana", Role.SUPERVISOR)).role is Role.SUPERVISOR
    with pytest.raises(RegistryError, match="one role"):
        further(robot.data, "Ana", Role.VIEWER)


def test_a_name_for_people_without_a_token_is_nobodys(robot: Robot) -> None:
    with pytest.raises(RegistryError, match="Choose another name"):
        further(robot.data, "Local", Role.VISITOR)


def test_whoever_comes_after_the_list_forgot_a_name_is_another_person(robot: Robot) -> None:
    tokens.create(robot.data, "Ana", Role.OPERATOR, -40 * 86400)
    (before,) = subjects(robot.data)
    tokens.create(robot.data, "Ben", Role.VIEWER, 60)  # any writing forgets
    tokens.create(robot.data, "Ana", Role.VISITOR, 60)
    assert before not in subjects(robot.data)


def test_the_list_decides_and_not_the_token(robot: Robot) -> None:
    robot.token("Ana", Role.VISITOR)
    (record,) = tokens.records(robot.data)
    key = identity.shared_secret(robot.data, identity.SIGNING_KEY)
    forged = identity.issue(key, "Sue", Role.SUPERVISOR, 10 * 86400, record.id, "somebody")
    who = Registry(robot.data).verify(forged)
    assert (who.name, who.role, who.subject, who.expires) == ("Ana", Role.VISITOR, record.subject, record.expires)


# What an earlier version wrote.


def old_token(data: Path, name: str, role: Role, number: int) -> str:
    """A token and its record without a subject."""
    key = identity.shared_secret(data, identity.SIGNING_KEY)
    record = {"id": f"old{number}", "name": name, "role": role.value, "created": 1.0, "expires": 4e9, "revoked": None}
    file = data / tokens.REGISTRY
    known = msgspec.json.decode(file.read_bytes()) if file.exists() else []
    file.write_bytes(msgspec.json.encode([*known, record]))
    claims = {
        "aud": "robot-acp",
        "sub": name,
        "role": role.value,
        "jti": f"old{number}",
        "iat": 1,
        "exp": 4_000_000_000,
    }
    return jwt.encode(claims, key, algorithm="HS256")


def test_of_old_namesakes_the_most_trusted_has_the_sessions_of_the_name(robot: Robot) -> None:
    visitor = old_token(robot.data, "Ana", Role.VISITOR, 1)
    operator = old_token(robot.data, "Ana", Role.OPERATOR, 2)
    local = old_token(robot.data, "local", Role.VISITOR, 3)
    registry = Registry(robot.data)
    assert registry.verify(operator).person == person_named("Ana")
    assert registry.verify(visitor).person not in (person_named("Ana"), person_named("visitor"))
    assert registry.verify(local).person != identity.LOCAL.person
    before = [registry.verify(token).person for token in (visitor, operator, local)]
    robot.token("Ben", Role.VIEWER)  # writes the subjects down
    tokens.revoke(robot.data, "old2")
    registry = Registry(robot.data)
    assert [registry.verify(token).person for token in (visitor, local)] == [before[0], before[2]]


OLD_TABLE = """
CREATE TABLE sessions (id VARCHAR(64) NOT NULL PRIMARY KEY, owner TEXT NOT NULL, title TEXT, cwd TEXT NOT NULL,
    mode TEXT NOT NULL, model TEXT NOT NULL, start_pose JSON, thought BOOLEAN NOT NULL, motion_asks BOOLEAN NOT NULL,
    created DOUBLE NOT NULL, updated DOUBLE NOT NULL);
CREATE TABLE events (session_id VARCHAR(64) NOT NULL REFERENCES sessions (id), seq INTEGER NOT NULL,
    time DOUBLE NOT NULL, "update" BLOB NOT NULL, PRIMARY KEY (session_id, seq));
INSERT INTO sessions VALUES ('old', 'Ana', 'a drive', '/', 'supervised', 'offline/commands', NULL, 1, 0, 1.0, 1.0);
INSERT INTO events VALUES ('old', 1, 1.0,
    CAST('{"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": "Hello."}}' AS BLOB));
"""


def old_database(file: Path) -> None:
    with closing(sqlite3.connect(file)) as connection:
        connection.executescript(OLD_TABLE)


@pytest.mark.parametrize("writes", [True, False])
async def test_a_database_from_before_keeps_its_owners(tmp_path: Path, writes: bool) -> None:
    old_database(tmp_path / "sessions.db")
    store = Store(f"sqlite:///{tmp_path / 'sessions.db'}", writes=writes)
    await store.open()
    row = await store.session("old")
    assert isinstance(row, SessionRow)
    assert (row.owner, row.owner_id, row.person) == ("Ana", None, person_named("Ana"))
    assert [found.id for found in await store.sessions(person_named("Ana"), None, 9)] == ["old"]
    assert await store.sessions(Identity("Ana", Role.VISITOR, subject="another").person, None, 9) == []
    await store.close()


# Through the real agent.


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    robot = Robot(tmp_path_factory.mktemp("data"))
    old_token(robot.data, "Ana", Role.OPERATOR, 1)
    old_database(robot.data / "sessions.db")
    with robot.running("agent", port=robot.agent_port):
        yield robot


async def login(robot: Robot, token: str) -> Client:
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
    await client.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})
    return client


async def listed(client: Client) -> set[str]:
    return {session["sessionId"] for session in (await client.link.request("session/list", {}))["sessions"]}


def named(session: str) -> dict[str, Any]:
    return {"sessionId": session, "cwd": "/", "mcpServers": []}


@pytest.mark.processes
async def test_a_visitor_with_an_operators_name_has_nothing_of_his(running: Robot) -> None:
    operator = await login(running, old_token(running.data, "Ana", Role.OPERATOR, 2))
    visitor = await login(running, old_token(running.data, "Ana", Role.VISITOR, 3))
    mine, old = await operator.new(), "old"
    await operator.prompt("where are you?")
    assert await listed(operator) >= {mine, old}
    assert await listed(visitor) == set()
    for session in (mine, old):
        for method in ("session/load", "session/delete", "session/fork", "session/close"):
            with pytest.raises(RefusedError, match="There is no session"):
                await visitor.link.request(method, named(session))
    await operator.link.request("session/delete", {"sessionId": old})
    assert await listed(operator) == {mine}
    for client in (operator, visitor):
        await client.close()


@pytest.mark.processes
async def test_all_tokens_of_one_person_have_the_same_sessions(running: Robot) -> None:
    first, second = [await login(running, further(running.data, "Vera", Role.VISITOR)) for _ in range(2)]
    session = await first.new()
    await first.prompt("where are you?")
    assert await listed(second) == {session}
    await second.link.request("session/delete", {"sessionId": session})
    for client in (first, second):
        await client.close()
