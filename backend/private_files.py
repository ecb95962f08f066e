"""Files of the data folder that are their owner's alone: keys, the list of tokens, the stop, the session log.

A file is written as a whole and survives a power failure once the call returns. No link is followed, and nothing here
may loosen a mode: a file or folder that others could have changed is refused with a sentence that says what to do.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from pathlib import Path
from typing import BinaryIO

FILE_MODE = 0o600
FOLDER_MODE = 0o700


class UnsafeFile(Exception):
    """A file or folder could have been read or changed by others; the text names it and says what to do."""


def make_folder(folder: Path) -> None:
    """Make a folder that only its owner may enter, with its parents, where there is none. Raises `OSError`."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True, mode=FOLDER_MODE)
    for path in missing:
        _sync_folder(path.parent)


def check_folder(folder: Path) -> None:
    """Refuse a folder that others may enter, or that belongs to somebody else. Raises `UnsafeFile`, `OSError`."""
    _check(folder, folder.stat(), "The data folder", FOLDER_MODE)


def read(path: Path) -> bytes:
    """The content of a file that nobody else could have read or changed. Raises `UnsafeFile` and `OSError`."""
    with opened(path, forbidden=0o077) as file:
        return file.read()


def opened(path: Path, *, forbidden: int = 0o022) -> BinaryIO:
    """A file that nobody else could have changed, open for reading; `forbidden` are the bits that its mode must not
    have. Raises `UnsafeFile` and `OSError`."""
    try:
        file = open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb")  # noqa: SIM115 - for the caller
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise UnsafeFile(f"{path} is a link. Put the file itself in its place.") from None
        raise
    try:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise UnsafeFile(f"{path} is no file. Remove it.")
        _check(path, status, "The file", FILE_MODE, forbidden)
    except BaseException:
        file.close()
        raise
    return file


def write(path: Path, content: bytes) -> None:
    """Write or replace a file as a whole. Its folder must exist. Raises `OSError`."""
    draft = _draft(path, content)
    try:
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    _sync_folder(path.parent)


def write_new(path: Path, content: bytes) -> bool:
    """Write a file that does not exist yet. Returns False, and changes nothing, where it does. Raises `OSError`.

    Of processes that write it at the same moment one succeeds: each links its complete draft into place.
    """
    draft = _draft(path, content)
    try:
        os.link(draft, path)
    except FileExistsError:
        return False
    finally:
        draft.unlink()
    _sync_folder(path.parent)
    return True


def restrict(path: Path) -> None:
    """Make sure that a file exists and is its owner's alone, for libraries that open it by its name. A file of another
    user stays as it is. Raises `OSError`."""
    try:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, FILE_MODE))
    except FileExistsError:
        # Not opened: closing a database that this process has open elsewhere would drop its locks.
        status = path.stat()
        if status.st_uid == os.geteuid() and stat.S_IMODE(status.st_mode) & 0o077:
            path.chmod(FILE_MODE)


def _draft(path: Path, content: bytes) -> Path:
    draft = path.with_name(f".{path.name}.{os.getpid()}.{secrets.token_hex(4)}")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, FILE_MODE)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(descriptor)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
    return draft


def _check(path: Path, status: os.stat_result, called: str, mode: int, forbidden: int = 0o077) -> None:
    if status.st_uid != os.geteuid():
        raise UnsafeFile(
            f"{called} {path} belongs to another user (id {status.st_uid}), who could change it. "
            "Run this as that user, or choose another folder with --data-dir."
        )
    if stat.S_IMODE(status.st_mode) & forbidden:
        raise UnsafeFile(
            f"{called} {path} is open to other users (mode {stat.S_IMODE(status.st_mode):04o}). If nobody but you has "
            f"used it, run `chmod {mode:o} {path}`."
        )


def _sync_folder(folder: Path) -> None:
    # Some file systems cannot sync a folder; there the name of a file is as durable as they make it.
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
