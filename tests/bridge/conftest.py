"""What the bridge's tests share: a bridge on a free port, scenes, and an agent that does what a test tells it to.

The agent is a peer on the other side of a real socket, not a stand-in for a part of this project.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import orjson
import pytest
import uvicorn
import viser
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from backend import config, tokens, wire
from backend.bridge import server
from backend.bridge.connection_limits import ConnectionLimit
from backend.bridge.limits import Limits
from backend.bridge.login import Authenticator
from backend.bridge.origin import OriginPolicy
from backend.bridge.scene.proxy import SceneSocket
from backend.bridge.scene.scene import Scene
from backend.config import Settings
from backend.identity import Role
from backend.robot_server import RobotServerClient
from tests.bridge.scenes import PATIENCE, TelemetryPeer, telemetry_peer
from tests.bridge.viser_page import SUBPROTOCOL


async def eventually(condition: Callable[[], object], seconds: float = PATIENCE) -> Any:
    """Wait until `condition` (which may have to be awaited itself) is true, and return what it gave."""
    async with asyncio.timeout(seconds):
        while True:
            value = condition()
            if inspect.isawaitable(value):
                value = await value
            if value:
                return value
            await asyncio.sleep(0.01)


PROBE = wire.HEALTH.encode()


class ScriptedAgent:
    """An NDJSON peer on TCP: it records what it hears, and says what a test has it say.

    It answers a probe of its health as an agent that does not know the method. Probes do not count as connections.
    """

    def __init__(self) -> None:
        self.port = 0
        self.connections = 0
        self.probes = 0
        self.heard_lines: asyncio.Queue[bytes] = asyncio.Queue()
        self.left = asyncio.Event()
        self.left.set()
        self.reading = asyncio.Event()
        self.reading.set()
        self._server: asyncio.Server | None = None
        self._writer: asyncio.StreamWriter | None = None

    async def start(self, port: int = 0) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port, limit=16 * 1024 * 1024)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        if self._server is not None:
            self._server.close()
        self.reading.set()
        self.hang_up()
        await self.left.wait()

    async def heard(self) -> bytes:
        """The next line that came, without its newline."""
        async with asyncio.timeout(PATIENCE):
            return await self.heard_lines.get()

    async def heard_message(self) -> dict[str, Any]:
        """The next line, parsed."""
        return orjson.loads(await self.heard())

    async def say(self, data: bytes) -> None:
        """Send bytes as they are, newlines included."""
        writer = await eventually(lambda: self._writer)
        writer.write(data)
        await writer.drain()

    def hang_up(self) -> None:
        """Close the latest connection."""
        if self._writer is not None:
            self._writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        before, left = self._writer, self.left.is_set()
        self.connections += 1
        self.left.clear()
        self._writer = writer
        with contextlib.suppress(ConnectionError):
            while True:
                await self.reading.wait()
                line = await reader.readline()
                if PROBE in line:
                    writer.write(
                        b'{"jsonrpc":"2.0","id":1,"error":{"code":-32601,"message":"There is no such method."}}\n'
                    )
                    self.probes += 1
                    self.connections -= 1
                    self._writer = before
                    writer.close()
                    if not left:
                        return
                    break
                if not line:
                    break
                self.heard_lines.put_nowait(line.removesuffix(b"\n"))
        writer.close()
        self.left.set()


@dataclass
class RunningBridge:
    """A bridge that serves, and the ways in."""

    settings: Settings
    port: int
    _clients: contextlib.AsyncExitStack = field(default_factory=contextlib.AsyncExitStack)

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def token(self, role: Role = Role.OPERATOR, name: str = "Ana", lifetime_s: float = 60) -> str:
        return tokens.create(self.settings.data_dir, name, role, lifetime_s)

    def http(self, token: str | None = None) -> httpx.AsyncClient:
        """A client that shows `token` as a bearer, or nothing."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        return httpx.AsyncClient(base_url=self.origin, headers=headers, trust_env=False, timeout=PATIENCE)

    def websocket(
        self, path: str = "/acp", *, token: str | None = "", called: str = "127.0.0.1", **options: Any
    ) -> connect:
        """A WebSocket as a program opens it: a bearer token (None for none), no Origin, our address as Host."""
        headers = dict(options.pop("headers", {}))
        if token is not None:
            headers["Authorization"] = f"Bearer {token or self.token()}"
        return connect(
            f"ws://{called}:{self.port}{path}",
            host="127.0.0.1",
            port=self.port,
            additional_headers=headers,
            proxy=None,
            compression=None,
            max_size=None,
            open_timeout=PATIENCE,
            **options,
        )


@asynccontextmanager
async def running_bridge(settings: Settings, limits: Limits | None = None) -> AsyncIterator[RunningBridge]:
    """Serve a bridge for `settings`, on a free port of loopback."""
    listener = server.listen(settings)
    port = listener.getsockname()[1]
    serving = asyncio.create_task(server.serve(settings, listener=listener, limits=limits))
    bridge = RunningBridge(settings, port)
    try:
        async with bridge.http() as http:
            await http.get("/api/me")  # the socket listens already; this waits for the application
        yield bridge
    finally:
        serving.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await serving


@pytest.fixture
async def agent() -> AsyncIterator[ScriptedAgent]:
    """An agent that listens."""
    peer = ScriptedAgent()
    await peer.start()
    yield peer
    await peer.stop()


@pytest.fixture
def settings_for(tmp_path: Path) -> Iterator[Callable[..., Settings]]:
    """Makes settings with a data folder of the test's own, and ports at which nobody listens."""

    def make(**flags: Any) -> Settings:
        bridge = {"port": 0} | flags.pop("bridge", {})
        # Port 1 is privileged and unused: what a test does not start is not there.
        return config.load(**({"robot": {"port": 1}, "agent": {"port": 1}} | flags), data_dir=tmp_path, bridge=bridge)

    return make


@pytest.fixture
async def bridge(agent: ScriptedAgent, settings_for: Callable[..., Settings]) -> AsyncIterator[RunningBridge]:
    """A bridge in front of the scripted agent."""
    async with running_bridge(settings_for(agent={"port": agent.port})) as running:
        yield running


@pytest.fixture
def bridge_with(settings_for: Callable[..., Settings]) -> Callable[..., Any]:
    """Runs a bridge with settings of the test's choice: `async with bridge_with(agent=…, limits=…) as bridge`."""
    return lambda limits=None, **flags: running_bridge(settings_for(**flags), limits)


@pytest.fixture
async def robot() -> AsyncIterator[TelemetryPeer]:
    """The robot's end of `/telemetry`, which sends what a test tells it to."""
    async with telemetry_peer() as peer:
        yield peer


@pytest.fixture
def scene_with(robot: TelemetryPeer) -> Callable[..., Any]:
    """Runs a scene that follows the robot: `async with scene_with(limits=…) as scene`."""

    @asynccontextmanager
    async def running(**options: Any) -> AsyncIterator[Scene]:
        scene = Scene("Sancho", RobotServerClient(f"http://127.0.0.1:{robot.port}", b"secret"), **options)
        task = asyncio.create_task(scene.run())
        try:
            await eventually(lambda: robot.subscriptions)
            yield scene
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    return running


@pytest.fixture
async def scene(scene_with: Callable[..., Any]) -> AsyncIterator[Scene]:
    """A scene that follows the robot."""
    async with scene_with() as running:
        yield running


@pytest.fixture
def opening(tmp_path: Path) -> Callable[..., Any]:
    """Serves a scene's WebSocket as the bridge does: `async with opening(scene) as opened, opened() as page`."""

    @asynccontextmanager
    async def serving(scene: Scene) -> AsyncIterator[Callable[[], connect]]:
        authenticator = Authenticator(tokens.Registry(tmp_path), OriginPolicy("127.0.0.1"))
        endpoint = ConnectionLimit(authenticator, 9, 9).endpoint(SceneSocket(authenticator, scene).serve)
        app = Starlette(routes=[WebSocketRoute("/scene", endpoint)])
        web = uvicorn.Server(uvicorn.Config(app, port=0, ws="websockets-sansio", log_config=None))
        task = asyncio.create_task(web.serve())
        await eventually(lambda: web.started)
        url = f"ws://127.0.0.1:{web.servers[0].sockets[0].getsockname()[1]}/scene"
        bearer = {"Authorization": f"Bearer {tokens.create(tmp_path, 'Ana', Role.VIEWER, 60)}"}
        options = {"subprotocols": [SUBPROTOCOL], "compression": None, "max_size": None, "proxy": None}
        try:
            yield lambda: connect(url, additional_headers=bearer, **options)
        finally:
            web.should_exit = True
            await task

    return serving


@pytest.fixture
def servers(monkeypatch: pytest.MonkeyPatch) -> list[viser.ViserServer]:
    """Every viser server that is started from here on."""
    started: list[viser.ViserServer] = []

    class Noted(viser.ViserServer):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(viser, "ViserServer", Noted)
    return started


INITIALIZE = b'{"jsonrpc":"2.0","id":0,"method":"initialize","params":{"protocolVersion":1}}'


@pytest.fixture
def initialize() -> bytes:
    """The frame that every connection begins with."""
    return INITIALIZE


@pytest.fixture
async def client(bridge: RunningBridge, agent: ScriptedAgent) -> AsyncIterator[ClientConnection]:
    """A WebSocket client that has sent `initialize`, which the agent has read."""
    async with bridge.websocket() as websocket:
        await websocket.send(INITIALIZE.decode())
        await agent.heard()
        yield websocket


async def read_to_end(websocket: ClientConnection) -> tuple[int, str]:
    """Read until the other side closes; its close code and reason."""
    async with asyncio.timeout(PATIENCE):
        with contextlib.suppress(ConnectionClosed):
            while True:
                await websocket.recv()
    return websocket.close_code, websocket.close_reason


@pytest.fixture
def closing() -> Callable[[ClientConnection], Awaitable[tuple[int, str]]]:
    """Waits for the end of a WebSocket: `code, reason = await closing(websocket)`."""
    return read_to_end


@pytest.fixture
def wait_until() -> Callable[..., Awaitable[Any]]:
    """Waits for a condition: `await wait_until(lambda: …)`."""
    return eventually
