"""The interface to a robot: a small protocol that each kind of robot implements.

The simulator is one kind; the ROS 2 adapter is the other, on top of localisation, Nav2 and topics. Tools, safety,
telemetry and stop stand above this interface and are written once. A robot moves only when `drive` or `turn` asks for
it, keeps its own limits and its own protective stop, and trusts that its caller has checked the goal. Units are SI;
axes and signs follow REP 103 (x forward, y left, counter-clockwise positive), and the map frame REP 105.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from backend.mcp_robot.navigation.grid import OccupancyGrid
from backend.telemetry import Battery, Place, Pose, Scan, Twist

PlaceKind = Literal["space", "docking"]


@dataclass(frozen=True)
class TopologicalMap:
    """The places that have a name, and as pairs of their ids, which of them are joined by a direct way."""

    frame_id: str
    places: tuple[Place, ...]
    edges: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Fix:
    """Where the robot believes it is; `stamp` is on the robot's clock (Unix seconds), `source` names what determined
    it."""

    pose: Pose
    stamp: float
    source: str


NOWHERE = Fix(Pose(0.0, 0.0, 0.0), 0.0, "unknown")
"""The fix of a robot that has never known where it is."""


@dataclass(frozen=True)
class Velocity:
    """A measured velocity: `stamp` is the time of the measurement on the robot's clock (Unix seconds)."""

    twist: Twist
    stamp: float


@dataclass(frozen=True)
class Route:
    """A path to a goal: points in the map frame from the robot to the goal, in m; its `length` in m and its expected
    duration in s. With `final_yaw` the robot turns to the goal's yaw at the end; without, any yaw will do."""

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
class Capabilities:
    """What a robot has beyond wheels, map and pose. A tool that needs a part that is missing is not offered."""

    camera: bool = True
    voice: bool = True
    laser: bool = True


@dataclass(frozen=True)
class Picture:
    """A camera picture as JPEG, its size in pixels, and the robot's pose when it was taken."""

    jpeg: bytes
    width: int
    height: int
    pose: Pose


@dataclass(frozen=True)
class Sound:
    """Speech as WAV and its length in s; `audible` is false for silence."""

    wav: bytes
    seconds: float
    audible: bool


class Robot(Protocol):
    """One robot. Properties return the latest value at once; nothing here blocks the event loop."""

    @property
    def name(self) -> str:
        """The robot's name."""

    @property
    def footprint_radius(self) -> float:
        """Radius in m of the circle that encloses the robot, around the point that it turns about."""

    @property
    def capabilities(self) -> Capabilities:
        """Which parts the robot has, as it was set up. They stay the same while it runs: a camera that is broken is
        still a camera, and refuses."""

    def clock(self) -> float:
        """The robot's time, in Unix seconds. A simulated robot's time may pass faster than the wall's."""

    @property
    def fix(self) -> Fix:
        """Where the robot is in the map; `NOWHERE` until it knows."""

    @property
    def velocity(self) -> Velocity:
        """The latest measured velocity."""

    @property
    def battery(self) -> Battery:
        """The charge of the battery, and whether it is charging."""

    @property
    def grid(self) -> OccupancyGrid:
        """The map that the robot moves in. Raises `Refusal` (no_map) while it has none."""

    @property
    def places(self) -> TopologicalMap:
        """The named places of that map."""

    @property
    def remaining(self) -> Remaining | None:
        """What is left of the motion under way; None when the robot has none."""

    @property
    def odometer(self) -> float:
        """Metres driven since the robot was switched on."""

    def scan(self) -> Scan:
        """The latest laser scan."""

    async def plan(self, goal: Pose, *, final_yaw: bool) -> Route:
        """Plan a path from the robot's pose to `goal`. Moves nothing. Raises `Refusal` (unreachable)."""

    async def drive(self, route: Route) -> None:
        """Drive along a route; returns at its end. Raises `Refusal` (blocked) or `Halted`. In each case the robot is at
        rest.

        Cancelling the task that waits here does not stop the robot: the caller that cancels has to call `halt`.
        """

    async def turn(self, angle: float) -> None:
        """Turn on the spot by `angle` rad, counter-clockwise positive. Ends like `drive`."""

    def halt(self) -> None:
        """Brake at once, as hard as the limits allow. Returns immediately and does not raise; `drive` and `turn` end
        with `Halted` once the robot is at rest."""

    def hold(self, held: bool) -> None:
        """While `held`, keep the robot at rest, also against other programs that command it. Returns immediately."""

    async def photo(self) -> Picture:
        """A picture from the camera, taken now. Raises `Refusal` (no_camera)."""

    async def synthesize(self, text: str) -> Sound:
        """The sound of a text. Plays nothing."""

    async def say(self, text: str, sound: Sound) -> None:
        """Say a text aloud; returns when the sound has ended. Raises `Halted` after `hush`, or `Refusal` (no_voice)."""

    def hush(self) -> None:
        """Stop speaking at once."""
