"""Who someone is and what they may do: signed tokens and the roles they carry.

A token is a JWT signed with a key that the processes share through the data folder. This is the only place
that issues or verifies one, and the only place that says what a role may do. Keys and tokens are never logged.
"""

from __future__ import annotations

import os
import secrets
import time
import uuid
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import jwt

_ALGORITHM = "HS256"
_AUDIENCE = "robot-acp"
SIGNING_KEY = "signing.key"
ROBOT_TOKEN = "robot.token"  # noqa: S105 - the name of a file


class Role(StrEnum):
    """What kind of person (or device) this is, from the least to the most trusted."""

    VIEWER = "viewer"
    VISITOR = "visitor"
    OPERATOR = "operator"
    SUPERVISOR = "supervisor"


class Right(StrEnum):
    """What someone may do beyond watching and stopping, which everybody may."""

    PROMPT = "prompt"
    APPROVE = "approve"
    CONFIGURE = "configure"  # mode, model and settings of a session
    RELEASE = "release"  # a latched stop
    TAKE_OVER = "take_over"  # the robot, and other people's sessions
    OFFER_SERVERS = "offer_servers"  # MCP servers of one's own, to a session


_RIGHTS: dict[Role, frozenset[Right]] = {
    Role.VIEWER: frozenset(),
    Role.VISITOR: frozenset({Right.PROMPT}),
    Role.OPERATOR: frozenset({Right.PROMPT, Right.APPROVE, Right.CONFIGURE}),
    Role.SUPERVISOR: frozenset(Right),
}


class InvalidToken(Exception):
    """The token proves nothing; the text says why, in words for the person who presented it."""


@dataclass(frozen=True)
class Identity:
    """A person or device. `expires` is in Unix seconds; None for one that was not proved by a token."""

    name: str
    role: Role
    token_id: str | None = None
    expires: float | None = None

    @property
    def expired(self) -> bool:
        """Whether the token's time is over."""
        return self.expires is not None and time.time() >= self.expires

    def may(self, right: Right) -> bool:
        """Whether this role has that right."""
        return right in _RIGHTS[self.role]


def issue(key: bytes, name: str, role: Role, lifetime_s: float, token_id: str | None = None) -> str:
    """A signed token for `name` in `role`, valid from now for `lifetime_s` seconds; `tokens.create` records it, too."""
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
    """Who the token stands for. Raises `InvalidToken` when it is malformed, forged, foreign or expired."""
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
    """The secret `name` of the data folder, made on first use, readable by its owner alone.

    Processes that start at the same moment agree on one: the file is linked into place whole, and the
    first one wins.
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
