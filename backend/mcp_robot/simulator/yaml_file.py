"""Reads a YAML file of a world as a model. The file is outside input: it is checked here once.

An error names the file, the place in it and the reason, on few lines. Whatever the file holds, reading it takes limited
time and memory. Nothing is written.
"""

from __future__ import annotations

from collections.abc import Hashable
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from backend.config import ConfigError

Model = TypeVar("Model", bound=BaseModel)

MAX_BYTES = 500_000
"""The largest file: some thousand places. PyYAML needs about 5 s for it."""
MAX_DEPTH = 20
"""Lists and maps within each other."""
SHOWN = 8
"""Mistakes that one error lists."""
_NOT_KNOWN = "there is no such key; look for a typing mistake"


class WorldError(ConfigError):
    """A world that cannot be used; the text names the file and the reason."""


def is_there(file: Path) -> bool:
    """Whether there is anything of this name: also a folder, or a link to nothing, which then cannot be read."""
    try:
        return file.exists() or file.is_symlink()
    except OSError as error:
        raise WorldError(f"{file} cannot be read: {error.strerror}.") from None


def read(file: Path, model: type[Model]) -> Model:
    """The file as this model. Raises `WorldError`."""
    text = _text(file)
    try:
        content: Any = yaml.load(text, _Loader)  # noqa: S506 - a SafeLoader
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise WorldError(f"{file} is not valid YAML: {where}{error.problem}.") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # a character, date or number that Python cannot have
        reason = str(error).splitlines()[0]
        raise WorldError(f"{file} is not valid YAML: {reason}.") from None
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise WorldError(f"{file} cannot be used:\n" + "\n".join(_mistakes(error))) from None


def _text(file: Path) -> str:
    try:
        if is_there(file) and not file.is_file():
            raise WorldError(f"{file} cannot be read: it is no file.")
        with file.open("rb") as opened:
            content = opened.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise WorldError(f"{file} is larger than {MAX_BYTES} bytes, the most that is read.")
        return content.decode("utf-8-sig")
    except FileNotFoundError:
        raise WorldError(f"{file} is missing.") from None
    except OSError as error:
        raise WorldError(f"{file} cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise WorldError(f"{file} cannot be read: it is no text in UTF-8.") from None


def _mistakes(error: ValidationError) -> list[str]:
    every = error.errors(include_url=False, include_context=False, include_input=False)
    lines = []
    for each in every[:SHOWN]:
        where = ".".join(map(str, each["loc"]))[:200] or "file"
        lines.append(f"  {where}: {_NOT_KNOWN if each['type'] == 'extra_forbidden' else each['msg']}")
    if len(every) > SHOWN:
        lines.append(f"  and {len(every) - SHOWN} more")
    return lines


class _Loader(yaml.SafeLoader):
    """YAML without aliases, which can make a small file endless; without a key that is there twice, of which only the
    last would count; and without depth, at which Python ends."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0  # of the node that is being composed

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        mark: Any = event.start_mark
        if isinstance(event, yaml.AliasEvent):
            problem = f"aliases such as *{event.anchor} are not read; write it out"
            raise yaml.composer.ComposerError(None, None, problem, mark)
        if self._depth >= MAX_DEPTH:
            raise yaml.composer.ComposerError(None, None, f"more than {MAX_DEPTH} levels", mark)
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key, _ in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else None
            mark: Any = key.start_mark
            if name is not None and name in seen:
                raise yaml.constructor.ConstructorError(None, None, f"the key {name[:80]} is there twice", mark)
            seen.add(name)
        return super().construct_mapping(node, deep)
