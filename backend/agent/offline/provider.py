"""Makes the command grammar a provider of litellm. Everything about commands is in `commands`."""

from __future__ import annotations

import json
import re
from collections.abc import AsyncIterator, Iterator
from typing import Any

from backend.agent.offline.commands import Reply, respond

CONTEXT_WORDS = 100_000


def register(litellm: Any) -> None:
    """Add the provider `offline` to litellm."""

    class Commands(litellm.CustomLLM):  # type: ignore[misc] # litellm is untyped and loaded late
        """The four ways in which litellm runs a provider."""

        def completion(self, *_args: Any, **kwargs: Any) -> Any:
            return _whole(litellm, kwargs)

        async def acompletion(self, *_args: Any, **kwargs: Any) -> Any:
            return _whole(litellm, kwargs)

        def streaming(self, *_args: Any, **kwargs: Any) -> Iterator[Any]:
            return _chunks(kwargs)

        async def astreaming(self, *_args: Any, **kwargs: Any) -> AsyncIterator[Any]:
            for chunk in _chunks(kwargs):
                yield chunk

    litellm.custom_provider_map = [{"provider": "offline", "custom_handler": Commands()}]
    litellm.register_model(
        {
            "offline/commands": {
                "litellm_provider": "offline",
                "mode": "chat",
                "max_input_tokens": CONTEXT_WORDS,
                "supports_function_calling": True,
            }
        }
    )


def _reply(kwargs: dict[str, Any]) -> tuple[Reply, dict[str, int]]:
    messages = kwargs["messages"]
    reply = respond(messages, (kwargs.get("optional_params") or {}).get("tools") or [])
    words = sum(len(str(m.get("content") or "").split()) for m in messages)
    said = len(reply.text.split())
    return reply, {"prompt_tokens": words, "completion_tokens": said, "total_tokens": words + said}


def _chunks(kwargs: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The reply word by word, then the tool calls, as litellm's generic streaming chunks."""
    reply, usage = _reply(kwargs)
    for word in re.findall(r"\S+\s*|\s+", reply.text):
        yield _chunk(text=word)
    for index, (name, arguments) in enumerate(reply.calls):
        function = {"name": name, "arguments": json.dumps(arguments, ensure_ascii=False)}
        tool_use = {"id": f"call_{index}", "type": "function", "index": index, "function": function}
        yield _chunk(tool_use=tool_use)
    finish = "tool_calls" if reply.calls else "stop"
    yield _chunk() | {"is_finished": True, "finish_reason": finish, "usage": usage}


def _chunk(text: str = "", tool_use: dict[str, Any] | None = None) -> dict[str, Any]:
    return {
        "text": text,
        "tool_use": tool_use,
        "is_finished": False,
        "finish_reason": "",
        "usage": None,
        "index": 0,
    }


def _whole(litellm: Any, kwargs: dict[str, Any]) -> Any:
    reply, usage = _reply(kwargs)
    response = litellm.ModelResponse(model=kwargs.get("model"))
    response.choices[0].message.content = reply.text or None
    response.choices[0].finish_reason = "tool_calls" if reply.calls else "stop"
    if reply.calls:
        response.choices[0].message.tool_calls = [
            litellm.ChatCompletionMessageToolCall(
                id=f"call_{index}",
                type="function",
                function={"name": name, "arguments": json.dumps(arguments, ensure_ascii=False)},
            )
            for index, (name, arguments) in enumerate(reply.calls)
        ]
    response.usage = litellm.Usage(**usage)
    return response
