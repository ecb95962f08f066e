"""An open store, for the tests of sessions."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from backend.agent.sessions.store import Store
from tests.databases import Database


@pytest.fixture
async def store(database: Database) -> AsyncIterator[Store]:
    """An open store on an empty database."""
    store = Store(database.url)
    await store.open()
    yield store
    await store.close()
