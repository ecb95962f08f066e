"""An HTTP proxy for tests: it notes the first line and the headers of each request, and carries nothing."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class Proxy:
    """One that listens on the loopback until it is closed."""

    listener: socket.socket
    requests: list[str] = field(default_factory=list)

    @property
    def port(self) -> int:
        return int(self.listener.getsockname()[1])

    @property
    def variables(self) -> dict[str, str]:
        """The environment that makes a program use it for everything, also for the loopback."""
        url = f"http://127.0.0.1:{self.port}"
        names = ("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY")
        return dict.fromkeys(names, url) | {"no_proxy": "", "NO_PROXY": ""}

    def serve(self) -> None:
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            with connection:
                connection.settimeout(5)
                try:
                    self.requests.append(connection.recv(65536).decode(errors="replace"))
                    connection.sendall(b"HTTP/1.1 502 Bad Gateway\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
                except OSError:
                    continue


@contextmanager
def proxy() -> Iterator[Proxy]:
    """A proxy on a free port."""
    listener = socket.create_server(("127.0.0.1", 0))
    running = Proxy(listener)
    thread = threading.Thread(target=running.serve, daemon=True)
    thread.start()
    try:
        yield running
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join()
