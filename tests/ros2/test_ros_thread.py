"""A link that is closed has left the ROS graph, whatever Python has collected: others must not wait for its answers."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from tests.processes import eventually
from tests.ros2.conftest import Setting, node


@pytest.fixture
def uncollected() -> Iterator[None]:
    """No cycle of objects is collected, as for long in a large process."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


async def test_a_robot_server_and_a_node_with_an_action_are_gone_when_they_are_closed(
    real_time: Setting, uncollected: None
) -> None:
    from nav2_msgs.action import Spin
    from rclpy.action import ActionServer

    async with node(real_time.domain) as looking:
        looking.open()

        def others() -> set[str]:
            return set(looking.node.get_node_names()) & {"robot_acp", "another"}

        async with real_time.served(), node(real_time.domain, "another") as link:
            ActionServer(link.node, Spin, "turn", lambda _: Spin.Result())
            link.open()
            await eventually(lambda: others() == {"robot_acp", "another"}, "both to be seen")
        await eventually(lambda: not others(), "both to be gone")
