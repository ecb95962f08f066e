"""Who may use the database of sessions, and what people are told where it cannot be used."""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import pytest

from backend.agent.sessions import database as database_module
from backend.agent.sessions.store import Store, StoreError
from tests.agent.sessions.stores import ROW
from tests.databases import PASSWORD, Cluster, Database
from tests.processes import eventually


async def test_a_second_agent_is_refused_and_comes_in_when_the_first_is_gone(
    database: Database, impatient: None
) -> None:
    first, second = Store(database.url), Store(database.url)
    await first.open()
    with pytest.raises(StoreError, match="Another agent is using the database of sessions"):
        await second.open()
    await first.add_session(ROW)
    await first.close()
    third = Store(database.url)
    await third.open()
    assert await third.session("s1") == ROW
    await third.close()


async def test_an_agent_waits_a_moment_for_the_one_before_it_to_be_gone(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    take, tries = database_module._take, []

    def counted(lock: Any) -> None:
        take(lambda: bool(tries.append(lock) or lock()))

    monkeypatch.setattr(database_module, "_take", counted)
    first, second = Store(database.url), Store(database.url)
    await first.open()
    opening = asyncio.create_task(second.open())
    await eventually(lambda: len(tries) > 2, "the second to try again")
    await first.close()
    await opening
    await second.add_session(ROW)
    await second.close()


async def test_a_database_of_another_version_is_told_and_left_alone(database: Database) -> None:
    database.execute("CREATE TABLE sessions (id VARCHAR(64) PRIMARY KEY, updated FLOAT)")
    database.execute("INSERT INTO sessions VALUES ('s1', 0)")
    store = Store(database.url)
    with pytest.raises(StoreError, match="was made by another version of robot-acp: sessions has no created, cwd"):
        await store.open()
    assert database.execute("SELECT id FROM sessions") == [("s1",)]


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("sqlite:////proc/none/sessions.db", "cannot be used: No such file or directory"),
        ("nonsense://ana:hunter2@host/db", "begins with no known kind; use sqlite:/// or postgresql://"),
        ("hunter2", "is no URL such as postgresql://NAME:PASSWORD@HOST:5432/DATABASE"),
        ("postgresql://ana:hunter2@host:port/db", "is no URL such as"),
        ("postgresql://ana:hun@ter2@host/db", "write %40 for an @ in the name or the password"),
    ],
)
async def test_a_url_that_cannot_be_used_is_told_without_its_password(url: str, told: str) -> None:
    with pytest.raises(StoreError) as caught:
        await Store(url).open()
    assert told in str(caught.value)
    assert "ter2" not in str(caught.value)


async def test_a_missing_driver_is_told_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(StoreError, match=r"pip install 'robot-acp\[postgres\]'"):
        await Store("postgresql://ana:hunter2@127.0.0.1/db").open()


async def test_a_server_that_lets_nobody_in_is_told_without_the_password(postgres: Cluster) -> None:
    url = postgres.url("postgres")
    for wrong, told in (
        (url.replace(PASSWORD, "letmein"), "password authentication failed for user"),
        (url.replace(str(postgres.port), "1"), "port 1 failed: Connection refused"),
        (url.replace("/postgres", "/nowhere"), 'database "nowhere" does not exist'),
        (url + "?colour=letmein", 'invalid connection option "colour"'),
    ):
        with pytest.raises(StoreError) as caught:
            await Store(wrong).open()
        assert told in str(caught.value)
        assert str(caught.value).endswith("Check agent.database.")
        assert "letmein" not in str(caught.value)
        assert PASSWORD not in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("scheme", ["postgresql://", "postgres://", "postgresql+psycopg://"])
async def test_a_postgresql_url_works_as_people_write_it(postgres: Cluster, scheme: str) -> None:
    with postgres.new_database() as database:
        store = Store(database.url.replace("postgresql://", scheme))
        await store.open()
        await store.add_session(ROW)
        assert await store.session("s1") == ROW
        await store.close()
