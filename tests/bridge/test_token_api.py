"""Supervisors list, make and revoke logins over HTTP; nobody else can, and no answer but one has a token."""

from __future__ import annotations

import stat
import time

import pytest

from backend import audit, tokens
from backend.bridge import token_api
from backend.identity import Role


def supervisor(bridge):
    return bridge.http(bridge.token(Role.SUPERVISOR, "Sue"))


async def test_a_new_login_works_is_listed_without_its_token_and_ends_when_it_is_revoked(bridge):
    async with supervisor(bridge) as http:
        began = time.time()
        made = await http.post("/api/tokens", json={"name": " Ana ", "role": "operator", "expires": "2h"})
        assert made.status_code == 201
        assert made.headers["cache-control"] == "no-store"
        new = made.json()
        assert (new["name"], new["role"]) == ("Ana", "operator")
        assert began + 7199 <= new["expires"] <= time.time() + 7201
        async with bridge.http(new["token"]) as ana:
            assert (await ana.get("/api/me")).json()["name"] == "Ana"
        listed = await http.get("/api/tokens")
        assert listed.headers["cache-control"] == "no-store"
        assert new["token"] not in listed.text
        by_name = {one["name"]: one for one in listed.json()["tokens"]}
        assert by_name["Sue"]["own"] is True
        assert {key: by_name["Ana"][key] for key in ("id", "role", "state", "own")} == {
            "id": new["id"],
            "role": "operator",
            "state": "valid",
            "own": False,
        }
        assert began - 1 <= by_name["Ana"]["created"] <= time.time()
        revoked = await http.delete(f"/api/tokens/{new['id']}")
        assert (revoked.status_code, revoked.json()) == (200, {"revoked": True})
        assert (await http.delete(f"/api/tokens/{new['id']}")).json() == {"revoked": False}
        async with bridge.http(new["token"]) as ana:
            assert "revoked" in (await ana.get("/api/me")).json()["error"]
        states = {one["id"]: one["state"] for one in (await http.get("/api/tokens")).json()["tokens"]}
        assert states[new["id"]] == "revoked"


async def test_a_revoked_login_leaves_the_websocket_that_it_uses(bridge, agent, initialize, closing):
    async with supervisor(bridge) as http:
        new = (await http.post("/api/tokens", json={"name": "Ana", "role": "viewer"})).json()
        async with bridge.websocket(token=new["token"]) as websocket:
            await websocket.send(initialize.decode())
            await agent.heard()
            await http.delete(f"/api/tokens/{new['id']}")
            _, reason = await closing(websocket)
    assert "revoked" in reason


@pytest.mark.parametrize("role", [Role.VIEWER, Role.VISITOR, Role.OPERATOR])
async def test_nobody_but_a_supervisor_sees_makes_or_revokes_logins(bridge, role):
    token = bridge.token(role, "Ana")
    known = tokens.records(bridge.settings.data_dir)
    async with bridge.http(token) as http:
        answers = [
            await http.get("/api/tokens"),
            await http.post("/api/tokens", json={"name": "Eve", "role": "supervisor"}),
            await http.delete(f"/api/tokens/{known[0].id}"),
        ]
    assert {answer.status_code for answer in answers} == {403}
    assert {answer.json()["error"] for answer in answers} == {"Only a supervisor can see, make and revoke logins."}
    assert tokens.records(bridge.settings.data_dir) == known


async def test_without_a_login_and_from_another_site_nothing_is_answered(bridge):
    async with bridge.http() as http:
        assert (await http.get("/api/tokens")).status_code == 401
        assert (await http.post("/api/tokens", json={}, headers={"Origin": bridge.origin})).status_code == 401
        await http.post("/api/login", json={"token": bridge.token(Role.SUPERVISOR, "Sue")})
        assert (await http.get("/api/tokens")).status_code == 200
        foreign = {"Origin": "https://evil.example"}
        wanted = {"name": "Eve", "role": "supervisor"}
        assert (await http.post("/api/tokens", json=wanted, headers=foreign)).status_code == 403
        own = tokens.records(bridge.settings.data_dir)[-1].id
        assert (await http.delete(f"/api/tokens/{own}?own=true", headers=foreign)).status_code == 403
        assert (await http.delete(f"/api/tokens/{own}?own=true")).status_code == 403, "a cookie without an Origin"
    assert {one.state for one in tokens.records(bridge.settings.data_dir)} == {"valid"}


@pytest.mark.parametrize(
    ("content", "status", "said"),
    [
        (b"", 400, "Send JSON"),
        (b"[]", 400, "Send JSON"),
        (b"{}", 400, "Send JSON"),
        (b'{"name": "Ana", "role": "admin"}', 400, "viewer, visitor, operator or supervisor"),
        (b'{"name": "Ana", "role": "viewer", "key": 1}', 400, "Send JSON"),
        (b'{"name": "\xff", "role": "viewer"}', 400, "Send JSON"),
        (b"[" * 4000, 400, "Send JSON"),
        (b'{"name": "' + b"x" * 5000 + b'", "role": "viewer"}', 413, "too long"),
        (b'{"name": "' + b"x" * 61 + b'", "role": "viewer"}', 400, "1 to 60 characters"),
        (b'{"name": "  ", "role": "viewer"}', 400, "1 to 60 characters"),
        (b'{"name": "A\\nB", "role": "viewer"}', 400, "on one line"),
        ('{"name": "A\u202eB", "role": "viewer"}'.encode(), 400, "on one line"),
        (b'{"name": "Ana", "role": "viewer", "expires": "soon"}', 400, "neither a time"),
        (b'{"name": "Ana", "role": "viewer", "expires": "2001-01-01"}', 400, "over already"),
        (b'{"name": "Ana", "role": "viewer", "expires": "9999d"}', 400, "ten years"),
        (b'{"name": "Ana", "role": "viewer", "expires": "' + b"1" * 33 + b'"}', 400, "Send JSON"),
        (b'{"name": "local", "role": "viewer"}', 409, "Choose another name"),
    ],
)
async def test_what_cannot_be_made_is_refused_with_a_sentence(bridge, content, status, said):
    async with supervisor(bridge) as http:
        answer = await http.post("/api/tokens", content=content)
        assert answer.status_code == status
        sentence = answer.json()["error"]
        assert said in sentence
        assert sentence.endswith(".")
        assert len((await http.get("/api/tokens")).json()["tokens"]) == 1


async def test_a_name_is_one_person_unless_the_same_is_said_to_be_meant(bridge):
    wanted = {"name": "Ana", "role": "operator"}
    async with supervisor(bridge) as http:
        assert (await http.post("/api/tokens", json=wanted)).status_code == 201
        refused = await http.post("/api/tokens", json=wanted | {"name": "ANA"})
        assert refused.status_code == 409
        assert "There is 'Ana' already" in refused.json()["error"]
        assert "--" not in refused.json()["error"], "no word about a command line"
        assert (await http.post("/api/tokens", json=wanted | {"same_person": True})).status_code == 201
        other_role = await http.post("/api/tokens", json=wanted | {"same_person": True, "role": "viewer"})
        assert (other_role.status_code, "a person has one role" in other_role.json()["error"]) == (409, True)
    subjects = {one.subject for one in tokens.records(bridge.settings.data_dir) if one.name == "Ana"}
    assert len(subjects) == 1


async def test_one_s_own_login_is_revoked_only_when_that_is_confirmed(bridge):
    async with supervisor(bridge) as http:
        own = next(one["id"] for one in (await http.get("/api/tokens")).json()["tokens"] if one["own"])
        refused = await http.delete(f"/api/tokens/{own}")
        assert (refused.status_code, "that you use now" in refused.json()["error"]) == (409, True)
        assert (await http.get("/api/me")).status_code == 200
        assert (await http.delete(f"/api/tokens/{own}?own=true")).json() == {"revoked": True}
        assert (await http.get("/api/me")).status_code == 401


async def test_a_name_revokes_nothing_and_an_unknown_id_is_said_to_be_unknown(bridge):
    async with supervisor(bridge) as http:
        bridge.token(Role.OPERATOR, "Ana")
        for unknown in ("Ana", "nobody", "x" * 3000):
            answer = await http.delete(f"/api/tokens/{unknown}")
            assert (answer.status_code, answer.json()["error"]) == (404, "There is no such login. Load the list again.")
    assert all(one.state == "valid" for one in tokens.records(bridge.settings.data_dir))


async def test_there_is_a_most_that_can_be_valid_at_once(bridge, monkeypatch):
    monkeypatch.setattr(token_api, "MAX_VALID", 2)
    async with supervisor(bridge) as http:
        first = await http.post("/api/tokens", json={"name": "Ana", "role": "viewer"})
        refused = await http.post("/api/tokens", json={"name": "Ben", "role": "viewer"})
        assert (refused.status_code, "Revoke some" in refused.json()["error"]) == (409, True)
        await http.delete(f"/api/tokens/{first.json()['id']}")
        assert (await http.post("/api/tokens", json={"name": "Ben", "role": "viewer"})).status_code == 201


async def test_who_made_and_who_revoked_a_login_is_in_the_audit_log_and_the_token_is_not(bridge, wait_until):
    async with supervisor(bridge) as http:
        new = (await http.post("/api/tokens", json={"name": "Ana", "role": "operator"})).json()
        await http.delete(f"/api/tokens/{new['id']}")
    folder = bridge.settings.data_dir

    def noted():
        return [one for one in audit.entries(folder) if str(one["event"]).startswith("token_")]

    await wait_until(lambda: len(noted()) == 2)
    created, revoked = noted()
    assert (created["event"], created["by"], created["role"], created["process"]) == (
        "token_created",
        "Sue",
        "supervisor",
        "bridge",
    )
    assert (created["created"], created["created_name"], created["created_role"]) == (new["id"], "Ana", "operator")
    assert (revoked["event"], revoked["by"], revoked["revoked"]) == ("token_revoked", "Sue", new["id"])
    assert new["token"] not in (folder / audit.FILE).read_text()


async def test_a_list_that_cannot_be_read_is_said_to_be_so(bridge):
    async with supervisor(bridge) as http:
        assert (await http.get("/api/tokens")).status_code == 200
        path = bridge.settings.data_dir / tokens.REGISTRY
        path.write_text("no list")
        path.chmod(stat.S_IRUSR | stat.S_IWUSR)
        answer = await http.get("/api/tokens")
        assert (answer.status_code, "cannot read" in answer.json()["error"]) == (503, True)
