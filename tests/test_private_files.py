"""Keys, the list of tokens, the stop and the session log belong to one user of the machine, and survive a crash."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

import pytest

from backend import identity, private_files, tokens
from backend.agent.sessions.store import Store
from backend.cli import main
from backend.identity import Role
from backend.mcp_robot.http.access import Access
from backend.mcp_robot.motion.stop import StopLatch
from backend.private_files import UnsafeFile
from backend.tokens import Registry, RegistryError
from tests.processes import Robot

KEYS = [identity.SIGNING_KEY, identity.ROBOT_TOKEN]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = tmp_path / "data"
    for name in KEYS:
        identity.shared_secret(folder, name)
    return folder


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def modes_in(folder: Path) -> dict[str, int]:
    return {path.name: mode_of(path) for path in folder.iterdir()}


@pytest.mark.parametrize("name", KEYS)
@pytest.mark.parametrize("size", [0, 1, 31])
def test_a_key_that_can_be_guessed_is_refused_with_what_to_do(data: Path, name: str, size: int) -> None:
    (data / name).write_bytes(b"k" * size)
    with pytest.raises(UnsafeFile, match=rf"{name} has only {size} bytes, and 32 are needed\. Delete it"):
        identity.shared_secret(data, name)
    (data / name).unlink()
    assert len(identity.shared_secret(data, name)) >= 32


@pytest.mark.parametrize("name", KEYS)
@pytest.mark.parametrize("mode", [0o604, 0o620, 0o640, 0o644, 0o666])
def test_a_key_that_others_could_have_read_or_written_is_refused(data: Path, name: str, mode: int) -> None:
    (data / name).chmod(mode)
    with pytest.raises(UnsafeFile, match=rf"{name} is open to other users \(mode {mode:04o}\).*run `chmod 600 "):
        identity.shared_secret(data, name)
    (data / name).chmod(0o600)
    identity.shared_secret(data, name)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to another user")
def test_a_key_or_folder_of_another_user_is_refused(data: Path) -> None:
    os.chown(data / identity.SIGNING_KEY, 65534, -1)
    with pytest.raises(UnsafeFile, match=r"belongs to another user \(id 65534\)"):
        identity.shared_secret(data, identity.SIGNING_KEY)
    os.chown(data, 65534, -1)
    with pytest.raises(UnsafeFile, match=r"The data folder .* belongs to another user"):
        identity.shared_secret(data, identity.ROBOT_TOKEN)


def test_a_key_is_no_link_and_no_pipe(data: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "chosen by somebody"
    elsewhere.write_bytes(b"k" * 64)
    elsewhere.chmod(0o600)
    (data / identity.SIGNING_KEY).unlink()
    (data / identity.SIGNING_KEY).symlink_to(elsewhere)
    with pytest.raises(UnsafeFile, match="is a link"):
        identity.shared_secret(data, identity.SIGNING_KEY)
    (data / identity.ROBOT_TOKEN).unlink()
    os.mkfifo(data / identity.ROBOT_TOKEN, 0o600)
    with pytest.raises(UnsafeFile, match="is no file"):
        identity.shared_secret(data, identity.ROBOT_TOKEN)


@pytest.mark.parametrize("mode", [0o701, 0o750, 0o777, 0o1777])
def test_a_data_folder_that_others_may_enter_is_refused(data: Path, mode: int) -> None:
    data.chmod(mode)
    with pytest.raises(UnsafeFile, match=r"The data folder .* is open to other users .*run `chmod 700 "):
        identity.shared_secret(data, identity.SIGNING_KEY)
    with pytest.raises(UnsafeFile, match="chmod 700"):
        tokens.create(data, "Ana", Role.VIEWER, 60)


def test_a_new_data_folder_is_its_owners_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        tokens.create(tmp_path / "data", "Ana", Role.VIEWER, 60)
        StopLatch(tmp_path / "data").set("Ana", 1.0)
    finally:
        os.umask(before)
    assert mode_of(tmp_path / "data") == 0o700
    assert set(modes_in(tmp_path / "data").values()) == {0o600}


def test_a_list_of_tokens_that_others_may_write_lets_nobody_in(data: Path) -> None:
    token = tokens.create(data, "Ana", Role.VIEWER, 60)
    (data / tokens.REGISTRY).chmod(0o606)
    with pytest.raises(RegistryError, match="Nobody can log in now"):
        Registry(data).verify(token)
    with pytest.raises(RegistryError, match="chmod 600"):
        tokens.records(data)


@pytest.mark.parametrize("command", [["up"], ["robot"], ["agent"], ["bridge"]])
def test_a_command_says_in_one_sentence_why_it_does_not_start(
    data: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    robot = Robot(data)
    for name, value in robot.variables.items():
        monkeypatch.setenv(name, value)
    (data / identity.ROBOT_TOKEN).write_bytes(b"")
    assert main(command) == 2
    assert "robot.token has only 0 bytes" in capsys.readouterr().err.splitlines()[-1]


def test_a_robot_server_without_a_token_is_not_made() -> None:
    with pytest.raises(ValueError, match="everybody would be let in"):
        Access(lambda *_: None, b"", "127.0.0.1")  # type: ignore[arg-type,return-value]


def test_what_is_written_is_synced_before_it_has_its_name_and_its_name_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    fsync = os.fsync

    def noted(descriptor: int) -> None:
        is_folder = stat.S_ISDIR(os.fstat(descriptor).st_mode)
        names = {path.name for path in tmp_path.iterdir()}
        done.append(f"{'folder' if is_folder else 'file'}, {'named' if 'stop.json' in names else 'unnamed'}")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    StopLatch(tmp_path).set("Ana", 1.0)
    assert done == ["file, unnamed", "folder, named"]
    (tmp_path / "stop.json").unlink()
    done.clear()
    private_files.write_new(tmp_path / "stop.json", b"key")
    assert done == ["file, unnamed", "folder, named"]


def test_a_stop_follows_no_link_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir(mode=0o700)
    victim = tmp_path / "victim"
    victim.write_text("precious")
    for name in ("stop.draft", ".stop.json"):
        (tmp_path / "data" / name).symlink_to(victim)
    (tmp_path / "data" / "stop.json").symlink_to(tmp_path / "nowhere")
    StopLatch(tmp_path / "data").set("Ana", 1.0)
    assert victim.read_text() == "precious"
    assert not (tmp_path / "data" / "stop.json").is_symlink()
    assert json.loads((tmp_path / "data" / "stop.json").read_text())["by"] == "Ana"
    assert {path.name for path in (tmp_path / "data").iterdir()} == {"stop.draft", ".stop.json", "stop.json"}


def test_a_stop_is_kept_in_a_folder_that_is_open_to_others_too(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    StopLatch(tmp_path).set("Ana", 1.0)
    assert StopLatch(tmp_path).stop is not None


DATABASE = ["sessions.db", "sessions.db-agent", "sessions.db-shm", "sessions.db-wal"]


async def test_the_session_log_is_its_owners_alone_also_where_it_was_not(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'sessions.db'}"
    before = os.umask(0)
    try:
        store = Store(url)
        await store.open()
        assert modes_in(tmp_path) == dict.fromkeys(DATABASE, 0o600)
        for name in DATABASE:
            (tmp_path / name).chmod(0o644)
        reader = Store(url, writes=False)
        await reader.open()
        assert modes_in(tmp_path) == dict.fromkeys(DATABASE, 0o600) | {"sessions.db-agent": 0o644}
        await reader.close()
        await store.close()
        store = Store(url)
        await store.open()
        assert modes_in(tmp_path) == dict.fromkeys(DATABASE, 0o600)
        await store.close()
    finally:
        os.umask(before)


async def test_the_lock_of_the_session_log_empties_no_file_that_a_link_names(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "sessions.db-agent").symlink_to(victim)
    store = Store(f"sqlite:///{tmp_path / 'sessions.db'}")
    await store.open()
    await store.close()
    assert victim.read_text() == "precious"
