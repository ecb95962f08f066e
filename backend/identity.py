"""Identities and roles: who somebody is, by a signed token, and what the role in it may do.

A token is a JWT (RFC 7519) signed with a key that the processes share through the data folder. No other file may issue
or verify a token, or decide what a role may do. Keys and tokens are never logged.
"""

from __future__ import annotations

import contextlib
import hashlib
import secrets
import time
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from backend import private_files
from backend.private_files import UnsafeFile

_ALGORITHM = "HS256"
_AUDIENCE = "robot-acp"
SIGNING_KEY = "signing.key"
ROBOT_TOKEN = "robot.token"  # noqa: S105 - the name of a file
MIN_SECRET_BYTES = 32
"""As many as the hash of the signature has (RFC 7518, 3.2)."""


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
    ADMINISTER = "administer"  # see, make and revoke login tokens


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
    """A person or device. `token_id` and `expires` (Unix seconds) are those of its token, None where there is none.

    `name` is for people to read. `subject` is who it is, and None for people that are known only by their name.
    """

    name: str
    role: Role
    token_id: str | None = None
    expires: float | None = None
    subject: str | None = None

    @property
    def person(self) -> str:
        """Who it is, for comparisons: it is the same for all tokens of one person, and no two persons share it."""
        return self.subject or person_named(self.name)

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
        return self.proven and other.proven and self.person != other.person

    def may(self, right: Right) -> bool:
        """Whether this role has that right."""
        return right in _RIGHTS[self.role]


LOCAL = Identity("local", Role.SUPERVISOR)
"""Whoever is let in without a token: the user who runs the agent, at the same machine."""


def key_id(key: bytes) -> str:
    """The name of a key in the header of its tokens (`kid`, RFC 7515). It says nothing about the key."""
    return hashlib.sha256(key).hexdigest()[:16]


def _key_of(keys: Sequence[bytes], kid: object, token: str) -> bytes:
    """The key that a token names. One from before keys had names gets the key that signed it."""
    import jwt  # see issue

    if kid is not None:
        for key in keys:
            if key_id(key) == kid:
                return key
        raise InvalidToken("This login token was signed with a key that is accepted no longer. Ask for a new one.")
    for key in keys[1:]:
        with contextlib.suppress(jwt.InvalidTokenError):
            jwt.decode(token, key, algorithms=[_ALGORITHM], options={"verify_exp": False, "verify_aud": False})
            return key
    return keys[0]


def person_named(name: str) -> str:
    """The `person` of somebody who is known only by a name: who runs the agent (`LOCAL`), and the owners of sessions
    from before people had subjects."""
    return f"name:{name}"


def issue(
    key: bytes, name: str, role: Role, lifetime_s: float, token_id: str | None = None, subject: str | None = None
) -> str:
    """A signed token for `name` in `role`, valid for `lifetime_s` seconds.

    It is refused unless it is in the list of tokens: `tokens.create` issues one and records it.
    """
    import jwt  # it loads cryptography, which most commands do not need

    now = time.time()
    claims = {
        "aud": _AUDIENCE,
        "sub": subject or uuid.uuid4().hex,
        "name": name,
        "role": role.value,
        "jti": token_id or uuid.uuid4().hex,
        "iat": int(now),
        "exp": int(now + lifetime_s),
    }
    return jwt.encode(claims, key, algorithm=_ALGORITHM, headers={"kid": key_id(key)})


def verify(keys: Sequence[bytes], token: str) -> Identity:
    """The identity that a token proves; `keys` are those that are accepted now.

    Raises `InvalidToken` when it is malformed, forged, foreign or expired, or when its key is accepted no longer.
    """
    import jwt  # see issue

    try:
        key = _key_of(keys, jwt.get_unverified_header(token).get("kid"), token)
        claims = jwt.decode(
            token,
            key,
            algorithms=[_ALGORITHM],
            audience=_AUDIENCE,
            options={"require": ["sub", "role", "jti", "exp"]},
        )
        return Identity(
            name=str(claims.get("name", claims["sub"])),  # in tokens from before people had subjects it was the name
            role=Role(claims["role"]),
            token_id=str(claims["jti"]),
            expires=float(claims["exp"]),
            subject=str(claims["sub"]) if "name" in claims else None,
        )
    except jwt.ExpiredSignatureError:
        raise InvalidToken("This login token has expired. Ask for a new one.") from None
    except (jwt.InvalidTokenError, ValueError):
        raise InvalidToken("This login token is not valid for this robot. Ask for a new one.") from None


def shared_secret(data_dir: Path, name: str) -> bytes:
    """The secret `name` of the data folder. It is made on first use and readable by its owner alone.

    Processes that start at the same moment agree on one secret. Raises `UnsafeFile` for a secret that others could have
    read, chosen or guessed.
    """
    private_files.make_folder(data_dir)
    private_files.check_folder(data_dir)
    path = data_dir / name
    try:
        return read_secret(path)
    except FileNotFoundError:
        private_files.write_new(path, new_secret())
    return read_secret(path)


def new_secret() -> bytes:
    """A new random secret of 64 printable ASCII characters."""
    return secrets.token_urlsafe(48).encode()


def read_secret(path: Path) -> bytes:
    """A secret that exists. Raises `FileNotFoundError`, and `UnsafeFile` as `shared_secret` does."""
    secret = private_files.read(path)
    if len(secret) < MIN_SECRET_BYTES:
        raise UnsafeFile(
            f"The key {path} has only {len(secret)} bytes, and {MIN_SECRET_BYTES} are needed. Delete it and start "
            "robot-acp again: a new one is made. If it is the signing key, everybody needs a new login token then."
        )
    return secret
