"""One goal of a ROS action, from sending to its end, for asyncio: acceptance, feedback, cancel, result.

Every wait has a limit: a server that does not answer, or falls silent, ends the wait with a refusal. A goal whose
caller is gone is cancelled, also when it is accepted only later.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus

from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.ros2.ros_thread import RosThread
from backend.mcp_robot.ros2.waiting import until

SUCCEEDED, CANCELED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED
LOOK_EVERY = 0.1
"""Seconds between two checks that the server is still there."""


class Goal:
    """A goal that is sent once."""

    def __init__(self, ros: RosThread, client: Any, name: str, answer_timeout: float) -> None:
        self.name = name
        self.halted = False  # set by halt; a goal that is accepted afterwards is cancelled at once
        self._ros = ros
        self._client = client
        self._answer_timeout = answer_timeout
        self._handle: Any = None  # on the ROS thread: set when accepted
        self._under_way = False  # on the ROS thread: from sending until the end is known
        self._heard = 0.0  # monotonic time of the latest feedback, or of acceptance

    def halt(self) -> None:
        """Cancel it, now or once it is accepted. Any thread; cannot fail."""
        self.halted = True
        self._ros.submit(self._cancel)

    @property
    def unfinished(self) -> bool:
        """Whether the goal was halted and its end is not known yet."""
        return self.halted and self._under_way

    @property
    def id(self) -> Any:
        """Its unique_identifier_msgs/UUID, None until it is accepted."""
        return self._handle and self._handle.goal_id

    def forget(self) -> None:
        """Its server does not know the goal, or no longer. On the ROS thread."""
        self._handle, self._under_way = None, False

    def server_is_there(self) -> bool:
        """Whether the action's server is in the ROS graph."""
        return bool(self._client.server_is_ready())

    def _cancel(self) -> None:
        if self._handle is not None:
            self._handle.cancel_goal_async()

    async def run(
        self,
        message: Any,
        *,
        silence: float,
        on_feedback: Callable[[Any], None] | None = None,
        check: Callable[[], None] | None = None,
    ) -> tuple[int, Any]:
        """Send it and wait for its end: status and result. Raises `Refusal` or `Halted`.

        `silence`: seconds without feedback, or without a result where there is none, after which it has failed.
        `check` is called all the while and may raise.
        """
        loop = asyncio.get_running_loop()
        accepted: asyncio.Future[bool] = loop.create_future()
        ended: asyncio.Future[tuple[int, Any]] = loop.create_future()

        def settle(future: asyncio.Future[Any], value: Any) -> None:
            def put() -> None:
                if not future.done():
                    future.set_exception(value) if isinstance(value, Exception) else future.set_result(value)

            with contextlib.suppress(RuntimeError):  # the loop has ended: nobody waits
                loop.call_soon_threadsafe(put)

        def on_answer(answer: Any) -> None:
            try:
                handle = answer.result()
            except Exception as error:
                settle(accepted, error)
                return
            self._under_way = handle.accepted
            self._heard = time.monotonic()
            if handle.accepted:
                self._handle = handle
                handle.get_result_async().add_done_callback(on_result)
                if self.halted:
                    self._cancel()
            settle(accepted, handle.accepted)

        def on_result(answer: Any) -> None:
            self.forget()
            try:
                settle(ended, (answer.result().status, answer.result().result))
            except Exception as error:
                settle(ended, error)

        def feedback(message: Any) -> None:
            self._heard = time.monotonic()
            if on_feedback:
                loop.call_soon_threadsafe(on_feedback, message.feedback)

        def send() -> None:
            if self.halted:
                settle(accepted, Halted())
                return
            self._under_way = True
            self._client.send_goal_async(message, feedback_callback=feedback).add_done_callback(on_answer)

        over = False
        try:
            await self._server()
            await self._ros.run(send)
            if not await self._limited(accepted, "accept or reject the goal"):
                raise Refusal("goal_rejected", f"{self.name} rejected the goal. Choose another, or look at its log.")
            end = await self._end(ended, silence, check)
            over = True
            return end
        finally:
            for future in (accepted, ended):
                future.cancel()
                if future.done() and not future.cancelled():
                    future.exception()  # or asyncio would log it: `_limited` and `_end` report it
            if not over:
                self.halt()

    async def _server(self) -> None:
        if not await until(self._client.server_is_ready, self._answer_timeout):
            raise Refusal(
                "nav_unavailable",
                f"The robot's action server {self.name} does not answer. Start Nav2, or see `robot-acp doctor`.",
            )

    async def _limited(self, future: asyncio.Future[bool], what: str) -> bool:
        if not await until(future.done, self._answer_timeout, every=0.01):
            sentence = f"{self.name} did not {what} within {self._answer_timeout:g} s. Look at its log, then try again."
            raise Refusal("timeout", sentence)
        return future.result()

    async def _end(
        self, ended: asyncio.Future[tuple[int, Any]], silence: float, check: Callable[[], None] | None
    ) -> tuple[int, Any]:
        gone_since: float | None = None
        while True:
            done, _ = await asyncio.wait({ended}, timeout=LOOK_EVERY)
            if done:
                return ended.result()
            if check:
                check()
            now = time.monotonic()
            gone_since = None if self._client.server_is_ready() else gone_since or now
            if gone_since and now - gone_since > self._answer_timeout:
                raise Refusal("nav_unavailable", f"{self.name} is gone. Start Nav2 again, then repeat what you asked.")
            if now - self._heard > silence:
                sentence = f"{self.name} has said nothing for {silence:g} s. Look at its log, then try again."
                raise Refusal("timeout", sentence)
