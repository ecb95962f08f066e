"""The list of login tokens: what the commands say and keep, and whom it lets in."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import stat
import subprocess
import time
from datetime import datetime
from pathlib import Path

import httpx
import pytest

from backend import identity, logins, tokens
from backend.chat.link import LinkError, RefusedError
from backend.cli import main
from backend.identity import InvalidToken, Role
from backend.lifetimes import lifetime
from backend.tokens import Registry, RegistryError
from tests.processes import PATIENCE_S, Client, Robot, end


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path / "data")


def command(robot: Robot, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        robot.command("token", *arguments), env=robot.variables, text=True, capture_output=True, timeout=PATIENCE_S
    )


def listed(robot: Robot) -> list[dict[str, str]]:
    return list(json.loads(command(robot, "list", "--json").stdout))


@pytest.mark.processes
def test_a_token_is_made_listed_and_revoked_by_its_id(robot: Robot) -> None:
    token = command(robot, "create", "--name", "Ana", "--role", "operator", "--expires", "12h").stdout.strip()
    assert Registry(robot.data).verify(token).name == "Ana"
    (about,) = listed(robot)
    assert (about["name"], about["role"], about["state"]) == ("Ana", "operator", "valid")
    created, expires = (datetime.fromisoformat(about[key]) for key in ("created", "expires"))
    assert created.utcoffset() is not None
    assert (expires - created).total_seconds() == 12 * 3600

    revoked = command(robot, "revoke", about["id"])
    assert (revoked.returncode, revoked.stdout) == (0, f"Revoked {about['id']} of Ana (operator).\n")
    assert listed(robot)[0]["state"] == "revoked"
    with pytest.raises(InvalidToken, match="revoked"):
        Registry(robot.data).verify(token)
    again = command(robot, "revoke", about["id"])
    assert (again.returncode, again.stdout) == (
        0,
        f"Nothing to do: no token of {about['id']} is valid any more.\n",
    )


def test_revoking_a_name_revokes_all_its_valid_tokens_and_nobody_elses(
    robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    anas = [robot.token("Ana", Role.OPERATOR) for _ in range(2)]
    robot.token("Ana", Role.OPERATOR, -1)
    ben = robot.token("Ben", Role.VIEWER)
    assert main(["--data-dir", str(robot.data), "token", "revoke", "Ana"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 3
    assert said[-1] == "These were all valid tokens of Ana."
    assert [record.state for record in tokens.records(robot.data)] == ["revoked", "revoked", "expired", "valid"]
    for token in anas:
        with pytest.raises(InvalidToken):
            Registry(robot.data).verify(token)
    assert Registry(robot.data).verify(ben).name == "Ben"


def test_an_id_that_does_not_exist_is_told_with_those_that_do(robot: Robot) -> None:
    empty = command(robot, "revoke", "Ana")
    assert (empty.returncode, empty.stderr) == (
        2,
        "robot-acp: There is no token with the id or name 'Ana'. There is no valid one.\n",
    )
    robot.token("Ana", Role.VIEWER)
    unknown = command(robot, "revoke", "Anna")
    assert unknown.returncode == 2
    assert f"'Anna'. Valid ones: {tokens.records(robot.data)[0].id} (Ana)." in unknown.stderr


def test_a_revocation_counts_within_two_seconds() -> None:
    assert 2 * tokens.CHECK_INTERVAL_S <= 2.0


def test_the_list_is_a_table_for_people(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--data-dir", str(robot.data), "token", "list"]
    assert main(arguments) == 0
    assert "no login tokens yet" in capsys.readouterr().out
    robot.token("Ana with a long name", Role.SUPERVISOR)
    robot.token("Ben", Role.VIEWER, -1)
    assert main(arguments) == 0
    header, ana, ben = capsys.readouterr().out.splitlines()
    assert header.split() == ["ID", "NAME", "ROLE", "CREATED", "EXPIRES", "STATE"]
    assert ana.endswith("valid")
    assert ben.endswith("expired")
    assert header.index("ROLE") == ana.index("supervisor") == ben.index("viewer")


@pytest.mark.parametrize(("text", "seconds"), [("1m", 60), ("30m", 1800), ("12h", 43200), ("7d", 604800)])
def test_a_lifetime_is_minutes_hours_or_days(text: str, seconds: float) -> None:
    assert lifetime(text) == seconds


def test_a_date_counts_to_its_end_here() -> None:
    year = datetime.now().year + 1
    end = datetime(year, 2, 1).timestamp()
    before = time.time()
    seconds = lifetime(f"{year}-01-31")
    assert before + seconds - 2 <= end <= time.time() + seconds + 2


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "neither"),
        ("7", "neither"),
        ("7w", "neither"),
        ("-7d", "neither"),
        ("1.5h", "neither"),
        ("soon", "neither"),
        ("٧d", "neither"),
        ("2027-13-01", "neither"),
        ("0m", "over already"),
        ("2020-01-01", "over already"),
        ("999999999d", "ten years"),
        ("9999-12-31", "ten years"),
    ],
)
def test_a_lifetime_that_is_none_is_refused_with_a_sentence_and_makes_no_token(
    robot: Robot, capsys: pytest.CaptureFixture[str], text: str, problem: str
) -> None:
    create = ["--data-dir", str(robot.data), "token", "create", "--name", "Ana", "--role", "viewer"]
    with pytest.raises(SystemExit) as refusal:
        main([*create, f"--expires={text}"])
    assert refusal.value.code == 2
    said = capsys.readouterr()
    assert f"argument --expires: {text!r} is" in said.err
    assert problem in said.err
    assert said.out == ""
    assert tokens.records(robot.data) == []


@pytest.mark.parametrize("name", ["", "  ", "Ana\nBen", "\x1b[2J", "x" * 61])
def test_a_name_that_would_garble_the_list_is_refused(robot: Robot, name: str) -> None:
    with pytest.raises(SystemExit):
        main(["--data-dir", str(robot.data), "token", "create", "--role", "viewer", "--name", name])
    assert tokens.records(robot.data) == []


def test_the_file_is_its_owners_alone_and_holds_no_token(robot: Robot) -> None:
    made = [robot.token("Ana", Role.OPERATOR), robot.token("Ben", Role.VIEWER)]
    tokens.revoke(robot.data, "Ben")
    file = robot.data / tokens.REGISTRY
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    content = file.read_text()
    for token in made:
        for part in token.split("."):
            assert part not in content
    assert {path.name for path in robot.data.iterdir()} == {tokens.REGISTRY, identity.SIGNING_KEY}


def test_a_genuine_token_that_is_not_in_the_list_is_refused(robot: Robot) -> None:
    robot.token("Ana", Role.VIEWER)
    key = identity.shared_secret(robot.data, identity.SIGNING_KEY)
    with pytest.raises(InvalidToken, match="not known to this robot"):
        Registry(robot.data).verify(identity.issue(key, "Eve", Role.SUPERVISOR, 60))


def test_what_expired_long_ago_is_forgotten(robot: Robot) -> None:
    robot.token("Old", Role.VIEWER, -40 * 86400)
    robot.token("Ana", Role.VIEWER)
    assert [record.name for record in tokens.records(robot.data)] == ["Ana"]


def _make_and_revoke(data: Path, name: str) -> None:
    for _ in range(10):
        tokens.create(data, name, Role.VIEWER, 60, same_person=True)
        tokens.create(data, f"{name} stays", Role.VIEWER, 60, same_person=True)
        tokens.revoke(data, name)


@pytest.mark.processes
def test_processes_that_write_at_once_lose_nothing(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    names = ["a", "b", "c", "d"]
    writers = [context.Process(target=_make_and_revoke, args=(tmp_path, name)) for name in names]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        tokens.records(tmp_path)  # a reader never sees half of it: this raises where it does
    assert [writer.exitcode for writer in writers] == [0, 0, 0, 0]
    known = tokens.records(tmp_path)
    assert len(known) == len({record.id for record in known}) == 80
    for name in names:
        assert {record.state for record in known if record.name == name} == {"revoked"}
        assert {record.state for record in known if record.name == f"{name} stays"} == {"valid"}


def break_list(data: Path, how: str) -> None:
    file = data / tokens.REGISTRY
    if how == "deleted":
        file.unlink()
    elif how == "a folder":
        file.unlink()
        file.mkdir()
    else:
        file.write_bytes({"empty": b"", "cut off": file.read_bytes()[:-20], "another shape": b"{}"}[how])


BREAKAGES = ["deleted", "a folder", "empty", "cut off", "another shape"]


@pytest.mark.parametrize("how", BREAKAGES)
def test_while_the_list_cannot_be_read_nobody_is_let_in_but_people_may_stop_the_robot(
    robot: Robot, caplog: pytest.LogCaptureFixture, how: str
) -> None:
    ana, ben = robot.token("Ana", Role.OPERATOR), robot.token("Ben", Role.OPERATOR)
    tokens.revoke(robot.data, "Ben")
    registry = Registry(robot.data)
    inside = registry.verify(ana)
    good = (robot.data / tokens.REGISTRY).read_bytes()

    break_list(robot.data, how)
    for knowing in (registry, Registry(robot.data)):  # one that read the list before, and one that starts now
        for _ in range(3):
            with pytest.raises(RegistryError, match="Nobody can log in now"):
                knowing.verify(ana)
        assert knowing.verify(ana, to_stop=True).name == "Ana"
        with pytest.raises(InvalidToken):
            knowing.verify("forged", to_stop=True)
    with pytest.raises(InvalidToken, match="revoked"):
        registry.verify(ben, to_stop=True)
    assert registry.ended(inside) is None  # whoever is in stays
    told = [record.getMessage() for record in caplog.records if record.name == "backend.tokens"]
    assert len(told) == 2  # once for each of the two, however often somebody asks
    assert all("nobody can log in" in line and "`robot-acp token create`" in line for line in told)

    if how == "a folder":
        (robot.data / tokens.REGISTRY).rmdir()
    (robot.data / tokens.REGISTRY).write_bytes(good)
    assert registry.verify(ana).name == "Ana"


@pytest.mark.parametrize("how", [how for how in BREAKAGES if how != "deleted"])
def test_a_list_that_cannot_be_read_is_never_overwritten(robot: Robot, how: str) -> None:
    robot.token("Ana", Role.VIEWER)
    break_list(robot.data, how)
    for attempt in (["create", "--name", "Ben", "--role", "viewer"], ["revoke", "Ana"], ["list"]):
        refused = command(robot, *attempt)
        assert (refused.returncode, refused.stdout) == (2, "")
        assert "cannot be read" in refused.stderr
        assert "Traceback" not in refused.stderr


def test_deleting_the_list_lets_nobody_back_in(robot: Robot) -> None:
    ana, ben = robot.token("Ana", Role.VIEWER), robot.token("Ben", Role.VIEWER)
    tokens.revoke(robot.data, "Ben")
    registry = Registry(robot.data)
    inside = registry.verify(ana)
    (robot.data / tokens.REGISTRY).unlink()
    new = robot.token("Ana", Role.VIEWER)
    for old in (ana, ben):
        with pytest.raises(InvalidToken):
            registry.verify(old)
    assert registry.ended(inside) is not None
    assert registry.verify(new).name == "Ana"


def test_a_writer_that_died_in_the_middle_leaves_the_list_as_it_was(robot: Robot) -> None:
    robot.token("Ana", Role.VIEWER)
    (robot.data / f".{tokens.REGISTRY}.{os.getpid()}").write_bytes(b"[{")
    robot.token("Ben", Role.VIEWER)
    assert [record.name for record in tokens.records(robot.data)] == ["Ana", "Ben"]


@pytest.mark.processes
def test_up_makes_a_code_and_no_token_however_often_it_is_started(robot: Robot) -> None:
    for number in (1, 2):
        up = robot.start("up", stdout=subprocess.PIPE)
        try:
            assert up.stdout is not None
            code = next(line.partition("#token=")[2].strip() for line in up.stdout if "#token=" in line)
        finally:
            end(up)
        assert listed(robot) == []
        assert len(tokens.records(robot.data)) == number
        record = Registry(robot.data).find_code(logins.digest(code))
        assert record is not None
        assert (record.kind, record.name, record.role) == ("code", "supervisor", Role.SUPERVISOR)
        assert record.expires - record.created <= 15 * 60
        assert code not in (robot.data / tokens.REGISTRY).read_text()


def test_the_login_command_prints_an_address_with_a_new_code(robot: Robot) -> None:
    said = subprocess.run(
        robot.command("login"), env=robot.variables, text=True, capture_output=True, timeout=PATIENCE_S
    )
    first, url = said.stdout.split("\n\n")[:2]
    assert first == "Open this address in a browser within 15 minutes. It works once:"
    address, code = url.strip().split("/#token=")
    assert address == f"http://127.0.0.1:{robot.bridge_port}"
    who, _ = logins.by_code(robot.data, code)
    assert (who.name, who.role) == ("supervisor", Role.SUPERVISOR)


def test_the_list_shows_logins_and_codes_only_when_asked(robot: Robot) -> None:
    who = Registry(robot.data).verify(robot.token("Ana", Role.OPERATOR))
    logins.by_token(robot.data, who)
    logins.new_code(robot.data)
    assert [about["name"] for about in listed(robot)] == ["Ana"]
    all_of_them = json.loads(command(robot, "list", "--json", "--logins").stdout)
    shown = [(about["name"], about["kind"], about["parent"]) for about in all_of_them]
    assert shown == [("Ana", "token", ""), ("Ana", "login", who.token_id), ("supervisor", "code", "")]
    header, *rows = command(robot, "list", "--logins").stdout.splitlines()
    assert header.split()[-2:] == ["KIND", "PARENT"]
    assert len(rows) == 3
    assert "code" not in command(robot, "list").stdout


def test_a_login_that_was_made_with_a_code_is_listed_and_can_be_revoked(robot: Robot) -> None:
    who, cookie = logins.by_code(robot.data, logins.new_code(robot.data))
    (about,) = listed(robot)
    assert (about["id"], about["name"], about["state"]) == (who.token_id, "supervisor", "valid")
    assert command(robot, "revoke", "supervisor").stdout == f"Revoked {who.token_id} of supervisor (supervisor).\n"
    with pytest.raises(InvalidToken):
        Registry(robot.data).verify(cookie)


def test_what_follows_from_a_token_ends_with_it_and_is_not_counted(robot: Robot) -> None:
    ana = Registry(robot.data).verify(robot.token("Ana", Role.OPERATOR))
    cookies = [logins.by_token(robot.data, ana)[1] for _ in range(3)]
    said = command(robot, "revoke", "Ana").stdout
    assert said == f"Revoked {ana.token_id} of Ana (operator).\n"
    for cookie in cookies:
        with pytest.raises(InvalidToken, match="was revoked"):
            Registry(robot.data).verify(cookie)
    with pytest.raises(InvalidToken):
        logins.by_token(robot.data, ana)


def test_few_codes_are_valid_at_once_and_the_newest_is_among_them(robot: Robot) -> None:
    codes = [logins.new_code(robot.data) for _ in range(2 * logins.MOST + 3)]
    known = tokens.records(robot.data)
    assert [one.state for one in known] == ["revoked"] * logins.MOST + ["valid"] * logins.MOST
    with pytest.raises(InvalidToken):
        logins.by_code(robot.data, codes[0])
    assert logins.by_code(robot.data, codes[-1])[0].name == "supervisor"


def test_a_new_key_at_once_ends_codes_and_logins_too(robot: Robot) -> None:
    ana = Registry(robot.data).verify(robot.token("Ana", Role.OPERATOR))
    logins.by_token(robot.data, ana)
    code = logins.new_code(robot.data)
    assert tokens.rotate_key(robot.data, time.time()) == 1
    with pytest.raises(InvalidToken):
        logins.by_code(robot.data, code)
    assert {one.state for one in tokens.records(robot.data)} == {"revoked"}


@pytest.mark.processes
async def test_the_revoke_command_ends_a_login_in_use_in_every_process(robot: Robot) -> None:
    token = robot.token("Ana", Role.SUPERVISOR)
    with robot.running("agent", port=robot.agent_port), robot.running("bridge", port=robot.bridge_port):
        web = await Client.open(f"ws://127.0.0.1:{robot.bridge_port}/acp", token)
        direct = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await direct.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})
        assert (await asyncio.to_thread(command, robot, "revoke", "Ana")).returncode == 0
        async with asyncio.timeout(PATIENCE_S):
            assert await web.link.closed == "Your login was revoked. Ask for a new one."
            await direct.link.closed
        with pytest.raises(LinkError, match="did not accept this login"):
            await Client.open(f"ws://127.0.0.1:{robot.bridge_port}/acp", token)
        for client in (web, direct):
            await client.close()


@pytest.mark.processes
async def test_a_logout_at_the_bridge_ends_the_login_in_the_agent_too(robot: Robot) -> None:
    token = robot.token("Ana", Role.SUPERVISOR)
    with robot.running("agent", port=robot.agent_port), robot.running("bridge", port=robot.bridge_port):
        base = f"http://127.0.0.1:{robot.bridge_port}"
        async with httpx.AsyncClient(base_url=base, trust_env=False, timeout=PATIENCE_S) as http:
            cookie = (await http.post("/api/login", json={"token": token})).cookies["robot_acp"]
            direct = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
            await direct.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": cookie}})
            await direct.new()
            assert (await http.post("/api/logout", headers={"Origin": base})).status_code == 204
            async with asyncio.timeout(PATIENCE_S):
                await direct.link.closed
            await direct.close()
        late = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        with pytest.raises(RefusedError, match="This login has ended"):
            await late.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": cookie}})
        await late.close()
