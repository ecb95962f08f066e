"""`robot-acp up`: starts robot server, agent and bridge on this machine, restarts each that exits, and ends all three.

Where the agent drives another robot (`agent.robot_url`), no robot server of ours is started: a second robot that nobody
drives would only be stopped and watched in the place of the other one. A process that cannot come up with its settings
is not started again: `up` ends. Each is `robot-acp robot|agent|bridge` in a process of its own, so that each can be
killed or replaced alone. They get their settings through environment variables, as a person would set them.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import random
import signal
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

import httpx

from backend import addresses, identity, logins, robot_address
from backend.config import ConfigError, Settings

log = logging.getLogger(__name__)

PROCESSES = ("robot", "agent", "bridge")
STOP_TIMEOUT_S = 3.0
CANNOT_COME_UP = 2
"""The exit status of a process whose settings, world, address or software cannot be used (`cli.main`)."""
MOST_STARTS = 5
"""A process that has ended so often without ever having come up is not started again."""
PROBE_S = 0.1
RESTART_PAUSES_S = (0.2, 1.0, 3.0, 10.0, 30.0, 60.0)
"""Before the first, second and each further restart of a process."""
STEADY_S = 30.0
"""A process that has run for longer than this is restarted as for the first time."""
MISSING_AFTER_S = 10.0
"""After the bridge answers, agent and robot have this long before the greeting says that they are missing."""
DEMO_DOMAINS = range(10, 100)
"""ROS domains whose ports lie below the ephemeral ports of Linux."""


class GaveUp(Exception):
    """A process is not started again; the text says why. `status` is the exit status of `up`."""

    def __init__(self, why: str, status: int) -> None:
        super().__init__(why)
        self.status = status


async def run(settings: Settings, config_file: Path | None) -> int:
    """Run until SIGINT or SIGTERM, or until a process cannot come up; returns the exit status. Prints the dashboard's
    address once it answers. Raises `ConfigError` when another program uses one of the addresses.
    """
    names = _processes(settings)
    _check_ports(settings, names)
    ending = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ending.set)
    environment = _environment(settings, config_file)
    if "ros2-demo" in names:
        environment |= _demo_domain(settings, environment)
    identity.shared_secret(settings.data_dir, identity.ROBOT_TOKEN)
    code = logins.new_code(settings.data_dir)
    status = 0
    try:
        async with asyncio.TaskGroup() as group:
            keepers = [group.create_task(_keep(name, _address(settings, name), environment)) for name in names]
            greeter = group.create_task(_greet(settings, code))
            await ending.wait()
            for task in (*keepers, greeter):
                task.cancel()
    except* GaveUp as gave_up:
        for error in gave_up.exceptions:
            print(f"robot-acp: {error}", file=sys.stderr)
            status = getattr(error, "status", 1)
    return status


def _processes(settings: Settings) -> tuple[str, ...]:
    """The processes to run. Our robot server is among them only if the agent drives it."""
    if not settings.drives_our_robot_server:
        where = robot_address.without_login(settings.robot_mcp_url)
        log.info("the robot is the MCP server at %s; no robot server of ours is started", where)
        return tuple(name for name in PROCESSES if name != "robot")
    if settings.robot.kind == "ros2" and settings.robot.ros2.demo:
        return ("ros2-demo", *PROCESSES)
    return PROCESSES


def _address(settings: Settings, name: str) -> tuple[str, int] | None:
    """The host and port of a process; None for one without."""
    where = getattr(settings, name, None)
    return (where.host, where.port) if where is not None else None


def _check_ports(settings: Settings, names: Sequence[str]) -> None:
    """Raise `ConfigError` when another program uses one of the addresses."""
    for name in names:
        if (where := getattr(settings, name, None)) is None:
            continue
        try:
            with socket.socket(addresses.family(where.host)) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((where.host, where.port))
        except OSError as error:
            variable = f"ROBOT_ACP_{name.upper()}__PORT"
            raise ConfigError(
                f"The {name} cannot use {addresses.authority(where.host, where.port)} ({error.strerror}). "
                f"Is another robot-acp running? End it, or choose another port with {variable}."
            ) from None


def _demo_domain(settings: Settings, environment: dict[str, str]) -> dict[str, str]:
    """The variables that give the demo a ROS domain of its own, so that no other robot takes the demo's commands."""
    chosen = settings.robot.ros2.domain_id
    if chosen is None and not environment.get("ROS_DOMAIN_ID"):
        chosen = next((domain for domain in random.sample(DEMO_DOMAINS, len(DEMO_DOMAINS)) if _is_unused(domain)), 0)
    domain = {} if chosen is None else {"ROBOT_ACP_ROBOT__ROS2__DOMAIN_ID": str(chosen)}
    return domain | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def _is_unused(domain: int) -> bool:
    """Whether no ROS process of this machine uses a domain: its first participant's port is free (DDSI-RTPS 9.6)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", 7410 + 250 * domain))
        except OSError:
            return False
    return True


async def _keep(name: str, address: tuple[str, int] | None, environment: dict[str, str]) -> None:
    """Run one process, and restart it whenever it ends, after a longer pause each time.

    Raises `GaveUp` for one that has never come up, which means that it accepted a connection at `address`: at once when
    it ends with `CANNOT_COME_UP`, otherwise after `MOST_STARTS`. One that came up is restarted without end: what ended
    it passes, such as a database that is away.
    """
    failures, came_up = 0, False
    while True:
        started = asyncio.get_running_loop().time()
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", "backend.cli", name),  # -P: no program of the folder that `up` is started in
            env=environment,
            stdin=asyncio.subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C reaches `up` alone, which then ends the processes itself
        )
        answering = asyncio.create_task(_answers(address))
        try:
            status = await process.wait()
        except asyncio.CancelledError:
            await _end(process)
            raise
        finally:
            came_up = came_up or answering.done()
            answering.cancel()
        lived = asyncio.get_running_loop().time() - started
        failures = 1 if lived > STEADY_S else failures + 1
        if not came_up:
            _may_start_again(name, status, failures)
        pause = RESTART_PAUSES_S[min(failures, len(RESTART_PAUSES_S)) - 1]
        log.warning("the %s process %s; starting it again in %g s", name, _how_it_ended(status), pause)
        await asyncio.sleep(pause)


async def _answers(address: tuple[str, int] | None) -> None:
    """Return when a process accepts connections; one without an address has come up when it has run for a while."""
    if address is None:
        await asyncio.sleep(STEADY_S)
        return
    while True:
        with contextlib.suppress(OSError):
            _, writer = await asyncio.open_connection(*address)
            writer.close()
            return
        await asyncio.sleep(PROBE_S)


def _may_start_again(name: str, status: int, failures: int) -> None:
    """Raise `GaveUp` if a process that has never come up is not to be started again."""
    if status == CANNOT_COME_UP:
        raise GaveUp(f"The {name} cannot come up; its own message says why. Everything has ended.", CANNOT_COME_UP)
    if failures >= MOST_STARTS:
        times = f"{_how_it_ended(status)}, {failures} times in a row, and never came up"
        raise GaveUp(f"The {name} process {times}; its log says why. Everything has ended.", 1)


def _how_it_ended(status: int) -> str:
    if status >= 0:
        return f"ended with status {status}"
    with contextlib.suppress(ValueError):
        return f"was killed by {signal.Signals(-status).name}"
    return f"was killed by signal {-status}"


async def _end(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
        try:
            async with asyncio.timeout(STOP_TIMEOUT_S):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()


async def _greet(settings: Settings, code: str) -> None:
    """Wait until all three answer, then print the dashboard's address; name those that are missing after a while."""
    base = settings.bridge_url
    loop = asyncio.get_running_loop()
    page_since: float | None = None
    async with httpx.AsyncClient(trust_env=False, timeout=1.0) as client:
        while True:
            with contextlib.suppress(httpx.HTTPError, ValueError):
                health = (await client.get(f"{base}/api/health")).json()
                page_since = page_since or loop.time()
                missing = [name for name in ("agent", "robot") if not health[name]["up"]]
                if not missing or loop.time() - page_since > MISSING_AFTER_S:
                    break
            await asyncio.sleep(0.05)
    state = "is ready" if not missing else f"is not all there: no answer from the {' and the '.join(missing)} yet"
    print(f"\n{settings.robot.name} {state}. Open this address in a browser:\n\n  {base}/#token={code}\n")
    print("It works once; `robot-acp login` prints another.\n", flush=True)


def _environment(settings: Settings, config_file: Path | None) -> dict[str, str]:
    """The environment of the processes: the flags of `up` as variables."""
    variables = {
        "ROBOT_ACP_DATA_DIR": str(settings.data_dir.absolute()),
        "ROBOT_ACP_LOG_LEVEL": settings.log_level,
        "ROBOT_ACP_ROBOT__TIME_SCALE": str(settings.robot.time_scale),
        "ROBOT_ACP_ROBOT__WORLD": settings.robot.world,
        "ROBOT_ACP_ROBOT__KIND": settings.robot.kind,
        "ROBOT_ACP_ROBOT__ROS2__DEMO": str(settings.robot.ros2.demo).lower(),
        "ROBOT_ACP_AGENT__MODEL": settings.agent.model,
        "ROBOT_ACP_BRIDGE__PORT": str(settings.bridge.port),
    }
    if config_file is not None:
        variables["ROBOT_ACP_CONFIG"] = str(config_file.absolute())
    return os.environ | variables
