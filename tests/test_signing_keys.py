"""A new signing key: tokens of the old one are accepted for a stated time, or not at all, and nothing is restarted."""

from __future__ import annotations

import stat
import time
from collections.abc import Iterator
from pathlib import Path

import jwt
import pytest

from backend import identity, private_files, signing_keys, tokens
from backend.chat.link import LinkError, RefusedError
from backend.cli import main
from backend.identity import InvalidToken, Role
from backend.private_files import UnsafeFile
from backend.tokens import Registry, RegistryError
from tests.processes import Client, Robot


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path / "data")


def rotate(robot: Robot, *arguments: str) -> int:
    return main(["--data-dir", str(robot.data), "key", "rotate", *arguments])


def test_a_token_names_its_key_and_not_the_key_itself(robot: Robot) -> None:
    token = robot.token("Ana", Role.VIEWER)
    key = identity.shared_secret(robot.data, identity.SIGNING_KEY)
    kid = jwt.get_unverified_header(token)["kid"]
    assert kid == identity.key_id(key)
    assert kid.encode() not in key


def test_old_tokens_are_accepted_until_the_stated_time(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    registry = Registry(robot.data)
    week, hour = robot.token("Ana", Role.VIEWER, 7 * 86400), robot.token("Ben", Role.VIEWER, 3600)
    assert rotate(robot, "--old-until", "2h") == 0
    new = robot.token("Cleo", Role.VIEWER, 7 * 86400)
    assert len({jwt.get_unverified_header(token)["kid"] for token in (week, hour, new)}) == 2
    now = time.time()
    assert now + 7190 < (registry.verify(week).expires or 0) <= now + 7200
    assert now + 3590 < (registry.verify(hour).expires or 0) <= now + 3600  # none is longer than it was
    inside = registry.verify(week)
    later = time.time() + 7300
    monkeypatch.setattr(time, "time", lambda: later)
    for reader in (registry, Registry(robot.data)):
        with pytest.raises(InvalidToken, match="signed with a key that is accepted no longer"):
            reader.verify(week)
        assert reader.verify(new).name == "Cleo"
    assert registry.ended(inside) == "Your login has expired. Log in again."


def test_with_now_every_old_token_is_refused_at_once(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    registry = Registry(robot.data)
    old = robot.token("Ana", Role.SUPERVISOR)
    inside = registry.verify(old)
    capsys.readouterr()
    assert rotate(robot, "--old-until", "now") == 0
    assert "Tokens that are revoked now: 1." in capsys.readouterr().out
    with pytest.raises(InvalidToken, match="accepted no longer"):
        registry.verify(old)
    with pytest.raises(InvalidToken, match="accepted no longer"):
        registry.verify(old, to_stop=True)
    assert registry.ended(inside) == "Your login was revoked. Ask for a new one."
    assert [record.state for record in tokens.records(robot.data)] == ["revoked"]


def test_a_second_rotation_gives_no_key_more_time(robot: Robot) -> None:
    token = robot.token("Ana", Role.VIEWER, 7 * 86400)
    for until in ("1d", "2h", "5d"):
        assert rotate(robot, "--old-until", until) == 0
    first, *others = signing_keys.read_retired(robot.data)
    assert first.until <= time.time() + 7200
    assert len(others) == 2
    assert (Registry(robot.data).verify(token).expires or 0) <= time.time() + 7200


def test_a_token_from_before_keys_had_names_is_accepted_with_its_key(robot: Robot) -> None:
    robot.token("Ana", Role.VIEWER)
    (record,) = tokens.records(robot.data)
    key = identity.shared_secret(robot.data, identity.SIGNING_KEY)
    claims = {"aud": "robot-acp", "sub": "Ana", "role": "viewer", "jti": record.id, "exp": int(time.time()) + 60}
    old, foreign = (jwt.encode(claims, signer, algorithm="HS256") for signer in (key, b"x" * 64))
    rotate(robot, "--old-until", "1h")
    assert Registry(robot.data).verify(old).name == "Ana"
    with pytest.raises(InvalidToken, match="not valid for this robot"):
        Registry(robot.data).verify(foreign)
    rotate(robot, "--old-until", "now")
    with pytest.raises(InvalidToken):
        Registry(robot.data).verify(old)


def test_the_old_keys_are_as_protected_as_the_key(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    token = robot.token("Ana", Role.VIEWER)
    rotate(robot)
    retired = robot.data / signing_keys.RETIRED
    assert {stat.S_IMODE(path.stat().st_mode) for path in robot.data.iterdir()} == {0o600}
    registry = Registry(robot.data)
    retired.chmod(0o640)
    with pytest.raises(UnsafeFile, match="chmod 600"):
        Registry(robot.data)
    with pytest.raises(RegistryError, match="Nobody can log in now"):
        registry.verify(token)  # a process that has read it before
    assert registry.verify(token, to_stop=True).name == "Ana"
    retired.chmod(0o600)
    assert registry.verify(token).name == "Ana"
    retired.write_bytes(b"[]x")
    with pytest.raises(UnsafeFile, match="Delete it"):
        Registry(robot.data)


def test_a_crash_in_the_middle_leaves_both_keys_valid(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    token = robot.token("Ana", Role.VIEWER)
    write, written = private_files.write, []

    def crash(path: Path, content: bytes) -> None:
        if written:
            raise OSError(28, "No space left on device")
        written.append(path)
        write(path, content)

    monkeypatch.setattr(private_files, "write", crash)
    with pytest.raises(RegistryError, match="No space left on device"):
        tokens.rotate_key(robot.data, time.time() + 3600)
    monkeypatch.undo()
    assert Registry(robot.data).verify(token).name == "Ana"


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Robot]:
    robot = Robot(tmp_path / "data")
    with robot.running("agent", port=robot.agent_port), robot.running("bridge", port=robot.bridge_port):
        yield robot


@pytest.mark.processes
async def test_running_processes_take_the_new_key_and_let_go_of_the_old_one(running: Robot) -> None:
    web = f"ws://127.0.0.1:{running.bridge_port}/acp"
    old = running.token("Ana", Role.SUPERVISOR)
    client = await Client.open(web, old)
    rotate(running, "--old-until", "1h")
    kept, new = await Client.open(web, old), await Client.open(web, running.token("Ben", Role.VIEWER))
    rotate(running, "--old-until", "now")
    for open_one in (client, kept, new):
        assert await open_one.link.closed == "Your login was revoked. Ask for a new one."
        await open_one.close()
    with pytest.raises((LinkError, RefusedError)):
        await Client.open(web, old)
    newest = await Client.open(web, running.token("Cleo", Role.VIEWER))
    await newest.close()
