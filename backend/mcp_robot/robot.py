"""The seam between the robot and everything that is said about it: a small protocol that a backend implements.

The simulator is one; a ROS 2 adapter maps it to localisation, Nav2 and topics. Tools, safety, telemetry and stop
stand above it and are written once. A backend moves only when told to by `drive` or `turn`, keeps its own limits and
protective stop, and trusts that its caller has checked the goal. SI units; the map frame and the robot's frame follow
REP 103 (x forward, y left, counter-clockwise positive).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from backend.mcp_robot.navigation.grid import OccupancyGrid
from backend.telemetry import Battery, Place, Pose, Scan, Twist

PlaceKind = Literal["space", "docking"]


@dataclass(frozen=True)
class TopologicalMap:
    """Places that people name, and which of them are joined by a way, as pairs of ids."""

    frame_id: str
    places: tuple[Place, ...]
    edges: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Fix:
    """Where the robot believes it is: `stamp` on the robot's clock (Unix seconds), `source` what says so."""

    pose: Pose
    stamp: float
    source: str


NOWHERE = Fix(Pose(0.0, 0.0, 0.0), 0.0, "unknown")
"""The fix of a robot that has never known where it is."""


@dataclass(frozen=True)
class Velocity:
    """How the robot moved when that was measured: `stamp` on the robot's clock (Unix seconds)."""

    twist: Twist
    stamp: float


@dataclass(frozen=True)
class Route:
    """A way to a goal: points in the map frame from the robot to the goal, its `length` in m and how long it will
    take in s. `final_yaw` says whether the goal's yaw is to be taken up, or any will do."""

    points: tuple[tuple[float, float], ...]
    length: float
    seconds: float
    goal: Pose
    final_yaw: bool


@dataclass(frozen=True)
class Remaining:
    """What is left of the motion under way: `distance` in m, `angle` in rad (turns only), `seconds` in s."""

    distance: float
    angle: float
    seconds: float


@dataclass(frozen=True)
class Picture:
    """A camera picture as JPEG, and where it was taken."""

    jpeg: bytes
    width: int
    height: int
    pose: Pose


@dataclass(frozen=True)
class Sound:
    """Speech as WAV, its length in s, and whether there is anything to hear in it."""

    wav: bytes
    seconds: float
    audible: bool


class Robot(Protocol):
    """One robot. Properties answer at once with the latest value; nothing here blocks the event loop."""

    @property
    def name(self) -> str:
        """What people call it."""

    @property
    def footprint_radius(self) -> float:
        """Radius of the circle that encloses it, in m."""

    def clock(self) -> float:
        """The robot's time, in Unix seconds. A simulated robot's may run faster than the wall's."""

    @property
    def fix(self) -> Fix:
        """Where it is; `NOWHERE` until it knows."""

    @property
    def velocity(self) -> Velocity:
        """How it moves, as measured last."""

    @property
    def battery(self) -> Battery:
        """How long it can."""

    @property
    def grid(self) -> OccupancyGrid:
        """The map that it moves in. Raises `Refusal` (no_map) while there is none."""

    @property
    def places(self) -> TopologicalMap:
        """The names in that map."""

    @property
    def remaining(self) -> Remaining | None:
        """What is left of the motion under way, None when there is none."""

    @property
    def odometer(self) -> float:
        """Metres driven since it was switched on."""

    def scan(self) -> Scan:
        """The latest laser scan."""

    async def plan(self, goal: Pose, *, final_yaw: bool) -> Route:
        """A way to `goal` from where it is. Moves nothing. Raises `Refusal` (unreachable)."""

    async def drive(self, route: Route) -> None:
        """Drive along a route; returns at its end, at rest. Raises `Refusal` (blocked) or `Halted`, at rest both.

        Cancelling the task that waits here does not stop the robot: whoever cancels calls `halt`.
        """

    async def turn(self, angle: float) -> None:
        """Turn on the spot by `angle` rad, counter-clockwise positive. Ends like `drive`."""

    def halt(self) -> None:
        """Brake at once, as hard as the limits allow. Returns immediately and cannot fail; `drive` and `turn` end
        with `Halted` once the robot is at rest."""

    def hold(self, held: bool) -> None:
        """While held, keep it at rest, against other commanders too where there are any. Returns immediately."""

    async def photo(self) -> Picture:
        """What the camera sees. Raises `Refusal` (no_camera)."""

    async def synthesize(self, text: str) -> Sound:
        """The sound of a text; says nothing yet."""

    async def say(self, text: str, sound: Sound) -> None:
        """Say it aloud; returns when it is said. Raises `Halted` after `hush`, or `Refusal` (no_voice)."""

    def hush(self) -> None:
        """Stop speaking at once."""
