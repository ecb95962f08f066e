"""`WS /acp`: connects each client to the agent, and closes it with a reason."""

from __future__ import annotations

import logging
import time
import uuid

from starlette.websockets import WebSocket

from backend.bridge.close_codes import CLIENT_LEFT, SERVICE_RESTART, TRY_AGAIN_LATER, CloseReason, close
from backend.bridge.first_completed import first_completed
from backend.bridge.limits import Limits
from backend.bridge.login import Authenticator, Login
from backend.bridge.relay import Relay
from backend.bridge.upstream import Agent, AgentUnreachableError
from backend.bridge.websocket_protocol import WebSocketProtocol

SUBPROTOCOL = "acp.v1"

log = logging.getLogger(__name__)


class AcpSocket:
    """Serves clients, each with a connection of its own to the agent."""

    def __init__(self, authenticator: Authenticator, agent: Agent, *, max_frame_bytes: int, limits: Limits) -> None:
        self._authenticator = authenticator
        self._agent = agent
        self._max_frame_bytes = max_frame_bytes
        self._limits = limits

    async def serve(self, websocket: WebSocket, login: Login) -> None:
        """Relay one client until either side has closed, then close the other one."""
        connection_id = uuid.uuid4().hex
        await websocket.accept(
            subprotocol=SUBPROTOCOL if SUBPROTOCOL in websocket.scope["subprotocols"] else None,
            headers=[(b"acp-connection-id", connection_id.encode())],
        )
        who = login.identity
        log.info("acp %s connected: %s (%s)", connection_id, who.name, who.role.value)
        started = time.monotonic()
        reason = CloseReason(SERVICE_RESTART, "interrupted")
        try:
            reason = await self._relay(websocket, login, connection_id)
        finally:
            seconds = time.monotonic() - started
            log.info("acp %s gone: %s after %.0f s: %s", connection_id, who.name, seconds, reason.reason)

    async def _relay(self, websocket: WebSocket, login: Login, connection_id: str) -> CloseReason:
        client = WebSocketProtocol.of(websocket.scope)
        relay = Relay(client, login.token, connection_id, self._max_frame_bytes, self._limits)
        try:
            agent = await self._agent.connect(relay, self._max_frame_bytes)
        except AgentUnreachableError as error:
            reason = CloseReason(TRY_AGAIN_LATER, str(error))
            await close(websocket, reason)
            return reason
        try:
            relay.begin(agent)
            reason = await first_completed(
                relay.ended(), _wait_for_client(websocket), self._authenticator.until_login_ends(login)
            )
            # The agent checks logins as well. Where it closed first, the end of the login is still the reason.
            reason = self._authenticator.login_end(login) or reason
            await close(websocket, reason)
            return reason
        finally:
            relay.close()
            await agent.close()  # last, as a child process may take its time


async def _wait_for_client(websocket: WebSocket) -> CloseReason:
    """Wait until the client has left, the only event that a relayed WebSocket still reports through ASGI."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass
    return CLIENT_LEFT
