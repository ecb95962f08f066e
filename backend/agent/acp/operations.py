"""The ACP operations of one connection on its sessions, and the routes from methods to operations.

The SDK's schema validates every message before it gets here. Who is at the connection is settled in `initialize`,
who may do what in `rights`; the methods that are not ACP's are in `extensions`. Nothing here talks to the robot or
to a model, but for a stop: that is the turn's work.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import orjson
from acp.exceptions import RequestError
from acp.router import MessageRouter, Route
from acp.schema import (
    AuthenticateRequest,
    CancelNotification,
    CloseSessionRequest,
    CloseSessionResponse,
    DeleteSessionRequest,
    ForkSessionRequest,
    InitializeRequest,
    ListSessionsRequest,
    ListSessionsResponse,
    LoadSessionRequest,
    LogoutRequest,
    NewSessionRequest,
    PromptRequest,
    PromptResponse,
    ResumeSessionRequest,
    SessionInfo,
    SetSessionConfigOptionBooleanRequest,
    SetSessionConfigOptionSelectRequest,
    SetSessionModeRequest,
)
from pydantic import BaseModel, Field

from backend import meta as keys
from backend import wire
from backend.agent.acp import commands, content_limits, settings, updates
from backend.agent.acp.attachments import Attachments
from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.dispatch import AnswerThen, after_stop, database_away
from backend.agent.acp.extensions import Extensions
from backend.agent.acp.initialize import Login
from backend.agent.acp.rights import Rights
from backend.agent.control.stop import StopFailed, stop
from backend.agent.robot.server_addresses import Offer, ServerRefused
from backend.agent.sessions.retention import QuotaExceeded
from backend.agent.sessions.session import QueueFull, Session
from backend.agent.turns.turn import Turn
from backend.agent.wiring import Wiring
from backend.identity import Identity, Right

_Message = TypeVar("_Message", bound=BaseModel)


class SetModelRequest(BaseModel):
    """`session/set_model`, which the protocol has dropped and clients in the field still send."""

    session_id: str = Field(alias="sessionId")
    model_id: str = Field(alias="modelId")


class Operations:
    """The agent as one client sees it."""

    def __init__(self, wiring: Wiring, connection: ClientConnection) -> None:
        self._wiring = wiring
        self._connection = connection
        self._rights = Rights(wiring, connection)
        self._attachments = Attachments(wiring.sessions, connection, self._rights)
        self._login = Login(wiring, connection, self._attachments)
        self._extensions = Extensions(wiring, self._rights, self._attachments.detach)
        wiring.people.add(connection, self._attachments.sessions)

    def router(self) -> MessageRouter:
        """Every method that this agent knows."""
        router = MessageRouter()

        def request(method: str, model: type[_Message], operation: Callable[[_Message], Awaitable[Any]]) -> None:
            def checked(params: dict[str, Any]) -> Awaitable[Any]:
                content_limits.check(method, params, self._wiring.settings.agent.storage)
                return operation(model.model_validate(params))

            router.add_route(Route(method, checked, "request"))

        request("initialize", InitializeRequest, self._login.initialize)
        request("authenticate", AuthenticateRequest, self._login.authenticate)
        request("logout", LogoutRequest, self._login.logout)
        request("session/new", NewSessionRequest, self.new_session)
        request("session/load", LoadSessionRequest, self.load_session)
        request("session/resume", ResumeSessionRequest, self.resume_session)
        request("session/fork", ForkSessionRequest, self.fork_session)
        request("session/list", ListSessionsRequest, self.list_sessions)
        request("session/close", CloseSessionRequest, self.close_session)
        request("session/delete", DeleteSessionRequest, self.delete_session)
        request("session/prompt", PromptRequest, self.prompt)
        request("session/set_mode", SetSessionModeRequest, self.set_session_mode)
        request("session/set_model", SetModelRequest, self.set_model)
        router.add_route(Route("session/set_config_option", self._set_config_option, "request"))
        router.add_route(
            Route(
                "session/cancel", lambda params: self.cancel(CancelNotification.model_validate(params)), "notification"
            )
        )
        router.handle_extension_request(self._extensions.call)
        return router

    def close(self) -> None:
        """The client has gone: leave its sessions, end its telemetry."""
        self._wiring.people.remove(self._connection)
        self._attachments.detach_all()
        self._login.close()

    # Sessions

    async def new_session(self, request: NewSessionRequest) -> AnswerThen:
        """Begin a session."""
        who = self._rights.authorized(Right.PROMPT)
        offers = self._read_offers(request.mcp_servers)
        agent = self._wiring.settings.agent
        await self._admit(who, who.person, 0, new_session=True)
        session = await self._wiring.sessions.create(
            who.name, request.cwd, agent.default_mode, agent.model, owner_id=who.person
        )
        await session.client_servers.take(offers)
        self._connection.folders[session.id] = request.cwd
        await self._attachments.attach(session)
        return self._with_commands(session, {"sessionId": session.id} | settings.state(session, self._wiring.models))

    async def load_session(self, request: LoadSessionRequest) -> AnswerThen:
        """Attach to a session from its beginning: everything so far, then everything that comes."""
        session = await self._reopened(request.session_id, request.mcp_servers)
        self._connection.folders[session.id] = request.cwd
        await self._attachments.attach(session, after=0)
        return self._with_commands(session, self._reopened_state(session))

    async def resume_session(self, request: ResumeSessionRequest) -> AnswerThen:
        """Attach to a session from now on, or from the event after the one that `_meta` names."""
        after = (request.field_meta or {}).get(keys.AFTER)
        if after is not None and (not isinstance(after, int) or isinstance(after, bool) or after < 0):
            raise RequestError(wire.INVALID_PARAMS, f"{keys.AFTER} must be the number of an event.")
        session = await self._reopened(request.session_id, request.mcp_servers)
        self._connection.folders[session.id] = request.cwd
        await self._attachments.attach(session, after)
        return self._with_commands(session, self._reopened_state(session))

    async def fork_session(self, request: ForkSessionRequest) -> AnswerThen:
        """Begin a session of one's own with the same past."""
        who = self._rights.authorized(Right.PROMPT)
        offers = self._read_offers(request.mcp_servers)
        session = await self._rights.session(request.session_id)
        size = self._wiring.retention.size_of(session.id)
        await self._admit(who, who.person, size, new_session=True)
        fork = await self._wiring.sessions.fork(session, who.name, request.cwd, owner_id=who.person)
        await fork.client_servers.take(offers)  # those of the original stay there: their headers are somebody's secrets
        self._connection.folders[fork.id] = request.cwd
        await self._attachments.attach(fork)
        return self._with_commands(fork, {"sessionId": fork.id} | settings.state(fork, self._wiring.models))

    async def list_sessions(self, request: ListSessionsRequest) -> ListSessionsResponse:
        """The sessions that this person may see, newest first; with `_meta`, only those that contain its words.

        `cwd` sorts out none: a robot has no working folders.
        """
        who = self._rights.known()
        words = (request.field_meta or {}).get(keys.SEARCH, "")
        if not isinstance(words, str):
            raise RequestError(wire.INVALID_PARAMS, f"{keys.SEARCH} must be text.")
        rows, last = await self._wiring.sessions.page(who, settings.read_cursor(request.cursor), words)
        infos = [
            SessionInfo(
                session_id=row.id,
                cwd=row.cwd,
                title=row.title,
                updated_at=settings.iso(row.updated),
                field_meta={keys.OWNER: row.owner} | self._running_turn(row.id),
            )
            for row in rows
        ]
        return ListSessionsResponse(sessions=infos, next_cursor=settings.cursor_behind(last) if last else None)

    async def close_session(self, request: CloseSessionRequest) -> CloseSessionResponse:
        """End what runs in the session, and leave it."""
        session = await self._rights.own(request.session_id)
        await session.close()
        self._attachments.detach(session.id)
        return CloseSessionResponse()

    async def delete_session(self, request: DeleteSessionRequest) -> dict[str, Any]:
        """Remove the session and its log."""
        who = self._rights.known()
        session = await self._rights.own(request.session_id)
        try:
            await self._wiring.sessions.delete(session)
        finally:
            if session.deleted:  # also where the client has gone meanwhile
                self._wiring.audit.record("session_deleted", who, session=session.id, owner=session.row.owner)
        self._attachments.forget(session.id)
        return {}

    # Turns

    async def prompt(self, request: PromptRequest) -> AnswerThen | PromptResponse:
        """Run a turn; the answer comes after its last update.

        `/stop` stops the robot before anything else, in any session and for everyone who is logged in.
        """
        who = self._rights.known()
        blocks = [block.model_dump(mode="json", by_alias=True, exclude_none=True) for block in request.prompt]
        if not blocks:
            raise RequestError(wire.INVALID_PARAMS, "A prompt needs at least one block.")
        stopped: str | None = None
        if commands.named_in(blocks) == "stop":  # a stop waits for nothing: no right, no log, no turn that runs
            stopped = await self._stop(who)
            blocks = [updates.text_block("/stop")]  # whatever was around it
            try:
                session = await self._rights.session(request.session_id)
            except Exception as error:
                raise after_stop(stopped, error) from None
        else:
            self._rights.authorized(Right.PROMPT)
            session = await self._rights.own(request.session_id)
            if self._wiring.journal.failure:
                raise database_away(self._wiring.journal.failure)
            await self._admit(who, session.row.person, len(orjson.dumps(blocks)))
        newly_attached = self._connection not in session.watching
        if newly_attached:
            await self._attachments.attach_at_once(session)  # waiting for a replay, the turn would miss a cancel
        turn = Turn(self._wiring.turns, session, who, blocks, self._connection, stopped)

        try:
            reason = await session.run_turn(turn)
        except QueueFull as full:
            raise RequestError(wire.INTERNAL_ERROR, str(full)) from None
        await session.flushed()
        answer = PromptResponse(stop_reason=reason)
        return self._with_commands(session, answer) if newly_attached else answer

    async def cancel(self, notification: CancelNotification) -> None:
        """End the turn. Whoever may prompt in a session may cancel in it."""
        self._rights.authorized(Right.PROMPT)
        (await self._rights.session(notification.session_id)).cancel()

    async def _stop(self, who: Identity) -> str:
        """Stop the robot, and say in words whether it is stopped."""
        try:
            await stop(self._wiring.link, self._wiring.sessions, who, self._wiring.audit)
        except StopFailed as failed:
            return str(failed)
        if self._wiring.link.keeps_a_stop:
            return "I am stopped. A supervisor has to release me."
        return "The robot's own server says that the robot is stopped. Every turn was cancelled."

    # Settings

    async def set_session_mode(self, request: SetSessionModeRequest) -> dict[str, Any]:
        """Change the mode, from the next tool call on."""
        await self._change_setting(request.session_id, "mode", request.mode_id)
        return {}

    async def set_model(self, request: SetModelRequest) -> dict[str, Any]:
        """Change the model, as older clients do."""
        await self._change_setting(request.session_id, "model", request.model_id)
        return {}

    async def _set_config_option(self, params: dict[str, Any]) -> dict[str, Any]:
        """Change one of the settings that a session publishes; the schema has a message for each type of value."""
        content_limits.check("session/set_config_option", params, self._wiring.settings.agent.storage)
        if params.get("type") == "boolean":
            switch = SetSessionConfigOptionBooleanRequest.model_validate(params)
            return await self._change_setting(switch.session_id, switch.config_id, switch.value)
        choice = SetSessionConfigOptionSelectRequest.model_validate(params)
        return await self._change_setting(choice.session_id, choice.config_id, choice.value)

    async def _change_setting(self, session_id: str, config_id: str, value: str | bool) -> dict[str, Any]:
        who = self._rights.authorized(Right.CONFIGURE)
        session = await self._rights.own(session_id)
        old_mode = session.row.mode
        if self._wiring.journal.failure and self._wiring.journal.overfull:
            raise database_away(self._wiring.journal.failure)
        try:
            updates = settings.change(session, config_id, value, self._wiring.models)
        except ValueError as error:
            raise RequestError(wire.INVALID_PARAMS, str(error)) from None
        if session.row.mode != old_mode:
            self._wiring.audit.record("mode_changed", who, session=session.id, old=old_mode, new=session.row.mode)
        for update in updates:
            session.record(update)
        return {"configOptions": settings.config_options(session, self._wiring.models)}

    # Shared by the operations

    async def _admit(self, who: Identity, owner: str, more_bytes: int, *, new_session: bool = False) -> None:
        """Refuse what the quota of a login has no room for."""
        try:
            await self._wiring.retention.admit(who, owner, more_bytes, new_session=new_session)
        except QuotaExceeded as full:
            raise RequestError(wire.NOT_ALLOWED, str(full)) from None

    def _read_offers(self, servers: list[Any] | None) -> tuple[Offer, ...]:
        """The MCP servers that the client brings, if it may bring them."""
        who = self._rights.known()
        try:
            return self._wiring.offers.read(servers or [], role=who.role, may_offer=who.may(Right.OFFER_SERVERS))
        except ServerRefused as refused:
            raise RequestError(refused.code, str(refused)) from None

    async def _reopened(self, session_id: str, servers: list[Any] | None) -> Session:
        """The session, with the client's MCP servers in place of those it had; without any it keeps those it had."""
        offers = self._read_offers(servers)
        session = await self._rights.session(session_id)
        if offers:
            await session.client_servers.take(offers)
        return session

    def _reopened_state(self, session: Session) -> dict[str, Any]:
        answer = settings.state(session, self._wiring.models)
        answer["_meta"] |= self._running_turn(session.id)
        return answer

    def _running_turn(self, session_id: str) -> dict[str, Any]:
        """The `_meta` that names the turn that runs in a session; empty between turns."""
        turn_id = self._wiring.sessions.turn_of(session_id)
        return {keys.TURN: {"id": turn_id, "state": "running"}} if turn_id is not None else {}

    def _with_commands(self, session: Session, answer: object) -> AnswerThen:
        """The answer, and the slash commands behind it: before it a client may not know the session."""
        return AnswerThen(answer, lambda: self._attachments.send_commands(session))
