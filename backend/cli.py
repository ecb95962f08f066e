"""The `robot-acp` command: one short function for each subcommand. Imports of the layers stay inside them, so that a
command starts only what it needs.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import signal
import sys
from collections.abc import Coroutine, Sequence
from pathlib import Path
from typing import Any

from backend import __version__, config, identity
from backend.identity import Role

TOKEN_DAYS = 7.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status is 2 for settings or arguments that cannot be used."""
    options = _parser().parse_args(arguments)
    try:
        settings = config.load(options.config, **_flags(options))
        _log_to_stderr(settings.log_level)
        return int(options.run(settings, options))
    except config.ConfigError as error:
        print(f"robot-acp: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"robot-acp: {error.strerror or error}", file=sys.stderr)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="robot-acp", description="A robot's LLM agent: ACP upwards, MCP downwards.")
    parser.add_argument("--version", action="version", version=f"robot-acp {__version__}")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings file (default: robot.toml, if it exists)")
    parser.add_argument("--data-dir", type=Path, metavar="DIR", help="where keys and sessions are kept")
    parser.add_argument("--log-level", choices=["debug", "info", "warning", "error"])
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    up = commands.add_parser("up", help="robot server, agent and bridge together, on this machine")
    _robot_flags(up)
    up.add_argument("--model", help="any litellm model name (default: offline/commands)")
    up.add_argument("--port", type=int, help="where the dashboard is served (default: 8080)")
    up.set_defaults(run=_up)

    robot = commands.add_parser("robot", help="the robot server: MCP tools, safety, telemetry, stop")
    _robot_flags(robot)
    robot.add_argument("--stdio", action="store_true", help="speak MCP on stdin and stdout")
    robot.set_defaults(run=_robot)

    agent = commands.add_parser("agent", help="the ACP agent: sessions, permissions, the loop")
    agent.add_argument("--model", help="any litellm model name (default: offline/commands)")
    agent.add_argument("--robot-url", help="MCP URL of the robot server, or stdio:COMMAND")
    agent.add_argument("--stdio", action="store_true", help="speak ACP on stdin and stdout")
    agent.set_defaults(run=_agent)

    bridge = commands.add_parser("bridge", help="the web side: dashboard, login, ACP over WebSocket, scene")
    bridge.add_argument("--agent", help="tcp://HOST:PORT or stdio:COMMAND (default: the agent of robot.toml)")
    bridge.add_argument("--port", type=int, help="where the dashboard is served (default: 8080)")
    bridge.set_defaults(run=_bridge)

    chat = commands.add_parser("chat", help="talk to the robot in this terminal")
    chat.add_argument("address", nargs="?", help="tcp://HOST:PORT or ws://HOST:PORT/acp (default: the local agent)")
    chat.add_argument("--session", metavar="ID", help="join this session; `last` joins the newest")
    chat.add_argument("--token", help="login token (or the variable ROBOT_ACP_TOKEN)")
    chat.add_argument("--json", action="store_true", help="print every message of the agent as one line of JSON")
    chat.set_defaults(run=_chat)

    token = commands.add_parser("token", help="login tokens")
    token_commands = token.add_subparsers(title="commands", required=True, metavar="COMMAND")
    create = token_commands.add_parser("create", help="print a new login token")
    create.add_argument("--name", required=True, help="who it is for")
    create.add_argument("--role", required=True, choices=[role.value for role in Role])
    create.add_argument("--days", type=float, default=TOKEN_DAYS, help="how long it is valid (default: 7)")
    create.set_defaults(run=_token_create)
    return parser


def _robot_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--time-scale", type=float, metavar="N", help="simulated time runs N times faster")
    parser.add_argument("--world", help="a built-in world, or a folder with map.yaml and places.yaml")


def _flags(options: argparse.Namespace) -> dict[str, Any]:
    """The flags that were given, in the shape of the settings."""
    is_bridge = options.run in (_up, _bridge)
    wanted = {
        ("data_dir",): getattr(options, "data_dir", None),
        ("log_level",): getattr(options, "log_level", None),
        ("robot", "time_scale"): getattr(options, "time_scale", None),
        ("robot", "world"): getattr(options, "world", None),
        ("agent", "model"): getattr(options, "model", None),
        ("agent", "robot_url"): getattr(options, "robot_url", None),
        ("bridge", "agent"): getattr(options, "agent", None),
        ("bridge", "port"): getattr(options, "port", None) if is_bridge else None,
    }
    flags: dict[str, Any] = {}
    for path, value in wanted.items():
        if value is not None:
            section = flags
            for name in path[:-1]:
                section = section.setdefault(name, {})
            section[path[-1]] = value
    return flags


def _up(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.up import run

    return asyncio.run(run(settings, options.config))


def _robot(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.mcp_robot.server import serve

    return _until_signal(serve(settings, stdio=options.stdio))


def _agent(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.agent.server import serve

    return _until_signal(serve(settings, stdio=options.stdio))


def _bridge(settings: config.Settings, _options: argparse.Namespace) -> int:
    from backend.bridge.server import serve

    return _until_signal(serve(settings))


def _chat(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.chat.app import run

    return asyncio.run(run(settings, options.address, options.session, options.token, options.json))


def _token_create(settings: config.Settings, options: argparse.Namespace) -> int:
    key = identity.shared_secret(settings.data_dir, identity.SIGNING_KEY)
    print(identity.issue(key, options.name, Role(options.role), options.days * 86400))
    return 0


def _until_signal(work: Coroutine[Any, Any, None]) -> int:
    """Run until the work ends, or SIGINT or SIGTERM cancels it: everything is closed in order either way."""

    async def run() -> None:
        task = asyncio.ensure_future(work)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, task.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            await task

    asyncio.run(run())
    return 0


def _log_to_stderr(level: str) -> None:
    logging.basicConfig(
        level=level.upper(), stream=sys.stderr, format="%(asctime)s %(levelname)-7s %(name)s: %(message)s"
    )
    for noisy in ("httpx", "httpx2", "httpcore", "httpcore2", "mcp", "websockets", "LiteLLM"):
        logging.getLogger(noisy).setLevel(max(logging.WARNING, logging.getLogger().level))


if __name__ == "__main__":
    sys.exit(main())
