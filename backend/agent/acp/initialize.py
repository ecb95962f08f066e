"""Who is at a connection: `initialize`, `authenticate` and `logout`, and what this agent says of itself.

What an identity may do is in `rights`. Nothing here opens a session.
"""

from __future__ import annotations

import hmac
import logging
from typing import Any

from acp.exceptions import RequestError
from acp.schema import (
    AgentCapabilities,
    AuthenticateRequest,
    AuthenticateResponse,
    AuthMethodAgent,
    Implementation,
    InitializeRequest,
    InitializeResponse,
    LogoutRequest,
    LogoutResponse,
    McpCapabilities,
    PromptCapabilities,
    SessionCapabilities,
)

from backend import __version__, identity, wire
from backend import meta as keys
from backend.agent.acp.attachments import Attachments
from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.extensions import EXTENSIONS
from backend.agent.acp.request_limits import too_many
from backend.agent.acp.telemetry import TelemetryFeed
from backend.agent.wiring import Wiring
from backend.identity import LOCAL, Identity
from backend.tokens import RegistryError
from backend.wrong_logins import TOO_MANY

PROTOCOL_VERSION = 1

log = logging.getLogger(__name__)


class Login:
    """The identity of one connection."""

    def __init__(self, wiring: Wiring, connection: ClientConnection, attachments: Attachments) -> None:
        self._wiring = wiring
        self._connection = connection
        self._attachments = attachments
        self._initialized = False
        self._telemetry: TelemetryFeed | None = None

    async def initialize(self, request: InitializeRequest) -> InitializeResponse:
        """Agree on the version, of which there is one, and learn who this is: from the token of the bridge or of the
        client, or because the client is one that is trusted without. Only the first time counts."""
        if self._initialized:
            return initialize_response(self._wiring, self._connection.identity)
        token = (request.field_meta or {}).get(keys.TOKEN)
        if token is not None:
            self._identify(token)
        elif self._connection.trusted:
            self._accept(LOCAL)
        self._initialized = True
        who = self._connection.identity
        log.info("client %s: %s", self._connection.id, f"{who.name}, {who.role.value}" if who else "not logged in")
        capabilities = request.client_capabilities.model_dump(by_alias=True) if request.client_capabilities else {}
        self._connection.client_capabilities = capabilities
        self._start_telemetry((capabilities.get("_meta") or {}).get(keys.TELEMETRY))
        return initialize_response(self._wiring, who)

    async def authenticate(self, request: AuthenticateRequest) -> AuthenticateResponse:
        """Log in with the token in `_meta`, perhaps as somebody else than before."""
        token = (request.field_meta or {}).get(keys.TOKEN)
        if request.method_id != "token" or not isinstance(token, str):
            raise RequestError(wire.INVALID_PARAMS, f'Authenticate with method "token" and {keys.TOKEN} in _meta.')
        self._identify(token)
        self._attachments.apply_rights()
        return AuthenticateResponse()

    async def logout(self, request: LogoutRequest) -> LogoutResponse:
        """Forget who this is: until it authenticates, the client is shown nothing and asked nothing."""
        del request
        if (who := self._connection.identity) is not None:
            self._wiring.audit.record("logout", who, address=self._connection.address)
        self._connection.identity = None
        self._attachments.detach_all()
        return LogoutResponse()

    def close(self) -> None:
        """The client has gone: end its telemetry."""
        if self._telemetry:
            self._telemetry.close()

    def _identify(self, token: object) -> None:
        local_token = self._wiring.local_token
        if local_token and hmac.compare_digest(str(token).encode(errors="replace"), local_token.encode()):
            self._accept(LOCAL)
            return
        try:
            self._accept(self._wiring.tokens.verify(str(token)))
        except identity.InvalidToken as error:
            if wait := self._wiring.wrong_logins.count(self._connection.address, str(error)):
                raise too_many(TOO_MANY, wait) from None
            raise RequestError(wire.AUTH_REQUIRED, str(error)) from None
        except RegistryError as error:
            self._wiring.audit.record("login_refused", address=self._connection.address, reason=str(error))
            raise RequestError(wire.AUTH_REQUIRED, str(error)) from None

    def _accept(self, who: Identity) -> None:
        self._connection.identity = who
        self._wiring.audit.record("login", who, address=self._connection.address)

    def _start_telemetry(self, wanted: Any) -> None:
        if isinstance(wanted, dict):
            self._telemetry = TelemetryFeed(self._wiring, self._connection, wanted.get("rate"))


def initialize_response(wiring: Wiring, who: Identity | None) -> InitializeResponse:
    """What this agent can do, and as whom it knows the client; `who` is None before the login."""
    robot = wiring.settings.robot.name
    about = {"extensions": list(EXTENSIONS), "robot": robot}
    if who:
        about |= {"role": who.role.value, "name": who.name}
    return InitializeResponse(
        protocol_version=PROTOCOL_VERSION,
        agent_info=Implementation(name="robot-acp", title=robot, version=__version__),
        auth_methods=[AuthMethodAgent(id="token", name="Login token", description="Ask the robot's operator.")],
        agent_capabilities=AgentCapabilities(
            load_session=True,
            prompt_capabilities=PromptCapabilities(image=True, audio=False, embedded_context=True),
            mcp_capabilities=McpCapabilities(http=bool(wiring.offers), sse=False),
            session_capabilities=SessionCapabilities.model_validate(
                {"list": {}, "resume": {}, "fork": {}, "close": {}, "delete": {}}
            ),
            field_meta={keys.CAPABILITIES: about},
        ),
    )
