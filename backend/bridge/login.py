"""Logins: a token in a cookie, in an `Authorization` header, or in a WebSocket subprotocol.

The login page exchanges a token or a one-time code for a cookie that scripts cannot read, with a token of its own
(`logins`). A token is never logged, never put into an answer and never taken from an address. A right token is never
refused because others send wrong ones.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import msgspec
from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from starlette.requests import HTTPConnection

from backend import logins, wire
from backend.audit import Audit
from backend.bridge.close_codes import LOGIN_ENDED, CloseReason
from backend.bridge.origin import OriginPolicy
from backend.http_protocol import LOGGED_IN
from backend.identity import Identity, InvalidToken
from backend.private_files import UnsafeFile
from backend.rates import Buckets
from backend.tokens import Record, Registry, RegistryError
from backend.wrong_logins import TOO_MANY, WrongLogins

COOKIE = "robot_acp"
SUBPROTOCOL = "bearer."
_MAX_BODY_BYTES = 16 * 1024


_NEW_PER_SECOND, _NEW_AT_ONCE = 1.0, 60
"""New logins of one person: each is written to the disk."""

_T = TypeVar("_T")

log = logging.getLogger(__name__)


class LoginError(Exception):
    """The request proves no identity; the text says what the person has to do. Where `wait_s` is not 0, that is to wait
    so many seconds."""

    def __init__(self, sentence: str, wait_s: float = 0.0) -> None:
        self.wait_s = math.ceil(wait_s)
        super().__init__(f"{sentence} Try again in {self.wait_s} s." if wait_s else sentence)

    def answer(self) -> JSONResponse:
        """401, or 429 for those who have to wait."""
        if self.wait_s:
            return JSONResponse({"error": str(self)}, 429, {"Retry-After": str(self.wait_s)})
        return JSONResponse({"error": str(self)}, 401)


@dataclass(frozen=True)
class Login:
    """An identity, and the token that proves it."""

    identity: Identity
    token: str


class _LoginBody(msgspec.Struct):
    token: str


class Authenticator:
    """Checks who sends a request, and whether the page that sends it may do so."""

    def __init__(self, tokens: Registry, origins: OriginPolicy, wrong_logins: WrongLogins | None = None) -> None:
        self.tokens = tokens
        self._origins = origins
        self._wrong_logins = wrong_logins or WrongLogins()

    def authenticate(self, connection: HTTPConnection) -> Login:
        """The login of a request that only reads. Raises `LoginError` or `RegistryError`."""
        return self._login(connection)

    def verify(self, connection: HTTPConnection, token: str, *, to_stop: bool = False) -> Identity:
        """The identity that a token of a request proves. Raises `LoginError` or `RegistryError`."""
        try:
            return self.tokens.verify(token, to_stop=to_stop)
        except InvalidToken as error:
            raise self.refusal(connection, str(error)) from None

    def find_code(self, connection: HTTPConnection, code: str) -> Record:
        """The one-time code, or the login that it has become. Raises `LoginError` or `RegistryError`."""
        record = self.tokens.find_code(logins.digest(code))
        if record is None:
            raise self.refusal(connection, logins.NOT_VALID)
        return record

    def refusal(self, connection: HTTPConnection, why: str) -> LoginError:
        """The error for a wrong login, which is counted."""
        wait = self._wrong_logins.count(_host(connection), why)
        return LoginError(TOO_MANY, wait) if wait else LoginError(why)

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
        reason = self.tokens.ended(login.identity)
        return CloseReason(LOGIN_ENDED, reason) if reason else None

    async def until_login_ends(self, login: Login) -> CloseReason:
        """Wait until a login is revoked or has expired."""
        return CloseReason(LOGIN_ENDED, await self.tokens.until_ended(lambda: login.identity))

    def check_origin(self, connection: HTTPConnection) -> None:
        """Check a request that carries its token in its body. Raises `OriginError`."""
        self._origins.check(connection, explicit_token=True)

    def _login(self, connection: HTTPConnection, *, to_stop: bool = False) -> Login:
        token, _ = _token_of(connection)
        if token is None:
            raise LoginError("Log in with a token first.")
        login = Login(self.verify(connection, token, to_stop=to_stop), token)
        connection.scope[LOGGED_IN] = True
        return login


def _token_of(connection: HTTPConnection) -> tuple[str | None, bool]:
    """The token of a request, and whether its sender added it explicitly: a browser adds only cookies by itself."""
    scheme, _, credentials = connection.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and credentials.strip():
        return credentials.strip(), True
    for offered in connection.scope.get("subprotocols", ()):
        if offered.startswith(SUBPROTOCOL):
            return offered.removeprefix(SUBPROTOCOL), True
    return connection.cookies.get(COOKIE), False


def _host(connection: HTTPConnection) -> str | None:
    return connection.client.host if connection.client else None


class Cookies:
    """Makes the logins that cookies carry, and ends them."""

    def __init__(self, authenticator: Authenticator, data_dir: Path, audit: Audit | None = None) -> None:
        self._authenticator = authenticator
        self._data_dir = data_dir
        self._audit = audit
        self._new = Buckets(_NEW_PER_SECOND, _NEW_AT_ONCE)

    async def begin(self, request: Request) -> tuple[Identity, str | None]:
        """Exchange the token or code in the body for a login: who it is, and the token for the cookie.

        The token is None where the cookie that the request came with is the login which the code has become: people
        open the printed address again. Raises `LoginError` or `RegistryError`.
        """
        try:
            shown = await _token_in_body(request)
        except LoginError as error:
            raise self._authenticator.refusal(request, str(error)) from None
        if logins.is_code(shown):
            record = self._authenticator.find_code(request, shown)
            if record.kind == "login" and (own := self._own(request)) and own.token_id == record.id:
                return own, None
            login = await self._written(request, lambda: logins.by_code(self._data_dir, shown))
        else:
            who = self._authenticator.verify(request, shown)
            if wait := self._new.take(who.person, time.monotonic()):
                raise LoginError("This person logs in too often.", wait)
            login = await self._written(request, lambda: logins.by_token(self._data_dir, who))
        self._record("login", login[0], request)
        return login

    async def end(self, request: Request) -> None:
        """End the login in the cookie, wherever it is in use. It is no error where there is none, or it has ended.

        Raises `RegistryError`: then it goes on.
        """
        if (who := self._own(request)) is None or (login_id := who.token_id) is None:
            return
        if await self._written(request, lambda: logins.end(self._data_dir, login_id)):
            self._record("logout", who, request)

    def _own(self, request: Request) -> Identity | None:
        """Who the cookie of a request proves to be; None for nobody. A wrong cookie does not count as a wrong login."""
        try:
            return self._authenticator.tokens.verify(request.cookies.get(COOKIE, ""))
        except (InvalidToken, RegistryError):
            return None

    async def _written(self, request: Request, write: Callable[[], _T]) -> _T:
        """Change the list of tokens in a thread. Raises `LoginError` and `RegistryError`."""
        try:
            return await asyncio.to_thread(write)
        except InvalidToken as error:
            raise self._authenticator.refusal(request, str(error)) from None
        except (OSError, UnsafeFile, RegistryError) as error:
            log.error("a login cannot be recorded: %s", error)
            raise RegistryError("The robot cannot write its list of tokens. Its log says what to do.") from None

    def _record(self, event: Literal["login", "logout"], who: Identity, request: Request) -> None:
        if self._audit is not None:
            self._audit.record(event, who, address=_host(request))


def router(authenticator: Authenticator, cookies: Cookies, robot: str) -> APIRouter:
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
        who, token = await cookies.begin(request)
        response = identity_response(who)
        if token is not None:
            response.set_cookie(
                COOKIE,
                token,
                max_age=max(0, int((who.expires or 0) - time.time())),
                httponly=True,
                samesite="strict",
                secure=_is_https(request),
            )
        return response

    @routes.post("/logout")
    async def logout(request: Request) -> Response:
        authenticator.check_origin(request)
        response = Response(status_code=204)
        try:
            await cookies.end(request)
        except RegistryError as error:  # the browser forgets the login all the same
            response = JSONResponse({"error": str(error)}, status_code=503)
        response.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=_is_https(request))
        return response

    @routes.get("/me")
    async def me(request: Request) -> Response:
        return identity_response(authenticator.authenticate(request).identity)

    return routes


def _is_https(request: Request) -> bool:
    """Whether the page was loaded over HTTPS. A proxy in front may speak plain HTTP with the bridge."""
    return request.url.scheme == "https" or request.headers.get("origin", "").lower().startswith("https:")


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
