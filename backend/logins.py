"""Logins of browsers: what a login cookie carries, and the one-time codes that `robot-acp up` prints.

A cookie never carries the token or code that was shown for it, but a token of a login of its own. So a logout ends that
login in every process, and nothing else. A login lasts as long as the token that was shown, and ends with it. A code is
kept only as a hash and is good for one login of the person "supervisor". The functions here wait for the disk: an event
loop calls them in a thread.
"""

from __future__ import annotations

import hashlib
import re
import secrets
import time
from pathlib import Path
from typing import Literal

import msgspec

from backend import audit, identity, tokens
from backend.identity import Identity, InvalidToken, Role
from backend.tokens import Record

LIFETIME_S = 7 * 86400.0
"""How long a login lasts that was made with a code."""
CODE_LIFETIME_S = 15 * 60.0
MOST = 20
"""So many logins of one token are valid at once; the oldest one ends where there are more. The same of codes, and of
logins made with codes."""
SUPERVISOR = "supervisor"
"""The name of the person who logs in with a code."""
NOT_VALID = "This address was used already, or is too old. `robot-acp login` on the robot's computer prints a new one."

_CODE = re.compile(r"[A-Za-z0-9_-]{22}")  # 128 bits; a token is longer, and has dots


def is_code(text: str) -> bool:
    """Whether this can be a one-time code, and no token."""
    return _CODE.fullmatch(text) is not None


def digest(code: str) -> str:
    """A code as the list keeps it."""
    return hashlib.sha256(code.encode()).hexdigest()


def new_code(data_dir: Path) -> str:
    """A new one-time code, which the audit log notes. Raises `RegistryError`, `UnsafeFile`, `OSError`."""
    identity.shared_secret(data_dir, identity.SIGNING_KEY)
    code = secrets.token_urlsafe(16)
    with tokens.changing(data_dir) as known:
        subject = tokens.subject_of(known, SUPERVISOR, Role.SUPERVISOR, same_person=True)
        until = time.time() + CODE_LIFETIME_S
        known.append(_record(SUPERVISOR, Role.SUPERVISOR, until, subject, kind="code", code=digest(code)))
        _limit(known, "code", "")
    audit.record_command(
        data_dir, ("code_created", {"created_name": SUPERVISOR, "created_role": Role.SUPERVISOR.value})
    )
    return code


def by_code(data_dir: Path, code: str) -> tuple[Identity, str]:
    """A new login in exchange for a one-time code: who it is, and the token for the cookie.

    Raises `InvalidToken` for a code that was used, has expired or never was one; else as `new_code`.
    """
    with tokens.changing(data_dir) as known:
        wanted = digest(code)
        used = next((one for one in known if one.code == wanted and one.kind == "code" and one.state == "valid"), None)
        if used is None:
            raise InvalidToken(NOT_VALID)
        known.remove(used)
        login = _record(used.name, used.role, time.time() + LIFETIME_S, used.subject, code=wanted)
        known.append(login)
        _limit(known, "login", "")
    return _issued(data_dir, login)


def by_token(data_dir: Path, who: Identity) -> tuple[Identity, str]:
    """A new login of a person who has shown the token of `who`; the result and the errors are those of `by_code`."""
    with tokens.changing(data_dir) as known:
        shown = next((one for one in known if one.id == who.token_id and one.state == "valid"), None)
        if shown is None:
            raise InvalidToken("This login token is no longer valid. Ask for a new one.")
        if shown.kind == "login":
            raise InvalidToken("This is the cookie of another login. Log in with the login token itself.")
        expires = min(shown.expires, who.expires or shown.expires)
        login = _record(shown.name, shown.role, expires, shown.subject, parent=shown.id)
        known.append(login)
        _limit(known, "login", shown.id)
    return _issued(data_dir, login)


def end(data_dir: Path, token_id: str) -> bool:
    """End the login with this id, wherever it is in use. Returns False, and ends nothing, where there is none: a token
    that was given to a person outlives every logout. Raises as `new_code`."""
    with tokens.changing(data_dir) as known:
        for number, one in enumerate(known):
            if one.id == token_id and one.kind == "login" and one.state == "valid":
                known[number] = msgspec.structs.replace(one, revoked=time.time())
                return True
    return False


def _record(
    name: str,
    role: Role,
    expires: float,
    subject: str,
    *,
    kind: Literal["login", "code"] = "login",
    parent: str = "",
    code: str = "",
) -> Record:
    now, whole = time.time(), float(int(expires))  # as the token has it
    return Record(secrets.token_hex(6), name, role, now, whole, subject=subject, kind=kind, parent=parent, code=code)


def _issued(data_dir: Path, login: Record) -> tuple[Identity, str]:
    key = identity.shared_secret(data_dir, identity.SIGNING_KEY)
    lifetime_s = login.expires - login.created
    token = identity.issue(key, login.name, login.role, lifetime_s, login.id, login.subject)
    return Identity(login.name, login.role, login.id, login.expires, login.subject), token


def _limit(known: list[Record], kind: str, parent: str) -> None:
    """Keep the newest `MOST` valid, and as many of those that have ended, whose pages can still learn why."""
    same = [one for one in known if (one.kind, one.parent) == (kind, parent)]
    valid = [one for one in same if one.state == "valid"]
    for one in valid[:-MOST]:
        same[same.index(one)] = known[known.index(one)] = msgspec.structs.replace(one, revoked=time.time())
    for one in [one for one in same if one.state != "valid"][:-MOST]:
        known.remove(one)
