"""The official SDKs as clients with one interface: the TypeScript SDK in node and in a browser, and the Python SDK.

They pass on what a test tells them and keep what they hear. What goes over the wire is made by the SDKs alone.
"""

from __future__ import annotations

import asyncio
import contextlib
import http.server
import json
import shutil
import subprocess
import threading
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any, Protocol

from acp import PROTOCOL_VERSION
from acp.client import ClientSideConnection
from acp.schema import (
    AllowedOutcome,
    ClientCapabilities,
    PermissionOption,
    RequestPermissionResponse,
    TextContentBlock,
    ToolCallUpdate,
)
from acp.ws import create_websocket_stream
from playwright.async_api import Page

from tests.processes import PATIENCE_S

SCRIPT = Path(__file__).with_name("typescript_client.mjs")
BUNDLER = Path(__file__).parents[2] / "web" / "node_modules" / ".bin" / "rolldown"


class SdkClient(Protocol):
    """What a test wants of a client."""

    heard: list[dict[str, Any]]
    """The params of each `session/update`."""
    questions: list[dict[str, Any]]
    """The params of each `session/request_permission`."""
    answers: list[str]
    """The options to choose for the next questions; without one a question stays open."""
    withdrawn: list[int]
    """The questions that were taken back, by their place in `questions`."""

    async def initialize(self) -> int:
        """Say hello, and return the version of the protocol that was agreed on."""

    async def new_session(self) -> str:
        """Begin a session, which the prompts go to."""

    async def prompt(self, text: str) -> str:
        """Ask for something, and return the stop reason."""

    async def cancel(self) -> None:
        """Cancel what was asked for."""


class TypeScriptClient:
    """The TypeScript SDK behind the commands and events of `typescript_client.mjs`."""

    def __init__(self) -> None:
        self.heard: list[dict[str, Any]] = []
        self.questions: list[dict[str, Any]] = []
        self.answers: list[str] = []
        self.withdrawn: list[int] = []
        self.session = ""
        self._results: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def obey(self, command: dict[str, Any]) -> None:
        """Hand a command to the script."""
        raise NotImplementedError

    def take(self, event: dict[str, Any]) -> None:
        """An event of the script."""
        if "heard" in event:
            self.heard.append(event["heard"])
        elif "withdrawn" in event:
            self.withdrawn.append(event["withdrawn"])
        elif "question" in event:
            self.questions.append(event["params"])
            if self.answers:
                answer = {"question": event["question"], "optionId": self.answers.pop(0)}
                task = asyncio.ensure_future(self.obey(answer))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
        else:
            self._results[event["id"]].set_result(event)

    async def request(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        """Let the SDK ask the agent."""
        number = len(self._results)
        answer = self._results[number] = asyncio.get_running_loop().create_future()
        await self.obey({"id": number, "method": method, "params": params})
        event = await answer
        assert "error" not in event, event["error"]
        return dict(event["result"])

    async def initialize(self) -> int:
        about = {"protocolVersion": 1, "clientInfo": {"name": "conformance", "version": "1"}, "clientCapabilities": {}}
        return int((await self.request("initialize", about))["protocolVersion"])

    async def new_session(self) -> str:
        self.session = str((await self.request("session/new", {"cwd": "/", "mcpServers": []}))["sessionId"])
        return self.session

    async def prompt(self, text: str) -> str:
        prompt = {"sessionId": self.session, "prompt": [{"type": "text", "text": text}]}
        return str((await self.request("session/prompt", prompt))["stopReason"])

    async def cancel(self) -> None:
        await self.obey({"method": "session/cancel", "params": {"sessionId": self.session}})


class TypeScriptInNode(TypeScriptClient):
    """The script in a process of its own."""

    process: asyncio.subprocess.Process

    @classmethod
    @contextlib.asynccontextmanager
    async def open(cls, address: str, token: str) -> AsyncIterator[TypeScriptInNode]:
        node = shutil.which("node")
        assert node is not None, "test.sh finds or installs it"
        client = cls()
        pipe = asyncio.subprocess.PIPE
        client.process = await asyncio.create_subprocess_exec(
            *(node, "--experimental-websocket", str(SCRIPT), address, token), stdin=pipe, stdout=pipe, limit=2**26
        )
        reader = asyncio.create_task(client._read())
        try:
            yield client
        finally:
            assert client.process.stdin is not None
            client.process.stdin.close()
            async with asyncio.timeout(PATIENCE_S):
                await reader
                assert await client.process.wait() == 0

    async def _read(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            self.take(json.loads(line))

    async def obey(self, command: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(command).encode() + b"\n")
        await self.process.stdin.drain()


class TypeScriptInPage(TypeScriptClient):
    """The script in a page of a browser."""

    page: Page

    @classmethod
    async def open(cls, page: Page, address: str, token: str) -> TypeScriptInPage:
        client = cls()
        client.page = page
        await page.expose_function("tell", client.take)
        await page.evaluate("([address, token]) => { window.obey = begin(address, token, tell) }", [address, token])
        return client

    async def obey(self, command: dict[str, Any]) -> None:
        await self.page.evaluate("command => { void obey(command) }", command)


@contextlib.contextmanager
def page_of_another_site(folder: Path) -> Iterator[str]:
    """A page with the script in it, on a server of its own; the origin of that server."""
    bundle = [str(BUNDLER), str(SCRIPT), "--platform", "browser", "--format", "esm", "--file", str(folder / "page.js")]
    subprocess.run(bundle, check=True, capture_output=True, timeout=PATIENCE_S)
    (folder / "index.html").write_text('<!doctype html><script type="module" src="/page.js"></script>')

    class Files(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments, directory=str(folder))

        def log_message(self, format: str, *arguments: Any) -> None:
            """Say nothing."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Files) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


class PythonClient:
    """The Python SDK over its WebSocket stream."""

    connection: ClientSideConnection

    def __init__(self) -> None:
        self.heard: list[dict[str, Any]] = []
        self.questions: list[dict[str, Any]] = []
        self.answers: list[str] = []
        self.withdrawn: list[int] = []
        self.session = ""

    @classmethod
    @contextlib.asynccontextmanager
    async def open(cls, address: str, token: str) -> AsyncIterator[PythonClient]:
        client = cls()
        stream = await create_websocket_stream(address, headers={"Authorization": f"Bearer {token}"})
        client.connection = ClientSideConnection(lambda _: client, stream)  # type: ignore[arg-type, return-value]
        try:
            yield client
        finally:
            await client.connection.close()
            await stream.close()

    # What the SDK calls.

    async def session_update(self, session_id: str, update: Any, **meta: Any) -> None:
        about = update.model_dump(by_alias=True, exclude_none=True)
        self.heard.append({"sessionId": session_id, "update": about, "_meta": meta})

    async def request_permission(
        self, options: list[PermissionOption], session_id: str, tool_call: ToolCallUpdate, **_: Any
    ) -> RequestPermissionResponse:
        self.questions.append({"toolCall": tool_call.model_dump(by_alias=True), "sessionId": session_id})
        option = self.answers.pop(0)
        assert option in [offered.option_id for offered in options]
        return RequestPermissionResponse(outcome=AllowedOutcome(outcome="selected", option_id=option))

    # What a test calls.

    async def initialize(self) -> int:
        hello = await self.connection.initialize(PROTOCOL_VERSION, client_capabilities=ClientCapabilities())
        return int(hello.protocol_version)

    async def new_session(self) -> str:
        self.session = (await self.connection.new_session(cwd="/", mcp_servers=[])).session_id
        return self.session

    async def prompt(self, text: str) -> str:
        prompt = [TextContentBlock(type="text", text=text)]
        return str((await self.connection.prompt(prompt=prompt, session_id=self.session)).stop_reason)

    async def cancel(self) -> None:
        await self.connection.cancel(session_id=self.session)
