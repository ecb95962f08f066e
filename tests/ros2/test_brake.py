"""A halt is over when the motion has ended, not when somebody was asked to end it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from tests.mcp_robot.tools.test_tools import refused
from tests.processes import PATIENCE_S, eventually
from tests.ros2.conftest import Setting, node
from tests.ros2_robots import WAITS, free_domain

SILENT = "timeout: stubborn has said nothing"
UNFINISHED = "timeout: stubborn does not end the motion that was halted"


class Stubborn:
    """An action server that accepts goals and cancels, and ends a goal only when it is told to."""

    def __init__(self, link: Any) -> None:
        from nav2_msgs.action import Spin
        from rclpy.action import ActionServer, CancelResponse

        self._link = link
        self.goals: list[Any] = []

        def execute(handle: Any) -> Any:
            handle.canceled()
            return Spin.Result()

        ActionServer(
            link.node, Spin, "stubborn", execute,
            handle_accepted_callback=self.goals.append, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def end(self) -> None:
        self._link.submit(self.goals[0].execute)


HURRIED = replace(WAITS, silence=0.5, halted_goal=1.0)


async def test_it_brakes_until_the_halted_motion_has_ended_and_begins_no_other(real_time: Setting) -> None:
    from geometry_msgs.msg import TwistStamped

    zeros: list[Any] = []
    async with node(real_time.domain) as link:
        stubborn = Stubborn(link)
        link.node.create_subscription(TwistStamped, "cmd_vel_nav", zeros.append, 1)
        link.open()
        async with real_time.served(waits=HURRIED, spin="stubborn", compute_path="") as robot, robot.mcp() as client:
            assert (await refused(client, "rotate_in_place", degrees=10)).startswith(SILENT)
            assert (await refused(client, "rotate_in_place", degrees=10)).startswith(UNFINISHED)
            assert (await refused(client, "navigate_to_place", place="reception")).startswith(UNFINISHED)
            assert len(stubborn.goals) == 1
            seen = len(zeros)
            await eventually(lambda: len(zeros) > seen + 10, "zeros long after the halt")
            stubborn.end()
            await rotate_until(client, lambda: len(stubborn.goals) == 2)


async def test_a_server_that_was_restarted_knows_nothing_of_the_halted_motion(
    real_time: Setting, never: Callable[..., None]
) -> None:
    never("the action stubborn")  # before the robot server has begun
    async with real_time.served(waits=HURRIED, spin="stubborn") as robot, robot.mcp() as client:
        async with node(real_time.domain) as link:
            killed = Stubborn(link)
            link.open()
            await rotate_until(client, lambda: killed.goals)
        assert (await refused(client, "rotate_in_place", degrees=10)).startswith(UNFINISHED)
        async with node(real_time.domain) as link:
            restarted = Stubborn(link)
            link.open()
            await rotate_until(client, lambda: restarted.goals)


async def rotate_until(client: Any, condition: Callable[[], Any]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await refused(client, "rotate_in_place", degrees=10)


@contextlib.contextmanager
def busy(link: Any) -> Iterator[None]:
    """A node that is there, and answers nothing."""
    held, gate = threading.Event(), threading.Event()

    def hold() -> None:
        held.set()
        gate.wait()

    link.submit(hold)
    held.wait()
    try:
        yield
    finally:
        gate.set()


async def test_no_motion_begins_before_a_cancel_that_was_asked_for_is_sent(real_time: Setting) -> None:
    from backend.config import Ros2
    from backend.mcp_robot.ros2.brake import Brake

    async with node(real_time.domain) as link:
        brake = Brake(link, Ros2(stops=[]), time.time, lambda: False)
        link.open()
        with busy(link):
            brake.halt()
            next_motion = asyncio.create_task(brake.let_go())
            await asyncio.sleep(0)
            assert not next_motion.done()
        await next_motion
        assert brake._cancelled_at > 0


async def test_a_halt_is_kept_that_comes_while_the_brake_sees_whether_the_robot_stands(interfaces: Path) -> None:
    """The brake asks on its own thread. It took the answer to that for the newer halt's, and let go of a robot that
    moved."""
    from geometry_msgs.msg import TwistStamped

    from backend.config import Ros2
    from backend.mcp_robot.ros2.brake import PULSE, Brake

    zeros: list[Any] = []
    asked, gate = threading.Event(), threading.Event()

    def moves() -> bool:
        if asked.is_set():
            return True
        asked.set()
        gate.wait(PATIENCE_S)
        return False  # so it was, before the second halt

    domain = free_domain()
    async with node(domain) as listener, node(domain, "braking") as link:
        listener.node.create_subscription(TwistStamped, "cmd_vel_nav", zeros.append, 1)
        listener.open()
        brake = Brake(link, Ros2(navigate="absent", spin="absent", stops=[]), time.time, moves)
        link.open()
        brake.halt()
        await eventually(asked.is_set, "the end of the first halt's pulse")
        brake.halt()
        again = time.monotonic()
        gate.set()
        await eventually(lambda: time.monotonic() > again + 1.5 * PULSE, "the end of the second halt's pulse")
        seen = len(zeros)
        await eventually(lambda: len(zeros) > seen + 5, "zeros as long as the robot moves")


async def test_a_halt_is_kept_that_comes_while_the_one_before_is_let_go(interfaces: Path) -> None:
    from backend.config import Ros2
    from backend.mcp_robot.ros2.brake import Brake

    async with node(free_domain()) as link:
        brake = Brake(link, Ros2(navigate="absent", spin="absent", stops=[]), time.time, lambda: True)
        link.open()
        brake.halt()
        await link.run(lambda: None)
        with busy(link):
            over = asyncio.create_task(brake.let_go())
            await asyncio.sleep(0)
            brake.halt()
        await over
        assert await link.run(lambda: brake._settling)


async def test_a_server_that_is_seen_is_reached_only_when_it_has_answered(real_time: Setting) -> None:
    from backend.config import Ros2
    from backend.mcp_robot.ros2.brake import Brake

    async with node(real_time.domain) as server, node(real_time.domain) as link:
        Stubborn(server)
        server.open()
        brake = Brake(link, Ros2(spin="stubborn", navigate="absent", stops=[]), time.time, lambda: True)
        link.open()
        with busy(server):
            brake.halt()
            await eventually(lambda: any(each.waiting for each in brake._cancels), "a cancel to be under way")
            assert not brake.reaches("stubborn")
        await eventually(lambda: brake.reaches("stubborn"), "the answer")
        assert not brake.reaches("absent")


async def test_a_cancel_that_nobody_answers_is_asked_again_and_holds_up_no_motion(real_time: Setting) -> None:
    from backend.config import Ros2
    from backend.mcp_robot.ros2.brake import Brake

    async with node(real_time.domain) as hung, node(real_time.domain) as link:
        Stubborn(hung)
        hung.open()
        brake = Brake(link, Ros2(spin="stubborn", navigate="absent", stops=[]), time.time, lambda: False)
        canceller = next(each for each in brake._cancels if each.action == "stubborn")
        link.open()
        await eventually(canceller._client.service_is_ready, "the brake to see the server")
        with busy(hung):
            brake.hold(True)
            await eventually(lambda: canceller._open is not None, "a cancel")
            first = canceller._open
            await eventually(lambda: canceller._open not in (None, first), "another one, after a while")
            assert len(canceller._client._pending_requests) == 1
            brake.hold(False)
            await link.run(lambda: None)  # whatever it was at when it was let go is over
            await eventually(lambda: not canceller.waiting, "nobody to wait for it")
            unanswered = canceller._open
            await brake.let_go()
            assert canceller._open is unanswered is not None
