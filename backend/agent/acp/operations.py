"""The ACP operations of one connection: what each does to a session. Who may is in `rights`, what is no ACP in
`extensions`.

The official SDK validates every message against the schema before it gets here, and every answer goes through its
types. Nothing here talks to the robot or to a model: that is the turn.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import orjson
from acp.agent.router import build_agent_router
from acp.exceptions import RequestError
from acp.router import MessageRouter
from acp.schema import (
    AuthenticateResponse,
    CloseSessionResponse,
    DeleteSessionRequest,
    InitializeResponse,
    ListSessionsResponse,
    LogoutRequest,
    LogoutResponse,
    PromptResponse,
    SessionInfo,
)
from pydantic import BaseModel, Field

from backend import identity, wire
from backend import meta as keys
from backend.agent.acp import commands, settings
from backend.agent.acp.connection import ClientConnection, after_the_answer
from backend.agent.acp.extensions import Extensions
from backend.agent.acp.initialize import hello
from backend.agent.acp.rights import Rights, no_session
from backend.agent.acp.telemetry import TelemetryFeed
from backend.agent.robot.robot_client import RobotError
from backend.agent.robot.server_addresses import Offer, ServerRefused
from backend.agent.sessions.session import QueueFull, Session
from backend.agent.turns.turn import Turn
from backend.agent.wiring import Wiring
from backend.identity import Identity, Right, Role
from backend.tokens import RegistryError

log = logging.getLogger(__name__)


class SetModelRequest(BaseModel):
    """`session/set_model`, which the protocol has dropped and clients in the field still send."""

    session_id: str = Field(alias="sessionId")
    model_id: str = Field(alias="modelId")
    field_meta: dict[str, Any] | None = Field(None, alias="_meta")


class Operations:
    """The agent as one client sees it. A plain class, so that an operation that is missing is an error."""

    def __init__(self, wiring: Wiring, connection: ClientConnection) -> None:
        self._wiring = wiring
        self._connection = connection
        self._attached: dict[str, Session] = {}
        self._attaching = asyncio.Lock()
        self._rights = Rights(wiring, connection)
        self._extensions = Extensions(wiring, self._rights, self._detach)
        self._greeted = False
        self._feed: TelemetryFeed | None = None
        wiring.people.enter(connection, self._attached)

    def router(self) -> MessageRouter:
        """The SDK's routes, and those that it lacks."""
        router = build_agent_router(self, use_unstable_protocol=True)  # type: ignore[arg-type] # see the class
        router.route_request("session/delete", DeleteSessionRequest, self, "delete_session")
        router.route_request("session/set_model", SetModelRequest, self, "set_model")
        router.route_request("logout", LogoutRequest, self, "logout")
        return router

    def left(self) -> None:
        """The client has gone."""
        self._wiring.people.leave(self._connection)
        self._detach_all()
        if self._feed:
            self._feed.close()

    # Connection

    async def initialize(
        self,
        protocol_version: int,
        client_capabilities: BaseModel | None = None,
        client_info: BaseModel | None = None,
        meta: dict[str, Any] | None = None,
    ) -> InitializeResponse:
        """Agree on the version, and learn who this is: by the bridge's token, or because it comes from here."""
        del protocol_version, client_info  # there is one version
        if self._greeted:
            return hello(self._wiring, self._connection.identity)  # who this is has been settled, and stays
        token = (meta or {}).get(keys.TOKEN)
        if token is not None:
            self._identify(token)
        elif self._connection.local and self._wiring.settings.agent.trust_loopback:
            self._connection.identity = Identity("local", Role.SUPERVISOR)
        capabilities = client_capabilities.model_dump(by_alias=True) if client_capabilities else {}
        self._greeted = True
        who = self._connection.identity
        log.info("client %s: %s", self._connection.id, f"{who.name}, {who.role.value}" if who else "not logged in")
        self._connection.client_capabilities = capabilities
        self._follow_robot((capabilities.get("_meta") or {}).get(keys.TELEMETRY))
        return hello(self._wiring, self._connection.identity)

    async def authenticate(self, method_id: str, meta: dict[str, Any] | None = None) -> AuthenticateResponse:
        """Prove who one is with a token in `_meta`."""
        token = (meta or {}).get(keys.TOKEN)
        if method_id != "token" or not isinstance(token, str):
            raise RequestError(wire.INVALID_PARAMS, f'Authenticate with method "token" and {keys.TOKEN} in _meta.')
        self._identify(token)
        self._judge()
        return AuthenticateResponse()

    async def logout(self, meta: dict[str, Any] | None = None) -> LogoutResponse:
        """Forget who this is: nothing is shown to it, and it is asked nothing, until it authenticates."""
        del meta
        self._connection.identity = None
        self._detach_all()
        return LogoutResponse()

    def _judge(self) -> None:
        """Who this is has changed, and so may what it may see and be asked."""
        who = self._rights.known()
        for session in list(self._attached.values()):
            if not self._wiring.sessions.shows(session, who):
                self._detach(session.id)
            elif self._connection in session.watching:  # else it is judged when it is attached
                session.rights_changed(self._connection)

    def _detach(self, session_id: str) -> None:
        if session := self._attached.pop(session_id, None):  # what waits to be attached is not attached any more
            session.detach(self._connection)

    def _detach_all(self) -> None:
        self._attached.clear()
        for session in self._wiring.sessions.open_sessions:
            session.detach(self._connection)

    def _identify(self, token: object) -> None:
        try:
            self._connection.identity = self._wiring.tokens.verify(str(token))
        except (identity.InvalidToken, RegistryError) as error:
            raise RequestError(wire.AUTH_REQUIRED, str(error)) from None

    # Sessions

    async def new_session(
        self,
        cwd: str,
        mcp_servers: list[Any] | None = None,
        additional_directories: list[str] | None = None,
        meta: dict[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Begin a session."""
        del additional_directories, meta
        who = self._rights.authorized(Right.PROMPT)
        offers = self._offers(mcp_servers)
        agent = self._wiring.settings.agent
        session = await self._wiring.sessions.create(who.name, cwd, agent.default_mode, agent.model)
        await session.client_servers.take(offers)
        await self._attach(session)
        return {"sessionId": session.id} | settings.state(session, self._wiring.models)

    async def load_session(
        self,
        cwd: str,
        session_id: str,
        mcp_servers: list[Any] | None = None,
        additional_directories: list[str] | None = None,
        meta: dict[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Watch a session from its beginning: everything so far, then what comes."""
        del cwd, additional_directories, meta
        session = await self._reopened(session_id, mcp_servers)
        await self._attach(session, after=0)
        return self._opened(session)

    async def resume_session(
        self,
        cwd: str,
        session_id: str,
        mcp_servers: list[Any] | None = None,
        additional_directories: list[str] | None = None,
        meta: dict[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Watch a session from now on, or from the event after the one that `_meta` names."""
        del cwd, additional_directories
        after = (meta or {}).get(keys.AFTER)
        if after is not None and (not isinstance(after, int) or isinstance(after, bool) or after < 0):
            raise RequestError(wire.INVALID_PARAMS, f"{keys.AFTER} must be the number of an event.")
        session = await self._reopened(session_id, mcp_servers)
        await self._attach(session, after)
        return self._opened(session)

    async def fork_session(
        self,
        session_id: str,
        cwd: str,
        mcp_servers: list[Any] | None = None,
        additional_directories: list[str] | None = None,
        meta: dict[str, Any] | None = None,
    ) -> dict[str, Any]:
        """A session of one's own with the same past."""
        del cwd, additional_directories, meta
        who = self._rights.authorized(Right.PROMPT)
        offers = self._offers(mcp_servers)
        fork = await self._wiring.sessions.fork(await self._rights.session(session_id), who.name)
        await fork.client_servers.take(offers)  # those of the original stay there: their headers are somebody's secrets
        await self._attach(fork)
        return {"sessionId": fork.id} | settings.state(fork, self._wiring.models)

    async def list_sessions(
        self, cwd: str | None = None, cursor: str | None = None, meta: dict[str, Any] | None = None
    ) -> ListSessionsResponse:
        """The sessions that this person may see, newest first; those alone that have the words that `_meta` gives."""
        del cwd  # a robot has no working folder that would sort sessions
        who = self._rights.known()
        words = (meta or {}).get(keys.SEARCH, "")
        if not isinstance(words, str):
            raise RequestError(wire.INVALID_PARAMS, f"{keys.SEARCH} must be text.")
        rows = await self._wiring.sessions.page(who, settings.read_cursor(cursor), words)
        infos = [
            SessionInfo(
                session_id=row.id,
                cwd=row.cwd,
                title=row.title,
                updated_at=settings.iso(row.updated),
                field_meta={keys.OWNER: row.owner} | self._running(row.id),
            )
            for row in rows
        ]
        return ListSessionsResponse(sessions=infos, next_cursor=settings.next_cursor(rows))

    async def close_session(self, session_id: str, meta: dict[str, Any] | None = None) -> CloseSessionResponse:
        """End what runs in the session, and stop watching it."""
        del meta
        session = await self._rights.own(session_id)
        await session.close()
        self._detach(session_id)
        return CloseSessionResponse()

    async def delete_session(self, session_id: str, meta: dict[str, Any] | None = None) -> dict[str, Any]:
        """Remove the session and its log."""
        del meta
        session = await self._rights.own(session_id)
        await self._wiring.sessions.delete(session)
        self._attached.pop(session_id, None)
        return {}

    # Turns

    async def prompt(
        self, session_id: str, prompt: list[BaseModel], meta: dict[str, Any] | None = None
    ) -> PromptResponse:
        """Run a turn; the answer comes after its last update. `/stop` stops first, whoever says it and wherever."""
        del meta
        who = self._rights.known()
        blocks = [block.model_dump(mode="json", by_alias=True, exclude_none=True) for block in prompt]
        if not blocks:
            raise RequestError(wire.INVALID_PARAMS, "A prompt needs at least one block.")
        stopped: str | None = None
        if commands.named_in(blocks) == "stop":  # a stop waits for nothing: no right, no log, no turn that runs
            stopped = await self._stopped(who)
            session = await self._rights.session(session_id)
        else:
            self._rights.authorized(Right.PROMPT)
            session = await self._rights.own(session_id)
            if self._wiring.journal.failure:
                raise RequestError(wire.INTERNAL_ERROR, self._wiring.journal.failure)
        if self._connection not in session.watching:
            await self._watch(session)  # behind no replay: a cancel that comes next must find the turn
        turn = Turn(self._wiring.turns, session, who, blocks, self._connection, stopped)

        try:
            reason = await session.run_turn(turn)
        except QueueFull as full:
            raise RequestError(wire.INTERNAL_ERROR, str(full)) from None
        await session.flushed()
        return PromptResponse(stop_reason=reason)

    async def _stopped(self, who: Identity) -> str:
        """Stop the robot, and tell in words what came of it."""
        try:
            await self._wiring.link.stop(who.name)
        except RobotError as error:
            return str(error)
        return "I am stopped. A supervisor has to release me."

    async def cancel(self, session_id: str, meta: dict[str, Any] | None = None) -> None:
        """End the turn. Whoever may prompt in a session may cancel in it."""
        del meta
        self._rights.authorized(Right.PROMPT)
        (await self._rights.session(session_id)).cancel()

    # Settings

    async def set_session_mode(self, session_id: str, mode_id: str, meta: dict[str, Any] | None = None) -> None:
        """Change the mode, from the next tool call on."""
        del meta
        await self.set_config_option("mode", session_id, mode_id)

    async def set_model(self, session_id: str, model_id: str, meta: dict[str, Any] | None = None) -> dict[str, Any]:
        """Change the model, as older clients do."""
        del meta
        await self.set_config_option("model", session_id, model_id)
        return {}

    async def set_config_option(
        self, config_id: str, session_id: str, value: str | bool, type: str | None = None, meta: Any = None
    ) -> dict[str, Any]:
        """Change the mode or the model."""
        del type, meta
        self._rights.authorized(Right.CONFIGURE)
        session = await self._rights.own(session_id)
        try:
            updates = settings.change(session, config_id, value, self._wiring.models)
        except ValueError as error:
            raise RequestError(wire.INVALID_PARAMS, str(error)) from None
        for update in updates:
            session.record(update)
        return {"configOptions": settings.config_options(session, self._wiring.models)}

    # Extensions

    async def ext_method(self, name: str, params: dict[str, Any]) -> dict[str, Any]:
        """The methods of our own, without the underscore that their names begin with."""
        return await self._extensions.call(name, params)

    async def ext_notification(self, name: str, params: dict[str, Any]) -> None:
        """Unknown notifications are ignored, as the protocol says."""

    # Helpers of the operations

    def _offers(self, servers: list[Any] | None) -> tuple[Offer, ...]:
        who = self._rights.known()
        try:
            return self._wiring.offers.read(servers or [], role=who.role, may_offer=who.may(Right.OFFER_SERVERS))
        except ServerRefused as refused:
            raise RequestError(refused.code, str(refused)) from None

    async def _reopened(self, session_id: str, servers: list[Any] | None) -> Session:
        """The session, with the servers of the client in place of those that it had; no servers leave it as it is."""
        offers = self._offers(servers)
        session = await self._rights.session(session_id)
        if offers:
            await session.client_servers.take(offers)
        return session

    async def _attach(self, session: Session, after: int | None = None) -> None:
        self._attached.pop(session.id, None)
        self._attached[session.id] = session  # the newest is the last
        async with self._attaching:  # two replays at once would mix their events
            if self._attached.get(session.id) is session:  # else it was left meanwhile
                await self._watch(session, after)

    async def _watch(self, session: Session, after: int | None = None) -> None:
        if not self._wiring.sessions.shows(session, self._rights.known()):  # the login may have changed meanwhile
            self._attached.pop(session.id, None)
            raise no_session(session.id)
        self._attached[session.id] = session
        if after is None:
            await session.attach(self._connection)
        else:
            await session.attach(self._connection, lambda upto: self._wiring.sessions.replay(session, after, upto))
        after_the_answer(lambda: self._tell_commands(session.id))

    def _tell_commands(self, session_id: str) -> None:
        update = {"sessionUpdate": "available_commands_update", "availableCommands": commands.available()}
        message = {"jsonrpc": "2.0", "method": "session/update", "params": {"sessionId": session_id, "update": update}}
        self._connection.deliver(orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE))

    def _opened(self, session: Session) -> dict[str, Any]:
        answer = settings.state(session, self._wiring.models)
        answer["_meta"] |= self._running(session.id)
        return answer

    def _running(self, session_id: str) -> dict[str, Any]:
        """The `_meta` that tells of the turn that runs in a session; empty between turns."""
        turn_id = self._wiring.sessions.turn_of(session_id)
        return {keys.TURN: {"id": turn_id, "state": "running"}} if turn_id is not None else {}

    def _follow_robot(self, wanted: Any) -> None:
        if isinstance(wanted, dict):
            self._feed = TelemetryFeed(self._wiring, self._connection, wanted.get("rate"))
