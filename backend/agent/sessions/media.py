"""An event without its photos, sounds and files: plain functions over its JSON, for retention."""

from __future__ import annotations

from typing import Any

import orjson

from backend.agent.acp import updates

_NAMES = {"image": "photo", "audio": "sound"}


def without_media(raw: bytes) -> bytes | None:
    """The update with a sentence in place of each photo, sound and file; None where it contains none."""
    update = orjson.loads(raw)
    content = update.get("content")
    if isinstance(content, dict):
        found = _sentence(content)
        if found is None:
            return None
        return orjson.dumps(update | {"content": updates.text_block(found)})
    if not isinstance(content, list):
        return None
    sentences = [_sentence(item.get("content")) if isinstance(item, dict) else None for item in content]
    if not any(sentences):
        return None
    items = [
        item | {"content": updates.text_block(sentence)} if sentence else item
        for item, sentence in zip(content, sentences, strict=True)
    ]
    return orjson.dumps(update | {"content": items})


def _sentence(block: Any) -> str | None:
    """What takes the place of a block that is a photo, a sound or a file; None for any other block."""
    if not isinstance(block, dict):
        return None
    resource = block.get("resource")
    is_file = block.get("type") == "resource" and isinstance(resource, dict) and "blob" in resource
    name = "file" if is_file else _NAMES.get(str(block.get("type")))
    return f"[This {name} is no longer kept.]" if name else None
