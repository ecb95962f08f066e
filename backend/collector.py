"""Short pauses of the garbage collector in a server.

A full collection looks at every object: the modules alone are hundreds of thousands, which took 50 to 130 ms, several
times a minute under load. Nothing else runs meanwhile, no cancel and no halt. So what a server consists of once it has
started is left out of later collections.
"""

from __future__ import annotations

import gc


def spare_program() -> None:
    """Leave every object that exists now out of later collections. A server calls it once it has started."""
    gc.freeze()
