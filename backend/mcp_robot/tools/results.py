"""The results of the tools: each model is a tool's output schema and its structured content.

Field descriptions are read by LLMs and people alike: they name unit and frame. Nothing here computes.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from backend import telemetry

Metres = Annotated[float, Field(description="m")]
Mode = Literal["idle", "driving", "turning", "stopped"]
Seconds = Annotated[float, Field(description="s, on the robot's clock")]


class Pose(BaseModel):
    """A pose in the map frame: x and y in m, yaw in rad, counter-clockwise from the x axis."""

    x: float
    y: float
    yaw: float

    @classmethod
    def of(cls, pose: telemetry.Pose) -> Pose:
        """The pose in mm and tenths of a mrad: a robot knows it no better."""
        return cls(x=round(pose.x, 3), y=round(pose.y, 3), yaw=round(pose.yaw, 4))


class Node(BaseModel):
    """A place that has a name."""

    id: str
    name: str
    type: Annotated[str, Field(description="space or docking")]
    position: Pose


class Edge(BaseModel):
    """Two places, by id, with a direct way between them."""

    source: str
    target: str


class TopologicalMap(BaseModel):
    """All named places and how they are joined."""

    frame_id: str
    nodes: list[Node]
    edges: list[Edge]


class CurrentPose(BaseModel):
    """Where the robot is."""

    x: Metres
    y: Metres
    yaw: Annotated[float, Field(description="rad, counter-clockwise from the x axis")]
    frame_id: str
    stamp: Annotated[float, Field(description="Unix seconds of the robot's clock")]
    stale: Annotated[bool, Field(description="true when the pose is too old to rely on")]
    source: Annotated[str, Field(description="what determined it")]
    nearest_place: str | None
    nearest_place_distance: Annotated[float | None, Field(description="m, as the crow flies")]


class Stopped(BaseModel):
    """Who stopped the robot, and when (Unix seconds)."""

    by: str
    at: float


class Goal(BaseModel):
    """Where the motion under way ends, and what is left of it."""

    kind: Literal["navigate", "rotate"]
    pose: Pose
    place: str | None
    distance_left: Metres
    seconds_left: Seconds


class RobotStatus(BaseModel):
    """What the robot is doing and how it is."""

    name: str
    mode: Mode
    battery: Annotated[float, Field(description="charge from 0 to 1")]
    charging: bool
    speed: Annotated[float, Field(description="m/s")]
    turn_rate: Annotated[float, Field(description="rad/s, counter-clockwise positive")]
    moving: bool
    stopped: Stopped | None
    goal: Goal | None
    speaking: str | None


class Navigation(BaseModel):
    """How a drive ended, or with plan_only what it would be: then nothing moved and `reached` is false."""

    reached: bool
    pose: Annotated[Pose, Field(description="where the robot is now")]
    distance: Annotated[float, Field(description="m driven")]
    duration_s: Seconds
    place: str | None
    path_length: Annotated[float, Field(description="m, as planned")]
    expected_s: Annotated[float, Field(description="s, as planned")]
    plan_only: bool


class Rotation(BaseModel):
    """How a turn ended."""

    reached: bool
    degrees: float
    pose: Pose
    duration_s: Seconds


class Photo(BaseModel):
    """A photo; the picture itself is in the content."""

    width: int
    height: int
    mime_type: str
    pose: Annotated[Pose, Field(description="where it was taken")]


class Spoken(BaseModel):
    """What was said; the sound itself is in the content."""

    text: str
    seconds: Annotated[float, Field(description="how long it took to say, s")]
    audible: Annotated[bool, Field(description="false when the robot has no voice and waited in silence")]
