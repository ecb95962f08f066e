"""The bridge's HTTP client of the robot server: stop, release and health, not through the agent.

A stop must never wait for anything else: there is no queue, and an answer comes within a few seconds.
"""

from __future__ import annotations

import asyncio
from typing import Any

import httpx

_REQUEST_SECONDS = 3.0
_HEALTH_SECONDS = 1.0
_CANNOT_STOP = "The robot cannot be reached to stop it. Use the stop button on the robot."


class RobotUnreachableError(Exception):
    """The robot server does not answer, or refuses; the text is for the person who pressed the button."""


class RobotServerClient:
    """Sends requests to the robot server at `base_url` with the secret that the processes share."""

    def __init__(self, base_url: str, secret: bytes) -> None:
        self._client = httpx.AsyncClient(
            base_url=base_url,
            headers={"Authorization": f"Bearer {secret.decode()}"},
            timeout=_REQUEST_SECONDS,
            trust_env=False,  # no proxy of the environment may delay or lose a stop
        )

    async def stop(self, by: str) -> dict[str, Any]:
        """Latch the stop in the name of `by`. Raises `RobotUnreachableError`."""
        return await self._post("/stop", by, _CANNOT_STOP)

    async def release(self, by: str) -> dict[str, Any]:
        """Release the latched stop. Raises `RobotUnreachableError`."""
        return await self._post("/release", by, "The robot cannot be reached.")

    async def health(self) -> tuple[bool, str]:
        """Whether the robot server answers, and its name and version, or what is wrong."""
        try:
            answer = await self._client.get("/health", timeout=_HEALTH_SECONDS)
            answer.raise_for_status()
            body = answer.json()
        except (httpx.HTTPError, ValueError):
            return False, f"Nothing answers at {self._client.base_url}."
        return True, f"{body.get('robot', 'robot')} {body.get('version', '')}".strip()

    async def close(self) -> None:
        """Close the open connections."""
        await self._client.aclose()

    async def _post(self, path: str, by: str, error_sentence: str) -> dict[str, Any]:
        for is_last in (False, True):  # an open connection may belong to a robot server that has ended
            try:
                async with asyncio.timeout(_REQUEST_SECONDS):
                    answer = await self._client.post(path, params={"by": by})
                    answer.raise_for_status()
                    body = answer.json()
            except (httpx.HTTPStatusError, ValueError) as error:
                raise RobotUnreachableError(f"{error_sentence} (The robot server answered: {error}.)") from None
            except (httpx.TransportError, TimeoutError):
                if is_last:
                    raise RobotUnreachableError(error_sentence) from None
                continue
            if isinstance(body, dict):
                return body
            break
        raise RobotUnreachableError(error_sentence)
