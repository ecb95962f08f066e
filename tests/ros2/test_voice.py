"""Speech by an action: it is over when the action says so, a stop ends it, and a missing one is told."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from tests.mcp_robot.tools.test_tools import call, refused
from tests.processes import eventually
from tests.ros2.conftest import Setting, node

# Any action with a text in its goal will do: this is one that is installed here.
ACTION = {
    "speech_action": "say",
    "speech_action_type": "nav2_msgs/action/NavigateToPose",
    "speech_action_field": "behavior_tree",
}


class Speaker:
    """An action server that says a sentence for as long as the test wants."""

    def __init__(self, link: Any) -> None:
        from nav2_msgs.action import NavigateToPose
        from rclpy.action import ActionServer, CancelResponse

        self._link = link
        self._goals: list[Any] = []
        self.texts: list[str] = []
        self.cancelled: list[bool] = []

        def accepted(handle: Any) -> None:
            self._goals.append(handle)
            self.texts.append(handle.request.behavior_tree)

        def cancel(_: Any) -> Any:
            self.cancelled.append(True)
            self._link.submit(self._goals[-1].execute)
            return CancelResponse.ACCEPT

        def execute(handle: Any) -> Any:
            handle.canceled() if handle.is_cancel_requested else handle.succeed()
            return NavigateToPose.Result()

        ActionServer(
            link.node, NavigateToPose, "say", execute, handle_accepted_callback=accepted, cancel_callback=cancel
        )

    def finish(self) -> None:
        self._link.submit(self._goals[-1].execute)


async def test_a_sentence_is_over_when_the_action_says_so_and_a_stop_ends_it(real_time: Setting) -> None:
    async with node(real_time.domain) as link:
        speaker = Speaker(link)
        link.open()
        async with (
            real_time.served(**ACTION) as robot,
            robot.mcp() as client,
            robot.http() as http,
            robot.telemetry("state", rate=50) as reader,
        ):
            speaking = asyncio.create_task(call(client, "speak", text="The meeting is at noon."))
            await eventually(lambda: speaker.texts == ["The meeting is at noon."], "the sentence")
            await reader.state(lambda state: state.speaking is not None)
            assert not speaking.done()
            speaker.finish()
            assert (await speaking)["text"] == "The meeting is at noon."

            speaking = asyncio.create_task(refused(client, "speak", text="A long story."))
            await eventually(lambda: len(speaker.texts) == 2, "the next one")
            await http.post("/stop", params={"by": "Ana"})
            assert (await speaking).startswith("stopped: Stopped by Ana.")
            assert speaker.cancelled
            await http.post("/release", params={"by": "Ana"})


async def test_a_listener_that_is_only_about_to_listen_is_waited_for(real_time: Setting) -> None:
    from std_msgs.msg import String

    async with real_time.served(speech="late") as robot, robot.mcp() as client, node(real_time.domain) as link:
        async with robot.telemetry("speech") as reader:
            speaking = asyncio.create_task(call(client, "speak", text="Yes"))
            await reader.until(lambda message: message.text == "Yes")
        link.node.create_subscription(String, "late", lambda _: None, 10)
        link.open()
        assert (await speaking)["text"] == "Yes"


async def test_a_stop_ends_the_wait_for_a_listener(real_time: Setting) -> None:
    async with (
        real_time.served(speech="nobody") as robot,
        robot.mcp() as client,
        robot.http() as http,
        robot.telemetry("state") as reader,
    ):
        speaking = asyncio.create_task(refused(client, "speak", text="Hello"))
        await reader.state(lambda state: state.speaking == "Hello")
        await http.post("/stop", params={"by": "Ana"})
        assert (await speaking).startswith("stopped: Stopped by Ana.")
        await http.post("/release")


async def test_a_speech_action_that_nobody_serves_is_told(real_time: Setting) -> None:
    async with real_time.served(**ACTION, answer_timeout=0.5) as robot, robot.mcp() as client:
        assert (await refused(client, "speak", text="Hello")).startswith(
            "no_voice: The robot's speech action say failed: nothing serves it."
        )


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        ({"speech_action_type": "no_msgs/action/Say"}, "The action type no_msgs/action/Say cannot be imported."),
        ({"speech_action_field": "words"}, "A goal of nav2_msgs/action/NavigateToPose has no field words."),
    ],
)
async def test_a_speech_action_that_cannot_be_used_is_told_at_the_start(
    real_time: Setting, wrong: dict[str, str], problem: str
) -> None:
    from backend.mcp_robot.ros2.interfaces import Ros2Missing

    with pytest.raises(Ros2Missing, match=problem):
        async with real_time.served(**ACTION | wrong):
            raise AssertionError("it was served")
