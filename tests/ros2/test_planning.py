"""Nav2's planner serves one goal at a time: a newer one ends the older, and that is never told as "unreachable"."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import pytest

from tests.mcp_robot.tools.test_tools import call, refused
from tests.processes import eventually
from tests.ros2.conftest import Setting, node

NEAR, NEARBY = {"x": 2.5, "y": 3.1}, {"x": 3.0, "y": 2.5}
"""Goals that a straight line leads to from the dock."""


class Planner:
    """A planner as Nav2's action servers are: a new goal ends the one before, with an empty result. It ends a goal by
    itself never: a test says when and how. To be used on its ROS thread."""

    def __init__(self, link: Any) -> None:
        from nav2_msgs.action import ComputePathToPose
        from rclpy.action import ActionServer, CancelResponse

        self.begun: list[Any] = []  # goals that were accepted
        self.preempted = 0
        self._latest: Any = None
        self._error = 0

        def accepted(handle: Any) -> None:
            self.begun.append(handle)
            if self._latest is not None:
                self.preempted += 1
                self.fail(0)
            self._latest = handle

        def execute(handle: Any) -> Any:
            result = ComputePathToPose.Result()
            if self._error is None:
                result.path.poses = [handle.request.goal]
                handle.succeed()
            else:
                result.error_code = self._error
                handle.abort()
            return result

        ActionServer(
            link.node, ComputePathToPose, "planner", execute,
            handle_accepted_callback=accepted, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def answer(self) -> None:
        """End the latest goal with a path."""
        self._end(None)

    def fail(self, error: int) -> None:
        """End the latest goal with this error; 0 is what another client's goal leaves."""
        self._end(error)

    def _end(self, error: int | None) -> None:
        handle, self._latest, self._error = self._latest, None, error
        handle.execute()


async def test_two_plans_at_once_are_asked_for_one_after_the_other(real_time: Setting) -> None:
    async with node(real_time.domain) as link:
        planner = Planner(link)
        link.open()
        async with real_time.served(compute_path="planner") as robot, robot.mcp() as client:
            plans = [
                asyncio.create_task(call(client, "navigate_to_pose", **goal, plan_only=True)) for goal in (NEAR, NEARBY)
            ]
            with contextlib.suppress(AssertionError):  # which is well; it took 20 ms when both were sent at once
                await eventually(lambda: len(planner.begun) == 2, "a second goal", seconds=1.0)
            await link.run(planner.answer)
            await eventually(lambda: len(planner.begun) == 2, "the other goal")
            if not all(plan.done() for plan in plans):
                await link.run(planner.answer)
            lengths = [(await plan)["path_length"] for plan in plans]
        assert lengths == pytest.approx([1.6, 2.18], abs=0.1)
        assert planner.preempted == 0


@pytest.mark.parametrize("times", [1, 2, 9])
async def test_a_plan_that_another_client_ended_is_asked_for_again_or_made_here(real_time: Setting, times: int) -> None:
    async with node(real_time.domain) as link:
        planner = Planner(link)
        link.open()
        async with real_time.served(compute_path="planner") as robot, robot.mcp() as client:
            planning = asyncio.create_task(call(client, "navigate_to_pose", **NEAR, plan_only=True))
            for count in range(1, times + 1):
                await eventually(lambda wanted=count: planning.done() or len(planner.begun) == wanted, "a goal")
                if not planning.done():
                    await link.run(lambda: planner.fail(0))
            await eventually(lambda: planning.done() or len(planner.begun) > times, "another goal, or a path from here")
            if not planning.done():
                await link.run(planner.answer)
            assert (await planning)["path_length"] == pytest.approx(1.6, abs=0.1)
            assert len(planner.begun) == min(times + 1, 3)


@pytest.mark.parametrize(
    ("error", "code"), [(209, "unreachable"), (207, "occupied"), (200, "nav_failed"), (201, "nav_failed")]
)
async def test_only_a_goal_that_no_path_leads_to_is_unreachable(real_time: Setting, error: int, code: str) -> None:
    async with node(real_time.domain) as link:
        planner = Planner(link)
        link.open()
        async with real_time.served(compute_path="planner") as robot, robot.mcp() as client:
            planning = asyncio.create_task(refused(client, "navigate_to_pose", **NEAR, plan_only=True))
            await eventually(lambda: planner.begun, "a goal")
            await link.run(lambda: planner.fail(error))
            assert (await planning).startswith(f"{code}: planner gave up")
