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
    assert str(entry["by"]).startswith("a␊␛[2J⟨U+202E⟩xxx")
    assert len(str(entry["by"])) < 400
    assert entry["reason"] == "b␊c"


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
