"""The one client of the robot server's HTTP paths: stop, release, health, previews and telemetry, all but MCP.

Agent, bridge and doctor use it. Its connections stay open, and a stop finds one that is ready. No proxy of the
environment ever takes part: it would get the robot's secret, and could delay or lose a stop. It never says that a robot
has stopped unless the robot's own server has said so.
"""

from __future__ import annotations

import asyncio
import contextlib
import ssl
import time
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import httpx
import orjson
from websockets.asyncio.client import connect

from backend import identity
from backend.config import Settings
from backend.robot_address import without_login

ATTEMPT_S = 1.5
"""How long the robot server may take to answer one attempt. A stop has two of them."""
HEALTH_S = 1.0
WARM_S = 2.0
"""How often a connection that nobody uses is used for a health check. The robot server closes one after 5 s."""
MAX_TELEMETRY_BYTES = 64 * 1024 * 1024
MAX_ANSWER_BYTES = 64 * 1024
PING_S = 5.0

NO_STOP_PATH = "This robot has no stop path here, so it was not stopped."
CANNOT_STOP = "The robot cannot be reached to stop it."
NOT_CONFIRMED = "The robot's server did not confirm the stop."
_LOST = (httpx.HTTPError, TimeoutError)
"""The errors of a request that got no answer, or half of one."""
OWN_STOP = "Use the stop button on the robot."


class RobotError(Exception):
    """The robot server did not do it; the text is for people and says what to do."""


class NotStopped(RobotError):
    """A stop was not confirmed. `reason` is its first sentence, without the advice."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason} {OWN_STOP}")
        self.reason = reason


class RobotServerClient:
    """The robot server below `base_url`; None for a robot that has no HTTP paths. `secret` is shown to it, where it is
    one of ours."""

    def __init__(self, base_url: str | None, secret: bytes | None = None) -> None:
        self._base = base_url.rstrip("/") if base_url else None
        self._headers = {"Authorization": f"Bearer {secret.decode()}"} if secret else {}
        self.is_ours = secret is not None
        """Whether it is our robot server: it keeps a stop until somebody releases it."""
        self._client = httpx.AsyncClient(
            headers=self._headers,
            timeout=ATTEMPT_S,
            trust_env=False,
            verify=tls_context(),
            limits=httpx.Limits(keepalive_expiry=None),
        )

    @classmethod
    def of(cls, settings: Settings, base_url: str | None) -> Self:
        """The server below one of the URLs of the settings. It gets the secret of the data folder if it is ours."""
        ours = settings.is_our_robot_server(base_url)
        return cls(base_url, identity.shared_secret(settings.data_dir, identity.ROBOT_TOKEN) if ours else None)

    @property
    def has_paths(self) -> bool:
        """Whether it has HTTP paths at all."""
        return self._base is not None

    async def stop(self, by: str) -> dict[str, Any]:
        """Stop the robot in the name of `by`: `{"stopped": {by, at}}`, as the robot's server confirms it. Raises
        `NotStopped`."""
        try:
            answer = await self._post("/stop", by, attempts=2)  # a second stop changes nothing
        except _LOST:
            raise NotStopped(CANNOT_STOP) from None
        if answer is None or answer.is_missing:
            raise NotStopped(NO_STOP_PATH)
        stopped = answer.body.get("stopped")
        if not answer.is_success or not isinstance(stopped, dict):
            raise NotStopped(f"{NOT_CONFIRMED} (HTTP status {answer.status}.)")
        said, at = stopped.get("by"), stopped.get("at")
        return {
            "stopped": {
                "by": said if isinstance(said, str) else by,
                "at": at if isinstance(at, int | float) and not isinstance(at, bool) else time.time(),
            }
        }

    async def release(self, by: str) -> dict[str, Any]:
        """Release the stop: `{"stopped": None}`. Raises `RobotError`.

        It is sent once: a second one could release a stop that somebody has set in between. A health check comes first,
        because an open connection can be that of a server that has ended.
        """
        try:
            await self._ask("GET", "/health")
            answer = await self._post("/release", by)
        except _LOST:
            raise RobotError("The robot cannot be reached.") from None
        if answer is None or answer.is_missing:
            raise RobotError("This robot has no path that releases a stop. Release it at the robot.")
        if not answer.is_success:
            error = answer.body.get("error")
            sentence = error if isinstance(error, str) else f"HTTP status {answer.status}."
            raise RobotError(f"The robot's server did not release the stop. ({sentence})")
        return {"stopped": None}

    async def health(self) -> tuple[bool, str]:
        """Whether the server answers, and its name and version, or what is wrong. Needs no secret. Raises `RobotError`
        for a robot that has no HTTP paths."""
        try:
            answer = await self._ask("GET", "/health", seconds=HEALTH_S)
        except _LOST:
            return False, f"Nothing answers at {self._shown}."
        if answer is None:
            raise RobotError("Only the agent reaches this robot: it is behind a command.")
        if answer.is_success and isinstance(name := answer.body.get("robot"), str):
            return True, f"{name} {answer.body.get('version', '')}".strip()
        if self.is_ours:
            return False, f"Another program answers at {self._shown}."
        return True, f"An MCP server at {self._shown}."

    async def forget_preview(self, own: str) -> None:
        """Withdraw the preview with this id. Raises `httpx.HTTPError` or `TimeoutError`."""
        await self._ask("DELETE", f"/preview/{own}", seconds=HEALTH_S)

    def telemetry(self) -> connect:
        """A connection to the telemetry stream. Raises `RobotError` without one."""
        if self._base is None:
            raise RobotError("This robot has no telemetry.")
        return connect(
            self._base.replace("http", "ws", 1) + "/telemetry",
            additional_headers=self._headers,
            compression=None,
            proxy=None,
            ssl=tls_context() if self._base.startswith("https:") else None,
            max_size=MAX_TELEMETRY_BYTES,
            ping_interval=PING_S,
            ping_timeout=PING_S,
        )

    async def keep_warm(self) -> None:
        """Keep a connection to our robot server open until cancelled, so that a stop has to open none."""
        while self.is_ours:
            await self.health()
            await asyncio.sleep(WARM_S)

    async def close(self) -> None:
        """Close the connections."""
        await self._client.aclose()

    @property
    def _shown(self) -> str:
        return without_login(self._base or "")

    async def _post(self, path: str, by: str, *, attempts: int = 1) -> _Answer | None:
        """The answer to a POST in the name of `by`. The name is in the address, which comes with the first packet, and
        in the body, where other servers expect it."""
        for _ in range(attempts - 1):
            with contextlib.suppress(*_LOST):
                return await self._ask("POST", path, params={"by": by}, json={"by": by})
        return await self._ask("POST", path, params={"by": by}, json={"by": by})

    async def _ask(self, method: str, path: str, seconds: float = ATTEMPT_S, **options: Any) -> _Answer | None:
        """The answer to one request; None where the robot has no paths. Raises one of `_LOST`."""
        if self._base is None:
            return None
        async with asyncio.timeout(seconds), self._client.stream(method, self._base + path, **options) as answer:
            body = bytearray()
            async for piece in answer.aiter_bytes():
                body += piece
                if len(body) > MAX_ANSWER_BYTES:
                    return _Answer(answer.status_code, {})
            return _Answer(answer.status_code, _object(bytes(body)))


@dataclass(frozen=True)
class _Answer:
    """The HTTP status and the JSON object of an answer; empty where it is something else or too large."""

    status: int
    body: dict[str, Any]

    @property
    def is_success(self) -> bool:
        return 200 <= self.status < 300

    @property
    def is_missing(self) -> bool:
        """Whether the server has no such path."""
        return self.status in (404, 405, 501)


@cache
def tls_context() -> ssl.SSLContext:
    """The TLS settings of every client of this process. Making them reads all certificates: 20 to 100 ms."""
    return httpx.create_ssl_context()


def _object(raw: bytes) -> dict[str, Any]:
    try:
        body = orjson.loads(raw)
    except ValueError:
        return {}
    return body if isinstance(body, dict) else {}
