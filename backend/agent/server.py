"""Runs the agent: on TCP, one ACP connection a client, or on stdin and stdout."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence

from sqlalchemy.exc import SQLAlchemyError

from backend import addresses, collector, exposure, identity, local_user, robot_address
from backend.agent.acp.abilities import Abilities
from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.operations import Operations
from backend.agent.acp.people import People
from backend.agent.acp.request_limits import RequestLimits
from backend.agent.control.attendance import Attendance
from backend.agent.control.lease import Lease
from backend.agent.control.policy import MODE_IDS, Policy
from backend.agent.robot.mcp_client import McpClient
from backend.agent.robot.robot_client import RobotClient
from backend.agent.robot.server_addresses import AllowList
from backend.agent.sessions.database import StoreError, why
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.retention import Retention
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Store
from backend.agent.sessions.usage import Usage
from backend.agent.turns import model, providers
from backend.agent.turns.environment import TurnEnvironment
from backend.agent.wiring import Wiring
from backend.audit import Audit
from backend.config import ConfigError, Settings
from backend.connections_before_login import ConnectionsBeforeLogin
from backend.descriptors import raise_limit
from backend.identity import Role
from backend.robot_server import RobotServerClient
from backend.sockets import notice_loss
from backend.stdio import stdin, stdout
from backend.tokens import Registry
from backend.visible import visible
from backend.wrong_logins import WrongLogins

log = logging.getLogger(__name__)

_STREAM_LIMIT = 64 * 1024
"""Up to twice as many bytes of a client wait unread in this process. A longer line is put together as it is read."""
_BACKLOG = 100
"""So many connections are accepted at once, before the oldest of those that are too many are closed."""
_SILENCE_S, _PROBE_S = 15, 5
"""How long a silent client counts as connected, and how often it is probed, in seconds: its machine may be gone."""
_DESCRIPTORS_KEPT = 128
"""File descriptors for everything but the bridge's clients: other clients, the database, MCP servers, telemetry."""


async def serve(settings: Settings, *, stdio: bool = False) -> None:
    """Serve until cancelled, or, on stdio, until the client closes stdin. Raises `ConfigError`, `OSError`."""
    needs_token = not stdio and settings.agent.trust_loopback is True
    local_token = local_user.write_token(settings.data_dir, settings.agent.port) if needs_token else None
    async with _wiring(settings, local_token) as wiring:
        if stdio:
            await _serve_stdio(wiring)
        else:
            await _serve_tcp(wiring)


async def _serve_tcp(wiring: Wiring) -> None:
    where = wiring.settings.agent
    exposure.warn(wiring.settings, "agent", log)
    most = where.requests
    raise_limit(wiring.settings.bridge.max_connections + most.max_before_login + _BACKLOG + _DESCRIPTORS_KEPT)
    before_login = ConnectionsBeforeLogin(most.max_before_login, most.max_before_login_per_address)
    clients: set[asyncio.Task[None]] = set()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - a coroutine always runs in a task
        clients.add(task)
        try:
            plug = writer.get_extra_info("socket")
            plug.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            notice_loss(plug, _SILENCE_S, _PROBE_S)
            with contextlib.suppress(asyncio.CancelledError):  # the agent ends; asyncio would log it as an error
                await _serve_client(wiring, reader, writer, _trust(wiring.settings, writer), before_login)
        finally:
            clients.discard(task)

    try:
        server = await asyncio.start_server(accept, where.host, where.port, limit=_STREAM_LIMIT, backlog=_BACKLOG)
    except OSError as error:
        at = addresses.authority(where.host, where.port)
        raise ConfigError(f"The agent cannot listen on {at}: {error.strerror or error}.") from None
    log.info("agent on %s", addresses.url("tcp", *server.sockets[0].getsockname()[:2]))
    try:
        await asyncio.Event().wait()
    finally:
        server.close()
        # Turns first: people see the robot come to rest before they are disconnected. `wait_closed` of the server would
        # wait until the clients have left by themselves.
        await wiring.sessions.close()
        for task in list(clients):
            task.cancel()
        await asyncio.gather(*clients, return_exceptions=True)


async def _serve_stdio(wiring: Wiring) -> None:
    async with stdin(_STREAM_LIMIT) as reader, stdout() as writer:
        await _serve_client(wiring, reader, writer, _trust_the_parent(wiring.settings))


async def _serve_client(
    wiring: Wiring,
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    trusted: Callable[[], Awaitable[bool]],
    before_login: ConnectionsBeforeLogin | None = None,
) -> None:
    most = wiring.settings.agent.max_outbox_bytes
    connection = ClientConnection(reader, writer, trusted, most, wiring.requests, before_login)
    operations = Operations(wiring, connection)
    serving = asyncio.create_task(connection.serve(operations.router()), name=f"client {connection.id}")
    watching = asyncio.create_task(_dismiss_when_login_ends(wiring, connection))
    try:
        await asyncio.wait({serving, watching}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        serving.cancel()
        watching.cancel()
        for outcome in await asyncio.gather(serving, watching, return_exceptions=True):
            if isinstance(outcome, Exception):
                log.error("the connection of client %s failed", connection.id, exc_info=outcome)
        _cancel_what_a_visitor_began(wiring, connection)  # the bridge leaves at a logout, before anybody is dismissed
        operations.close()
        if before_login is not None:
            before_login.remove(connection)
        if connection.initialized:  # else it was no ACP client
            level = logging.INFO if connection.identity else logging.DEBUG  # no line for each wrong token
            log.log(level, "client %s (%s) left", connection.id, connection.name)


async def _dismiss_when_login_ends(wiring: Wiring, connection: ClientConnection) -> None:
    reason = await wiring.tokens.until_ended(lambda: connection.identity)
    log.info("client %s (%s) has to leave: %s", connection.id, connection.name, reason)
    _cancel_what_a_visitor_began(wiring, connection)
    await connection.dismiss()


def _cancel_what_a_visitor_began(wiring: Wiring, connection: ClientConnection) -> None:
    """Cancel the turns of a visitor whose login has ended: nobody else at that screen could cancel them."""
    who = connection.identity
    if who is None or who.role is not Role.VISITOR or wiring.tokens.ended(who) is None:
        return
    for session in wiring.sessions.open_sessions:
        if session.row.person == who.person and connection in session.watching:
            session.cancel()


@contextlib.asynccontextmanager
async def _wiring(settings: Settings, local_token: str | None) -> AsyncIterator[Wiring]:
    """Start everything that the connections share; at the end, stop it in the reverse order. Raises `ConfigError`."""
    agent = settings.agent
    if agent.default_mode not in MODE_IDS:
        raise ConfigError(f"agent.default_mode: there is no mode {agent.default_mode!r}.")
    try:
        policy = Policy(agent.policy, agent.visitors)
        offers = AllowList(agent.mcp_allow)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    # No other MCP server receives our secrets.
    bearer = (
        identity.shared_secret(settings.data_dir, identity.ROBOT_TOKEN) if settings.drives_our_robot_server else None
    )
    headers = {"Authorization": f"Bearer {bearer.decode()}"} if bearer else None
    tools = McpClient(settings.robot_mcp_url, headers, absent=_absent(settings))
    server = RobotServerClient.of(settings, settings.robot_base_url)
    link = RobotClient(server)
    tokens = Registry(settings.data_dir)
    store = Store(settings.database_url)
    usage = Usage()
    try:
        await store.open()
        await usage.read(store)
    except (StoreError, SQLAlchemyError) as error:
        raise ConfigError(why(error)) from None
    journal = Journal(store, count=usage.add_event)
    sessions = Sessions(store, journal, tools, agent.pose_tool, agent.permission_timeout, usage=usage)
    retention = Retention(store, sessions, usage, agent.storage)
    lease = Lease()
    audit = Audit(settings.data_dir, "agent")
    wiring = Wiring(
        settings=settings,
        tokens=tokens,
        sessions=sessions,
        journal=journal,
        retention=retention,
        link=link,
        turns=TurnEnvironment(
            robot_name=settings.robot.name,
            tools=tools,
            policy=policy,
            link=link,
            store=store,
            lease=lease,
            thought_timeout_s=agent.thought_timeout,
            max_steps=agent.max_steps,
            answer_timeout_s=agent.permission_timeout,
            four_eyes=frozenset(agent.four_eyes),
            preview=agent.preview,
            audit=audit,
        ),
        models=tuple(dict.fromkeys([agent.model, *agent.models, model.OFFLINE_MODEL])),
        offers=offers,
        abilities=Abilities(tools, agent.places_tool),
        people=People(),
        requests=RequestLimits(agent.requests),
        audit=audit,
        local_token=local_token,
        wrong_logins=WrongLogins(agent.requests.wrong_logins, audit),
    )
    background = [
        asyncio.create_task(tokens.run(), name="tokens"),
        asyncio.create_task(journal.run(), name="journal"),
        asyncio.create_task(retention.run(), name="retention"),
        asyncio.create_task(link.run(), name="robot link"),
        asyncio.create_task(server.keep_warm(), name="connection to the robot server"),
        asyncio.create_task(Attendance(sessions, lease, agent.unattended_after).run(), name="attendance"),
        asyncio.create_task(wiring.people.run(), name="people"),
        asyncio.create_task(_warm_up(tools, agent.model, agent.four_eyes), name="warm up"),
    ]
    try:
        yield wiring
    finally:
        await sessions.close()
        await journal.flush()
        for task in background:
            task.cancel()
        await asyncio.gather(*background, return_exceptions=True)
        await tools.close()
        await server.close()
        await store.close()
        await asyncio.to_thread(audit.close)


def _absent(settings: Settings) -> str:
    """The sentence for people while the robot does not answer."""
    if settings.drives_our_robot_server:
        return "The robot server does not answer. Start it with `robot-acp robot`, then try again."
    where = robot_address.without_login(settings.robot_mcp_url)
    return f"The robot's MCP server ({where}) does not answer. Start it, then try again."


async def _warm_up(tools: McpClient, default_model: str, four_eyes: Sequence[str]) -> None:
    """Connect to the robot and load the provider of the default model before anybody asks."""
    with contextlib.suppress(Exception):  # a robot that is not there yet is no error: the first prompt connects again
        for name in sorted(set(four_eyes) - set(await tools.tools())):
            log.warning("agent.four_eyes: the robot has no tool %r", visible(name))
    await providers.ready(default_model)
    collector.spare_program()


def _trust(settings: Settings, writer: asyncio.StreamWriter) -> Callable[[], Awaitable[bool]]:
    """Whether a TCP client is let in without a token, as `agent.trust_loopback` says."""

    async def trusted() -> bool:
        there, here = (writer.get_extra_info(end)[:2] for end in ("peername", "sockname"))
        if settings.agent.trust_loopback is False or not local_user.is_loopback(there[0]):
            return False
        if settings.agent.trust_loopback == "any_user":
            return True
        return await asyncio.to_thread(local_user.is_same_user, here, there)

    return trusted


def _trust_the_parent(settings: Settings) -> Callable[[], Awaitable[bool]]:
    """The same on stdio, where the client is the program that started this one."""

    async def trusted() -> bool:
        return settings.agent.trust_loopback is not False

    return trusted
