"""`WS /acp`: which agent a client gets, and what it is told at the end."""

from __future__ import annotations

import logging
import time
import uuid

from starlette.websockets import WebSocket

from backend.bridge.closing import LEFT, SERVICE_RESTART, TRY_AGAIN_LATER, End, close
from backend.bridge.direct import DirectWebSocket
from backend.bridge.login import Gate, Login
from backend.bridge.race import first_of
from backend.bridge.relay import Relay
from backend.bridge.upstream import Agent, AgentDownError

SUBPROTOCOL = "acp.v1"

log = logging.getLogger(__name__)


class AcpSocket:
    """Serves clients, each with an agent's connection of its own."""

    def __init__(self, gate: Gate, agent: Agent, *, max_frame_bytes: int) -> None:
        self._gate = gate
        self._agent = agent
        self._limit = max_frame_bytes

    async def serve(self, websocket: WebSocket, login: Login) -> None:
        """Relay for one client until either side is gone, and close."""
        connection_id = uuid.uuid4().hex
        await websocket.accept(
            subprotocol=SUBPROTOCOL if SUBPROTOCOL in websocket.scope["subprotocols"] else None,
            headers=[(b"acp-connection-id", connection_id.encode())],
        )
        who = login.identity
        log.info("acp %s connected: %s (%s)", connection_id, who.name, who.role.value)
        started = time.monotonic()
        end = End(SERVICE_RESTART, "interrupted")
        try:
            end = await self._relay(websocket, login, connection_id)
        finally:
            seconds = time.monotonic() - started
            log.info("acp %s gone: %s after %.0f s: %s", connection_id, who.name, seconds, end.reason)

    async def _relay(self, websocket: WebSocket, login: Login, connection_id: str) -> End:
        relay = Relay(DirectWebSocket.of(websocket.scope), login.token, connection_id, self._limit)
        try:
            agent = await self._agent.connect(relay, self._limit)
        except AgentDownError as error:
            end = End(TRY_AGAIN_LATER, str(error))
            await close(websocket, end)
            return end
        try:
            relay.begin(agent)
            end = await first_of(relay.ended(), _left(websocket), self._gate.until_ended(login))
            # The agent watches logins as well: when it hung up first, this is still the reason.
            end = self._gate.ended(login) or end
            await close(websocket, end)
            return end
        finally:
            relay.close()
            await agent.close()  # last: a child process may take its time


async def _left(websocket: WebSocket) -> End:
    """Wait until the client has gone: the only thing that a relayed WebSocket still tells through ASGI."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass
    return LEFT
