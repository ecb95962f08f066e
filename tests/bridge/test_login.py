"""Login, logout, and asking who one is."""

from __future__ import annotations

import time
from http.cookies import SimpleCookie

import pytest

from backend.identity import Role


def cookie_of(response):
    jar = SimpleCookie(response.headers["set-cookie"])
    return jar["robot_acp"]


async def test_a_token_becomes_a_cookie_that_scripts_cannot_read_and_other_sites_cannot_send(bridge):
    began = time.time()
    token = bridge.token(Role.SUPERVISOR, "Ana", lifetime_s=600)
    async with bridge.http() as http:
        response = await http.post("/api/login", json={"token": token})
    assert response.status_code == 200
    body = response.json()
    assert {key: body[key] for key in ("name", "role", "robot")} == {
        "name": "Ana",
        "role": "supervisor",
        "robot": "Sancho",
    }
    assert began + 599 <= body["expires"] <= time.time() + 600
    assert token not in response.text
    cookie = cookie_of(response)
    assert cookie.value == token
    assert cookie["httponly"]
    assert cookie["samesite"] == "strict"
    assert cookie["path"] == "/"
    assert body["expires"] - time.time() - 1 <= int(cookie["max-age"]) <= 600
    assert not cookie["secure"]  # this server speaks plain HTTP; see the next test
    assert response.headers["cache-control"] == "no-store"


async def test_behind_https_the_cookie_is_for_https_alone(bridge):
    async with bridge.http() as http:
        response = await http.post("/api/login", json={"token": bridge.token()}, headers={"X-Forwarded-Proto": "https"})
    assert cookie_of(response)["secure"]


async def test_the_cookie_says_who_one_is_until_logout(bridge):
    async with bridge.http() as http:
        await http.post("/api/login", json={"token": bridge.token(Role.VISITOR, "Vic")})
        me = await http.get("/api/me")
        assert (me.status_code, me.json()["name"], me.json()["role"]) == (200, "Vic", "visitor")
        logout = await http.post("/api/logout", headers={"Origin": bridge.origin})
        assert logout.status_code == 204
        assert (await http.get("/api/me")).status_code == 401


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"{}",
        b'{"token": 5}',
        b'{"token": ""}',
        b'{"token": "x"}',
        b'{"token": "\xff"}',
        b'{"token": "' + b"x" * 100_000 + b'"}',
    ],
)
async def test_what_is_no_token_is_refused_with_a_sentence(bridge, body):
    async with bridge.http() as http:
        response = await http.post("/api/login", content=body)
    assert response.status_code == 401
    assert response.json()["error"].endswith(("}.", "."))
    assert "set-cookie" not in response.headers


async def test_an_expired_token_is_refused_and_the_person_is_told_what_to_do(bridge):
    async with bridge.http() as http:
        response = await http.post("/api/login", json={"token": bridge.token(lifetime_s=-1)})
    assert response.status_code == 401
    assert response.json() == {"error": "This login token has expired. Ask for a new one."}


async def test_another_site_cannot_log_anyone_in_or_out(bridge):
    async with bridge.http() as http:
        for path, body in (("/api/login", {"token": bridge.token()}), ("/api/logout", {})):
            response = await http.post(path, json=body, headers={"Origin": "https://evil.example"})
            assert response.status_code == 403
            assert "set-cookie" not in response.headers


async def test_without_a_login_nobody_is_told_who_they_are(bridge):
    async with bridge.http() as http:
        response = await http.get("/api/me")
    assert response.status_code == 401
    assert response.json() == {"error": "Log in with a token first."}


async def test_a_token_in_the_address_is_not_a_login(bridge):
    async with bridge.http() as http:
        assert (await http.get("/api/me", params={"token": bridge.token()})).status_code == 401
