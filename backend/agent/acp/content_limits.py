"""How much a request may contain: the limit of each text, list and prompt that a client sends to be kept or looked for.

The checks come before the schema's, so that a request that is too large costs no time. Nothing here knows who asks.
"""

from __future__ import annotations

from typing import Any

import orjson
from acp.exceptions import RequestError

from backend import meta as keys
from backend import wire
from backend.agent.acp import commands
from backend.agent.robot.server_addresses import MAX_SERVERS
from backend.config import Storage

MAX_CWD_CHARS = 4096
"""As long as a path may be on Linux."""
MAX_ID_CHARS = 256
"""Of a mode, a model, a setting or its value."""
MAX_SEARCH_CHARS = 1000
MAX_CURSOR_CHARS = 256
MAX_REST_BYTES = 64 * 1024
"""Of all in a prompt that is no text, picture, sound or file: addresses, names, `_meta`."""

_TEXTS = {
    "cwd": MAX_CWD_CHARS,
    "cursor": MAX_CURSOR_CHARS,
    "modeId": MAX_ID_CHARS,
    "modelId": MAX_ID_CHARS,
    "configId": MAX_ID_CHARS,
    "value": MAX_ID_CHARS,
}
_DATA = ("data", "blob")


def check(method: str, params: dict[str, Any], storage: Storage) -> None:
    """Raise `RequestError` where something in the parameters of a request is longer than it may be."""
    for name, limit in _TEXTS.items():
        _check_text(name, params.get(name), limit)
    servers = params.get("mcpServers")
    if isinstance(servers, list) and len(servers) > MAX_SERVERS:
        raise _too_much(f"A session takes at most {MAX_SERVERS} MCP servers; these are {len(servers)}.")
    if method == "session/list" and isinstance(params.get("_meta"), dict):
        _check_text(keys.SEARCH, params["_meta"].get(keys.SEARCH), MAX_SEARCH_CHARS)
    if method == "session/prompt" and isinstance(params.get("prompt"), list):
        _check_prompt(params["prompt"], storage)


def _check_text(name: str, value: object, limit: int) -> None:
    if isinstance(value, str) and len(value) > limit:
        raise _too_much(f"{name} has {len(value)} characters, and at most {limit} are taken.")


def _check_prompt(blocks: list[Any], storage: Storage) -> None:
    if is_stop(blocks):
        return  # a stop is never refused
    if len(blocks) > storage.max_prompt_blocks:
        raise _too_much(
            f"This prompt has {len(blocks)} content blocks, and at most {storage.max_prompt_blocks} are taken. "
            "Send fewer, or several prompts."
        )
    chars = data = rest = 0
    for block in blocks:
        if isinstance(block, dict):
            resource = block.get("resource")
            for part in (block, resource if isinstance(resource, dict) else {}):
                chars += _length(part.get("text"))
                data += sum(_length(part.get(name)) for name in _DATA)
            rest += len(orjson.dumps(_without_content(block)))
    if chars > storage.max_prompt_chars:
        raise _too_much(
            f"The text of this prompt has {chars} characters, and at most {storage.max_prompt_chars} are taken. "
            "Send less of it."
        )
    if data > storage.max_prompt_bytes:
        raise _too_much(
            f"The pictures, sounds and files of this prompt have {data} bytes, and at most {storage.max_prompt_bytes} "
            "are taken. Send smaller or fewer ones."
        )
    if rest > MAX_REST_BYTES:
        raise _too_much(
            f"The names, addresses and _meta of this prompt have {rest} bytes, and at most {MAX_REST_BYTES} are taken."
        )


def is_stop(blocks: list[Any]) -> bool:
    """Whether the prompt is the command `/stop`."""
    texts = [block for block in blocks[:1] if isinstance(block, dict) and isinstance(block.get("text"), str)]
    return bool(texts) and len(blocks) == 1 and commands.named_in(texts) == "stop"


def _without_content(block: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in block.items() if key not in ("text", *_DATA)}
    if isinstance(kept.get("resource"), dict):
        kept["resource"] = {k: v for k, v in kept["resource"].items() if k not in ("text", *_DATA)}
    return kept


def _length(value: object) -> int:
    return len(value) if isinstance(value, str) else 0


def _too_much(text: str) -> RequestError:
    return RequestError(wire.INVALID_PARAMS, text)
