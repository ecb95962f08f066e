"""The stop latch: once set, nothing moves until a person releases it, not even after a restart.

The latch is kept in one small file of the data folder. A file that cannot be read counts as a stop: in doubt the robot
stands still. It is no certified safety function. Releasing it never restarts a motion.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec

from backend.telemetry import Stop

FILE = "stop.json"
MAX_NAME = 80
NOBODY = "someone"
"""The name in a stop that came without one."""

logger = logging.getLogger(__name__)


class StopLatch:
    """The latch and its file. `stop` says who set it and when; None while it is released."""

    def __init__(self, data_dir: Path) -> None:
        self._file = data_dir / FILE
        self.stop: Stop | None = self._read()

    def _read(self) -> Stop | None:
        try:
            return msgspec.json.decode(self._file.read_bytes(), type=Stop)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError) as error:
            logger.error("The stop file cannot be read (%s): the robot stays stopped until it is released.", error)
            return Stop(by="an unreadable stop file", at=0.0)

    def set(self, by: str, at: float) -> Stop:
        """Set the latch, at `at` in Unix seconds. A second press changes neither the name nor the time of the first."""
        if self.stop is None:
            self.stop = Stop(by, at)
            self._write(self.stop)
        return self.stop

    def name(self, stop: Stop, by: str) -> Stop:
        """Name the person who set `stop`, if nobody is named yet and it has not been released; returns the stop with
        its name."""
        if stop.by == NOBODY and by != NOBODY:
            stop = Stop(by, stop.at)
            if self.stop is not None and (self.stop.by, self.stop.at) == (NOBODY, stop.at):
                self.stop = stop
                self._write(stop)
        return stop

    def release(self) -> None:
        """Release the latch. Raises `OSError`, and stays set, when its file cannot be removed, which a restart would
        find."""
        self._file.unlink(missing_ok=True)
        self.stop = None

    def _write(self, stop: Stop) -> None:
        # The robot is stopped already, whatever happens here; a full disk only costs the memory of it.
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            draft = self._file.with_suffix(".draft")
            with draft.open("wb") as file:
                file.write(msgspec.json.encode(stop))
                file.flush()
                os.fsync(file.fileno())
            draft.replace(self._file)
        except OSError as error:
            logger.error("The stop could not be written down, a restart would forget it: %s", error)


def name_of(by: str | None) -> str:
    """The name of the person who pressed, as one printable line. A stop without a usable name is still a stop."""
    name = " ".join(by.split())[:MAX_NAME] if by else ""
    return "".join(c for c in name if c.isprintable()) or NOBODY
