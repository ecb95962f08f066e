"""The thread in which ROS runs: a context, a node and an executor of their own.

asyncio never waits for ROS: `submit` hands work to the executor's thread, and its result is set on the event loop.
Subscriptions and clients are made and destroyed on that thread alone; any thread may publish. Nothing here knows a
robot.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import os
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

T = TypeVar("T")

JOIN_LIMIT = 5.0
"""Seconds that the thread may take to end."""

logger = logging.getLogger(__name__)


class RosThread:
    """A node whose callbacks run in a thread of its own, from `open` to `close`."""

    def __init__(self, name: str, domain_id: int | None) -> None:
        self.domain = domain = int(os.environ.get("ROS_DOMAIN_ID") or 0) if domain_id is None else domain_id
        self._context = Context()
        self._context.init(domain_id=domain)  # unlike rclpy.init it leaves the process's signals alone
        self.node: Any = Node(name, context=self._context, start_parameter_services=False, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name="ros", daemon=True)
        self._closing = False

    def open(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """End the thread and leave the ROS graph. Blocks for some tens of milliseconds."""
        self._closing = True
        self._executor.create_task(lambda: None)  # ends the wait of the thread
        self._thread.join(JOIN_LIMIT)
        if self._thread.is_alive():
            logger.error("The ROS thread did not end within %.0f s.", JOIN_LIMIT)
            return
        self._executor.shutdown(timeout_sec=1.0)
        # A node destroys all that it has but its actions, and those keep it in the graph until Python collects cycles.
        for action in list(self.node.waitables):
            action.destroy()
        self.node.destroy_node()
        self._context.try_shutdown()

    def submit(self, work: Callable[[], T]) -> concurrent.futures.Future[T]:
        """Run `work` on the executor's thread, soon."""
        done: concurrent.futures.Future[T] = concurrent.futures.Future()

        def run() -> None:
            try:
                result = work()
            except BaseException as error:
                done.set_exception(error)
            else:
                done.set_result(result)

        self._executor.create_task(run)
        return done

    async def run(self, work: Callable[[], T], limit: float = JOIN_LIMIT) -> T:
        """The same for asyncio. Raises `TimeoutError` after `limit` s."""
        async with asyncio.timeout(limit):
            return await asyncio.wrap_future(self.submit(work))

    def _spin(self) -> None:
        while not self._closing:
            try:
                self._executor.spin_once(timeout_sec=0.5)
            except ExternalShutdownException:
                return
            except Exception:
                # One message that cannot be used must not cost the robot all others.
                logger.exception("A ROS callback failed.")
