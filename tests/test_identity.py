"""Tokens, roles, and the secrets that the processes share."""

from __future__ import annotations

import base64
import json
import multiprocessing
import stat
import time
from pathlib import Path

import jwt
import pytest

from backend import identity
from backend.identity import Identity, InvalidToken, Right, Role, issue, shared_secret, verify

KEY = b"k" * 64


def test_a_token_says_who_it_was_issued_to_until_it_expires():
    before = time.time()
    who = verify([KEY], issue(KEY, "Ana", Role.OPERATOR, 60))
    assert (who.name, who.role) == ("Ana", Role.OPERATOR)
    assert before + 59 <= who.expires <= time.time() + 60
    assert who.token_id


def test_two_tokens_for_the_same_person_can_be_told_apart():
    one, other = (verify([KEY], issue(KEY, "Ana", Role.VIEWER, 60)) for _ in range(2))
    assert one.token_id != other.token_id


@pytest.mark.parametrize("name", ["Ana", "Ánä 😀", "", "a" * 500, "robot-acp", '"; drop'])
def test_names_come_back_as_they_were(name):
    assert verify([KEY], issue(KEY, name, Role.VIEWER, 60)).name == name


def claims(**changes) -> dict:
    now = int(time.time())
    known = {"aud": "robot-acp", "sub": "Eve", "role": "supervisor", "jti": "1", "iat": now, "exp": now + 86_400}
    return {key: value for key, value in (known | changes).items() if value is not None}


def unsigned(algorithm: str = "none") -> str:
    def part(value: dict) -> str:
        return base64.urlsafe_b64encode(json.dumps(value).encode()).rstrip(b"=").decode()

    return f"{part({'alg': algorithm, 'typ': 'JWT'})}.{part(claims())}."


def tampered() -> str:
    head, body, signature = issue(KEY, "Ana", Role.VIEWER, 86_400).split(".")
    forged = json.loads(base64.urlsafe_b64decode(body + "=="))
    forged["role"] = "supervisor"
    body = base64.urlsafe_b64encode(json.dumps(forged).encode()).rstrip(b"=").decode()
    return f"{head}.{body}.{signature}"


FORGERIES = {
    "nothing": "",
    "words": "not a token",
    "three empty parts": "..",
    "another key": jwt.encode(claims(), b"x" * 64, algorithm="HS256"),
    "no signature": unsigned(),
    "no signature, claimed otherwise": unsigned("HS256"),
    "another algorithm": jwt.encode(claims(), KEY, algorithm="HS512"),
    "a role raised afterwards": tampered(),
    "another audience": jwt.encode(claims(aud="other"), KEY, algorithm="HS256"),
    "no audience": jwt.encode(claims(aud=None), KEY, algorithm="HS256"),
    "an unknown role": jwt.encode(claims(role="root"), KEY, algorithm="HS256"),
    "no role": jwt.encode(claims(role=None), KEY, algorithm="HS256"),
    "no name": jwt.encode(claims(sub=None), KEY, algorithm="HS256"),
    "no id": jwt.encode(claims(jti=None), KEY, algorithm="HS256"),
    "no end": jwt.encode(claims(exp=None), KEY, algorithm="HS256"),
    "not valid yet": jwt.encode(claims(nbf=int(time.time()) + 43_200), KEY, algorithm="HS256"),
}


@pytest.mark.parametrize("token", FORGERIES.values(), ids=FORGERIES.keys())
def test_a_token_that_was_not_issued_here_proves_nothing(token):
    with pytest.raises(InvalidToken, match="not valid for this robot"):
        verify([KEY], token)


def test_a_token_that_has_expired_says_so():
    with pytest.raises(InvalidToken, match="expired"):
        verify([KEY], issue(KEY, "Ana", Role.SUPERVISOR, -1))


def test_why_a_token_is_refused_never_repeats_it():
    for token in FORGERIES.values():
        with pytest.raises(InvalidToken) as refusal:
            verify([KEY], token)
        assert not token or token not in str(refusal.value)
        assert refusal.value.__cause__ is None


RIGHTS = {
    Role.VIEWER: set(),
    Role.VISITOR: {Right.PROMPT},
    Role.OPERATOR: {Right.PROMPT, Right.APPROVE, Right.CONFIGURE},
    Role.SUPERVISOR: {
        Right.PROMPT,
        Right.APPROVE,
        Right.CONFIGURE,
        Right.RELEASE,
        Right.TAKE_OVER,
        Right.OFFER_SERVERS,
        Right.ADMINISTER,
    },
}


@pytest.mark.parametrize("role", list(Role))
def test_what_each_role_may_do(role):
    who = Identity("Ana", role)
    assert {right for right in Right if who.may(right)} == RIGHTS[role]


def test_a_shared_secret_is_made_once_and_only_its_owner_may_read_it(tmp_path: Path):
    folder = tmp_path / "data" / "robot"
    secret = shared_secret(folder, identity.ROBOT_TOKEN)
    assert len(secret) >= 43
    assert secret.decode().isascii()
    assert shared_secret(folder, identity.ROBOT_TOKEN) == secret
    assert shared_secret(folder, identity.SIGNING_KEY) != secret
    assert stat.S_IMODE((folder / identity.ROBOT_TOKEN).stat().st_mode) == 0o600
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {path.name for path in folder.iterdir()} == {identity.ROBOT_TOKEN, identity.SIGNING_KEY}


def _make(folder: Path, gate, results) -> None:
    gate.wait()
    results.put(shared_secret(folder, "x"))


def test_processes_that_start_at_the_same_moment_agree_on_one_secret(tmp_path: Path):
    context = multiprocessing.get_context("spawn")
    gate, results = context.Barrier(4), context.Queue()
    processes = [context.Process(target=_make, args=(tmp_path / "data", gate, results)) for _ in range(4)]
    for process in processes:
        process.start()
    secrets = {results.get(timeout=30) for _ in processes}
    for process in processes:
        process.join(30)
    assert secrets == {(tmp_path / "data" / "x").read_bytes()}
