"""The tools that observe: map, pose, status, photo. They change nothing, and run while the robot moves."""

from __future__ import annotations

from typing import Annotated

from mcp_types import CallToolResult

from backend import meta as keys
from backend import telemetry
from backend.mcp_robot.motion.pilot import STALE_AFTER, Pilot
from backend.mcp_robot.navigation import named_places
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import NOWHERE
from backend.mcp_robot.tools import results
from backend.mcp_robot.tools.mcp_server import READ_ONLY, RobotServer, image, with_content


def add(server: RobotServer, pilot: Pilot) -> None:
    """Register these tools with the server; take_photo for a robot that has a camera."""
    robot = pilot.robot

    @server.tool(title="Read the map", annotations=READ_ONLY, meta={keys.TITLE: "Read the map"})
    async def get_topological_map() -> results.TopologicalMap:
        """All places that have a name, with id, name, type (space or docking) and position, and how they are joined."""
        nodes = [
            results.Node(id=p.id, name=p.name, type=p.kind, position=results.Pose.of(p.pose))
            for p in robot.places.places
        ]
        edges = [results.Edge(source=a, target=b) for a, b in robot.places.edges]
        return results.TopologicalMap(frame_id=robot.places.frame_id, nodes=nodes, edges=edges)

    @server.tool(title="Where is the robot", annotations=READ_ONLY, meta={keys.TITLE: "Look where the robot is"})
    async def get_current_pose() -> results.CurrentPose:
        """Where the robot is in the map frame, and which named place is nearest."""
        fix = robot.fix
        if fix is NOWHERE:
            raise Refusal("lost", "The robot does not know where it is. Set its initial pose, then ask again.")
        near = named_places.nearest(fix.pose, robot.places)
        return results.CurrentPose(
            **results.Pose.of(fix.pose).model_dump(),
            frame_id=robot.places.frame_id,
            stamp=fix.stamp,
            stale=robot.clock() - fix.stamp > STALE_AFTER,
            source=fix.source,
            nearest_place=near[0].name if near else None,
            nearest_place_distance=round(near[1], 2) if near else None,
        )

    @server.tool(title="Robot status", annotations=READ_ONLY, meta={keys.TITLE: "Look how the robot is"})
    async def get_robot_status() -> results.RobotStatus:
        """Battery, speed, the stop, and what the robot is doing now."""
        return _status(pilot.state())

    if robot.capabilities.camera:
        _add_photo(server, pilot)


def _add_photo(server: RobotServer, pilot: Pilot) -> None:
    @server.tool(title="Take a photo", annotations=READ_ONLY, meta={keys.TITLE: "Take a photo"})
    async def take_photo() -> Annotated[CallToolResult, results.Photo]:
        """Take a picture with the robot's front camera."""
        picture = await pilot.photo()
        facts = results.Photo(
            width=picture.width,
            height=picture.height,
            mime_type="image/jpeg",
            pose=results.Pose.of(picture.pose),
        )
        return with_content(facts, image(picture.jpeg))


def _status(state: telemetry.State) -> results.RobotStatus:
    motion, stop, twist = state.motion, state.stop, state.twist
    goal = motion and results.Goal(
        kind=motion.kind,
        pose=results.Pose.of(motion.goal),
        place=motion.place,
        distance_left=round(motion.distance, 2),
        seconds_left=round(motion.seconds, 1),
    )
    return results.RobotStatus(
        name=state.robot,
        mode=_mode(state),
        battery=round(state.battery.level, 4),
        charging=state.battery.charging,
        speed=round(twist.linear, 3),
        turn_rate=round(twist.angular, 3),
        moving=twist.linear != 0.0 or twist.angular != 0.0,
        stopped=results.Stopped(by=stop.by, at=stop.at) if stop else None,
        goal=goal,
        speaking=state.speaking,
    )


def _mode(state: telemetry.State) -> results.Mode:
    if state.stop:
        return "stopped"
    if state.motion:
        return "driving" if state.motion.kind == "navigate" else "turning"
    return "idle"
