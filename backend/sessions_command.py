"""`robot-acp sessions`: lists, exports and deletes sessions, and gives the space of a SQLite file back.

A running agent deletes its sessions itself, because it may be using them; only without one is the database changed
here. Nothing is deleted that the arguments do not name. Imports are made where they are needed, as in `cli`.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from backend.agent.sessions.store import Store
    from backend.chat.link import Link
    from backend.config import Settings

_DAY_S = 86400.0


def add_commands(parser: argparse.ArgumentParser) -> None:
    """Add the commands to `robot-acp sessions`."""
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    commands.add_parser("list", help="the sessions, newest first").set_defaults(run=_list)
    export = commands.add_parser("export", help="print a session's events as JSON Lines")
    export.add_argument("id", help="the session's id, as `sessions list` shows it")
    export.set_defaults(run=_export)
    delete = commands.add_parser("delete", help="delete sessions and their events, also beside a running agent")
    delete.add_argument("ids", nargs="*", metavar="ID", help="a session's id, as `sessions list` shows it")
    delete.add_argument("--older-than", type=_days, metavar="30d", help="all without a new event for so many days")
    delete.set_defaults(run=_delete)
    compact = commands.add_parser("compact", help="give the free space of a SQLite file back; no agent may run")
    compact.set_defaults(run=_compact)


def _days(text: str) -> float:
    days = text.removesuffix("d")
    if not days.isdecimal() or not 0 < int(days[:6]) < 36_500:
        raise argparse.ArgumentTypeError("a number of days, such as 30d")
    return float(days)


def _list(settings: Settings, _options: argparse.Namespace) -> int:
    from backend.agent.acp.export import list_sessions

    return asyncio.run(list_sessions(settings.database_url))


def _export(settings: Settings, options: argparse.Namespace) -> int:
    from backend.agent.acp.export import print_session

    return asyncio.run(print_session(settings.database_url, options.id))


def _delete(settings: Settings, options: argparse.Namespace) -> int:
    from backend.config import ConfigError

    if not options.ids and options.older_than is None:
        raise ConfigError("Name the sessions to delete, or give --older-than. See `robot-acp sessions list`.")
    return asyncio.run(delete(settings, options.ids, options.older_than))


def _compact(settings: Settings, _options: argparse.Namespace) -> int:
    return asyncio.run(compact(settings))


async def delete(settings: Settings, ids: list[str], older_than_days: float | None) -> int:
    """Delete the named sessions, and those without a new event for so many days. The exit status is 1 when one of them
    could not be deleted. Raises `ConfigError`."""
    from backend.agent.sessions import upkeep

    chosen = list(ids)
    if older_than_days is not None:
        reader = await _opened(settings, writes=False)
        try:
            before = time.time() - older_than_days * _DAY_S
            chosen += [size.id for size in await upkeep.sizes(reader) if size.updated < before]
        finally:
            await reader.close()
    link = await _running_agent(settings)
    failed = await _delete_through(link, chosen) if link else await _delete_here(settings, chosen)
    print(f"Deleted {len(chosen) - failed} of {len(chosen)} sessions.")
    return 1 if failed else 0


async def compact(settings: Settings) -> int:
    """Rewrite the file of the database without free space. Raises `ConfigError`, also while an agent runs."""
    from backend.agent.sessions import upkeep

    store = await _opened(settings, writes=True)
    try:
        await upkeep.compact(store)
    finally:
        await store.close()
    print("The database has no free space any more.")
    return 0


async def _running_agent(settings: Settings) -> Link | None:
    """A connection to the agent that runs on this machine; None where none runs."""
    from backend import local_user
    from backend import meta as keys
    from backend.chat.link import LinkError, RefusedError, open_link
    from backend.config import ConfigError

    try:
        link = await open_link(settings.agent_url, None, lambda _message: None)
        token = os.environ.get("ROBOT_ACP_TOKEN") or local_user.token_for(settings.agent_url, settings)
        about = {"_meta": {keys.TOKEN: token}} if token else {}
        await link.request("initialize", {"protocolVersion": 1, "clientCapabilities": {}} | about)
    except LinkError:
        return None
    except RefusedError as error:
        raise ConfigError(f"The agent refused: {error}") from None
    return link


async def _delete_through(link: Link, ids: list[str]) -> int:
    from backend.chat.link import LinkError, RefusedError
    from backend.config import ConfigError

    failed = 0
    try:
        for session in ids:
            try:
                await link.request("session/delete", {"sessionId": session})
            except RefusedError as error:
                failed += 1
                print(f"robot-acp: {session}: {error}", file=sys.stderr)
    except LinkError as error:
        raise ConfigError(str(error)) from None
    finally:
        await link.close()
    return failed


async def _delete_here(settings: Settings, ids: list[str]) -> int:
    from sqlalchemy.exc import SQLAlchemyError

    from backend import audit
    from backend.agent.sessions import upkeep
    from backend.agent.sessions.database import why
    from backend.config import ConfigError

    failed = 0
    deleted: list[audit.Details] = []
    store = await _opened(settings, writes=True)
    try:
        for session in ids:
            row = await store.session(session)
            if row is None:
                failed += 1
                print(f"robot-acp: There is no session {session[:64]}.", file=sys.stderr)
            else:
                owner = row.owner
                await store.delete_session(session)
                deleted.append({"session": session, "owner": owner})
        await upkeep.give_back_space(store)
    except SQLAlchemyError as error:
        raise ConfigError(why(error)) from None
    finally:
        await store.close()
        audit.record_command(settings.data_dir, *(("session_deleted", session) for session in deleted))
    return failed


async def _opened(settings: Settings, *, writes: bool) -> Store:
    from backend.agent.sessions.database import StoreError
    from backend.agent.sessions.store import Store
    from backend.config import ConfigError

    store = Store(settings.database_url, writes=writes)
    try:
        await store.open()
    except StoreError as error:
        raise ConfigError(str(error)) from None
    return store
