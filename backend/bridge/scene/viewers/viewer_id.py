"""The id of a viewer in an address: a UUID that a page made up, in its plain form."""

from __future__ import annotations

import uuid

from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse
from starlette.websockets import WebSocket

_REFUSAL = "The id of a viewer is a UUID, such as 3f2b8c1e-7d54-4c8e-9a35-0c6f1e2d4b5a."


def viewer_id(connection: HTTPConnection) -> str | None:
    """The id in a connection's address; None for what is no UUID."""
    given = str(connection.path_params["viewer"])
    try:
        known = str(uuid.UUID(given))
    except ValueError:
        return None
    return known if known == given.lower() else None


def refusal() -> JSONResponse:
    """The answer to an address without one."""
    return JSONResponse({"error": _REFUSAL}, status_code=404)


async def refuse(websocket: WebSocket) -> None:
    """The same to a WebSocket that asks to be opened."""
    await websocket.send_denial_response(refusal())
