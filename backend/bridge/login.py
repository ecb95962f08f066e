"""Logins: a token in a cookie, in an `Authorization` header, or in a WebSocket subprotocol.

The login page exchanges a token for a cookie that scripts cannot read. A token is never logged, never put into an
answer and never taken from an address.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import msgspec
from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from starlette.requests import HTTPConnection

from backend import wire
from backend.bridge.close_codes import LOGIN_ENDED, CloseReason
from backend.bridge.origin import OriginPolicy
from backend.identity import Identity, InvalidToken
from backend.tokens import Registry

COOKIE = "robot_acp"
SUBPROTOCOL = "bearer."
_MAX_BODY_BYTES = 16 * 1024


class LoginError(Exception):
    """The request proves no identity; the text says what the person has to do."""


@dataclass(frozen=True)
class Login:
    """An identity, and the token that proves it."""

    identity: Identity
    token: str


class _LoginBody(msgspec.Struct):
    token: str


class Authenticator:
    """Checks who sends a request, and whether the page that sends it may do so."""

    def __init__(self, tokens: Registry, origins: OriginPolicy) -> None:
        self._tokens = tokens
        self._origins = origins

    def authenticate(self, connection: HTTPConnection) -> Login:
        """The login of a request that only reads. Raises `LoginError` or `RegistryError`."""
        return self._login(connection)

    def verify(self, token: str, *, to_stop: bool = False) -> Identity:
        """The identity that a token proves. Raises `LoginError` or `RegistryError`."""
        try:
            return self._tokens.verify(token, to_stop=to_stop)
        except InvalidToken as error:
            raise LoginError(str(error)) from None

    def admit(self, connection: HTTPConnection, *, to_stop: bool = False) -> Login:
        """The login of a request that can change something, or that opens a WebSocket: its origin is checked, too.

        `to_stop` is for requests that stop the robot: it accepts logins that nothing else does (`Registry.verify`).
        Raises `LoginError`, `OriginError` or `RegistryError`.
        """
        _, is_explicit = _token_of(connection)
        self._origins.check(connection, explicit_token=is_explicit)
        return self._login(connection, to_stop=to_stop)

    def login_end(self, login: Login) -> CloseReason | None:
        """Why an accepted login has ended; None while it is valid."""
        reason = self._tokens.ended(login.identity)
        return CloseReason(LOGIN_ENDED, reason) if reason else None

    async def until_login_ends(self, login: Login) -> CloseReason:
        """Wait until a login is revoked or has expired."""
        return CloseReason(LOGIN_ENDED, await self._tokens.until_ended(lambda: login.identity))

    def check_origin(self, connection: HTTPConnection) -> None:
        """Check a request that carries its token in its body. Raises `OriginError`."""
        self._origins.check(connection, explicit_token=True)

    def _login(self, connection: HTTPConnection, *, to_stop: bool = False) -> Login:
        token, _ = _token_of(connection)
        if token is None:
            raise LoginError("Log in with a token first.")
        return Login(self.verify(token, to_stop=to_stop), token)


def _token_of(connection: HTTPConnection) -> tuple[str | None, bool]:
    """The token of a request, and whether its sender added it explicitly: a browser adds only cookies by itself."""
    scheme, _, credentials = connection.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and credentials.strip():
        return credentials.strip(), True
    for offered in connection.scope.get("subprotocols", ()):
        if offered.startswith(SUBPROTOCOL):
            return offered.removeprefix(SUBPROTOCOL), True
    return connection.cookies.get(COOKIE), False


def router(authenticator: Authenticator, robot: str) -> APIRouter:
    """The routes `/api/login`, `/api/logout` and `/api/me`."""
    routes = APIRouter(prefix="/api")

    def identity_response(who: Identity) -> JSONResponse:
        return JSONResponse(
            {"name": who.name, "role": who.role.value, "robot": robot, "expires": who.expires},
            headers={"Cache-Control": "no-store"},
        )

    @routes.post("/login")
    async def login(request: Request) -> Response:
        authenticator.check_origin(request)
        token = await _token_in_body(request)
        who = authenticator.verify(token)
        response = identity_response(who)
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
        authenticator.check_origin(request)
        response = Response(status_code=204)
        response.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=request.url.scheme == "https")
        return response

    @routes.get("/me")
    async def me(request: Request) -> Response:
        return identity_response(authenticator.authenticate(request).identity)

    return routes


async def _token_in_body(request: Request) -> str:
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > _MAX_BODY_BYTES:
            raise LoginError("That is too long to be a login token.")
    try:
        return msgspec.json.decode(bytes(body), type=_LoginBody).token.strip()
    except wire.UNREADABLE:
        raise LoginError('Send the login token as JSON: {"token": "…"}.') from None
