"""The list of login tokens: which were issued, and which were revoked. It is one small file in the data folder.

A token is valid only while this list contains it, so deleting the file logs everybody out and makes no revoked token
valid again. The file names people and must never contain a token. Writers replace it as a whole under a lock, so
readers need no lock and never see half of it.
"""

from __future__ import annotations

import asyncio
import fcntl
import logging
import os
import secrets
import time
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import msgspec

from backend import identity, private_files, signing_keys, wire
from backend.identity import Identity, InvalidToken, Role
from backend.private_files import UnsafeFile
from backend.signing_keys import KeyRing

REGISTRY = "tokens.json"
CHECK_INTERVAL_S = 0.5
"""How often a process checks whether the list has changed, and whether a login has expired."""
_KEPT_S = 30 * 86400.0
"""How long the list keeps an expired token, for people who ask what happened to it."""

_UNREADABLE = "Nobody can log in now: the robot cannot read its list of tokens. Its log says what to do."
log = logging.getLogger(__name__)


class RegistryError(Exception):
    """The list cannot be read or written, or lacks the requested token; the text says what to do."""


class NameTaken(RegistryError):
    """A new token cannot have this name; `without_hint` says why without a word about the command line."""

    def __init__(self, without_hint: str, hint: str = "") -> None:
        super().__init__(f"{without_hint}{hint}")
        self.without_hint = without_hint


class Record(msgspec.Struct, frozen=True, omit_defaults=True):
    """One token of the list. Times are Unix seconds; `revoked` is when it was revoked, None where it was not.

    `subject` is the person: all tokens of one person have the same, and no other person has it, whatever the names are.
    A "token" is given to a person. A "login" is in one browser's cookie (`logins`): `parent` is the id of the token
    that was shown for it, empty where it was a one-time code. A "code" is such a code, and `code` is its SHA-256.
    """

    id: str
    name: str
    role: Role
    created: float
    expires: float
    revoked: float | None = None
    subject: str = ""
    kind: Literal["token", "login", "code"] = "token"
    parent: str = ""
    code: str = ""

    @property
    def is_access(self) -> bool:
        """Whether it is the reason why somebody may log in, and not a login that follows from it or a code."""
        return self.kind != "code" and not self.parent

    @property
    def state(self) -> Literal["valid", "expired", "revoked"]:
        """Whether the token can be used."""
        if self.revoked is not None:
            return "revoked"
        return "expired" if time.time() >= self.expires else "valid"


def create(data_dir: Path, name: str, role: Role, lifetime_s: float, *, same_person: bool = False) -> str:
    """Record and return a new login token. Raises `RegistryError`, and `NameTaken` for a name that somebody has.

    `same_person` makes it a further token of the person who has this name already, where there is one.
    """
    key = identity.shared_secret(data_dir, identity.SIGNING_KEY)
    with _locked(data_dir):
        known = records(data_dir)
        record = _record(name, role, lifetime_s, subject_of(known, name, role, same_person=same_person))
        _add(data_dir, known, record)
    return identity.issue(key, name, role, lifetime_s, record.id, record.subject)


def _record(name: str, role: Role, lifetime_s: float, subject: str) -> Record:
    now = time.time()
    return Record(secrets.token_hex(6), name, role, now, now + lifetime_s, subject=subject)


def _add(data_dir: Path, known: Sequence[Record], record: Record) -> None:
    _write(data_dir, [*(old for old in known if record.created - old.expires < _KEPT_S), record])


def subject_of(known: Sequence[Record], name: str, role: Role, *, same_person: bool) -> str:
    """The person for whom a new token is. Raises `NameTaken`."""
    if _alike(name, identity.LOCAL.name):
        raise NameTaken(f"{name!r} is what people without a token are called. Choose another name.")
    namesakes = [one for one in known if _alike(one.name, name)]
    if not namesakes:
        return secrets.token_hex(8)
    newest = ([one for one in namesakes if one.is_access] or namesakes)[-1]
    if not same_person:
        raise NameTaken(
            f"There is {newest.name!r} already: {newest.role.value}, token {newest.id}, {newest.state}. For another "
            "person choose another name.",
            " For a further token of the same person add --same-person.",
        )
    person = ([one for one in namesakes if one.role == role] or namesakes)[-1].subject
    for one in known:
        if one.subject == person and one.state == "valid" and one.role != role:
            raise NameTaken(
                f"{one.name!r} is {one.role.value}, and a person has one role. Revoke the token {one.id} first, or "
                "choose another name."
            )
    return person


def _alike(one: str, other: str) -> bool:
    """Whether people would take two names for one."""
    first, second = (" ".join(unicodedata.normalize("NFKC", name).casefold().split()) for name in (one, other))
    return first == second


def records(data_dir: Path) -> list[Record]:
    """All tokens of the list, the oldest first. Raises `RegistryError`."""
    path = data_dir / REGISTRY
    try:
        with private_files.opened(path) as file:
            return _parse(file.read())
    except FileNotFoundError:
        return []
    except (OSError, ValueError, UnsafeFile) as error:
        raise RegistryError(_cannot_read(path, error)) from None


def revoke(data_dir: Path, id_or_name: str) -> list[Record]:
    """Revoke the token with this id, or all tokens with this name. Returns those that were valid until now.

    The logins that were made with them end, too; such a login is returned only if `id_or_name` is its own id. Raises
    `RegistryError` when no token has this id or name.
    """
    if not data_dir.is_dir():
        raise RegistryError(_unknown(id_or_name, []))
    with _locked(data_dir):
        known = records(data_dir)
        meant = [one for one in known if one.id == id_or_name] or [one for one in known if one.name == id_or_name]
        if not meant:
            raise RegistryError(_unknown(id_or_name, known))
        now = time.time()
        ids = {one.id for one in meant}
        ending = [one for one in known if {one.id, one.parent} & ids and one.state == "valid"]
        revoked = {one.id: msgspec.structs.replace(one, revoked=now) for one in ending}
        if revoked:
            _write(data_dir, [revoked.get(one.id, one) for one in known])
    return [one for one in revoked.values() if one.is_access or one.id == id_or_name]


@contextmanager
def changing(data_dir: Path) -> Iterator[list[Record]]:
    """The list, to be changed in place; it is written at the end if it was changed. Raises `RegistryError`, `OSError`,
    `UnsafeFile`. It waits for other writers and for the disk, so an event loop must use a thread."""
    with _locked(data_dir):
        known = records(data_dir)
        before = list(known)
        yield known
        if known != before:
            _write(data_dir, known)


def rotate_key(data_dir: Path, until: float) -> int:
    """Make a new signing key, and return how many tokens were valid until now.

    They are valid until `until`, in Unix seconds, at the longest. Where that is now they are revoked, and whoever is
    logged in with one has to leave. Raises `RegistryError`, `UnsafeFile`.
    """
    identity.shared_secret(data_dir, identity.SIGNING_KEY)
    now = time.time()
    with _locked(data_dir):
        known = records(data_dir)
        try:
            signing_keys.rotate(data_dir, until)
        except OSError as error:
            raise RegistryError(f"The keys in {data_dir} cannot be written: {error.strerror}.") from None
        valid = [one for one in known if one.state == "valid"]
        _write(data_dir, [_cut(one, until, now) if one.state == "valid" else one for one in known])
    return sum(one.is_access for one in valid)


def _cut(record: Record, until: float, now: float) -> Record:
    if until <= now:
        return msgspec.structs.replace(record, revoked=now)
    return msgspec.structs.replace(record, expires=min(record.expires, until))


class Registry:
    """The list as a server process has read it. It reads a changed list at each new login, and twice a second in `run`.

    While the list cannot be read, no new login is accepted, and the accepted ones remain valid.
    """

    def __init__(self, data_dir: Path) -> None:
        self._path = data_dir / REGISTRY
        self._keys = KeyRing(data_dir)
        self._records: dict[str, Record] = {}
        self._version: tuple[int, ...] | None = None  # of the file that was read last; None before
        self._error: str | None = None  # why the list cannot be read; None while it can
        self._waiting: dict[asyncio.Future[str], Callable[[], Identity | None]] = {}

    def verify(self, token: str, *, to_stop: bool = False) -> Identity:
        """The identity that a token proves. Raises `InvalidToken`, and `RegistryError` while the list cannot be read.

        `to_stop` is for requests that stop the robot, which must not fail because the list cannot be read: they are
        accepted with every genuine token that is not known to be revoked.
        """
        self._reload()
        who = identity.verify(self._keys.accepted(), token)
        record = self._records.get(who.token_id or "")
        if record is not None and record.revoked is not None:
            raise InvalidToken(self._why_revoked(record, "This login token was revoked. Ask for a new one."))
        if self._error is not None:
            if to_stop:
                return who
            raise RegistryError(_UNREADABLE)
        if record is None:
            raise InvalidToken("This login token is not known to this robot. Ask for a new one.")
        if record.state == "expired":
            raise InvalidToken("This login token has expired. Ask for a new one.")
        return _identity(who, record)

    def find_code(self, digest: str) -> Record | None:
        """The one-time code with this SHA-256, or the login that it has become. Raises `RegistryError`."""
        self._reload()
        if self._error is not None:
            raise RegistryError(_UNREADABLE)
        return next((one for one in self._records.values() if one.code == digest), None)

    def ended(self, who: Identity | None) -> str | None:
        """Why an accepted login has ended, as a sentence for that person; None while it is valid."""
        self._reload()
        return self._ended(who)

    async def until_ended(self, who: Callable[[], Identity | None]) -> str:
        """Wait until the login that `who` returns has ended, and return why. `run` has to be running."""
        ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._waiting[ended] = who
        try:
            return await ended
        finally:
            del self._waiting[ended]

    async def run(self) -> None:
        """Check the list and the clock for all callers of `until_ended`, until cancelled."""
        while True:
            self._reload()
            for ended, who in self._waiting.items():
                if not ended.done() and (reason := self._ended(who())):
                    ended.set_result(reason)
            await asyncio.sleep(CHECK_INTERVAL_S)

    def _ended(self, who: Identity | None) -> str | None:
        if who is None or who.token_id is None:
            return None
        if who.expired:
            return "Your login has expired. Log in again."
        record = self._records.get(who.token_id)
        if record is None:
            return None if self._error else "Your login is no longer known. Ask for a new one."
        if record.state == "expired":
            return "Your login has expired. Log in again."
        if record.revoked is None:
            return None
        return self._why_revoked(record, "Your login was revoked. Ask for a new one.")

    def _why_revoked(self, record: Record, sentence: str) -> str:
        """`sentence`, unless only this login has ended: by a logout, or because there were too many newer ones."""
        parent = self._records.get(record.parent)
        alone = record.kind == "login" and (parent is None or parent.revoked is None)
        return "This login has ended. Log in again." if alone else sentence

    def _reload(self) -> None:
        """Read keys and list if they have changed. A failure is logged once, and what was read before remains."""
        try:
            self._keys.reload()
        except (OSError, UnsafeFile) as error:
            self._failed(f"The signing key cannot be read: nobody can log in. {error}")
            return
        try:
            with private_files.opened(self._path) as file:
                status = os.fstat(file.fileno())
                version = (status.st_ino, status.st_mtime_ns, status.st_size)
                if version == self._version and self._error is None:
                    return
                known = _parse(file.read())
        except (OSError, ValueError, UnsafeFile) as error:
            self._failed(_cannot_read(self._path, error))
            return
        if self._error is not None:
            log.info("the list of login tokens can be read again")
        self._records = {record.id: record for record in known}
        self._version, self._error = version, None

    def _failed(self, error: str) -> None:
        if error != self._error:
            log.warning("%s", error)
        self._error = error


@contextmanager
def _locked(data_dir: Path) -> Iterator[None]:
    """Allow one writer at a time. The lock is on the folder; the system releases it when its process dies."""
    private_files.check_folder(data_dir)
    folder = os.open(data_dir, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def _write(data_dir: Path, known: Sequence[Record]) -> None:
    try:
        private_files.write(data_dir / REGISTRY, msgspec.json.format(msgspec.json.encode(known), indent=1) + b"\n")
    except OSError as error:
        raise RegistryError(f"The list of login tokens in {data_dir} cannot be written: {error.strerror}.") from None


def _identity(claimed: Identity, record: Record) -> Identity:
    """Who a token is for. The list decides, not the token."""
    expires = min(record.expires, claimed.expires or record.expires)
    return Identity(record.name, record.role, record.id, expires, record.subject)


def _parse(content: bytes) -> list[Record]:
    """Raises `ValueError`."""
    try:
        known = msgspec.json.decode(content, type=list[Record])
    except wire.UNREADABLE as error:
        raise ValueError(str(error)) from None
    return [one if one.subject else msgspec.structs.replace(one, subject=_old_subject(one, known)) for one in known]


def _old_subject(one: Record, known: Sequence[Record]) -> str:
    """The person of a token from before people had subjects.

    Sessions of that time belong to a name. They go to the most trusted one who had the name, never to a namesake.
    """
    roles = list(Role)
    namesakes = [other.role for other in known if other.name == one.name and not other.subject]
    if one.name != identity.LOCAL.name and one.role == max(namesakes, key=roles.index):
        return identity.person_named(one.name)
    return f"role:{one.role.value}:{one.name}"


def _cannot_read(path: Path, error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return f"There is no list of login tokens ({path}): nobody can log in. Make one with `robot-acp token create`."
    why = (error.strerror if isinstance(error, OSError) else None) or error
    return (
        f"The list of login tokens {path} cannot be read ({why}): nobody can log in. Mend it, or delete it and make "
        "new tokens with `robot-acp token create`; all earlier ones stay refused then."
    )


def _unknown(id_or_name: str, known: Sequence[Record]) -> str:
    valid = [f"{one.id} ({one.name})" for one in known if one.is_access and one.state == "valid"]
    exist = f"Valid ones: {', '.join(valid)}." if valid else "There is no valid one."
    return f"There is no token with the id or name {id_or_name!r}. {exist}"
