"""`up` keeps its processes: what cannot come up ends it, what came up once is restarted after growing pauses."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import socket

import pytest

from backend import up
from tests.processes import eventually, free_port

NOTHING_TO_DO = "--version"
"""Given as the name of a process, it makes a real one that ends at once with status 0."""
UNKNOWN = "no-such-command"
"""The same with the status of a command that cannot be used."""


@pytest.fixture(autouse=True)
def _short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(up, "RESTART_PAUSES_S", (0.001, 0.002, 0.003, 0.004))


async def keep(name: str, port: int) -> None:
    await up._keep(name, ("127.0.0.1", port), dict(os.environ))


async def test_what_cannot_be_used_is_started_once(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(up.GaveUp, match="cannot come up; its own message says why") as gave_up:
        await keep(UNKNOWN, free_port())
    assert gave_up.value.status == 2
    assert not starts_again(caplog)


async def test_what_never_comes_up_is_not_started_for_ever(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(up.GaveUp, match="ended with status 0, 5 times in a row, and never came up") as gave_up:
        await keep(NOTHING_TO_DO, free_port())
    assert gave_up.value.status == 1
    assert len(starts_again(caplog)) == up.MOST_STARTS - 1


@pytest.mark.parametrize("name", [NOTHING_TO_DO, UNKNOWN])
async def test_what_came_up_once_is_restarted_without_end_after_growing_pauses(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:  # the address answers: it has come up
        keeping = asyncio.create_task(keep(name, listener.getsockname()[1]))
        await eventually(lambda: len(starts_again(caplog)) > up.MOST_STARTS, "more starts than a first time has")
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)
    assert starts_again(caplog)[:6] == ["0.001", "0.002", "0.003", "0.004", "0.004", "0.004"]


def starts_again(caplog: pytest.LogCaptureFixture) -> list[str]:
    """The pauses that the log tells, in s."""
    assert all(record.levelno == logging.WARNING for record in caplog.records if "starting" in record.message)
    return re.findall(r"starting it again in (\S+) s", caplog.text)
