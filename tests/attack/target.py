"""The instance that is attacked, the attacker's connections to it, and a witness who goes on using the robot.

Nothing of the attacked code is imported: an attacker has a socket, and at most a token. `Attack`s are in the other
files of this folder; `python -m tests.attack` runs them.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake

ANSWER_S = 30.0
"""After so long, an answer to the attacker counts as none."""
MAX_FRAME_BYTES = 16 * 1024 * 1024
CLOSED = "the connection was closed"
NO_ANSWER = "no answer"


class Broken(AssertionError):
    """The instance did what it must never do; the text says what."""


@dataclass(frozen=True)
class Target:
    """Where the instance is, and the two people: the attacker and the witness. `tcp` is the agent's own port, where
    the attacker can reach it."""

    url: str
    token: str
    witness_token: str
    role: str
    tcp: tuple[str, int] | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the bridge."""
        parts = urlsplit(self.url)
        return parts.hostname or "127.0.0.1", parts.port or (443 if parts.scheme == "https" else 80)

    @property
    def may_prompt(self) -> bool:
        """Whether the attacker's role may begin sessions."""
        return self.role != "viewer"

    def http(self, token: str | None = None) -> httpx.AsyncClient:
        """A client with this token, or with none."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        return httpx.AsyncClient(base_url=self.url, headers=headers, trust_env=False, timeout=ANSWER_S)

    def websocket(self, path: str, token: str | None, **headers: str) -> connect:
        """A WebSocket to a path of the bridge."""
        if token:
            headers["Authorization"] = f"Bearer {token}"
        scheme = "wss" if self.url.startswith("https") else "ws"
        host, port = self.address
        return connect(
            f"{scheme}://{host}:{port}{path}",
            additional_headers=headers,
            proxy=None,
            max_size=None,
            open_timeout=ANSWER_S,
            ping_interval=None,
        )

    @contextlib.asynccontextmanager
    async def client(self, token: str | None = None) -> AsyncIterator[Client]:
        """An ACP client that is initialized: the attacker's, or the one of `token`."""
        async with self.websocket("/acp", token or self.token) as socket:
            client = Client(socket)
            try:
                await client.call("initialize", {"protocolVersion": 1, "clientCapabilities": {}})
                yield client
            finally:
                client.reading.cancel()

    @contextlib.asynccontextmanager
    async def raw(self, to: tuple[str, int]) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        """A bare TCP connection."""
        reader, writer = await asyncio.open_connection(*to)
        try:
            yield reader, writer
        finally:
            writer.transport.abort()


class Client:
    """An ACP client whose requests may be anything. `call` returns the whole answer: a result or an error."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.heard: list[dict[str, Any]] = []
        self.closed = asyncio.Event()
        self._answers: dict[object, asyncio.Future[dict[str, Any]]] = {}
        self._number = 0
        self._sent = 0
        self.reading = asyncio.create_task(self._read())

    async def call(self, method: str, params: Any, seconds: float = ANSWER_S) -> dict[str, Any]:
        """Send a request and wait for its answer. Where none comes: an error that says so, without a code."""
        answer = await self.begin(method, params)
        closed = asyncio.ensure_future(self.closed.wait())
        try:
            await asyncio.wait([answer, closed], timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        finally:
            closed.cancel()
        if answer.done():
            return answer.result()
        return self._none()

    async def begin(self, method: str, params: Any) -> asyncio.Future[dict[str, Any]]:
        """Send a request; its answer comes later."""
        self._number += 1
        answer = self._answers[self._number] = asyncio.get_running_loop().create_future()
        await self.send({"jsonrpc": "2.0", "id": self._number, "method": method, "params": params})
        return answer

    async def notify(self, method: str, params: Any) -> None:
        """Send a notification."""
        await self.send({"jsonrpc": "2.0", "method": method, "params": params})

    async def send(self, message: Any) -> None:
        """Send anything that is JSON, or bytes as they are. A closed connection takes nothing, and that is no error."""
        with contextlib.suppress(ConnectionClosed):
            await self.socket.send(message if isinstance(message, str | bytes) else json.dumps(message))
        self._sent += 1
        # Sending need not wait, so a flood would leave the witness, which lives in this process, no time.
        if self._sent % 50 == 0:
            await asyncio.sleep(0)

    async def session(self) -> str | None:
        """A new session; None where the role may not begin one."""
        answer = await self.call("session/new", {"cwd": "/", "mcpServers": []})
        return answer["result"]["sessionId"] if "result" in answer else None

    async def prompt(self, session: str, text: str, seconds: float = ANSWER_S) -> dict[str, Any]:
        """A prompt, cancelled where it takes longer than a moment, and its answer."""
        params = {"sessionId": session, "prompt": [{"type": "text", "text": text}]}
        answer = await self.begin("session/prompt", params)
        await asyncio.wait([answer], timeout=1.0)
        if not answer.done():
            await self.notify("session/cancel", {"sessionId": session})
            await asyncio.wait([answer], timeout=seconds)
        return answer.result() if answer.done() else self._none()

    def _none(self) -> dict[str, Any]:
        """What stands in place of an answer that has not come."""
        if not self.is_closed:
            return {"error": {"message": NO_ANSWER}}
        reason = self.socket.close_reason
        return {"error": {"message": f"{CLOSED} ({self.socket.close_code}{f': {reason}' if reason else ''})"}}

    @property
    def is_closed(self) -> bool:
        """Whether the instance has closed the connection."""
        return self.closed.is_set()

    async def _read(self) -> None:
        try:
            async for frame in self.socket:
                message = json.loads(frame)
                if "method" not in message and (waiting := self._answers.pop(message.get("id"), None)):
                    if not waiting.done():
                        waiting.set_result(message)
                else:
                    self.heard.append(message)
                    if message.get("method") == "session/request_permission":
                        refusal = {"outcome": {"outcome": "cancelled"}}
                        await self.send({"jsonrpc": "2.0", "id": message["id"], "result": refusal})
        except ConnectionClosed:
            pass
        finally:
            self.closed.set()


def said(answer: dict[str, Any]) -> str:
    """How the instance answered, in a few words. Raises `Broken` for an error that tells an attacker too much."""
    error = answer.get("error")
    if error is None:
        return "answered"
    text = error.get("message", "")
    if "Traceback" in text or 'File "' in text or len(text) > 2_000:
        raise Broken(f"the error says too much: {text[:200]}")
    return f"refused: {text[:90]}" if "code" in error else text


def refused(answer: dict[str, Any]) -> str:
    """As `said`, for a request that must be refused. Raises `Broken` where it was carried out."""
    if "error" not in answer:
        raise Broken(f"it was carried out: {str(answer)[:200]}")
    return said(answer)


@dataclass
class Witness:
    """Another person, who asks the agent and the bridge four times a second, and how long each answer took, in s."""

    target: Target
    waits: list[float] = field(default_factory=list)
    stop_waits: list[float] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    @contextlib.asynccontextmanager
    async def watching(self) -> AsyncIterator[Witness]:
        """Ask while the context lasts."""
        async with self.target.client(self.target.witness_token) as client:
            asking = [
                asyncio.create_task(self._again(lambda: self._list(client), self.waits)),
                asyncio.create_task(self._again(self._reach_stop, self.stop_waits)),
            ]
            try:
                yield self
            finally:
                await asyncio.sleep(0.3)
                for task in asking:
                    task.cancel()
                await asyncio.gather(*asking, return_exceptions=True)
                if client.is_closed:
                    self.failures.append("the witness lost the connection")

    async def _list(self, client: Client) -> str | None:
        answer = await client.call("session/list", {})
        return None if "result" in answer else said(answer)

    async def _reach_stop(self) -> str | None:
        """A new connection to Stop without a login: a refusal shows that a press would have arrived."""
        try:
            async with self.target.http() as http:
                status = (await http.post("/api/stop")).status_code
        except httpx.HTTPError as error:
            return f"stop is out of reach: {type(error).__name__}"
        return None if status in (401, 403) else f"stop answered {status} to nobody"

    async def _again(self, ask: Callable[[], Awaitable[str | None]], waits: list[float]) -> None:
        while True:
            began = time.monotonic()
            waits.append(0.0)
            try:
                if problem := await ask():
                    self.failures.append(problem)
            finally:  # an answer that is still missing at the end took at least so long
                waits[-1] = time.monotonic() - began
            await asyncio.sleep(0.25)


Run = Callable[[Target], Awaitable[str]]


@dataclass(frozen=True)
class Attack:
    """One attack: what is sent, and the function that sends it. It returns how the instance answered."""

    sends: str
    run: Run


ATTACKS: list[Attack] = []


def attack(sends: str) -> Callable[[Run], Run]:
    """Add a function to the attacks; `sends` stands in the table."""

    def add(run: Run) -> Run:
        ATTACKS.append(Attack(sends, run))
        return run

    return add


@dataclass(frozen=True)
class Outcome:
    """One row of the table. `broken` is None where the instance held."""

    attack: Attack
    answered: str
    longest_wait: float
    longest_stop_wait: float
    broken: str | None


async def carry_out(attack: Attack, target: Target, patience: float) -> Outcome:
    """Run one attack beside a witness. It has broken the instance when the witness waited longer than `patience`, in s,
    when it lost its connection, or when nobody can connect afterwards."""
    witness = Witness(target)
    answered, broken = "", None
    try:
        async with witness.watching():
            try:
                async with asyncio.timeout(4 * ANSWER_S):
                    answered = await attack.run(target)
            except Broken as error:
                broken = str(error)
            except TimeoutError:
                broken = "the attack did not come to an end"
            except (OSError, ConnectionClosed, InvalidHandshake, httpx.HTTPError) as error:
                answered = f"{CLOSED} ({type(error).__name__})"
        async with target.client(target.witness_token) as client:
            if "result" not in (answer := await client.call("session/list", {})):
                broken = broken or f"afterwards: {said(answer)}"
    except (OSError, ConnectionClosed, InvalidHandshake) as error:
        broken = broken or f"nobody can connect: {type(error).__name__}"
    longest, to_stop = max(witness.waits, default=0.0), max(witness.stop_waits, default=0.0)
    if broken is None and witness.failures:
        broken = witness.failures[0]
    if broken is None and max(longest, to_stop) > patience:
        broken = f"somebody else waited {max(longest, to_stop):.1f} s"
    return Outcome(attack, answered, longest, to_stop, broken)
