"""The audit log: every event of several processes, in few files that only their owner can read."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from backend import audit
from backend.audit import Audit
from backend.identity import Identity, Role
from tests.processes import wait_until

ANA = Identity("Ana", Role.OPERATOR, "t1", 2e9)


def test_an_event_says_who_did_what_where_and_when(tmp_path: Path) -> None:
    log = Audit(tmp_path, "agent")
    log.record("permission", ANA, tool="speak", answer="allow_once")
    log.record("stop", "Ben")
    log.record("login_refused", None, address="192.0.2.7", reason="revoked")
    log.close()
    first, second, third = audit.entries(tmp_path)
    assert first | {"time": 0} == {
        "time": 0, "process": "agent", "event": "permission", "by": "Ana", "role": "operator", "token": "t1",
        "tool": "speak", "answer": "allow_once",
    }  # fmt: skip
    assert (second["event"], second["by"]) == ("stop", "Ben")
    assert "by" not in third
    assert list(audit.entries(tmp_path, since=float(str(first["time"])) + 3600)) == []


def test_only_its_owner_can_read_it_and_no_link_leads_out(tmp_path: Path) -> None:
    log = Audit(tmp_path, "agent")
    log.record("stop", ANA)
    log.close()
    assert stat.S_IMODE((tmp_path / audit.FILE).stat().st_mode) == 0o600
    (tmp_path / audit.FILE).unlink()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.touch()
    (tmp_path / audit.FILE).symlink_to(elsewhere)
    log.record("stop", ANA)
    log.close()
    assert elsewhere.read_bytes() == b""


def test_a_text_of_a_stranger_is_one_short_readable_line(tmp_path: Path) -> None:
    log = Audit(tmp_path, "bridge")
    log.record("login_refused", "a\n\x1b[2J\u202e" + "x" * 10_000, reason="b\nc")
    log.close()
    (entry,) = audit.entries(tmp_path)
    assert str(entry["by"]).startswith("a↵‹U+001B›[2J‹U+202E›xxx")
    assert len(str(entry["by"])) < 400
    assert entry["reason"] == "b↵c"


def test_old_files_are_removed_and_the_newest_events_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audit, "MAX_FILE_BYTES", 1_000)
    for number in range(200):
        log = Audit(tmp_path, "agent")
        log.record("stop", ANA, number=number)
        log.close()
    files = sorted(path.name for path in tmp_path.iterdir())
    assert files == ["audit.jsonl", *(f"audit.jsonl.{number}" for number in range(1, audit.KEPT_FILES))]
    assert all((tmp_path / name).stat().st_size <= 1_000 for name in files)
    numbers = [int(str(entry["number"])) for entry in audit.entries(tmp_path)]
    assert numbers == list(range(numbers[0], 200))


WRITER = """
import sys; from pathlib import Path; from backend import audit
audit.MAX_FILE_BYTES = 20_000; audit.KEPT_FILES = 50; audit.PER_MINUTE = 1_000
log = audit.Audit(Path(sys.argv[1]), sys.argv[2])
for number in range(300): log.record("stop", number=number)
log.close()
"""


def test_processes_that_write_at_once_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audit, "KEPT_FILES", 50)
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, tmp_path, name]) for name in ("agent", "bridge", "robot")
    ]
    assert [writer.wait(60) for writer in writers] == [0, 0, 0]
    seen: dict[object, list[object]] = {}
    for entry in audit.entries(tmp_path):
        seen.setdefault(entry["process"], []).append(entry["number"])
    assert seen == {name: list(range(300)) for name in ("agent", "bridge", "robot")}


def test_a_log_that_cannot_be_written_stops_nobody(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    log = Audit(tmp_path / "gone", "agent")
    for _ in range(3):
        log.record("stop", ANA)
    log.close()
    assert [record.levelname for record in caplog.records][:1] == ["ERROR"]
    os.makedirs(tmp_path / "gone")
    log.record("release", ANA)
    log.close()
    assert [entry["event"] for entry in audit.entries(tmp_path / "gone")] == ["release"]


def test_a_flood_of_one_person_is_counted_and_hides_nobody_else(tmp_path: Path) -> None:
    log = Audit(tmp_path, "agent")
    for _ in range(5_000):
        log.record("login_refused", None, reason="wrong")
        log.record("stop", ANA)
    log.record("stop", "Ben")
    log.close()
    found = list(audit.entries(tmp_path))
    listed = [(entry["event"], entry.get("by")) for entry in found if "more" not in entry]
    counts = {(entry["event"], entry.get("by")): entry["more"] for entry in found if "more" in entry}
    refused, stops = listed.count(("login_refused", None)), listed.count(("stop", "Ana"))
    assert audit.PER_MINUTE <= refused < 2 * audit.PER_MINUTE
    assert audit.AT_ONCE <= stops < audit.AT_ONCE + audit.PER_MINUTE
    assert counts == {("login_refused", None): 5_000 - refused, ("stop", "Ana"): 5_000 - stops}
    assert ("stop", "Ben") in listed


def test_a_flood_that_has_ended_is_counted_without_a_further_event(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit, "COUNT_EVERY_S", 0.05)
    log = Audit(tmp_path, "agent")
    for _ in range(100):
        log.record("login_refused", None)
    wait_until(lambda: sum(int(str(entry.get("more", 1))) for entry in audit.entries(tmp_path)) == 100, "the count")
    log.close()


def test_many_names_take_little_memory(tmp_path: Path) -> None:
    repeated = audit._Repeated()
    for number in range(3 * audit.MAX_PEOPLE):
        for _ in range(audit.AT_ONCE + 1):
            repeated.admit(("stop", f"name {number}"), 0.0)
    assert len(repeated._rates) == audit.MAX_PEOPLE
    counts = repeated.take_counts()
    assert len(counts) == audit.MAX_PEOPLE + 1
    assert sum(counts.values()) == 3 * audit.MAX_PEOPLE


def test_a_machine_without_room_for_a_thread_does_not_stop_the_caller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(_: object) -> None:
        raise RuntimeError("can't start new thread")

    log = Audit(tmp_path, "robot")
    with monkeypatch.context() as exhausted:
        exhausted.setattr("threading.Thread.start", no_room)
        log.record("stop", "Ana")
    log.record("stop", "Ben")
    log.close()
    assert [(e["event"], e.get("by"), e.get("more")) for e in audit.entries(tmp_path)] == [
        ("stop", "Ben", None), ("lost", None, 1),
    ]  # fmt: skip


@pytest.mark.parametrize("line", [b"", b"{", b"[]", b"1", b'{"time": "x"}', b'{"time": [1]}', b"{}", b"\xff\xfe"])
def test_a_line_that_is_no_event_is_left_out(tmp_path: Path, line: bytes) -> None:
    (tmp_path / audit.FILE).write_bytes(line + b'\n{"time": 2.0, "event": "stop"}\n' + line)
    assert list(audit.entries(tmp_path)) == [{"time": 2.0, "event": "stop"}]
