"""The MCP server that carries the tools: strict about arguments, and a refusal is an answer.

A refusal becomes a tool error whose text is `code: sentence`, with the same two in the structured content. It knows no
tool and no robot. It builds on private parts of the SDK, which tests/test_mcp_private_parts.py lists.
"""

from __future__ import annotations

import base64
from typing import Any, cast

from mcp.server.lowlevel import Server
from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.utilities.func_metadata import ArgModelBase
from mcp_types import (
    AudioContent,
    CallToolResult,
    ImageContent,
    InputRequiredResult,
    TextContent,
    ToolAnnotations,
)
from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.tools import watchdog

READ_ONLY = ToolAnnotations(read_only_hint=True, destructive_hint=False, idempotent_hint=True, open_world_hint=False)
"""The annotations of a tool that changes nothing."""
ACTS = ToolAnnotations(read_only_hint=False, destructive_hint=False, idempotent_hint=False, open_world_hint=True)
"""Those of a tool that acts on the robot or the world around it."""
ACTS_IDEMPOTENTLY = ToolAnnotations(
    read_only_hint=False, destructive_hint=False, idempotent_hint=True, open_world_hint=True
)
"""Those of a tool that acts, and whose second call with the same arguments changes nothing more."""


class RobotServer(MCPServer[Any]):
    """An MCP server whose arguments have to fit the published schema to the letter.

    `callers` are the clients that have named themselves while one of their calls acts: the watchdog listens for them.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.callers = watchdog.Callers()

    @property
    def core(self) -> Server[Any]:
        """The SDK's low-level server, for a transport of our own."""
        return self._lowlevel_server

    async def call_tool(
        self, name: str, arguments: dict[str, Any], context: Context[Any, Any] | None = None
    ) -> CallToolResult | InputRequiredResult:
        """Call a tool. A refusal and arguments that do not fit are results with `is_error`, not exceptions."""
        caller = watchdog.caller(context.request_context.meta) if context else None
        if caller:
            self.callers.hear(caller)
        try:
            return await super().call_tool(name, arguments, context)
        except ToolError as error:
            cause = error.__cause__
            if isinstance(cause, ValidationError):
                cause = Refusal("bad_arguments", _complaint(cause))
            if not isinstance(cause, Refusal):
                raise
            return CallToolResult(
                content=[TextContent(type="text", text=str(cause))],
                structured_content={"error": {"code": cause.code, "message": cause.sentence}},
                is_error=True,
            )

    def enforce_schemas(self) -> None:
        """From here on, arguments have to be what the tools' schemas say: no text where a number belongs, no flag where
        a number belongs, no unknown names. Tools that are added later are not covered."""
        for tool in self._tool_manager.list_tools():
            strict = ConfigDict(strict=True, extra="forbid", title=tool.fn_metadata.arg_model.__name__)
            model = cast("type[ArgModelBase]", create_model(tool.name, __base__=tool.fn_metadata.arg_model))
            model.model_config.update(strict)
            model.model_rebuild(force=True)
            tool.fn_metadata.arg_model = model
            tool.parameters = model.model_json_schema(by_alias=True)


def _complaint(error: ValidationError) -> str:
    parts = [f"{'.'.join(map(str, e['loc'])) or 'arguments'}: {e['msg'].lower()}" for e in error.errors()]
    return "; ".join(parts) + "."


def image(jpeg: bytes) -> ImageContent:
    """A JPEG picture as MCP content."""
    return ImageContent(type="image", data=base64.b64encode(jpeg).decode(), mime_type="image/jpeg")


def audio(wav: bytes) -> AudioContent:
    """A WAV sound as MCP content."""
    return AudioContent(type="audio", data=base64.b64encode(wav).decode(), mime_type="audio/wav")


def with_content(facts: BaseModel, content: ImageContent | AudioContent) -> CallToolResult:
    """A result with a picture or a sound: `facts` are its structured content, and its text for clients that show only
    content."""
    return CallToolResult(
        content=[content, TextContent(type="text", text=facts.model_dump_json(indent=2))],
        structured_content=facts.model_dump(mode="json"),
    )
