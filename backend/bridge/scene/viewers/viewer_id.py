"""The id of a viewer in an address: a UUID that a page has made up, in the form with hyphens."""

from __future__ import annotations

import uuid

from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse
from starlette.websockets import WebSocket

_INVALID_ID = "The id of a viewer is a UUID, such as 3f2b8c1e-7d54-4c8e-9a35-0c6f1e2d4b5a."


def viewer_id(connection: HTTPConnection) -> str | None:
    """The id in a connection's address, in lower case; None for a text that is no UUID."""
    given = str(connection.path_params["viewer"])
    try:
        parsed = str(uuid.UUID(given))
    except ValueError:
        return None
    return parsed if parsed == given.lower() else None


def invalid_id_response() -> JSONResponse:
    """The answer to a request whose address has no valid id."""
    return JSONResponse({"error": _INVALID_ID}, status_code=404)


async def refuse_invalid_id(websocket: WebSocket) -> None:
    """Refuse the upgrade of a WebSocket whose address has no valid id."""
    await websocket.send_denial_response(invalid_id_response())
