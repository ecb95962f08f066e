"""The private and undocumented parts of the `mcp` package that this program rests on, each with the reason.

A minor version may change any of them, so pyproject.toml allows one minor version alone. Whoever raises it runs this
file first: each test names one part, shows what we expect of it with the real package, and says who needs it.
"""

from __future__ import annotations

import asyncio
import dataclasses
import importlib.metadata
import inspect
import io
import json
import tomllib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, cast

import anyio
import mcp
import mcp_types as types
import pytest
from mcp.client.streamable_http import streamable_http_client
from mcp.server.context import ServerRequestContext
from mcp.server.lowlevel import Server
from mcp.server.mcpserver import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.utilities.func_metadata import ArgModelBase
from mcp.server.session import ServerSession
from mcp.server.stdio import stdio_server
from mcp.shared import _httpx_utils
from mcp.shared.message import ServerMessageMetadata
from pydantic import ConfigDict, ValidationError, create_model

PYPROJECT = Path(__file__).parent.parent / "pyproject.toml"
KNOWN_MINOR = "2.3"


def test_the_pin_allows_only_the_minor_version_that_these_tests_know() -> None:
    dependencies = tomllib.loads(PYPROJECT.read_text())["project"]["dependencies"]
    major, minor = KNOWN_MINOR.split(".")
    assert f"mcp>={KNOWN_MINOR},<{major}.{int(minor) + 1}" in dependencies
    installed = importlib.metadata.version("mcp")
    assert installed.startswith(f"{KNOWN_MINOR}."), f"mcp {installed}: see which of these parts have changed"


def test_the_time_limits_of_http_clients() -> None:
    """mcp_client.py: the transport takes a client of our own making, which has the SDK's time limits for streams."""
    assert _httpx_utils.MCP_DEFAULT_TIMEOUT > 0
    assert _httpx_utils.MCP_DEFAULT_SSE_READ_TIMEOUT >= 60, "streams may be silent for a minute"
    wanted = inspect.signature(streamable_http_client).parameters["http_client"].annotation
    assert "httpx2.AsyncClient" in str(wanted)


def test_the_low_level_server_behind_a_server() -> None:
    """tools/mcp_server.py, `core`: only the low-level server can be run on streams of our own (stdio_transport.py)."""
    core = MCPServer(name="canary")._lowlevel_server
    assert isinstance(core, Server)
    assert list(inspect.signature(core.run).parameters)[:3] == ["read_stream", "write_stream", "initialization_options"]
    assert core.create_initialization_options().server_name == "canary"


async def test_the_argument_model_of_a_tool_can_be_replaced() -> None:
    """tools/mcp_server.py, `enforce_schemas`: the SDK takes "1" for a number and ignores unknown names."""
    server = MCPServer(name="canary")

    @server.tool()
    async def double(number: float) -> float:
        return 2 * number

    (tool,) = server._tool_manager.list_tools()
    assert issubclass(tool.fn_metadata.arg_model, ArgModelBase)
    assert not (await called(server, "double", {"number": "1", "more": 2})).is_error, "no longer needed"
    model = cast("type[ArgModelBase]", create_model("double", __base__=tool.fn_metadata.arg_model))
    model.model_config.update(ConfigDict(strict=True, extra="forbid"))
    model.model_rebuild(force=True)
    tool.fn_metadata.arg_model = model
    tool.parameters = {"title": "replaced"}
    assert (await server.list_tools())[0].input_schema == {"title": "replaced"}
    for arguments in ({"number": "1"}, {"number": 1.0, "more": 2}):
        with pytest.raises(ToolError) as wrong:
            await server.call_tool("double", arguments)
        assert isinstance(wrong.value.__cause__, ValidationError)
    assert not (await called(server, "double", {"number": 1.0})).is_error


async def called(server: MCPServer[Any], name: str, arguments: dict[str, Any]) -> types.CallToolResult:
    result = await server.call_tool(name, arguments)
    assert isinstance(result, types.CallToolResult)
    return result


async def test_a_tool_error_keeps_what_the_tool_raised() -> None:
    """tools/mcp_server.py, `call_tool`: from the cause it makes the result of a refusal."""
    server = MCPServer(name="canary")

    @server.tool()
    async def fail() -> None:
        raise LookupError("nothing there")

    with pytest.raises(ToolError) as failed:
        await server.call_tool("fail", {})
    assert isinstance(failed.value.__cause__, LookupError)


async def test_a_server_calls_tools_by_its_own_method() -> None:
    """tools/mcp_server.py: it overrides `call_tool`, which the SDK's handler of `tools/call` has to go through."""

    class Overriding(MCPServer[Any]):
        async def call_tool(self, name: str, arguments: dict[str, Any], context: Any = None) -> types.CallToolResult:
            return types.CallToolResult(content=[types.TextContent(type="text", text=f"{name} {arguments}")])

    async with mcp.Client(Overriding(name="canary")) as client:
        result = await client.call_tool("any", {"a": 1})
    assert result.content == [types.TextContent(type="text", text="any {'a': 1}")]


def test_what_a_handler_knows_of_its_request() -> None:
    """tools/watchdog.py and long_call.py: the `_meta` of the call, and the HTTP request whose scope says that its
    client has hung up."""
    fields = {field.name for field in dataclasses.fields(ServerRequestContext)}
    assert {"session", "request_id", "meta", "request"} <= fields


def test_the_session_tells_whether_it_may_ask_its_client_and_asks_on_the_stream_of_a_call() -> None:
    """tools/watchdog.py: a ping where the protocol's version allows a server to ask."""
    assert isinstance(inspect.getattr_static(ServerSession, "can_send_request"), property)
    assert {"request", "result_type", "metadata"} <= set(inspect.signature(ServerSession.send_request).parameters)
    assert ServerMessageMetadata(related_request_id=1).related_request_id == 1


async def test_the_stdio_transport_only_iterates_over_its_input() -> None:
    """stdio_transport.py: it hands over an iterator of lines where the SDK's types ask for a file."""
    line = json.dumps({"jsonrpc": "2.0", "id": 1, "method": "ping"})

    async def lines() -> AsyncIterator[str]:
        yield line

    output = anyio.wrap_file(io.StringIO())
    stdin = cast("anyio.AsyncFile[str]", lines())
    async with (
        asyncio.timeout(10),
        stdio_server(stdin=stdin, stdout=output) as (incoming, outgoing),
        incoming,
        outgoing,
    ):
        received = await incoming.receive()
    assert not isinstance(received, Exception)
    assert json.loads(received.message.model_dump_json(exclude_none=True))["method"] == "ping"


async def test_a_result_that_breaks_its_own_schema_is_a_runtime_error() -> None:
    """mcp_client.py, `call`: the SDK has no class of its own for it, and the connection still stands."""
    schema = {"type": "object", "properties": {"x": {"type": "number"}}, "required": ["x"]}

    async def listed(_: Any, __: Any) -> types.ListToolsResult:
        tool = types.Tool(name="lie", input_schema={"type": "object"}, output_schema=schema)
        return types.ListToolsResult(tools=[tool])

    async def lie(_: Any, __: Any) -> types.CallToolResult:
        return types.CallToolResult(content=[], structured_content={"x": "none"})

    async with mcp.Client(Server("canary", on_list_tools=listed, on_call_tool=lie)) as client:
        with pytest.raises(RuntimeError):
            await client.call_tool("lie", {})
        assert (await client.list_tools()).tools
