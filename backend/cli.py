"""The `robot-acp` command: its arguments, and one short function for each subcommand.

Imports are made where they are needed, so that a command loads nothing else: `--help` takes a fraction of a second, and
`robot-acp bridge` never loads the agent.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Coroutine, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from backend import __version__, audit_command, sessions_command, token_commands

if TYPE_CHECKING:
    from backend import config
    from backend.gateway.remote import Address

LISTEN_PORT = 9200


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status: 2 for settings or arguments that cannot be used."""
    options = _parser().parse_args(arguments)
    from backend import config, private_files, tokens  # after the parser, so that `--help` does not wait for them

    try:
        settings = config.load(options.config, **_flags(options))
        _log_to_stderr(settings.log_level)
        return int(options.run(settings, options))
    except (config.ConfigError, tokens.RegistryError, private_files.UnsafeFile) as error:
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

    demo = commands.add_parser("ros2-demo", help="a stand-in for a ROS 2 robot: the simulator behind ROS nodes")
    demo.add_argument("--time-scale", type=float, metavar="N", help="simulated time runs N times faster")
    demo.add_argument("--world", help="a built-in world, or a folder with map.yaml and places.yaml")
    demo.set_defaults(run=_ros2_demo)

    doctor = commands.add_parser("doctor", help="what of all this works here, what is missing, and what to do")
    doctor.add_argument("--robot", choices=["simulator", "ros2"], help="which robot it is (default: of the settings)")
    doctor.set_defaults(run=_doctor)

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
    chat.add_argument(
        "--token", help="login token; other users of this computer can see it here, so rather set ROBOT_ACP_TOKEN"
    )
    chat.add_argument("--json", action="store_true", help="print every message of the agent as one line of JSON")
    chat.add_argument(
        "--telemetry", action="store_true", help="show the robot's state: battery, speed, pose, who has it"
    )
    chat.set_defaults(run=_chat)

    connect = commands.add_parser("connect", help="be a stdio agent for an editor: messages go to a remote robot")
    _remote_flags(connect)
    connect.set_defaults(run=_connect)

    listen = commands.add_parser("listen", help="be a TCP agent on this machine: messages go to a remote robot")
    _remote_flags(listen)
    listen.add_argument("--port", type=int, default=LISTEN_PORT, help="on 127.0.0.1 (default: 9200)")
    listen.set_defaults(run=_listen)

    token_commands.add_to(commands)
    audit_command.add_to(commands)

    sessions = commands.add_parser("sessions", help="the log of sessions, for those who run the robot")
    sessions_command.add_commands(sessions)
    return parser


def _remote_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "address", nargs="?", help="wss://HOST/acp, ws://HOST:PORT/acp or tcp://HOST:PORT (default: the local bridge)"
    )
    parser.add_argument(
        "--token", help="login token; other users of this computer can see it here, so rather set ROBOT_ACP_TOKEN"
    )


def _robot_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--time-scale", type=float, metavar="N", help="simulated time runs N times faster")
    parser.add_argument("--robot", choices=["simulator", "ros2"], help="which robot it is (default: simulator)")
    parser.add_argument(
        "--ros2-demo", action="store_true", default=None, help="the ROS 2 robot is a stand-in: the simulator behind ROS"
    )
    parser.add_argument("--world", help="a built-in world, or a folder with map.yaml and places.yaml")


def _flags(options: argparse.Namespace) -> dict[str, Any]:
    """The given flags as nested dicts, in the structure of the settings."""
    is_bridge = options.run in (_up, _bridge)
    values = {
        ("data_dir",): getattr(options, "data_dir", None),
        ("log_level",): getattr(options, "log_level", None),
        ("robot", "time_scale"): getattr(options, "time_scale", None),
        ("robot", "world"): getattr(options, "world", None),
        ("robot", "kind"): "ros2" if getattr(options, "ros2_demo", None) else getattr(options, "robot", None),
        ("robot", "ros2", "demo"): getattr(options, "ros2_demo", None),
        ("agent", "model"): getattr(options, "model", None),
        ("agent", "robot_url"): getattr(options, "robot_url", None),
        ("bridge", "agent"): getattr(options, "agent", None),
        ("bridge", "port"): getattr(options, "port", None) if is_bridge else None,
    }
    flags: dict[str, Any] = {}
    for path, value in values.items():
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


def _ros2_demo(settings: config.Settings, _options: argparse.Namespace) -> int:
    from backend.mcp_robot.ros2.demo.start import serve

    return _until_signal(serve(settings))


def _doctor(settings: config.Settings, _options: argparse.Namespace) -> int:
    from backend.doctor import run

    return asyncio.run(run(settings))


def _agent(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.agent.server import serve

    return _until_signal(serve(settings, stdio=options.stdio))


def _bridge(settings: config.Settings, _options: argparse.Namespace) -> int:
    from backend.bridge.server import serve

    return _until_signal(serve(settings))


def _chat(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.chat.app import run

    return asyncio.run(
        run(
            settings,
            options.address,
            options.session,
            options.token,
            as_json=options.json,
            telemetry=options.telemetry,
        )
    )


def _connect(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.gateway.connect import run

    return _until_signal(run(_remote(settings, options)))


def _listen(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend.config import ConfigError
    from backend.gateway.listen import serve

    if not 0 <= options.port <= 65535:
        raise ConfigError(f"--port: {options.port} is no port.")
    return _until_signal(serve(_remote(settings, options), options.port))


def _remote(settings: config.Settings, options: argparse.Namespace) -> Address:
    from backend import local_user
    from backend.gateway.remote import Address

    token = options.token or os.environ.get("ROBOT_ACP_TOKEN")
    if not options.address:
        return Address.of_local_bridge(settings, token)
    return Address.parse(options.address, token or local_user.token_for(options.address, settings))


def _until_signal(work: Coroutine[Any, Any, int | None]) -> int:
    """Run `work` until it ends, or until SIGINT or SIGTERM cancels it. Either way it closes what it has opened."""

    async def run() -> int:
        task = asyncio.ensure_future(work)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, task.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            return await task or 0
        return 0

    return asyncio.run(run())


class LogLine(logging.Formatter):
    """A record as one line, whatever texts of other people are in it; a traceback follows on lines of its own."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - the base class's name
        from backend.visible import visible

        record.message = visible(record.message)
        return super().formatMessage(record)


def _log_to_stderr(level: str) -> None:
    to_stderr = logging.StreamHandler(sys.stderr)
    to_stderr.setFormatter(LogLine("%(asctime)s %(levelname)-7s %(name)s: %(message)s"))
    logging.basicConfig(level=level.upper(), handlers=[to_stderr])
    for name in ("httpx", "httpx2", "httpcore", "httpcore2", "mcp", "websockets", "LiteLLM"):
        logging.getLogger(name).setLevel(max(logging.WARNING, logging.getLogger().level))


if __name__ == "__main__":
    sys.exit(main())
