"""The keys that sign login tokens: the current one, and those before it that are accepted for a while.

`signing.key` is the current key; `retired.keys` has the others, each with the time until which it is accepted. Both are
secrets. No file but `tokens` may have them changed.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from backend import identity, private_files
from backend.private_files import UnsafeFile

RETIRED = "retired.keys"


class Retired(msgspec.Struct, frozen=True):
    """A key that signs no more, accepted until a time in Unix seconds."""

    key: bytes
    until: float


class KeyRing:
    """The keys of a data folder, as they were read last. `current` signs. Making one makes the current key, where there
    is none. Raises `UnsafeFile`, `OSError`."""

    def __init__(self, data_dir: Path) -> None:
        self._data_dir = data_dir
        self.current = identity.shared_secret(data_dir, identity.SIGNING_KEY)
        self._retired: Sequence[Retired] = read_retired(data_dir)
        self._version = self._files()

    def reload(self) -> None:
        """Read the keys again if a file has changed. Raises `UnsafeFile`, `OSError`; the keys read before remain."""
        version = self._files()
        if version != self._version:
            current = identity.read_secret(self._data_dir / identity.SIGNING_KEY)
            self.current, self._retired = current, read_retired(self._data_dir)
            self._version = version

    def accepted(self) -> list[bytes]:
        """The keys whose tokens are accepted now, the current one first."""
        now = time.time()
        return [self.current, *(one.key for one in self._retired if now < one.until)]

    def _files(self) -> list[tuple[int, ...]]:
        versions: list[tuple[int, ...]] = []
        for name in (identity.SIGNING_KEY, RETIRED):
            try:
                status = (self._data_dir / name).stat()
                versions.append((status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode, status.st_uid))
            except FileNotFoundError:
                versions.append(())
        return versions


def read_retired(data_dir: Path) -> list[Retired]:
    """The keys before the current one. Raises `UnsafeFile`, `OSError`."""
    path = data_dir / RETIRED
    try:
        return msgspec.json.decode(private_files.read(path), type=list[Retired])
    except FileNotFoundError:
        return []
    except (msgspec.DecodeError, UnicodeDecodeError):
        raise UnsafeFile(
            f"The old keys in {path} cannot be read. Delete it: then only tokens of the current key are accepted."
        ) from None


def rotate(data_dir: Path, until: float) -> None:
    """Make a new current key; tokens of the one before are accepted until `until`, in Unix seconds.

    The caller has the lock of the data folder. After a crash in between, both keys are accepted. Raises `OSError`,
    `UnsafeFile`.
    """
    current = identity.shared_secret(data_dir, identity.SIGNING_KEY)
    now = time.time()
    old = [Retired(one.key, min(one.until, until)) for one in read_retired(data_dir)]
    kept = [one for one in (*old, Retired(current, until)) if now < one.until]
    private_files.write(data_dir / RETIRED, msgspec.json.encode(kept))
    private_files.write(data_dir / identity.SIGNING_KEY, identity.new_secret())
