"""Says sentences through ROS: by an action whose goal holds the text, or by a topic of std_msgs/String.

It makes no sound itself. An action reports when a sentence is over; a topic does not, so there the adapter waits for as
long as the sentence takes.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib
from collections.abc import Callable
from typing import Any, Protocol

from rclpy.action import ActionClient
from std_msgs.msg import String

from backend.config import Ros2
from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.ros2.goals import SUCCEEDED, Goal
from backend.mcp_robot.ros2.interfaces import Ros2Missing
from backend.mcp_robot.ros2.ros_thread import RosThread
from backend.mcp_robot.ros2.waiting import EVERY, until

PATIENCE = 3.0
"""A speech action may take so many times as long as the sentence would, and START seconds more."""
START = 5.0


class Voice(Protocol):
    """Made on the ROS thread before it runs; used from the event loop."""

    async def say(self, text: str, seconds: float) -> None:
        """Say it; returns when it is said. Raises `Refusal` (no_voice), or `Halted` after `hush`."""

    def hush(self) -> None:
        """Stop speaking at once."""


def voice(ros: RosThread, settings: Ros2, clock: Callable[[], float]) -> Voice:
    """The robot's voice as the settings have it. Raises `Ros2Missing` for an action type that is not installed."""
    return ActionVoice(ros, settings) if settings.speech_action else TopicVoice(ros, settings, clock)


def action_type(name: str) -> Any:
    """The class of an action type such as `audio_common_msgs/action/TTS`. Raises `Ros2Missing`."""
    package, _, kind = name.partition("/action/")
    try:
        return getattr(importlib.import_module(f"{package}.action"), kind)
    except (ImportError, AttributeError):
        advice = "Install its package and source it, or set robot.ros2.speech_action_type."
        raise Ros2Missing(f"The action type {name} cannot be imported. {advice}") from None


class ActionVoice:
    """By an action: it is known when a sentence is over, and one can be ended."""

    def __init__(self, ros: RosThread, settings: Ros2) -> None:
        self._ros = ros
        self._name, self._field = settings.speech_action, settings.speech_action_field
        self._answer_timeout = settings.answer_timeout
        self._type = action_type(settings.speech_action_type)
        if not hasattr(self._type.Goal(), self._field):
            sentence = f"A goal of {settings.speech_action_type} has no field {self._field}."
            raise Ros2Missing(f"{sentence} Set robot.ros2.speech_action_field.")
        self._client = ActionClient(ros.node, self._type, self._name)
        self._goal: Goal | None = None  # what is being said

    async def say(self, text: str, seconds: float) -> None:
        """Send the text as a goal, and wait for its end."""
        message = self._type.Goal()
        setattr(message, self._field, text)
        goal = self._goal = Goal(self._ros, self._client, self._name, self._answer_timeout)
        try:
            status, _ = await goal.run(message, silence=START + PATIENCE * seconds)
        except Refusal as refusal:
            # What a goal says of Nav2 is true of any action server but for the advice.
            problem = {
                "nav_unavailable": "nothing serves it",
                "goal_rejected": "it rejected the sentence",
            }.get(refusal.code, "it does not answer in time")
            raise self._mute(problem) from None
        finally:
            self._goal = None
        if goal.halted:
            raise Halted
        if status != SUCCEEDED:
            raise self._mute("it gave the sentence up")

    def hush(self) -> None:
        """Cancel the goal."""
        if self._goal:
            self._goal.halt()

    def _mute(self, problem: str) -> Refusal:
        sentence = f"The robot's speech action {self._name} failed: {problem}."
        return Refusal("no_voice", f"{sentence} Look at the speech node, or see `robot-acp doctor`.")


class TopicVoice:
    """By a topic: an empty text ends what is being said."""

    def __init__(self, ros: RosThread, settings: Ros2, clock: Callable[[], float]) -> None:
        self._topic = settings.speech
        self._answer_timeout = settings.answer_timeout
        self._clock = clock
        self._publisher = ros.node.create_publisher(String, self._topic, 10) if self._topic else None
        self._hushed = asyncio.Event()  # set by hush, replaced when something is said
        self._hushed.set()

    async def say(self, text: str, seconds: float) -> None:
        """Publish the text, and wait for as long as saying it takes."""
        if self._publisher is None:
            raise Refusal("no_voice", "The robot has no voice: nobody listens, no topic is set for it.")
        hushed, count = asyncio.Event(), self._publisher.get_subscription_count
        self._hushed = hushed
        # Nodes need a while to see each other: one that has just been started may be about to listen.
        await until(lambda: hushed.is_set() or count(), self._answer_timeout)
        if hushed.is_set():
            raise Halted
        if not count():
            raise Refusal("no_voice", f"The robot has no voice: nobody listens, on the topic {self._topic}.")
        self._publisher.publish(String(data=text))
        end = self._clock() + seconds
        while self._clock() < end:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(EVERY):
                    await hushed.wait()
            if hushed.is_set():
                raise Halted

    def hush(self) -> None:
        """Publish an empty text, which replaces what is being said."""
        if not self._hushed.is_set() and self._publisher is not None:
            self._publisher.publish(String(data=""))
        self._hushed.set()
