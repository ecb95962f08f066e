"""What wakes viser's pages when something was drawn, in viser's own thread alone.

viser sets this event twice for each change: at once, in whatever thread drew, which asyncio does not allow, and a
moment later in its own. The first fails now and then when many pages wait, and the rest of a drawing is lost with it.
"""

from __future__ import annotations

import asyncio

import viser


class _Wakeup(asyncio.Event):
    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._of_viser = loop

    def set(self) -> None:
        """Wake those who wait; in another thread nothing, as viser calls it again in the right one."""
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            return
        if here is self._of_viser:
            super().set()


def in_its_own_thread(server: viser.ViserServer) -> None:
    """Have a server that nobody has connected to yet wake its pages so."""
    buffer = server._websock_server.get_message_buffer()
    buffer.message_event = _Wakeup(buffer.event_loop)
