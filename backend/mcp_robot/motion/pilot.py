"""The pilot: the only way from the tools to the robot. It checks the rules, runs one motion at a time, and stops it.

All tools act through the pilot, so that stop, cancel and telemetry see the same state. A motion belongs to the task
that waits for it: when that task is cancelled, for whatever reason, the robot brakes. The pilot never starts a motion
by itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NoReturn

import msgspec
import numpy as np

from backend.config import Limits
from backend.mcp_robot.motion import safety
from backend.mcp_robot.motion.guard import PERIOD, Guard
from backend.mcp_robot.motion.path_preview import PathPreview
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.navigation.grid import Floats
from backend.mcp_robot.navigation.named_places import at_dock
from backend.mcp_robot.refusal import Halted, Refusal
from backend.mcp_robot.robot import Picture, Robot, Route, Sound
from backend.telemetry import Halt, Motion, Path, Place, Pose, Speech, State, Stop, Zone

logger = logging.getLogger(__name__)

MOST_PLANS = 2
"""Paths that are planned at the same time: more would take the processor from the guard."""
STALE_AFTER = 1.0
"""Seconds on the robot's clock after which a pose is reported as stale."""
PROTECTIVE = frozenset({"blocked", "lost"})
"""The codes with which a robot itself ends a motion for safety's sake. Any other code means that a part failed."""
PREVIEW_AGE = 300.0
"""Seconds of wall time after which a preview is withdrawn, because its owner may be gone. People who are asked for
permission have less time than that."""
REST_TIME = 3.0
"""Seconds that a refusal waits for the robot to come to rest; then it is answered all the same."""


@dataclass(frozen=True)
class Leg:
    """A motion that reached its goal: where it ended, the distance driven in m, and its duration in s of the robot's
    clock."""

    pose: Pose
    distance: float
    seconds: float


@dataclass(frozen=True)
class _Intent:
    """The motion under way, as the client asked for it."""

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
    """One robot, its stop latch, and the one motion that may be under way."""

    def __init__(
        self,
        robot: Robot,
        latch: StopLatch,
        limits: Limits,
        zones: Sequence[Zone] = (),
        *,
        preview_age: float = PREVIEW_AGE,
    ) -> None:
        self.robot = robot
        self.limits = limits
        self.zones = tuple(zones)
        self._preview_age = preview_age
        self._latch = latch
        self._motions = safety.Rate("motions", limits.max_motions_per_minute)
        self._speeches = safety.Rate("speeches", limits.max_speeches_per_minute)
        self._veto: Refusal | None = None  # why the path that the robot changed to is refused, during a motion
        self._intent: _Intent | None = None  # the motion under way, from its first rule to its end
        self._planners = asyncio.Semaphore(MOST_PLANS)
        self._preview: PathPreview | None = (
            None  # the path that is shown or being computed for it, until it is withdrawn
        )
        self._preview_ends: asyncio.TimerHandle | None = None  # the timer that withdraws it
        self._brakings = 0  # how often `brake` was called: an action that was asked for before must not begin after it
        self.halted: Halt | None = None  # set when a motion ends for safety's sake, until the next one begins
        self.speaking: str | None = None  # the text that is being said; None while silent
        self.path = Path(robot.clock(), [])  # the path that telemetry shows; replaced on change
        self.speech: Speech | None = None  # the latest sentence that was begun; replaced on change
        self.on_change: Callable[[], None] = lambda: None  # called after path or speech changed
        robot.hold(latch.stop is not None)

    @property
    def stopped(self) -> Stop | None:
        """The stop, while it is latched."""
        return self._latch.stop

    @property
    def motion(self) -> Motion | None:
        """The motion under way."""
        intent, left = self._intent, self.robot.remaining
        if intent is None or left is None:
            return None
        return Motion(intent.kind, intent.goal, intent.place, left.distance, left.seconds)

    def state(self) -> State:
        """What the robot does now, as telemetry."""
        robot, now = self.robot, self.robot.clock()
        # Another thread may write these: the velocity is read first, so that a robot at rest has its pose of that rest.
        twist = robot.velocity.twist
        return State(
            now, robot.name, robot.fix.pose, twist,
            msgspec.structs.replace(robot.battery, floor=self.limits.battery_floor),
            self.motion, self.stopped, self.speaking, self.halted,
        )  # fmt: skip

    async def plan(self, goal: Pose, *, final_yaw: bool, preview: PathPreview | None = None) -> Route:
        """Compute the path to a goal; with a `preview`, show it in telemetry. Moves nothing. Raises `Refusal`."""
        safety.goal_is_ordinary(goal)
        if preview is None:
            return await self._plan(goal, final_yaw)
        if preview.rehearsal:
            self._may_move(goal)
        elif self._preview and self._preview.rehearsal:
            return await self._plan(goal, final_yaw)  # people are being asked about the path that is shown
        self._drop_preview()  # a newer preview replaces it for good
        self._preview = preview
        try:
            route = await self._plan(goal, final_yaw)
        except BaseException:
            if self._preview is preview:
                self._drop_preview()
            raise
        # The preview may have been withdrawn meanwhile; and a path that is being driven takes precedence.
        if self._preview is preview and self._intent is None:
            self._show(route.points, preview=True)
            self._preview_ends = asyncio.get_running_loop().call_later(self._preview_age, self._drop_preview)
        return route

    def forget_preview(self, own: str) -> str | None:
        """Withdraw the preview with this id. A preview with another id, and a path that is being driven, stay. Returns
        the id of the preview that is shown now, None for none."""
        if self._preview and self._preview.id == own:
            self._drop_preview()
        return self._preview.id if self._preview else None

    def _drop_preview(self) -> None:
        self._preview = None
        if self._preview_ends:
            self._preview_ends.cancel()
        if self.path.preview:
            self._show((), preview=False)

    async def navigate(self, goal: Pose, *, final_yaw: bool, place: Place | None = None) -> tuple[Route, Leg]:
        """Drive to a goal; returns on arrival. Raises `Refusal`. Cancelling the caller's task brakes."""
        safety.goal_is_ordinary(goal)
        with self._motion(_Intent("navigate", goal, place.name if place else None), goal) as brakings:
            route = await self._plan(goal, final_yaw)
            self._not_braked_since(brakings)
            self._show(route.points, preview=False)
            try:
                to_dock = at_dock(goal, self.robot.places)
                return route, await self._run(self.robot.drive(route), brakings, to_dock=to_dock)
            finally:
                self._show((), preview=False)

    async def rotate(self, degrees: float) -> Leg:
        """Turn on the spot, counter-clockwise positive; returns when done. Raises `Refusal`. Cancelling brakes."""
        safety.finite(degrees=degrees)
        safety.turn_fits(degrees)
        pose = self.robot.fix.pose
        goal = Pose(pose.x, pose.y, math.remainder(pose.yaw + math.radians(degrees), math.tau))
        with self._motion(_Intent("rotate", goal, None), None) as brakings:
            return await self._run(self.robot.turn(math.radians(degrees)), brakings, to_dock=False)

    async def speak(self, text: str) -> Sound:
        """Say a text aloud; returns when it is said. Raises `Refusal`. Cancelling the caller's task ends the speech."""
        safety.not_stopped(self.stopped)
        safety.has_voice(self.robot.capabilities)
        safety.speech_fits(text, self.limits)
        safety.idle("speaking already" if self.speaking else None)
        self._speeches.take(self.robot.clock())
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
        """A picture from the camera, taken now. Raises `Refusal` (no_camera)."""
        safety.has_camera(self.robot.capabilities)
        return await self.robot.photo()

    def brake(self) -> None:
        """End motion and speech that are under way or about to begin, at once and without a latch."""
        self._brakings += 1  # first: nothing may begin any more, whatever happens below
        for act in (self.robot.halt, self.robot.hush):
            self._do_for_sure(act)

    def stop(self, by: str) -> Stop:
        """Stop everything and latch it."""
        self.brake()  # first: nothing below may delay it
        self._do_for_sure(lambda: self.robot.hold(True))
        stop = self._latch.set(by, time.time())
        logger.warning("Stop by %s (latched by %s).", by, stop.by)
        return stop

    def name_stop(self, stop: Stop, by: str) -> Stop:
        """Name the person who set `stop`, if it is latched still and has no name; returns what is latched."""
        named = self._latch.name(stop, by)
        if named is not stop:
            logger.warning("It was %s who stopped.", named.by)
        return named

    @staticmethod
    def _do_for_sure(act: Callable[[], None]) -> None:
        # A robot that fails to take one command must still get the next one, and the latch must still be set.
        try:
            act()
        except Exception:
            logger.exception("The robot did not take a command to halt.")

    def release(self, by: str) -> None:
        """Release the latch; starts no motion. Raises `OSError` when its file cannot be removed: the stop stays."""
        if self._latch.stop:
            logger.warning("Stop of %s released by %s.", self._latch.stop.by, by)
        self._latch.release()
        self.robot.hold(False)

    def halted_by(self, refusal: Refusal) -> None:
        """Report that the safety layer ended the motion under way: telemetry shows it until the next motion begins."""
        if self._intent is not None:
            self.halted = Halt(refusal.code, refusal.sentence, time.time())

    def rerouted(self, points: Floats) -> None:
        """The robot took another path, shape (n, 2), during a drive: check it by the same rules; show it, or halt."""
        try:
            self._check_path(points)
        except Refusal as refusal:
            self._veto = refusal
            self.robot.halt()
        except Exception:
            logger.exception("A way that the robot took cannot be judged.")
            self._veto = Refusal("blocked", "The robot took a way that cannot be judged, and has halted. Ask again.")
            self.robot.halt()
        else:
            self._show(points.tolist(), preview=False)

    async def _plan(self, goal: Pose, final_yaw: bool) -> Route:
        robot = self.robot
        safety.goal_keeps_out(self.zones, robot.grid, goal, robot.footprint_radius)
        safety.goal_is_free(robot.grid, goal, robot.footprint_radius)
        async with self._planners:
            route = await robot.plan(goal, final_yaw=final_yaw)
        self._check_path(np.array(route.points))
        return route

    def _check_path(self, points: Floats) -> None:
        safety.path_is_free(self.robot.grid, self.zones, points, self.robot.footprint_radius)

    async def _run(self, motion: Coroutine[Any, Any, None], brakings: int, *, to_dock: bool) -> Leg:
        """Run a motion under the guard. `brakings` is the count of brakings when the motion was allowed."""
        robot = self.robot
        guard = Guard(robot, self.zones, self.limits, to_dock=to_dock)
        try:
            guard.check()  # a motion that the guard would halt at once does not begin
        except BaseException:
            motion.close()
            raise
        began, driven = robot.clock(), robot.odometer
        moving = asyncio.ensure_future(self._begin(motion, brakings))
        try:
            await asyncio.wait({moving}, timeout=PERIOD)
            while not moving.done():
                guard.check()
                await asyncio.wait({moving}, timeout=PERIOD)
        except BaseException as reason:
            robot.halt()
            if isinstance(reason, Refusal):
                self.halted_by(reason)
            await self._rest(moving, reason)
            motion.close()  # for a motion that ended before its first step
            raise
        if self._veto and moving.exception():
            self.halted_by(self._veto)
            raise self._veto from moving.exception()
        self._result(moving)
        return Leg(robot.fix.pose, robot.odometer - driven, robot.clock() - began)

    async def _begin(self, motion: Coroutine[Any, Any, None], brakings: int) -> None:
        """Check once more that nobody has braked, and begin in the same step of the event loop, so that no stop comes
        between."""
        try:
            self._not_braked_since(brakings)
        except Refusal:
            motion.close()
            raise
        await motion

    def _result(self, moving: asyncio.Future[None]) -> None:
        try:
            moving.result()
        except Refusal as refusal:
            if refusal.code in PROTECTIVE:
                self.halted_by(refusal)
            raise

    async def _rest(self, moving: asyncio.Future[None], reason: BaseException) -> None:
        """Wait for the end of a motion that was halted: a refusal is answered when the robot is at rest."""
        try:
            if isinstance(reason, Refusal):
                logger.warning("The guard halted the robot: %s", reason)
                await asyncio.wait({moving}, timeout=REST_TIME)
        finally:
            moving.cancel()  # also when this task is cancelled: nothing of the motion may outlive it
            await asyncio.gather(moving, return_exceptions=True)

    @contextlib.contextmanager
    def _motion(self, intent: _Intent, goal: Pose | None) -> Iterator[int]:
        """Check the rules that every motion has to pass, and halt the robot if this block ends before the motion does.
        Yields the count of brakings: the motion may begin only while the count is still the same."""
        self._may_move(goal)
        self._motions.take(self.robot.clock())
        self._drop_preview()  # a path that is only computed must not be shown beside the driven one
        self._intent, self._veto, self.halted = intent, None, None
        arrived = False
        try:
            yield self._brakings
            arrived = True
        except Halted:
            self._tell_why()
        finally:
            if not arrived:
                self.robot.halt()
            self._intent = None

    def _may_move(self, goal: Pose | None) -> None:
        """Check the rules that need no path: every motion and every rehearsal has to pass them. Raises `Refusal`."""
        safety.not_stopped(self.stopped)
        safety.idle(self._intent.activity if self._intent else None)
        safety.battery_suffices(self.robot.battery, goal, self.robot.places, self.limits)

    def _not_braked_since(self, brakings: int) -> None:
        # A stop that was released meanwhile counts, too: a release never lets a motion begin.
        if self._brakings != brakings:
            self._tell_why()

    def _tell_why(self) -> NoReturn:
        """Raise the refusal for a call that a halt interrupted."""
        safety.not_stopped(self.stopped)
        raise Refusal("stopped", "The robot was halted before it was done.")

    def _show(self, points: Sequence[tuple[float, float]], *, preview: bool) -> None:
        self.path = Path(self.robot.clock(), [(x, y) for x, y in points], preview)
        self.on_change()
