"""How long a token is valid, as people write it: `30m`, `12h`, `7d`, or a date."""

from __future__ import annotations

import re
import time
from datetime import date, datetime

LONGEST_S = 3650 * 86400.0
_UNIT_S = {"m": 60, "h": 3600, "d": 86400}


def lifetime(text: str) -> float:
    """The seconds that `30m`, `12h` or `7d` means, or those until the end of a date such as `2027-01-31` (local time).

    Raises `ValueError` with a sentence for the person who wrote it.
    """
    if match := re.fullmatch(r"([0-9]{1,9})([mhd])", text):
        seconds = float(match[1]) * _UNIT_S[match[2]]
    else:
        try:
            last_second = datetime.combine(date.fromisoformat(text), datetime.max.time()).replace(microsecond=0)
            seconds = last_second.timestamp() - time.time()
        except (ValueError, OverflowError):
            raise ValueError(
                f"{text!r} is neither a time such as 30m, 12h or 7d, nor a date such as 2027-01-31"
            ) from None
    if seconds <= 0:
        raise ValueError(f"{text!r} is over already")
    if seconds > LONGEST_S:
        raise ValueError(f"{text!r} is too long: a token is valid for ten years at most")
    return seconds
