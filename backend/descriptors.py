"""How many files and sockets this process may have open. Nothing here fails for what a system does not have.

Many systems begin with 1,024, however many they allow: enough for some 100 pages, and whoever is let in after that
finds no answer, on Stop either.
"""

from __future__ import annotations

import logging

_MOST = 65_536
"""Never asked for more: some systems allow a thousand millions, and programs that we start may walk through them."""

log = logging.getLogger(__name__)


def raise_limit(needed: int) -> int:
    """Raise the limit as far as the system lets us, say so when it stays below `needed`, and return what it is now."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return max(needed, _MOST)
    told = resource.getrlimit(resource.RLIMIT_NOFILE)
    soft, hard = (_MOST if limit == resource.RLIM_INFINITY else limit for limit in told)
    target = min(hard, _MOST)
    if soft < target:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (target, told[1]))
            soft = target
        except (OSError, ValueError) as error:  # macOS may allow less than it says
            log.warning("the limit of open files cannot be raised: %s", error)
    if soft < needed:
        log.warning(
            "this process may open %d files and connections at once, and %d would be enough for all that the settings "
            "allow: raise its hard limit (`ulimit -Hn`, or LimitNOFILE of systemd)",
            soft,
            needed,
        )
    return soft
