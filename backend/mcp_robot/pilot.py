"""Between the tools and the robot: asks the safety rules, lets one motion happen at a time, and stops.

All tools act through it, so that stop, cancel and telemetry see the same state. A motion belongs to the task that waits
for it: when that task is cancelled, whatever the reason, the robot brakes. It must never start anything by itself.
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass
from typing import Any, Literal, NoReturn

from backend.config import Limits
from backend.mcp_robot import safety
from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.robot import Picture, Robot, Route, Sound
from backend.mcp_robot.stop import StopLatch
from backend.telemetry import Motion, Path, Place, Pose, Speech, State, Stop

logger = logging.getLogger(__name__)

STALE_AFTER = 1.0
"""Seconds on the robot's clock after which a pose is old."""


@dataclass(frozen=True)
class Leg:
    """A motion that ended where it should: the way driven in m, the time it took in s of the robot's clock."""

    pose: Pose
    distance: float
    seconds: float


@dataclass(frozen=True)
class _Intent:
    """The motion under way, as it was asked for."""

    kind: Literal["navigate", "rotate"]
    goal: Pose
    place: str | None

    @property
    def activity(self) -> str:
        if self.kind == "rotate":
            return "turning already"
        where = self.place or f"({self.goal.x:.1f}, {self.goal.y:.1f})"
        return f"driving to {where} already"


class Pilot:
    """One robot and who may move it now."""

    def __init__(self, robot: Robot, latch: StopLatch, limits: Limits) -> None:
        self.robot = robot
        self._latch = latch
        self._limits = limits
        self._intent: _Intent | None = None  # from a motion's first rule to its end
        self._brakings = 0  # how often brake was called: what began before one must not go on after it
        self.speaking: str | None = None  # what is being said, while it is
        self.path = Path(robot.clock(), [])  # latest planned path, replaced on change
        self.speech: Speech | None = None  # latest sentence begun, replaced on change
        self.on_change: Callable[[], None] = lambda: None  # called after path or speech changed

    @property
    def stopped(self) -> Stop | None:
        """What the stop latch is set to."""
        return self._latch.stop

    @property
    def motion(self) -> Motion | None:
        """The motion under way."""
        intent, left = self._intent, self.robot.remaining
        if intent is None or left is None:
            return None
        return Motion(intent.kind, intent.goal, intent.place, left.distance, left.seconds)

    def state(self) -> State:
        """Everything that changes all the time, as telemetry."""
        robot = self.robot
        return State(
            robot.clock(), robot.name, robot.fix.pose, robot.twist, robot.battery,
            self.motion, self.stopped, self.speaking,
        )  # fmt: skip

    async def plan(self, goal: Pose, *, final_yaw: bool) -> Route:
        """Compute the way to a goal and show it. Moves nothing. Raises `Refusal`."""
        safety.finite(x=goal.x, y=goal.y, yaw=goal.yaw)
        route = await self._plan(goal, final_yaw)
        if self._intent is None:  # the path that is being driven matters more
            self._show(route, preview=True)
        return route

    async def navigate(self, goal: Pose, *, final_yaw: bool, place: Place | None = None) -> tuple[Route, Leg]:
        """Drive to a goal; returns there. Raises `Refusal`. Cancelling brakes."""
        safety.finite(x=goal.x, y=goal.y, yaw=goal.yaw)
        with self._motion(_Intent("navigate", goal, place.name if place else None), goal):
            brakings = self._brakings
            route = await self._plan(goal, final_yaw)
            self._not_braked_since(brakings)
            self._show(route, preview=False)
            try:
                return route, await self._run(self.robot.drive(route))
            finally:
                self._show(None, preview=False)

    async def rotate(self, degrees: float) -> Leg:
        """Turn on the spot, counter-clockwise positive; returns when done. Raises `Refusal`. Cancelling brakes."""
        safety.finite(degrees=degrees)
        safety.turn_fits(degrees)
        pose = self.robot.fix.pose
        goal = Pose(pose.x, pose.y, math.remainder(pose.yaw + math.radians(degrees), math.tau))
        with self._motion(_Intent("rotate", goal, None), None):
            return await self._run(self.robot.turn(math.radians(degrees)))

    async def speak(self, text: str) -> Sound:
        """Say a text aloud; returns when it is said. Raises `Refusal`. Cancelling ends it."""
        safety.not_stopped(self.stopped)
        safety.speech_fits(text, self._limits)
        safety.idle("speaking already" if self.speaking else None)
        self.speaking = text
        brakings = self._brakings
        try:
            sound = await self.robot.synthesize(text)
            self._not_braked_since(brakings)
            self.speech = Speech(self.robot.clock(), text, sound.seconds)
            self.on_change()
            await self.robot.say(text, sound)
        except Halted:
            self._tell_why()
        finally:
            self.robot.hush()
            self.speaking = None
        return sound

    async def photo(self) -> Picture:
        """What the camera sees."""
        return await self.robot.photo()

    def brake(self) -> None:
        """End what is under way or about to begin, at once and without a latch."""
        self.robot.halt()
        self.robot.hush()
        self._brakings += 1

    def stop(self, by: str) -> Stop:
        """Stop everything and latch it."""
        self.brake()  # first: nothing below may delay it
        stop = self._latch.set(by, time.time())
        logger.warning("Stop by %s (latched by %s).", by, stop.by)
        return stop

    def release(self, by: str) -> None:
        """Release the latch; nothing begins to move by it."""
        if self._latch.stop:
            logger.warning("Stop of %s released by %s.", self._latch.stop.by, by)
        self._latch.release()

    async def _plan(self, goal: Pose, final_yaw: bool) -> Route:
        safety.goal_is_free(self.robot.grid, goal, self.robot.footprint_radius)
        return await self.robot.plan(goal, final_yaw=final_yaw)

    async def _run(self, motion: Coroutine[Any, Any, None]) -> Leg:
        robot = self.robot
        began, driven = robot.clock(), robot.odometer
        await motion
        return Leg(robot.fix.pose, robot.odometer - driven, robot.clock() - began)

    @contextlib.contextmanager
    def _motion(self, intent: _Intent, goal: Pose | None) -> Iterator[None]:
        """The rules that every motion has to pass, and the promise that it does not outlive this block."""
        safety.not_stopped(self.stopped)
        safety.idle(self._intent.activity if self._intent else None)
        safety.battery_suffices(self.robot.battery, goal, self.robot.places, self._limits)
        self._intent = intent
        arrived = False
        try:
            yield
            arrived = True
        except Halted:
            self._tell_why()
        finally:
            if not arrived:
                self.robot.halt()
            self._intent = None

    def _not_braked_since(self, brakings: int) -> None:
        # A stop that was pressed and released meanwhile counts: a release never lets a motion begin.
        if self._brakings != brakings:
            self._tell_why()

    def _tell_why(self) -> NoReturn:
        """The refusal that answers whoever was interrupted by a halt."""
        safety.not_stopped(self.stopped)
        raise Refusal("stopped", "The robot was halted before it was done.")

    def _show(self, route: Route | None, *, preview: bool) -> None:
        self.path = Path(self.robot.clock(), list(route.points) if route else [], preview)
        self.on_change()
