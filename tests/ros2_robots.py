"""A ROS 2 robot for tests: the stand-in in a process of its own, on a ROS domain of its own."""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import os
import signal
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from backend.mcp_robot.ros2.waiting import Waits
from tests.processes import PATIENCE_S, Robot, end

UNFIT = None if importlib.util.find_spec("rclpy") else "rclpy cannot be imported: install the extra ros2"
needs_ros2 = pytest.mark.skipif(UNFIT is not None, reason=UNFIT or "")

FIRST_DOMAIN, DOMAINS = 10, 90
"""The domains whose ports lie below those that a system gives out."""
_taken: set[int] = set()


def own_domains() -> range:
    """The domains of this process: pytest-xdist's workers divide them, because a domain that two of them probe at the
    same time looks free to both."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    share = DOMAINS // workers
    return range(FIRST_DOMAIN + worker * share, FIRST_DOMAIN + (worker + 1) * share)


def free_domain() -> int:
    """A ROS domain without participants on this machine, and not given out before."""
    domains = own_domains()
    begin = os.getpid()  # another run on this machine begins elsewhere
    for step in range(len(domains)):
        domain = domains[(begin + step) % len(domains)]
        if domain not in _taken and _is_free(7410 + 250 * domain):
            _taken.add(domain)
            return domain
    _taken.clear()
    return free_domain()


def _is_free(port: int) -> bool:
    """Whether the first participant's discovery port of a domain can be had."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


PATIENT = {"answer_timeout": PATIENCE_S, "camera_timeout": PATIENCE_S}
"""Settings under `robot.ros2` for tests in which every node answers some time, however busy the machine is."""

VARIABLES = {
    "ROBOT_ACP_ROBOT__ROS2__ANSWER_TIMEOUT": f"{PATIENCE_S}",
    "ROBOT_ACP_ROBOT__LIMITS__POSE_TIMEOUT": "10",
    "ROBOT_ACP_ROBOT__LIMITS__CLIENT_SILENCE": "30",
}
"""The same for commands; and limits that a machine that stands for some seconds does not reach."""

WAITS = Waits(start=0.8 * PATIENCE_S, halted_goal=PATIENCE_S)
"""A robot server in a test waits for slow parts as long as a test waits for anything."""


@dataclass
class StandIn:
    """A robot's process and its ROS domain; `untouched` when a test left it as it found it."""

    domain: int
    process: subprocess.Popen[str]
    untouched: bool = False


class StandIns:
    """Stand-ins in processes of their own, the next one of a kind started while a test uses the one before."""

    def __init__(self, data_dir: Path) -> None:
        self._data_dir = data_dir
        self._ready: dict[tuple[str, ...], list[StandIn]] = {}  # how they were started -> those that wait

    @contextlib.contextmanager
    def one(self, *arguments: str) -> Iterator[StandIn]:
        """A stand-in that is as new."""
        ready = self._ready.setdefault(arguments, [])
        stand_in = ready.pop() if ready else start(self._data_dir, *arguments)
        try:
            if not stand_in.untouched:
                assert stand_in.process.stdout is not None
                assert "on the domain" in stand_in.process.stdout.readline()
            stand_in.untouched = False
            if not ready:
                ready.append(start(self._data_dir, *arguments))
            yield stand_in
        finally:
            if stand_in.untouched:
                ready.append(stand_in)
            else:
                assert end(stand_in.process) == 0

    @contextlib.contextmanager
    def frozen(self, stand_in: StandIn) -> Iterator[None]:
        """As if the robot's computer had died: nothing is said any more, and nothing answers."""
        stand_in.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            stand_in.process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        for stand_in in itertools.chain(*self._ready.values()):
            end(stand_in.process, signal.SIGKILL)


def start(data_dir: Path, *arguments: str) -> StandIn:
    """Start a stand-in, which says on its standard output when it is there."""
    domain = free_domain()
    environment = {"ROBOT_ACP_ROBOT__ROS2__DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    process = Robot(data_dir, environment).spawn("ros2-demo", *arguments, stdout=subprocess.PIPE)
    return StandIn(domain, process)
