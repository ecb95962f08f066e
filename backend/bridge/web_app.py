"""Serves the built web app, with security headers on every answer.

Pages and assets are public: they contain no secret, and people log in within the page. Nothing outside the folder of
the build may ever be served.
"""

from __future__ import annotations

import asyncio
import gzip
from functools import lru_cache
from pathlib import Path, PurePosixPath

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

APP_POLICY = "; ".join(
    [
        "default-src 'self'",
        "script-src 'self'",
        "style-src 'self' 'unsafe-inline'",  # component libraries position popups with style elements
        "img-src 'self' data: blob:",
        "media-src 'self' data: blob:",
        "font-src 'self' data:",
        "connect-src 'self' data: blob:",
        "worker-src 'self' blob:",
        "frame-src 'self'",
        "frame-ancestors 'self'",
        "base-uri 'none'",
        "form-action 'self'",
        "object-src 'none'",
    ]
)

_COMPRESSIBLE = {".css", ".html", ".js", ".json", ".map", ".svg", ".txt", ".webmanifest"}

_NOT_BUILT = """<!doctype html>
<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>robot-acp</title>
<style>
  body { font: 16px/1.5 system-ui, sans-serif; max-width: 34rem; margin: 20vh auto; padding: 0 1rem;
         color-scheme: light dark }
  code { background: #8882; padding: .1em .4em; border-radius: 4px }
</style>
<h1>The web app is not built.</h1>
<p>Run <code>./run.sh</code>: it builds the app and starts everything.</p>
</html>
"""


class WebApp(StaticFiles):
    """The files of the build. Every address that is no file is answered with the app, which routes its own pages."""

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, check_dir=False)
        self._folder = folder

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        self.config_checked = True  # Starlette would fail for a missing folder; a build may be made while this runs
        await super().__call__(scope, receive, send)

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The file at `path`, otherwise the app. Raises `HTTPException` (404) for a missing asset."""
        if path == "api" or path.startswith("api/"):
            return JSONResponse({"error": "There is no such address."}, status_code=404)
        if not (self._folder / "index.html").is_file():
            return HTMLResponse(_NOT_BUILT, status_code=503, headers={"Cache-Control": "no-store"})
        hashed = path.startswith("assets/")
        try:
            response = await super().get_response(path, scope)
        except HTTPException as missing:
            if missing.status_code != 404 or hashed or PurePosixPath(path).suffix:
                raise
            response = await super().get_response("index.html", scope)
        response.headers["Cache-Control"] = "public, max-age=31536000, immutable" if hashed else "no-cache"
        response.headers["Vary"] = "Accept-Encoding"
        if isinstance(response, FileResponse) and "gzip" in Headers(scope=scope).get("accept-encoding", ""):
            return await _compressed(response)
        return response


async def _compressed(response: FileResponse) -> Response:
    """The same file in gzip, where that makes it smaller; each version of a file is compressed once."""
    stat = response.stat_result
    if stat is None or stat.st_size < 1024 or PurePosixPath(response.path).suffix not in _COMPRESSIBLE:
        return response
    content = await asyncio.to_thread(_gzipped, str(response.path), stat.st_mtime_ns)
    headers = {name: value for name, value in response.headers.items() if name != "content-length"}
    return Response(content, headers=headers | {"content-encoding": "gzip"})


@lru_cache(maxsize=128)
def _gzipped(path: str, changed: int) -> bytes:
    return gzip.compress(Path(path).read_bytes(), compresslevel=9)


class SecurityHeaders:
    """ASGI middleware that adds headers to every answer: no foreign content, no foreign frames, no guessed types."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and add the headers that its answer does not set itself."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("Content-Security-Policy", APP_POLICY)
                headers.setdefault("X-Content-Type-Options", "nosniff")
                headers.setdefault("X-Frame-Options", "SAMEORIGIN")
                headers.setdefault("Referrer-Policy", "no-referrer")
                headers.setdefault("Cross-Origin-Resource-Policy", "same-origin")
                headers.setdefault("Permissions-Policy", "camera=(), geolocation=(), microphone=(self)")
            await send(message)

        await self._app(scope, receive, send_with_headers)
