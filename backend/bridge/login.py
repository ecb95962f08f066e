"""Who is asking: a token in a cookie, in an `Authorization` header, or in a WebSocket subprotocol.

The login page trades a token for a cookie that scripts cannot read. A token is never logged, never put into
an answer and never taken from an address.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import msgspec
from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from starlette.requests import HTTPConnection

from backend.bridge.closing import LOGIN_ENDED, End
from backend.bridge.origin import OriginPolicy
from backend.identity import Identity, InvalidToken
from backend.tokens import Registry

COOKIE = "robot_acp"
SUBPROTOCOL = "bearer."
_MAX_BODY_BYTES = 16 * 1024


class LoginError(Exception):
    """The request proves no identity; the text tells the person what to do."""


@dataclass(frozen=True)
class Login:
    """A proved identity, and the token that proves it."""

    identity: Identity
    token: str


class _LoginBody(msgspec.Struct):
    token: str


class Gate:
    """Tells who a request comes from, and whether it may come from there."""

    def __init__(self, tokens: Registry, origins: OriginPolicy) -> None:
        self._tokens = tokens
        self._origins = origins

    def login(self, connection: HTTPConnection) -> Login:
        """Who is asking. Raises `LoginError` or `RegistryError`."""
        return self._login(connection)

    def verify(self, token: str, *, to_stop: bool = False) -> Identity:
        """Whom a token stands for. Raises `LoginError` or `RegistryError`."""
        try:
            return self._tokens.verify(token, to_stop=to_stop)
        except InvalidToken as error:
            raise LoginError(str(error)) from None

    def admit(self, connection: HTTPConnection, *, to_stop: bool = False) -> Login:
        """Who asks for something that changes the world. Raises `LoginError`, `OriginError` or `RegistryError`.

        `to_stop` lets in whoever may stop the robot, which is more than may do anything else.
        """
        _, explicit = _presented(connection)
        self._origins.check(connection, explicit_token=explicit)
        return self._login(connection, to_stop=to_stop)

    def ended(self, login: Login) -> End | None:
        """The end of a login that was let in; None while it holds."""
        reason = self._tokens.ended(login.identity)
        return End(LOGIN_ENDED, reason) if reason else None

    async def until_ended(self, login: Login) -> End:
        """Wait until a login is over: revoked, or expired."""
        return End(LOGIN_ENDED, await self._tokens.until_ended(lambda: login.identity))

    def check_origin(self, connection: HTTPConnection) -> None:
        """For the requests that carry a token in their body. Raises `OriginError`."""
        self._origins.check(connection, explicit_token=True)

    def _login(self, connection: HTTPConnection, *, to_stop: bool = False) -> Login:
        token, _ = _presented(connection)
        if token is None:
            raise LoginError("Log in with a token first.")
        return Login(self.verify(token, to_stop=to_stop), token)


def _presented(connection: HTTPConnection) -> tuple[str | None, bool]:
    """The token that a request brings, and whether it is one that no browser adds by itself."""
    scheme, _, credentials = connection.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and credentials.strip():
        return credentials.strip(), True
    for offered in connection.scope.get("subprotocols", ()):
        if offered.startswith(SUBPROTOCOL):
            return offered.removeprefix(SUBPROTOCOL), True
    return connection.cookies.get(COOKIE), False


def router(gate: Gate, robot: str) -> APIRouter:
    """The routes of login, logout, and of asking who one is."""
    routes = APIRouter(prefix="/api")

    def told(who: Identity) -> JSONResponse:
        return JSONResponse(
            {"name": who.name, "role": who.role.value, "robot": robot, "expires": who.expires},
            headers={"Cache-Control": "no-store"},
        )

    @routes.post("/login")
    async def login(request: Request) -> Response:
        gate.check_origin(request)
        token = await _token_in_body(request)
        who = gate.verify(token)
        response = told(who)
        response.set_cookie(
            COOKIE,
            token,
            max_age=max(0, int((who.expires or 0) - time.time())),
            httponly=True,
            samesite="strict",
            secure=request.url.scheme == "https",
        )
        return response

    @routes.post("/logout")
    async def logout(request: Request) -> Response:
        gate.check_origin(request)
        response = Response(status_code=204)
        response.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=request.url.scheme == "https")
        return response

    @routes.get("/me")
    async def me(request: Request) -> Response:
        return told(gate.login(request).identity)

    return routes


async def _token_in_body(request: Request) -> str:
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > _MAX_BODY_BYTES:
            raise LoginError("That is too long to be a login token.")
    try:
        return msgspec.json.decode(bytes(body), type=_LoginBody).token.strip()
    except (msgspec.DecodeError, UnicodeDecodeError):
        raise LoginError('Send the login token as JSON: {"token": "…"}.') from None
