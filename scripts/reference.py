"""Writes docs/reference/ from the code: the tools, telemetry, HTTP paths, settings and commands, as they are.

`python -m scripts.reference` writes the pages; tests/test_docs.py compares them with what it would write. No row is
kept by hand, but for the sentence about each HTTP path, which the code does not have: a path without a sentence, and a
sentence without a path, is an error.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, get_args

import msgspec
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from starlette.routing import BaseRoute, Route, WebSocketRoute

from backend import cli, config, telemetry
from backend import meta as keys
from backend.audit import Audit
from backend.bridge import app as bridge
from backend.mcp_robot import refusal, robots
from backend.mcp_robot.http.routes import create_app
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.tools import catalogue
from backend.mcp_robot.tools.mcp_server import RobotServer

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "docs/reference"
MADE: Final = "This page is written by `python -m scripts.reference` from {source}; a test fails when the two differ."

ROBOT_PATHS: Final = {
    "GET /health": "Answers without a token: `{status, robot, version}`.",
    "POST /stop": "Sets the stop latch; `{by}` or `?by=` names the person. Answers `{stopped: {by, at}}`.",
    "POST /release": "Releases the stop latch; `{by}` or `?by=` names the person. Answers `{stopped: null}`, or "
    "500 and `{error}` when the latch cannot be removed.",
    "DELETE /preview/{id}": "Takes back the preview of a path. Answers `{preview}`: whether it was drawn.",
    "WebSocket /telemetry": "The [telemetry](telemetry.md): msgpack messages.",
    "GET, POST, DELETE /mcp": "MCP over Streamable HTTP: the [tools](tools.md).",
}
BRIDGE_PATHS: Final = {
    "POST /api/login": "`{token}`, a login token or a one-time code: begins a login and sets its cookie. Answers as "
    "`GET /api/me`, or 429 and `Retry-After` after many wrong logins.",
    "POST /api/logout": "Ends the login of the cookie, wherever it is in use, and removes the cookie.",
    "GET /api/me": "Who is logged in: `{name, role, robot, expires}`.",
    "GET /api/tokens": "The logins that were issued, for supervisors: "
    "`{tokens: [{id, name, role, created, expires, state, own}]}`. `own` is the one that the request uses.",
    "POST /api/tokens": "`{name, role, expires}`: makes a login token, for supervisors. `expires` is `30m`, `12h`, "
    "`7d` or a date; `same_person: true` makes a further one for the person who has the name. Answers "
    "`{token, id, name, role, expires}`: the token is in no other answer.",
    "DELETE /api/tokens/{token_id}": "Revokes a login token, for supervisors; the one that the request uses only with "
    "`?own=true`. Answers `{revoked}`: whether it was valid until now.",
    "POST /api/stop": "Stops the robot, for everyone who is logged in. It needs no agent. Answers "
    "`{stopped: {by, at}}`, or 503 and `{error}` where the robot's server has not confirmed it "
    "([safety](../safety.md#another-robot)).",
    "POST /api/release": "Releases the stop, for supervisors.",
    "GET /api/health": "The state of agent and robot server.",
    "WebSocket /acp": "ACP: one JSON-RPC message a text frame.",
    "WebSocket /camera": "The robot's camera: one JPEG a binary frame ([the scene](../scene.md#the-robots-camera)).",
    "GET /scene": "Redirects to `/scene/`.",
    "GET /scene/": "The page of the live scene.",
    "WebSocket /scene": "The live scene itself, in viser's protocol, one way.",
    "GET /scene/{viewer}": "Redirects to `/scene/{viewer}/`.",
    "GET /scene/{viewer}/": "The scene with a camera of its own ([whose camera](../scene.md#whose-camera)).",
    "WebSocket /scene/{viewer}": "The scene for this viewer.",
    "WebSocket /scene/{viewer}/control": "JSON: where the camera stands, and clicks on the floor.",
    "POST /scene/{viewer}/moved": "The page reports that its viewer has moved the camera.",
}


def pages() -> dict[str, str]:
    """Each page of the folder, by its name."""
    settings = config.Settings.model_construct()  # the defaults: no file and no variable counts
    with tempfile.TemporaryDirectory() as folder:
        settings = settings.model_copy(update={"data_dir": Path(folder)})
        robot = robots.simulated(settings)
        pilot = Pilot(robot, StopLatch(settings.data_dir), settings.robot.limits, [])
        tools = catalogue.build(pilot)
        audit = Audit(settings.data_dir, "robot")
        routes = create_app(pilot, tools, b"token", settings.robot.host, audit).routes
        return {
            "tools.md": _tools_page(tools),
            "telemetry.md": _telemetry_page(),
            "http.md": _http_page(routes, bridge.create_app(settings).routes),
            "settings.md": _settings_page(),
            "command-line.md": _commands_page(),
        }


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


def _joined(parts: list[str]) -> str:
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def _code(value: object) -> str:
    return f"`{value}`"


def _prose(docstring: str | None) -> str:
    return re.sub(r"\s*\n\s*", " ", (docstring or "").strip())


# Tools


def _tools_page(server: RobotServer) -> str:
    tools = asyncio.run(server.list_tools())
    codes = ", ".join(_code(code) for code in get_args(refusal.Code))
    parts = [
        "# The tools of the robot server",
        "For people who write an agent or another MCP client for the robot: each MCP tool with its arguments and its "
        "result. " + MADE.format(source="`backend/mcp_robot/tools/`"),
        "A tool that cannot do its work answers with a tool error. Its text reads `code: sentence`, and its structured "
        'content is `{"error": {"code", "message"}}`. The codes are '
        + codes
        + "; [safety](../safety.md#codes) has the table.",
        _table(
            ("tool", "purpose", "reads only", "preview"),
            [
                (
                    f"[`{tool.name}`](#{tool.name})",
                    _prose(tool.title),
                    _yes(tool.annotations and tool.annotations.read_only_hint),
                    _yes(keys.PREVIEW in (tool.meta or {})),
                )
                for tool in tools
            ],
        ),
        "A tool with *preview* can compute its path and move nothing, with `plan_only`.",
    ]
    parts += [_tool(tool) for tool in tools]
    return _joined(parts)


def _yes(value: object) -> str:
    return "yes" if value else "no"


def _tool(tool: Any) -> str:
    meta = tool.meta or {}
    arguments = list(_properties(tool.input_schema))
    parts = [f"## `{tool.name}`", _prose(tool.description)]
    parts.append("Title for people: " + _code(meta[keys.TITLE]) + ".")
    if sign := meta.get(keys.SIGN_OF_LIFE):
        parts.append(
            f"The robot halts when its caller is silent for {sign['within']:g} s "
            "([losing the client](../safety.md#losing-the-client))."
        )
    parts.append(
        _table(("argument", "type", "needed", "meaning"), arguments) if arguments else "It takes no arguments."
    )
    results = [(name, kind, meaning) for name, kind, _, meaning in _properties(tool.output_schema)]
    parts.append(_table(("result", "type", "meaning"), results))
    return _joined(parts).strip()


def _properties(schema: dict[str, Any], prefix: str = "", root: dict[str, Any] | None = None) -> Iterator[Any]:
    """The rows of a JSON schema: name, type, whether it is required, meaning. Nested objects follow with a dot."""
    root = root or schema
    required = schema.get("required", [])
    for name, field in schema.get("properties", {}).items():
        kind, nested, suffix = _kind(field, root)
        default = f"no, `{_json(field['default'])}`" if "default" in field else "no"
        meaning = field.get("description") or (_prose(nested.get("description")) if nested else "")
        yield _code(prefix + name), kind, "yes" if name in required else default, meaning
        if nested:
            yield from _properties(nested, f"{prefix}{name}{suffix}.", root)


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()


def _kind(field: dict[str, Any], root: dict[str, Any]) -> tuple[str, dict[str, Any] | None, str]:
    """A type in words; the schema of the object that it leads to, if any; and what the name of that gets behind it."""
    if "$ref" in field:
        nested = root["$defs"][field["$ref"].rpartition("/")[2]]
        return ("object", nested, "") if "properties" in nested else _kind(nested, root)
    if "allOf" in field:
        return _kind(field["allOf"][0], root)
    if "anyOf" in field:
        kinds = [_kind(each, root) for each in field["anyOf"]]
        nested, suffix = next(((n, s) for _, n, s in kinds if n), (None, ""))
        return " or ".join(kind for kind, _, _ in kinds), nested, suffix
    if "enum" in field:
        return " or ".join(_code(value) for value in field["enum"]), None, ""
    if field.get("type") == "array":
        kind, nested, _ = _kind(field.get("items", {}), root)
        return f"list of {kind}", nested, "[]"
    longest = f", at most {field['maxLength']} characters" if "maxLength" in field else ""
    return field.get("type", "anything") + longest, None, ""


# Telemetry


def _telemetry_page() -> str:
    messages = [telemetry.Hello, telemetry.Subscribe, *_messages()]
    parts = [
        "# The telemetry of the robot server",
        "For people who write a program that watches the robot: each message of the WebSocket `/telemetry`. "
        + MADE.format(source="`backend/telemetry.py`"),
        "Each frame is one msgpack map, whose `type` names the message. Units are SI. Times are Unix seconds of the "
        "robot's clock. Frames follow REP 103: x forward, y left, counter-clockwise positive. The server sends "
        f"`hello` with version {telemetry.VERSION}; the reader answers with `subscribe` and then receives the channels "
        "that it named. A slow reader receives fewer messages, and never an old one.",
        "## Messages",
    ]
    parts += [_struct(message, "###") for message in messages]
    parts.append("## Parts of messages")
    parts += [_struct(part, "###") for part in _parts()]
    return _joined(parts)


def _messages() -> list[type[msgspec.Struct]]:
    return [each for each in get_args(telemetry.AnyMessage) if each is not telemetry.Hello]


def _parts() -> list[type[msgspec.Struct]]:
    structs = [each for each in vars(telemetry).values() if isinstance(each, type) and issubclass(each, msgspec.Struct)]
    return [each for each in structs if not each.__struct_config__.tag and each is not telemetry.Message]


def _struct(struct: type[msgspec.Struct], level: str) -> str:
    tag = struct.__struct_config__.tag
    rows: list[tuple[str, ...]] = [(_code("type"), _code(f'"{tag}"'), "")] if tag else []
    for field in msgspec.structs.fields(struct):
        default = "" if field.required else _code(_json(_default(field)))
        rows.append((_code(field.name), _code(struct.__annotations__[field.name]), default))
    name = f"`{tag}`" if tag else struct.__name__
    return f"{level} {name}\n\n{_prose(struct.__doc__)}\n\n{_table(('field', 'type', 'default'), rows)}"


def _default(field: Any) -> object:
    return field.default if field.default is not msgspec.NODEFAULT else field.default_factory()


# HTTP


def _http_page(robot: list[BaseRoute], web: list[BaseRoute]) -> str:
    parts = [
        "# HTTP paths",
        "For people who reach the robot server or the bridge by HTTP: each path of the two. "
        + MADE.format(source="the routes of both servers"),
        "## The robot server",
        "Its address is `http://127.0.0.1:8000` by default. Every path but `/health` needs the header "
        "`Authorization: Bearer` with the content of `robot.token` in the data folder. Host and Origin are checked.",
        _paths(robot, ROBOT_PATHS),
        "## The bridge",
        "Its address is `http://127.0.0.1:8080` by default. Every path but the login, the logout, the health, the "
        "redirects and the files of the web app needs a login: the cookie that `POST /api/login` sets, or the header "
        "`Authorization: Bearer` with a login token. A WebSocket may offer the token as the subprotocol "
        "`bearer.TOKEN` instead. All other paths are files of the web app.",
        _paths(web, BRIDGE_PATHS),
    ]
    return _joined(parts)


def _paths(routes: list[BaseRoute], sentences: dict[str, str]) -> str:
    # FastAPI keeps a router that is included as one route, with the router in it.
    flat = [inner for route in routes for inner in getattr(getattr(route, "original_router", None), "routes", [route])]
    found = {_path(route) for route in flat if isinstance(route, Route | WebSocketRoute)}
    if found != set(sentences):
        raise ValueError(f"the sentences about HTTP paths and the routes differ: {sorted(found ^ set(sentences))}")
    return _table(("path", "purpose"), [(_code(path), sentence) for path, sentence in sentences.items()])


def _path(route: Route | WebSocketRoute) -> str:
    if isinstance(route, WebSocketRoute):
        return f"WebSocket {route.path}"
    methods = sorted(set(route.methods or {"GET", "POST", "DELETE"}) - {"HEAD"}, key=("GET", "POST", "DELETE").index)
    return f"{', '.join(methods)} {route.path}"


# Settings


def _settings_page() -> str:
    parts = [
        "# Settings",
        "For people who run a robot: each setting of [robot.toml](../../robot.toml), with its default and what it may "
        "be. " + MADE.format(source="`backend/config.py` and the comments of `robot.toml`"),
        "A variable overrides the file, and a flag of the command overrides both. The variable of `port` under "
        "`[robot]` is `ROBOT_ACP_ROBOT__PORT`: capital letters, and two underscores between the names. An unknown name "
        "is an error.",
    ]
    comments = _comments()
    parts += list(_section(config.Settings, "", comments))
    return _joined(parts)


def _comments() -> dict[tuple[str, str], str]:
    """What robot.toml says about each setting, by section and name; about a section, under the name ""."""
    section, found = "", {}
    for line in (ROOT / "robot.toml").read_text().splitlines():
        if match := re.match(r"(?:# )?\[([a-z0-9_.]+)\]\s*(?:# (.*))?", line):
            section = match[1]
            found[section, ""] = match[2] or ""
        elif match := re.match(r"# (\w+) = (?:\"[^\"]*\"|[^#]*?)\s+# (.*)", line):
            found[section, match[1]] = match[2]
    return found


def _section(model: type[BaseModel], name: str, comments: dict[tuple[str, str], str]) -> Iterator[str]:
    rows, nested = [], []
    for key, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            nested.append((field.annotation, f"{name}.{key}".strip(".")))
        else:
            meaning = _meaning(comments.get((name, key), ""), field.description or "")
            rows.append((_code(key), _setting_type(field), _setting_default(field), meaning))
    yield f"## `[{name}]`" if name else "## At the top of the file"
    yield _prose(model.__doc__) if name else ""
    yield _table(("setting", "type", "default", "meaning"), rows)
    for each, path in nested:
        yield from _section(each, path, comments)


def _meaning(comment: str, description: str) -> str:
    """The comment of robot.toml, but for one that goes on from the value before it."""
    return description if description and comment.startswith(("or ", "beside ")) else comment or description


def _setting_type(field: FieldInfo) -> str:
    annotation = field.annotation
    name = annotation.__name__ if isinstance(annotation, type) and not get_args(annotation) else str(annotation)
    name = re.sub(r"\b(?:backend\.config|pathlib|typing)\.", "", name).replace(" | None", "")
    if choices := re.fullmatch(r"Literal\[(.*)\]", name):
        return " or ".join(_code(choice.strip("' ")) for choice in choices[1].split(","))
    name = name.replace("Literal['allow', 'ask', 'deny']", "Decision")
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤", "min_length": "length ≥", "max_length": "length ≤"}
    limits = [
        f"{sign} {getattr(limit, key)}"
        for limit in field.metadata
        for key, sign in signs.items()
        if hasattr(limit, key)
    ]
    return ", ".join([_code(name), *limits])


def _setting_default(field: FieldInfo) -> str:
    if field.default is PydanticUndefined or field.default is None:
        return ""
    return _code(_json(field.default))


# Commands


def _commands_page() -> str:
    parts = [
        "# The command line",
        "For people who start robot-acp, or one of its processes: each command of `robot-acp` with its arguments. "
        + MADE.format(source="`backend/cli.py`"),
        "After `./run.sh` the command is `.venv/bin/robot-acp`. Its exit status is 2 for arguments or settings that "
        "cannot be used.",
    ]
    parts += list(_command(cli._parser(), "robot-acp", "The options of every command stand before its name."))
    return _joined(parts)


def _command(parser: argparse.ArgumentParser, name: str, about: str) -> Iterator[str]:
    commands = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    rows = [_option(action) for action in parser._actions if action.help != argparse.SUPPRESS and action.dest != "help"]
    rows = [row for row, action in zip(rows, _shown(parser), strict=True) if action not in commands]
    yield f"## `{name}`\n\n{about[:1].upper()}{about[1:].rstrip('.')}."
    if rows:
        yield _table(("argument", "meaning"), rows)
    for action in commands:
        abouts = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for word, command in action.choices.items():
            yield from _command(command, f"{name} {word}", abouts[word])


def _shown(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in parser._actions if action.help != argparse.SUPPRESS and action.dest != "help"]


def _option(action: argparse.Action) -> tuple[str, str]:
    words = action.metavar or ("|".join(map(str, action.choices)) if action.choices else action.dest.upper())
    if not action.option_strings:
        shown = f"[{words}]" if action.nargs == "?" else str(words)
    else:
        shown = action.option_strings[-1] + ("" if action.nargs == 0 else f" {words}")
    needed = " (needed)" if action.option_strings and action.required else ""
    return _code(shown) + needed, (action.help or "").replace("%(default)s", str(action.default))


def main() -> int:
    """Write the pages."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / name).write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
