"""Login, logout, and asking who one is."""

from __future__ import annotations

import asyncio
import time
from http.cookies import SimpleCookie

import pytest

from backend import audit, logins, tokens
from backend.identity import Role
from tests.bridge.conftest import running_bridge


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
    assert cookie.value not in ("", token)
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


async def test_behind_a_proxy_that_says_nothing_the_page_says_that_it_is_https(bridge_with):
    origin = "https://robot.example.org"
    async with bridge_with(bridge={"allowed_origins": [origin]}) as bridge, bridge.http() as http:
        response = await http.post("/api/login", json={"token": bridge.token()}, headers={"Origin": origin})
        assert cookie_of(response)["secure"]
        response = await http.post("/api/login", json={"token": bridge.token()}, headers={"Origin": bridge.origin})
        assert not cookie_of(response)["secure"]


async def test_the_cookie_is_a_login_of_its_own_with_the_same_person_role_and_end(bridge):
    token = bridge.token(Role.VISITOR, "Vic")
    async with bridge.http() as http:
        for _ in range(2):
            assert (await http.post("/api/login", json={"token": token})).status_code == 200
    shown, *derived = tokens.records(bridge.settings.data_dir)
    assert len({record.id for record in (shown, *derived)}) == 3
    for login in derived:
        assert (login.kind, login.parent, login.state) == ("login", shown.id, "valid")
        assert (login.subject, login.name, login.role) == (shown.subject, "Vic", Role.VISITOR)
        assert abs(login.expires - shown.expires) <= 1


async def test_a_cookie_makes_no_further_login(bridge):
    async with bridge.http() as http:
        cookie = cookie_of(await http.post("/api/login", json={"token": bridge.token()})).value
        response = await http.post("/api/login", json={"token": cookie})
    assert response.status_code == 401
    assert response.json()["error"] == "This is the cookie of another login. Log in with the login token itself."


async def test_of_many_logins_with_one_token_the_oldest_gives_way_and_the_list_stays_short(bridge):
    token = bridge.token()
    async with bridge.http() as http:
        cookies = [
            cookie_of(await http.post("/api/login", json={"token": token})).value for _ in range(2 * logins.MOST + 5)
        ]
        statuses = []
        for cookie in cookies:
            http.cookies.clear()
            statuses.append((await http.get("/api/me", headers={"Cookie": f"robot_acp={cookie}"})).status_code)
    assert statuses == [401] * (logins.MOST + 5) + [200] * logins.MOST
    assert len(tokens.records(bridge.settings.data_dir)) == 1 + 2 * logins.MOST


async def test_a_person_who_logs_in_without_end_has_to_wait(bridge, monkeypatch):
    monkeypatch.setattr("backend.bridge.login._NEW_AT_ONCE", 3)
    monkeypatch.setattr("backend.bridge.login._NEW_PER_SECOND", 0.001)
    async with running_bridge(bridge.settings) as again, again.http() as http:
        answers = [await http.post("/api/login", json={"token": bridge.token(name="Ana")}) for _ in range(4)]
        other = await http.post("/api/login", json={"token": bridge.token(name="Ben")})
    assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
    assert int(answers[-1].headers["retry-after"]) > 0
    assert other.status_code == 200


async def test_a_one_time_code_is_a_login_of_seven_days_once(bridge):
    code = logins.new_code(bridge.settings.data_dir)
    async with bridge.http() as first, bridge.http() as second:
        entered = await first.post("/api/login", json={"token": code})
        refused = await second.post("/api/login", json={"token": code})
        assert (await first.get("/api/me")).json()["role"] == "supervisor"
    assert (entered.status_code, entered.json()["name"]) == (200, "supervisor")
    assert 6.9 * 86400 < entered.json()["expires"] - time.time() <= 7 * 86400
    assert (refused.status_code, refused.json()) == (401, {"error": logins.NOT_VALID})
    assert "set-cookie" not in refused.headers
    assert code not in (bridge.settings.data_dir / tokens.REGISTRY).read_text()


async def test_who_opens_the_printed_address_again_stays_logged_in_and_after_the_logout_does_not(bridge):
    code = logins.new_code(bridge.settings.data_dir)
    async with bridge.http() as http:
        entered = await http.post("/api/login", json={"token": code})
        again = await http.post("/api/login", json={"token": code})
        assert (again.status_code, again.json()) == (200, entered.json())
        assert "set-cookie" not in again.headers
        cookie = f"robot_acp={cookie_of(entered).value}"
        await http.post("/api/logout", headers={"Origin": bridge.origin})
        last = await http.post("/api/login", json={"token": code}, headers={"Cookie": cookie})
        assert last.status_code == 401


async def test_a_code_that_is_too_old_is_refused(bridge, monkeypatch):
    monkeypatch.setattr(logins, "CODE_LIFETIME_S", -1.0)
    code = logins.new_code(bridge.settings.data_dir)
    async with bridge.http() as http:
        response = await http.post("/api/login", json={"token": code})
    assert (response.status_code, response.json()) == (401, {"error": logins.NOT_VALID})


async def test_of_two_who_send_one_code_at_once_one_gets_in(bridge):
    code = logins.new_code(bridge.settings.data_dir)
    async with bridge.http() as http:
        answers = await asyncio.gather(*(http.post("/api/login", json={"token": code}) for _ in range(8)))
    assert sorted(answer.status_code for answer in answers) == [200] + [401] * 7


async def test_where_a_login_cannot_be_recorded_nobody_is_logged_in_and_the_logout_says_so(bridge, monkeypatch):
    token, cookie = bridge.token(), ""
    async with bridge.http() as http:
        cookie = cookie_of(await http.post("/api/login", json={"token": token})).value

        def full(*_):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("backend.private_files.write", full)
        entered = await http.post("/api/login", json={"token": token})
        left = await http.post("/api/logout", headers={"Cookie": f"robot_acp={cookie}", "Origin": bridge.origin})
    for answer in (entered, left):
        assert (answer.status_code, answer.json()) == (
            503,
            {"error": "The robot cannot write its list of tokens. Its log says what to do."},
        )
    assert "set-cookie" not in entered.headers
    assert cookie_of(left).value == ""


async def test_logins_and_logouts_are_recorded_and_no_token_is(bridge_with):
    async with bridge_with() as bridge, bridge.http() as http:
        token = bridge.token(Role.OPERATOR, "Ana")
        cookie = cookie_of(await http.post("/api/login", json={"token": token})).value
        await http.post("/api/login", json={"token": "x.y.z"})
        await http.post("/api/logout", headers={"Origin": bridge.origin})
    events = list(audit.entries(bridge.settings.data_dir))
    assert [(event["event"], event.get("by")) for event in events] == [
        ("login", "Ana"),
        ("login_refused", None),
        ("logout", "Ana"),
    ]
    assert {event["process"] for event in events} == {"bridge"}
    assert {event["address"] for event in events} == {"127.0.0.1"}
    written = (bridge.settings.data_dir / audit.FILE).read_text()
    assert all(secret not in written for secret in (token, cookie, "x.y.z"))


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
