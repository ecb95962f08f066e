"""The robot server process: one robot, its tools over HTTP and, if asked, over stdio, until it is cancelled.

`serve` is what `robot-acp robot` calls. On its way out it stops the robot's motion. Standard output belongs to MCP when
it serves stdio: nothing here prints.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable

import uvicorn
from starlette.applications import Starlette

from backend import addresses, collector, config, exposure, identity
from backend.audit import Audit
from backend.config import ConfigError, Settings
from backend.connections_before_login import ConnectionsBeforeLogin
from backend.http_protocol import HttpLimits, uvicorn_options
from backend.mcp_robot import robots, stdio_transport
from backend.mcp_robot.http.routes import create_app
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.tools import catalogue
from backend.sockets import notice_loss
from backend.telemetry import Zone

logger = logging.getLogger(__name__)

SEND_BUFFER = 128 * 1024
"""Bytes that the kernel may buffer for one connection. Telemetry in that buffer can no longer be replaced by newer."""
MAX_CONNECTIONS = 256
"""HTTP connections at once, without WebSockets; beyond it the one that has waited longest is closed."""
GRACE = 2
"""Seconds that open connections have to end when the server shuts down."""


async def serve(
    settings: Settings,
    *,
    stdio: bool = False,
    on_ready: Callable[[int], None] | None = None,
    built: tuple[robots.RunningRobot, list[Zone]] | None = None,
) -> None:
    """Run the robot server until cancelled, signalled, or, with `stdio`, until standard input ends.

    `on_ready` is called with the port once it answers. `built` is the robot and its keep-out zones, where the caller
    has built them already; else the settings say which. Raises `WorldError` for a world that cannot be used,
    `Ros2Missing` where ROS 2 cannot be used, and `ConfigError` for an address that cannot be had.
    """
    robot_settings = settings.robot
    exposure.warn(settings, "robot", logger)
    robot, zones = built or robots.build(settings)
    pilot = Pilot(robot, StopLatch(settings.data_dir), robot_settings.limits, zones)
    robot.on_reroute = pilot.rerouted
    mcp = catalogue.build(pilot)
    token = identity.shared_secret(settings.data_dir, identity.ROBOT_TOKEN)
    audit = Audit(settings.data_dir, "robot")
    with contextlib.closing(audit), contextlib.closing(_listen(robot_settings)) as listener:
        http = _Http(create_app(pilot, mcp, token, robot_settings.host, audit), pilot, on_ready)
        async with robot.running():
            collector.spare_program()
            serving = asyncio.create_task(http.serve(sockets=[listener]), name="http")
            tasks = {serving}
            if stdio:
                tasks.add(asyncio.create_task(stdio_transport.run(mcp), name="stdio"))
            try:
                done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                pilot.brake()
                http.should_exit = True
                await asyncio.wait({serving}, timeout=GRACE + 1.0)
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
            for task in done:
                task.result()


class _Http(uvicorn.Server):
    """uvicorn, which reports when it answers, and brakes the robot before it waits for open connections to end."""

    def __init__(self, app: Starlette, pilot: Pilot, on_ready: Callable[[int], None] | None) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                **uvicorn_options(HttpLimits(ConnectionsBeforeLogin(MAX_CONNECTIONS, MAX_CONNECTIONS))),
                ws="websockets-sansio",
                ws_per_message_deflate=False,
                ws_max_size=64 * 1024,
                log_config=None,
                access_log=False,
                lifespan="on",
                timeout_graceful_shutdown=GRACE,
            )
        )
        self._pilot = pilot
        self._on_ready = on_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        host, port = (sockets or [])[0].getsockname()[:2]
        logger.info("The robot server answers on %s.", addresses.url("http", host, port))
        if self._on_ready:
            self._on_ready(port)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._pilot.brake()
        await super().shutdown(sockets)


def _listen(settings: config.Robot) -> socket.socket:
    host, port = settings.host, settings.port
    family = addresses.family(host)
    # With the protocol named: asyncio sets TCP_NODELAY only then, and without it every answer waits 40 ms for an ACK.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        notice_loss(listener, settings.limits.client_silence)
        listener.bind((host, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        at = addresses.authority(host, port)
        raise ConfigError(f"The robot server cannot listen on {at}: {error.strerror or error}.") from None
    return listener
