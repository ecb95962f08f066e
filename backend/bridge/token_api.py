"""The HTTP API for login tokens: list, create and revoke them. Only supervisors may use it.

A new token is in the answer to the request that made it and nowhere else: the list, the logs and the audit log never
contain one. Files are read and written in a thread.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse

from backend import identity, tokens, wire
from backend.audit import Audit
from backend.bridge.login import Authenticator
from backend.identity import Identity, Right, Role
from backend.lifetimes import lifetime
from backend.private_files import UnsafeFile
from backend.token_commands import MAX_NAME_CHARS
from backend.tokens import NameTaken, Record, RegistryError

MAX_VALID = 1000
"""Valid tokens up to which this API makes new ones: the list is read as a whole whenever it has changed."""
_MAX_BODY_BYTES = 4096
_MAX_ID_CHARS = 64
_FORM = 'Send JSON: {"name": "…", "role": "viewer, visitor, operator or supervisor", "expires": "7d"}.'

Result = TypeVar("Result")


class _Refusal(Exception):
    """The request cannot be carried out; the text is one sentence that says what to do."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class _NewToken(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    role: Role
    expires: Annotated[str, msgspec.Meta(max_length=32)] = "7d"
    same_person: bool = False


def router(authenticator: Authenticator, data_dir: Path, audit: Audit) -> APIRouter:
    """The routes below `/api/tokens`."""
    routes = APIRouter(prefix="/api/tokens")

    @routes.get("")
    async def listed(request: Request) -> JSONResponse:
        who = authenticator.authenticate(request).identity
        return await _answer(who, lambda: {"tokens": _listed(data_dir, who)})

    @routes.post("")
    async def create(request: Request) -> JSONResponse:
        who = authenticator.admit(request).identity
        body = await _body(request) if who.may(Right.ADMINISTER) else b""
        return await _answer(who, lambda: _create(data_dir, audit, who, body), status=201)

    @routes.delete("/{token_id}")
    async def revoke(request: Request, token_id: str) -> JSONResponse:
        who = authenticator.admit(request).identity
        own = request.query_params.get("own") == "true"
        return await _answer(who, lambda: _revoke(data_dir, audit, who, token_id, own=own))

    return routes


async def _answer(who: Identity, work: Callable[[], dict[str, Any]], status: int = 200) -> JSONResponse:
    """Do `work` in a thread, for a supervisor. Raises `RegistryError` when the list cannot be read or written."""
    headers = {"Cache-Control": "no-store"}
    if not who.may(Right.ADMINISTER):
        sentence = "Only a supervisor can see, make and revoke logins."
        return JSONResponse({"error": sentence}, status_code=403, headers=headers)
    try:
        return JSONResponse(await asyncio.to_thread(work), status_code=status, headers=headers)
    except _Refusal as refusal:
        return JSONResponse({"error": str(refusal)}, status_code=refusal.status, headers=headers)
    except UnsafeFile as error:
        raise RegistryError(str(error)) from None


async def _body(request: Request) -> bytes:
    """The body, or as much of it as is too much."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > _MAX_BODY_BYTES:
            break
    return bytes(body)


def _listed(data_dir: Path, who: Identity) -> list[dict[str, Any]]:
    known = tokens.records(data_dir)
    own = _own_id(known, who)
    return [
        {
            "id": one.id,
            "name": one.name,
            "role": one.role.value,
            "created": one.created,
            "expires": one.expires,
            "state": one.state,
            "own": one.id == own,
        }
        for one in _issued(known)
    ]


def _create(data_dir: Path, audit: Audit, who: Identity, body: bytes) -> dict[str, Any]:
    wanted = _parse(body)
    name = wanted.name.strip()
    if not name or not name.isprintable() or len(name) > MAX_NAME_CHARS:
        raise _Refusal(400, f"A name is 1 to {MAX_NAME_CHARS} characters on one line.")
    try:
        lifetime_s = lifetime(wanted.expires.strip())
    except ValueError as error:
        raise _Refusal(400, f"{error}.") from None
    if sum(one.state == "valid" for one in _issued(tokens.records(data_dir))) >= MAX_VALID:
        raise _Refusal(409, f"There are {MAX_VALID} valid logins already. Revoke some that nobody needs.")
    try:
        token = tokens.create(data_dir, name, wanted.role, lifetime_s, same_person=wanted.same_person)
    except NameTaken as taken:
        raise _Refusal(409, taken.without_hint) from None
    made = identity.verify([identity.shared_secret(data_dir, identity.SIGNING_KEY)], token)
    audit.record("token_created", who, created=made.token_id, created_name=name, created_role=made.role.value)
    return {"token": token, "id": made.token_id, "name": name, "role": made.role.value, "expires": made.expires}


def _parse(body: bytes) -> _NewToken:
    if len(body) > _MAX_BODY_BYTES:
        raise _Refusal(413, f"That is too long. {_FORM}")
    try:
        return msgspec.json.decode(body, type=_NewToken)
    except wire.UNREADABLE:
        raise _Refusal(400, _FORM) from None


def _revoke(data_dir: Path, audit: Audit, who: Identity, token_id: str, *, own: bool) -> dict[str, Any]:
    known = tokens.records(data_dir)
    if len(token_id) > _MAX_ID_CHARS or token_id not in {one.id for one in _issued(known)}:
        raise _Refusal(404, "There is no such login. Load the list again.")
    if token_id == _own_id(known, who) and not own:
        raise _Refusal(409, "That is the login that you use now. Confirm it with ?own=true.")
    revoked = tokens.revoke(data_dir, token_id)
    for one in revoked:
        audit.record("token_revoked", who, revoked=one.id, revoked_name=one.name, revoked_role=one.role.value)
    return {"revoked": bool(revoked)}


def _issued(known: Sequence[Record]) -> list[Record]:
    """The tokens that somebody was given. A login that a page made out of one goes with it, and is not listed."""
    return [one for one in known if one.is_access]


def _own_id(known: Sequence[Record], who: Identity) -> str | None:
    """The id of the token with which a person logged in."""
    used = next((one for one in known if one.id == who.token_id), None)
    return (used.parent if used else None) or who.token_id
