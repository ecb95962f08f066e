"""The connection to one MCP server and its tools: made once, tools listed once, made anew when it breaks.

It knows MCP and nothing of what the tools do: the server may be the robot's or one that a client brought. It never logs
a header, which can be a secret. It rests on private parts of the SDK, which tests/test_mcp_private_parts.py lists.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import logging
import re
import shlex
import string
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast
from urllib.parse import urlsplit

import anyio
import httpx2
import mcp
import mcp_types
import orjson
from mcp.client.stdio import StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared._httpx_utils import MCP_DEFAULT_SSE_READ_TIMEOUT, MCP_DEFAULT_TIMEOUT
from mcp.shared.exceptions import MCPError

from backend import meta as keys
from backend.agent.control.policy import ToolTraits
from backend.agent.robot import sign_of_life
from backend.robot_address import without_login
from backend.robot_server import tls_context
from backend.visible import visible

log = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 5.0
"""How long connecting to a server, or its answer to a check, may take."""
START_TIMEOUT_S = 30.0
"""The same for a server that is a command: a busy computer needs long to start one, and each try starts it anew."""
PARTING_TIMEOUT_S = 5.0
"""How long closing a connection may take; after that it goes on in the background."""
MAX_RESULT_BYTES = 12 * 1024 * 1024
"""A spoken sentence is returned as sound: half a minute of it is over the SDK's own limit of one MiB."""


MAX_TITLE_CHARS = 1000
MAX_TOOLS = 500
"""Of one server."""
MAX_READINGS = 4
"""So many calls of reading tools run at once. One connection carries all calls, and a cancel waits behind those that
were sent before it: behind hundreds, the robot moved on for 0.15 s."""


class ServerUnavailable(Exception):
    """The MCP server does not answer; the text says which, and what to do."""


@dataclass(frozen=True)
class Progress:
    """How far a call is: `fraction` from 0 to 1 where known, and words for people."""

    fraction: float | None
    message: str


@dataclass(frozen=True)
class ToolResult:
    """What a call returned: ACP content blocks for people, structured output for programs."""

    failed: bool
    content: list[dict[str, Any]]
    structured: Any

    @property
    def text(self) -> str:
        """The text blocks, joined."""
        return " ".join(block["text"] for block in self.content if block["type"] == "text")


@dataclass(frozen=True)
class Tool:
    """One tool as its server describes it."""

    name: str
    description: str
    parameters: dict[str, Any]
    title: str
    title_template: str | None
    read_only: bool | None
    server: str | None = None
    """The offered server that it belongs to; None for the robot's own."""
    sign_of_life: sign_of_life.Asked | None = None
    preview: str | None = None
    """The flag with which the tool only computes what it would do, if its server says that it has one."""
    fingerprint: str = ""
    """What an answer for a whole session counts for: the hash of the server's address, the tool's name there and its
    input schema. Empty for a tool of the agent's own."""

    @property
    def traits(self) -> ToolTraits:
        """The traits by which the policy decides."""
        return ToolTraits(self.name, self.read_only, self.can_preview)

    @property
    def can_preview(self) -> bool:
        """Whether it can be called to compute only and do nothing. Only the robot's own server is believed in this."""
        return self.server is None and self.preview is not None

    @property
    def schema(self) -> dict[str, Any]:
        """The tool in the form that litellm takes."""
        function = {"name": self.name, "description": self.description, "parameters": self.parameters}
        return {"type": "function", "function": function}

    def title_for(self, arguments: dict[str, Any]) -> str:
        """A title for people of a call with these arguments, on one line, without invisible characters.

        People allow the call by this title, so a title that is cut says how much is missing.
        """
        title = visible(self._title_for(arguments))
        more = len(title) - MAX_TITLE_CHARS
        return title if more <= 0 else f"{title[:MAX_TITLE_CHARS]}… ({more} more characters)"

    def _title_for(self, arguments: dict[str, Any]) -> str:
        if self.title_template:
            with contextlib.suppress(KeyError, ValueError, IndexError, AttributeError, TypeError):
                return _PlainFormatter().format(self.title_template, **arguments)
        shown = ", ".join(f"{key} {value}" for key, value in arguments.items())
        return f"{self.title}: {shown}" if shown else self.title


class _PlainFormatter(string.Formatter):
    """Format strings come from a server: plain names only, no attributes, no indices."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        return kwargs[field_name], field_name

    def format_field(self, value: Any, format_spec: str) -> Any:
        if any(int(number) > MAX_TITLE_CHARS for number in re.findall(r"\d+", format_spec[:MAX_TITLE_CHARS])):
            raise ValueError(f"a width of more than {MAX_TITLE_CHARS} characters")
        return super().format_field(value, format_spec)


ProgressCallback = Callable[[Progress], None]


class McpClient:
    """The connection to one MCP server: an `http(s)://` URL, which gets the `headers`, or `stdio:COMMAND`.

    `absent` is the sentence for people when the server does not answer; `connect_timeout` is in s. `by_proxy` says
    whether a proxy of the environment may be on the way. For the robot's own server none may: it would get the secret
    in the headers, and could delay a cancel.
    """

    def __init__(
        self,
        url: str,
        headers: Mapping[str, str] | None = None,
        *,
        absent: str,
        connect_timeout: float = CONNECT_TIMEOUT_S,
        by_proxy: bool = False,
    ) -> None:
        self._url = url
        self._command = url.removeprefix("stdio:") if url.startswith("stdio:") else None
        self._headers = dict(headers or {})
        self._absent = absent
        self._by_proxy = by_proxy
        self._connect_timeout = START_TIMEOUT_S if self._command else connect_timeout
        self._answer_timeout = connect_timeout
        self._closed = False
        self._lock = asyncio.Lock()
        self._client: mcp.Client | None = None
        self._lost = asyncio.Event()
        self._owner: asyncio.Task[None] | None = None
        self._tools: dict[str, Tool] = {}
        self._readings = asyncio.Semaphore(MAX_READINGS)

    async def close(self) -> None:
        """Disconnect for good: later calls are refused as if the server were gone."""
        self._closed = True
        async with self._lock:
            await self._drop()

    async def tools(self) -> dict[str, Tool]:
        """The tools by name. Raises `ServerUnavailable`."""
        await self._connected()
        return self._tools

    async def call(
        self,
        name: str,
        arguments: dict[str, Any],
        on_progress: ProgressCallback | None = None,
        meta: Mapping[str, Any] | None = None,
    ) -> ToolResult:
        """Run a tool to its end; `meta` goes with the call. Cancelling this cancels the tool, which halts a robot.

        Raises `ServerUnavailable` when the server is gone; a tool that fails is a result with `failed`.
        """
        client = await self._connected()
        tool = self._tools.get(name)
        if tool is None or tool.read_only is not True:
            return await self._call(client, name, arguments, on_progress, meta)
        async with self._readings:
            return await self._call(client, name, arguments, on_progress, meta)

    async def _call(
        self,
        client: mcp.Client,
        name: str,
        arguments: dict[str, Any],
        on_progress: ProgressCallback | None,
        meta: Mapping[str, Any] | None,
    ) -> ToolResult:
        async def report(progress: float, total: float | None, message: str | None) -> None:
            if on_progress:
                on_progress(Progress(progress / total if total else None, message or ""))

        try:
            async with sign_of_life.given(client, self._sign_asked_by(name)) as sign:
                both = cast("mcp_types.RequestParamsMeta", {**(meta or {}), **(sign or {})})
                result = await client.call_tool(name, arguments, progress_callback=report, meta=both or None)
        except (MCPError, RuntimeError) as error:
            if await self._still_there(client):  # disconnecting would end its other calls, such as a drive
                return ToolResult(True, [{"type": "text", "text": _refusal(error)}], None)
            await self._forget(client)
            raise self._unavailable() from error
        except (OSError, anyio.ClosedResourceError, anyio.BrokenResourceError) as error:
            await self._forget(client)
            raise self._unavailable() from error
        content = [shown for block in result.content if (shown := _as_acp(block))]
        return ToolResult(result.is_error, content, result.structured_content)

    def _sign_asked_by(self, name: str) -> sign_of_life.Asked | None:
        """The sign of life that a tool asks for. It is given only by a read-only tool: no other may be called
        unasked."""
        tool = self._tools.get(name)
        asked = tool.sign_of_life if tool else None
        cheap = self._tools.get(asked.tool) if asked else None
        return asked if cheap and cheap.read_only else None

    async def _connected(self) -> mcp.Client:
        async with self._lock:
            if self._closed:
                raise ServerUnavailable(self._absent)
            if self._client is None:
                await self._connect()
            assert self._client is not None  # noqa: S101 - `_connect` sets it or raises
            return self._client

    async def _connect(self) -> None:
        """Start the task that owns the connection, and wait until it is made.

        The client's task group must be entered and left by one and the same task, hence the owner.
        """
        ready: asyncio.Future[mcp.Client] = asyncio.get_running_loop().create_future()
        self._lost = asyncio.Event()
        self._owner = asyncio.create_task(self._own(ready, self._lost), name="mcp connection")
        try:
            async with asyncio.timeout(self._connect_timeout):
                self._client = await asyncio.shield(ready)
        except BaseException as error:  # also when this task is cancelled: the owner must not outlive it
            await self._drop()
            if isinstance(error, Exception):
                raise self._unavailable() from error
            raise

    async def _own(self, ready: asyncio.Future[mcp.Client], lost: asyncio.Event) -> None:
        try:
            async with (
                self._transport() as transport,
                mcp.Client(transport, read_timeout_seconds=None) as client,
            ):
                self._tools = {tool.name: tool for tool in await _list(client, _origin(self._url))}
                ready.set_result(client)
                await lost.wait()
        except Exception as error:
            if not ready.done():
                ready.set_exception(error)
            else:
                log.info("the connection to an MCP server broke: %s", type(error).__name__)

    @contextlib.asynccontextmanager
    async def _transport(self) -> AsyncIterator[Any]:
        if self._command:
            command, *arguments = shlex.split(self._command)
            yield stdio_client(StdioServerParameters(command=command, args=arguments))
        else:
            timeout = httpx2.Timeout(MCP_DEFAULT_TIMEOUT, read=MCP_DEFAULT_SSE_READ_TIMEOUT)
            async with httpx2.AsyncClient(
                headers=self._headers, timeout=timeout, verify=tls_context(), trust_env=self._by_proxy
            ) as http:
                yield streamable_http_client(self._url, http_client=http, max_sse_event_size=MAX_RESULT_BYTES)

    async def _still_there(self, client: mcp.Client) -> bool:
        """Whether the server still answers: this distinguishes a refused call from a lost server."""
        try:
            async with asyncio.timeout(self._answer_timeout):
                await client.list_tools(cache_mode="bypass")
        except Exception:
            return False
        return True

    async def _forget(self, client: mcp.Client) -> None:
        async with self._lock:
            if self._client is client:
                await self._drop()

    async def _drop(self) -> None:
        self._client = None
        owner, self._owner = self._owner, None
        if owner is not None:
            self._lost.set()
            owner.cancel()
            # `wait` never raises the owner's error, but always a cancellation of this task.
            await asyncio.wait([owner], timeout=PARTING_TIMEOUT_S)

    def _unavailable(self) -> ServerUnavailable:
        log.warning("no MCP server at %s", without_login(self._url))
        return ServerUnavailable(self._absent)


def _refusal(error: MCPError | RuntimeError) -> str:
    """Why a call failed at a server that is there. The SDK has no class of its own for a result that does not fit the
    tool's schema, and its words quote the result."""
    return error.message if isinstance(error, MCPError) else "The tool's answer is not what it announced."


def _origin(url: str) -> str:
    """What distinguishes the server from others: its address without user and password, or its command."""
    parts = urlsplit(url)
    return url if url.startswith("stdio:") else f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"


async def _list(client: mcp.Client, origin: str) -> list[Tool]:
    tools: list[Tool] = []
    cursor: str | None = None
    while True:
        page = await client.list_tools(cursor=cursor)
        tools += [_tool(described, origin) for described in page.tools]
        cursor = page.next_cursor
        if cursor is None or not page.tools or len(tools) >= MAX_TOOLS:
            return tools[:MAX_TOOLS]


def _fingerprint(origin: str, described: mcp_types.Tool) -> str:
    identity = orjson.dumps([origin, described.name, described.input_schema], option=orjson.OPT_SORT_KEYS)
    return hashlib.sha256(identity).hexdigest()


def _tool(described: mcp_types.Tool, origin: str) -> Tool:
    notes = described.annotations
    meta = described.meta or {}
    template = meta.get(keys.TITLE)
    title = described.title or (notes and notes.title) or described.name.replace("_", " ").capitalize()
    return Tool(
        name=described.name,
        description=described.description or title,
        parameters=described.input_schema,
        title=title,
        title_template=template if isinstance(template, str) else None,
        read_only=notes.read_only_hint if notes else None,
        sign_of_life=sign_of_life.Asked.of(meta),
        preview=_flag(meta.get(keys.PREVIEW), described.input_schema),
        fingerprint=_fingerprint(origin, described),
    )


def _flag(name: object, schema: Mapping[str, Any]) -> str | None:
    """The flag that a tool's `_meta` names, if the tool has it."""
    flag = (schema.get("properties") or {}).get(name) if isinstance(name, str) else None
    return str(name) if isinstance(flag, dict) and flag.get("type") == "boolean" else None


def _as_acp(block: mcp_types.ContentBlock) -> dict[str, Any] | None:
    """A content block of MCP as one of ACP; None for what people cannot be shown."""
    match block:
        case mcp_types.TextContent(text=text):
            return {"type": "text", "text": text}
        case mcp_types.ImageContent(data=data, mime_type=mime):
            return {"type": "image", "data": data, "mimeType": mime}
        case mcp_types.AudioContent(data=data, mime_type=mime):
            return {"type": "audio", "data": data, "mimeType": mime}
        case _:
            return None
