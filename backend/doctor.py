"""`robot-acp doctor`: checks what works on this machine, what is missing, and what to do about it.

It changes nothing: it must make no key, start no server and move no robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx

from backend import addresses, exposure, identity, private_files
from backend.config import Settings
from backend.findings import Finding, bad, good, warning
from backend.robot_address import without_login
from backend.robot_server import RobotError, RobotServerClient

OLDEST, NEWEST = (3, 11), (3, 13)


async def run(settings: Settings) -> int:
    """Print one line for each finding, and return the exit status: 0 when nothing is missing."""
    findings = [*_machine(settings), await asyncio.to_thread(_database, settings)]
    findings += [*await _processes(settings), *_network(settings)]
    for finding in findings:
        print(finding)
    if settings.robot.kind == "ros2" and settings.drives_our_robot_server:
        from backend.mcp_robot.ros2.diagnosis import examine

        for finding in await examine(settings):
            findings.append(finding)
            print(finding, flush=True)
    missing = sum(not finding.ok for finding in findings)
    warnings = sum(finding.warns for finding in findings)
    also = f", {warnings} {'warning' if warnings == 1 else 'warnings'}" if warnings else ""
    print(f"\n{len(findings)} checks, {missing or 'none'} missing{also}.")
    return 1 if missing else 0


def _machine(settings: Settings) -> Iterator[Finding]:
    version = ".".join(map(str, sys.version_info[:3]))
    fits = OLDEST <= sys.version_info[:2] <= NEWEST
    yield (good if fits else bad)("Python", version, "Use Python 3.11, 3.12 or 3.13.")
    kind = settings.robot.kind + (", a stand-in" if settings.robot.kind == "ros2" and settings.robot.ros2.demo else "")
    if not settings.drives_our_robot_server:
        kind = "of another make: agent.robot_url"
    yield good("settings", f"they are valid; the robot is {settings.robot.name} ({kind})")
    folder = settings.data_dir
    nearest = next(place for place in (folder, *folder.parents) if place.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        yield bad("data folder", f"{folder} cannot be written", "Set data_dir to a folder of yours, or its rights.")
    elif not folder.exists():
        yield good("data folder", f"{folder} (will be made)")
    else:
        yield _folder_and_keys(folder)


def _folder_and_keys(folder: Path) -> Finding:
    try:
        private_files.check_folder(folder)
        for name in (identity.SIGNING_KEY, identity.ROBOT_TOKEN):
            with contextlib.suppress(FileNotFoundError):
                identity.read_secret(folder / name)
    except private_files.UnsafeFile as unsafe:
        problem, _, advice = str(unsafe).partition(". ")
        return bad("data folder", problem, advice)
    except OSError as error:
        return bad("data folder", f"{error.filename} cannot be read ({error.strerror})", "Give it to this user.")
    return good("data folder", str(folder))


def _database(settings: Settings) -> Finding:
    """Whether the database of sessions can be used, also while the agent has it open."""
    from backend.agent.sessions import database

    try:
        return good("database", database.examine(settings.database_url))
    except Exception as error:
        return bad("database", database.why(error), "The agent cannot keep sessions without it; Stop works.")


async def _processes(settings: Settings) -> list[Finding]:
    """Whether each of the three addresses answers as expected, is free, or is used by another program."""
    found: list[Finding] = []
    ours = settings.drives_our_robot_server
    if not ours:
        found.append(await _other_robot(settings))
    async with httpx.AsyncClient(trust_env=False, timeout=2.0) as client:
        for name, path in (("robot", "/health"), ("agent", None), ("bridge", "/api/health"))[0 if ours else 1 :]:
            where = getattr(settings, name)
            address = addresses.authority(where.host, where.port)
            host = addresses.reached_at(where.host)
            if not _listens(host, where.port):
                found.append(good(name, f"{address} is free; it is not running"))
                continue
            answers = path is None
            if path:
                with contextlib.suppress(httpx.HTTPError):
                    answers = "status" in (await client.get(addresses.url("http", host, where.port, path))).text
            advice = f"End the other program, or choose another port with ROBOT_ACP_{name.upper()}__PORT."
            found.append(
                good(name, f"it answers on {address}")
                if answers
                else bad(name, f"another program has {address}", advice)
            )
    return found


def _network(settings: Settings) -> Iterator[Finding]:
    """What other machines could read."""
    processes: tuple[exposure.Process, ...] = ("robot", "agent", "bridge")
    for process in processes[0 if settings.drives_our_robot_server else 1 :]:
        if found := exposure.warning(settings, process):
            what, advice = found
            yield warning(process, f"it {what}", f"{advice[0].upper()}{advice[1:]}.")


async def _other_robot(settings: Settings) -> Finding:
    """Whether the robot of another make answers that the agent drives."""
    where = without_login(settings.robot_mcp_url)
    server = RobotServerClient(settings.robot_base_url)
    try:
        up, detail = await server.health()
    except RobotError:
        up, detail = True, f"another MCP server, which the agent starts: {where}. It has no stop path"
    finally:
        await server.close()
    return (good if up else bad)(
        "robot", detail, f"Start the robot's MCP server at {where}, or see to agent.robot_url."
    )


def _listens(host: str, port: int) -> bool:
    try:
        with socket.create_connection((host, port), timeout=1.0):
            return True
    except OSError:
        return False
