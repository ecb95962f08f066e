"""The limit of open files and sockets of this process. A system without such a limit is no error.

Many systems set it to 1,024 and allow more. 1,024 are enough for about 70 pages; a process without free descriptors
answers no request, not even Stop.
"""

from __future__ import annotations

import logging

_ENOUGH = 65_536
"""The limit is raised no further: some systems allow 10^9, and a child process may close each of them in a loop."""

log = logging.getLogger(__name__)


def raise_limit(needed: int) -> int:
    """Raise the limit as far as the system allows, and return it. A limit below `needed` is logged as a warning."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return max(needed, _ENOUGH)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    soft, hard = (_ENOUGH if limit == resource.RLIM_INFINITY else limit for limit in limits)
    target = min(hard, _ENOUGH)
    if soft < target:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (target, limits[1]))
            soft = target
        except (OSError, ValueError) as error:  # macOS may allow less than it reports
            log.warning("the limit of open files cannot be raised: %s", error)
    if soft < needed:
        log.warning(
            "this process may open %d files and connections at once, and %d would be enough for all that the settings "
            "allow: raise its hard limit (`ulimit -Hn`, or LimitNOFILE of systemd)",
            soft,
            needed,
        )
    return soft
