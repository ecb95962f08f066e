"""The tools that move the robot: drive to a pose, drive to a place, turn on the spot.

They translate arguments for the pilot and its answer into a result. They decide nothing about safety: the pilot does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from mcp.server.mcpserver import Context
from pydantic import Field

from backend import meta as keys
from backend import telemetry
from backend.mcp_robot.motion.path_preview import PathPreview
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.navigation import named_places
from backend.mcp_robot.tools import results, watchdog
from backend.mcp_robot.tools.long_call import long_call
from backend.mcp_robot.tools.mcp_server import ACTS, ACTS_IDEMPOTENTLY, RobotServer

MAX_PREVIEW_ID = 200
"""Characters of a preview's id. None of them is a slash, because the id is a segment of an HTTP path."""

PlanOnly = Annotated[bool, Field(description="only compute the path; move nothing")]


def add(server: RobotServer, pilot: Pilot) -> None:
    """Register these tools with the server; those that drive for a robot that has a laser, because without one the
    guard halts every drive."""
    if pilot.robot.capabilities.laser:
        _add_driving(server, pilot)
    _add_turning(server, pilot)


def _add_driving(server: RobotServer, pilot: Pilot) -> None:
    sign = watchdog.announced(pilot.limits)
    plans = {keys.PREVIEW: "plan_only"}

    async def go(
        context: Context, goal: telemetry.Pose, final_yaw: bool, place: telemetry.Place | None, plan_only: bool
    ) -> results.Navigation:
        robot = pilot.robot
        name = place.name if place else None
        if plan_only:
            preview = preview_asked_for(context.request_context.meta)
            route = await pilot.plan(goal, final_yaw=final_yaw, preview=preview)
            pose, distance, seconds = robot.fix.pose, 0.0, 0.0
        else:
            async with long_call(context, server.callers, pilot.limits, moving=pilot):
                route, leg = await pilot.navigate(goal, final_yaw=final_yaw, place=place)
            pose, distance, seconds = leg.pose, leg.distance, leg.seconds
        return results.Navigation(
            reached=not plan_only,
            pose=results.Pose.of(pose),
            distance=round(distance, 2),
            duration_s=round(seconds, 2),
            place=name,
            path_length=round(route.length, 2),
            expected_s=round(route.seconds, 1),
            plan_only=plan_only,
        )

    @server.tool(
        title="Drive to a pose",
        annotations=ACTS_IDEMPOTENTLY,
        meta={keys.TITLE: "Drive to ({x}, {y})", **sign, **plans},
    )
    async def navigate_to_pose(
        ctx: Context,
        x: Annotated[float, Field(description="m in the map frame")],
        y: Annotated[float, Field(description="m in the map frame")],
        yaw: Annotated[float | None, Field(description="rad to face at the end; any when left out")] = None,
        plan_only: PlanOnly = False,
    ) -> results.Navigation:
        """Drive to a point of the map, around walls and furniture; returns when the robot is there."""
        return await go(ctx, telemetry.Pose(x, y, yaw or 0.0), yaw is not None, None, plan_only)

    @server.tool(
        title="Drive to a place", annotations=ACTS_IDEMPOTENTLY, meta={keys.TITLE: "Drive to {place}", **sign, **plans}
    )
    async def navigate_to_place(
        ctx: Context,
        place: Annotated[str, Field(description="id or name from get_topological_map", max_length=200)],
        plan_only: PlanOnly = False,
    ) -> results.Navigation:
        """Drive to a named place of the topological map; returns when the robot is there."""
        found = named_places.resolve(place, pilot.robot.places)
        return await go(ctx, found.pose, True, found, plan_only)


def _add_turning(server: RobotServer, pilot: Pilot) -> None:
    sign = watchdog.announced(pilot.limits)

    @server.tool(title="Turn on the spot", annotations=ACTS, meta={keys.TITLE: "Turn by {degrees}°", **sign})
    async def rotate_in_place(
        ctx: Context,
        degrees: Annotated[float, Field(description="positive is counter-clockwise, to the left")],
    ) -> results.Rotation:
        """Turn the robot on the spot; returns when it has turned."""
        async with long_call(ctx, server.callers, pilot.limits, moving=pilot):
            leg = await pilot.rotate(degrees)
        return results.Rotation(
            reached=True, degrees=degrees, pose=results.Pose.of(leg.pose), duration_s=round(leg.seconds, 2)
        )


def preview_asked_for(meta: Mapping[str, Any] | None) -> PathPreview | None:
    """The preview that a call with `plan_only` asks for in its `_meta`; None where it asks for none that can be used:
    then the path is computed and not drawn."""
    match (meta or {}).get(keys.PREVIEW):
        case {"id": str(own), **more} if 0 < len(own) <= MAX_PREVIEW_ID and "/" not in own:
            return PathPreview(own, more.get("rehearsal") is True)
    return None
