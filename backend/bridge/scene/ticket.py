"""A scene ticket: with it viser's page opens its WebSocket, in a frame that has no cookies and no origin.

viser's page is foreign code, so it runs in a sandbox and cannot use the login of the page around it. The bridge puts a
ticket into the page instead. It is good for one viewer of the scene and for nothing else, and ends with the login for
which it was made. It is no login token and must not be accepted as one.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
from dataclasses import asdict
from pathlib import Path

import msgspec
from starlette.requests import HTTPConnection

from backend.bridge.login import Authenticator, Login, LoginError
from backend.identity import Identity, Role, shared_secret

PARAMETER = "ticket"
_KEY = "scene.key"
_SIGNATURE_BYTES = 32
_MAX_CHARS = 2048
_NOT_VALID = "This map belongs to a login that has ended. Reload the page."


class SceneTickets:
    """Makes and checks the tickets of one bridge. They outlive a restart: the key is in the data folder."""

    def __init__(self, authenticator: Authenticator, data_dir: Path) -> None:
        self._authenticator = authenticator
        self._key = shared_secret(data_dir, _KEY)

    def make(self, who: Identity, viewer: str) -> str:
        """The ticket for a viewer's page; the same each time. `viewer` is empty for the page without an id."""
        body = msgspec.json.encode({"viewer": viewer, "who": asdict(who)})
        return base64.urlsafe_b64encode(self._signature(body) + body).decode().rstrip("=")

    def admit(self, connection: HTTPConnection) -> Login:
        """The login of a request of viser's page, by its ticket; without a ticket, as for any other request.

        A ticket needs no check of the origin: no other page knows it. Raises `LoginError`, `OriginError` or
        `RegistryError`.
        """
        ticket = connection.query_params.get(PARAMETER)
        if ticket is None:
            return self._authenticator.admit(connection)
        login = Login(self._read(connection, ticket, str(connection.path_params.get("viewer", "")).lower()), "")
        if (end := self._authenticator.login_end(login)) is not None:
            raise LoginError(end.reason)
        return login

    def _read(self, connection: HTTPConnection, ticket: str, viewer: str) -> Identity:
        try:
            raw = base64.urlsafe_b64decode(ticket[:_MAX_CHARS] + "=" * (-len(ticket) % 4))
            signature, body = raw[:_SIGNATURE_BYTES], raw[_SIGNATURE_BYTES:]
            if not hmac.compare_digest(signature, self._signature(body)):
                raise ValueError
            content = msgspec.json.decode(body)  # written by `make`
            who = Identity(**(content["who"] | {"role": Role(content["who"]["role"])}))
        except (ValueError, TypeError, KeyError):
            raise self._authenticator.refusal(connection, _NOT_VALID) from None
        if content["viewer"] != viewer or who.expired:
            raise LoginError(_NOT_VALID)
        return who

    def _signature(self, body: bytes) -> bytes:
        return hmac.digest(self._key, body, hashlib.sha256)
