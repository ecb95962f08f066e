"""Identities and roles: who somebody is, by a signed token, and what the role in it may do.

A token is a JWT (RFC 7519) signed with a key that the processes share through the data folder. No other file may issue
or verify a token, or decide what a role may do. Keys and tokens are never logged.
"""

from __future__ import annotations

import os
import secrets
import time
import uuid
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

_ALGORITHM = "HS256"
_AUDIENCE = "robot-acp"
SIGNING_KEY = "signing.key"
ROBOT_TOKEN = "robot.token"  # noqa: S105 - the name of a file


class Role(StrEnum):
    """The role of a person or device, from the least to the most trusted."""

    VIEWER = "viewer"
    VISITOR = "visitor"
    OPERATOR = "operator"
    SUPERVISOR = "supervisor"


class Right(StrEnum):
    """What a role may do. Watching and stopping the robot need no right: everybody who is logged in may do so."""

    PROMPT = "prompt"
    APPROVE = "approve"
    CONFIGURE = "configure"  # change mode, model and settings of a session
    RELEASE = "release"  # release a latched stop
    TAKE_OVER = "take_over"  # take over the robot, and other people's sessions
    OFFER_SERVERS = "offer_servers"  # bring MCP servers to a session


_RIGHTS: dict[Role, frozenset[Right]] = {
    Role.VIEWER: frozenset(),
    Role.VISITOR: frozenset({Right.PROMPT}),
    Role.OPERATOR: frozenset({Right.PROMPT, Right.APPROVE, Right.CONFIGURE}),
    Role.SUPERVISOR: frozenset(Right),
}


class InvalidToken(Exception):
    """The token proves no identity; the text tells the person who presented it why."""


@dataclass(frozen=True)
class Identity:
    """A person or device. `token_id` and `expires` (Unix seconds) are those of its token, None where there is none."""

    name: str
    role: Role
    token_id: str | None = None
    expires: float | None = None

    @property
    def expired(self) -> bool:
        """Whether the token has expired."""
        return self.expires is not None and time.time() >= self.expires

    @property
    def proven(self) -> bool:
        """Whether a token proves who this is. A client that is trusted because of where it runs proves nobody."""
        return self.token_id is not None

    def is_somebody_else(self, other: Identity) -> bool:
        """Whether this is another person than `other`, and tokens prove both."""
        return self.proven and other.proven and self.name != other.name

    def may(self, right: Right) -> bool:
        """Whether this role has that right."""
        return right in _RIGHTS[self.role]


def issue(key: bytes, name: str, role: Role, lifetime_s: float, token_id: str | None = None) -> str:
    """A signed token for `name` in `role`, valid for `lifetime_s` seconds.

    It is refused unless it is in the list of tokens: `tokens.create` issues one and records it.
    """
    import jwt  # it loads cryptography, which most commands do not need

    now = time.time()
    claims = {
        "aud": _AUDIENCE,
        "sub": name,
        "role": role.value,
        "jti": token_id or uuid.uuid4().hex,
        "iat": int(now),
        "exp": int(now + lifetime_s),
    }
    return jwt.encode(claims, key, algorithm=_ALGORITHM)


def verify(key: bytes, token: str) -> Identity:
    """The identity that a token proves. Raises `InvalidToken` when it is malformed, forged, foreign or expired."""
    import jwt  # see issue

    try:
        claims = jwt.decode(
            token,
            key,
            algorithms=[_ALGORITHM],
            audience=_AUDIENCE,
            options={"require": ["sub", "role", "jti", "exp"]},
        )
        return Identity(
            name=str(claims["sub"]),
            role=Role(claims["role"]),
            token_id=str(claims["jti"]),
            expires=float(claims["exp"]),
        )
    except jwt.ExpiredSignatureError:
        raise InvalidToken("This login token has expired. Ask for a new one.") from None
    except (jwt.InvalidTokenError, ValueError):
        raise InvalidToken("This login token is not valid for this robot. Ask for a new one.") from None


def shared_secret(data_dir: Path, name: str) -> bytes:
    """The secret `name` of the data folder. It is made on first use and readable by its owner alone.

    Processes that start at the same moment agree on one secret: each links its complete draft into place, and only the
    first link succeeds.
    """
    path = data_dir / name
    try:
        return path.read_bytes()
    except FileNotFoundError:
        pass
    data_dir.mkdir(parents=True, exist_ok=True, mode=0o700)
    draft = data_dir / f".{name}.{os.getpid()}.{secrets.token_hex(4)}"
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(secrets.token_urlsafe(48).encode())
    try:
        os.link(draft, path)
    except FileExistsError:
        pass
    finally:
        draft.unlink()
    return path.read_bytes()
