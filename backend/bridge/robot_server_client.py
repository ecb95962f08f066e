"""The short way to the robot server: stop, release and health over its own HTTP, not through the agent.

A stop must never wait behind anything else: no queue, no retry longer than a person's patience.
"""

from __future__ import annotations

import asyncio
from typing import Any

import httpx

_SECONDS = 3.0
_HEALTH_SECONDS = 1.0
_CANNOT_STOP = "The robot cannot be reached to stop it. Use the stop button on the robot."


class RobotDownError(Exception):
    """The robot server cannot be reached or refuses; the text is for the person who pressed the button."""


class RobotLink:
    """HTTP to the robot server at `base_url`, with the bearer token that the processes share."""

    def __init__(self, base_url: str, secret: bytes) -> None:
        self._client = httpx.AsyncClient(
            base_url=base_url,
            headers={"Authorization": f"Bearer {secret.decode()}"},
            timeout=_SECONDS,
            trust_env=False,  # a proxy of the environment must not stand between a person and Stop
        )

    async def stop(self, by: str) -> dict[str, Any]:
        """Latch the stop in the name of `by`. Raises `RobotDownError`."""
        return await self._post("/stop", by, _CANNOT_STOP)

    async def release(self, by: str) -> dict[str, Any]:
        """Release the latched stop. Raises `RobotDownError`."""
        return await self._post("/release", by, "The robot cannot be reached.")

    async def health(self) -> tuple[bool, str]:
        """Whether the robot server answers, and what it says about itself or what is wrong."""
        try:
            answer = await self._client.get("/health", timeout=_HEALTH_SECONDS)
            answer.raise_for_status()
            body = answer.json()
        except (httpx.HTTPError, ValueError):
            return False, f"Nothing answers at {self._client.base_url}."
        return True, f"{body.get('robot', 'robot')} {body.get('version', '')}".strip()

    async def close(self) -> None:
        """Close the kept connections."""
        await self._client.aclose()

    async def _post(self, path: str, by: str, otherwise: str) -> dict[str, Any]:
        for last in (False, True):  # a kept connection may have died with an earlier robot server
            try:
                async with asyncio.timeout(_SECONDS):
                    answer = await self._client.post(path, params={"by": by})
                    answer.raise_for_status()
                    body = answer.json()
            except (httpx.HTTPStatusError, ValueError) as error:
                raise RobotDownError(f"{otherwise} (The robot server answered: {error}.)") from None
            except (httpx.TransportError, TimeoutError):
                if last:
                    raise RobotDownError(otherwise) from None
                continue
            if isinstance(body, dict):
                return body
            break
        raise RobotDownError(otherwise)
