"""The robot's MCP tools: from arguments to the pilot and back to typed results, nothing else.

A refusal becomes a tool error whose text is `code: sentence`, with the same two in the structured content. Tools
neither decide what is safe nor know which robot it is. Titles and descriptions are for people and LLMs.
"""

from __future__ import annotations

import base64
import logging
from typing import Annotated, Any, cast

from mcp.server.lowlevel import Server
from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.utilities.func_metadata import ArgModelBase
from mcp_types import (
    AudioContent,
    CallToolResult,
    ImageContent,
    InputRequiredResult,
    TextContent,
    ToolAnnotations,
)
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from backend import __version__, telemetry
from backend import meta as keys
from backend.mcp_robot.motion.pilot import STALE_AFTER, Pilot
from backend.mcp_robot.navigation import places
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import NOWHERE
from backend.mcp_robot.tools import preview, results, watchdog
from backend.mcp_robot.tools.progress import accompanied

LOOK = ToolAnnotations(read_only_hint=True, destructive_hint=False, idempotent_hint=True, open_world_hint=False)
GO = ToolAnnotations(read_only_hint=False, destructive_hint=False, idempotent_hint=True, open_world_hint=True)
"""Going to the same place twice changes nothing; the world that it moves in is open."""
ACT = ToolAnnotations(read_only_hint=False, destructive_hint=False, idempotent_hint=False, open_world_hint=True)

PlanOnly = Annotated[bool, Field(description="only compute the path; move nothing")]

INSTRUCTIONS = """\
You move a real or simulated service robot called {name} in a building. Look before you act: get_topological_map lists
the places that have names. Coordinates are metres in the map frame, yaw is in radians counter-clockwise. One motion at
a time; every motion tool returns when the robot has arrived. Errors read `code: sentence`; the sentence says what to
do."""


class RobotServer(MCPServer[Any]):
    """An MCP server whose arguments have to fit the published schema to the letter, and whose tool errors are
    sentences: a refusal's own, and one for wrong arguments."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.callers = watchdog.Callers()

    @property
    def core(self) -> Server[Any]:
        """The SDK's low-level server, for a transport of our own."""
        return self._lowlevel_server

    async def call_tool(
        self, name: str, arguments: dict[str, Any], context: Context[Any, Any] | None = None
    ) -> CallToolResult | InputRequiredResult:
        """Call a tool; what the robot refuses is a result, not an exception."""
        name_of_caller = watchdog.caller(context.request_context.meta) if context else None
        if name_of_caller:
            self.callers.hear(name_of_caller)
        try:
            return await super().call_tool(name, arguments, context)
        except ToolError as error:
            cause = error.__cause__
            if isinstance(cause, ValidationError):
                cause = Refusal("bad_arguments", _complaint(cause))
            if not isinstance(cause, Refusal):
                raise
            return CallToolResult(
                content=[TextContent(type="text", text=str(cause))],
                structured_content={"error": {"code": cause.code, "message": cause.sentence}},
                is_error=True,
            )

    def hold_to_schemas(self) -> None:
        """From here on, arguments are what the tools' schemas say: no text for a number, no flag for one, no others."""
        for tool in self._tool_manager.list_tools():
            strict = ConfigDict(strict=True, extra="forbid", title=tool.fn_metadata.arg_model.__name__)
            model = cast("type[ArgModelBase]", create_model(tool.name, __base__=tool.fn_metadata.arg_model))
            model.model_config.update(strict)
            model.model_rebuild(force=True)
            tool.fn_metadata.arg_model = model
            tool.parameters = model.model_json_schema(by_alias=True)


def _complaint(error: ValidationError) -> str:
    parts = [f"{'.'.join(map(str, e['loc'])) or 'arguments'}: {e['msg'].lower()}" for e in error.errors()]
    return "; ".join(parts) + "."


def build(pilot: Pilot) -> RobotServer:
    """The MCP server with all tools of this robot."""
    server = RobotServer(
        name="robot-acp robot",
        title=pilot.robot.name,
        version=__version__,
        instructions=INSTRUCTIONS.format(name=pilot.robot.name),
        log_level="WARNING",
    )
    _add_looking(server, pilot)
    _add_moving(server, pilot)
    _add_speaking(server, pilot)
    server.hold_to_schemas()
    logging.getLogger("mcp").setLevel(logging.WARNING)
    return server


def _add_looking(server: RobotServer, pilot: Pilot) -> None:
    robot = pilot.robot

    @server.tool(title="Read the map", annotations=LOOK, meta={keys.TITLE: "Read the map"})
    async def get_topological_map() -> results.TopologicalMap:
        """All places that have a name, with id, name, type (space or docking) and position, and how they are joined."""
        nodes = [
            results.Node(id=p.id, name=p.name, type=p.kind, position=results.Pose.of(p.pose))
            for p in robot.places.places
        ]
        edges = [results.Edge(source=a, target=b) for a, b in robot.places.edges]
        return results.TopologicalMap(frame_id=robot.places.frame_id, nodes=nodes, edges=edges)

    @server.tool(title="Where is the robot", annotations=LOOK, meta={keys.TITLE: "Look where the robot is"})
    async def get_current_pose() -> results.CurrentPose:
        """Where the robot is in the map frame, and which named place is nearest."""
        fix = robot.fix
        if fix is NOWHERE:
            raise Refusal("lost", "The robot does not know where it is. Set its initial pose, then ask again.")
        near = places.nearest(fix.pose, robot.places)
        return results.CurrentPose(
            **results.Pose.of(fix.pose).model_dump(),
            frame_id=robot.places.frame_id,
            stamp=fix.stamp,
            stale=robot.clock() - fix.stamp > STALE_AFTER,
            source=fix.source,
            nearest_place=near[0].name if near else None,
            nearest_place_distance=round(near[1], 2) if near else None,
        )

    @server.tool(title="Robot status", annotations=LOOK, meta={keys.TITLE: "Look how the robot is"})
    async def get_robot_status() -> results.RobotStatus:
        """Battery, speed, the stop, and what the robot is doing now."""
        return _status(pilot)

    @server.tool(title="Take a photo", annotations=LOOK, meta={keys.TITLE: "Take a photo"})
    async def take_photo() -> Annotated[CallToolResult, results.Photo]:
        """Take a picture with the robot's front camera."""
        picture = await pilot.photo()
        facts = results.Photo(
            width=picture.width,
            height=picture.height,
            mime_type="image/jpeg",
            pose=results.Pose.of(picture.pose),
        )
        image = ImageContent(type="image", data=base64.b64encode(picture.jpeg).decode(), mime_type="image/jpeg")
        return _with_text(facts, image)


def _sign_of_life(pilot: Pilot) -> dict[str, Any]:
    """What a client is told of the watchdog, in the `_meta` of tools that act."""
    return {keys.SIGN_OF_LIFE: {"within": pilot.limits.client_silence, "tool": "get_robot_status"}}


def _add_moving(server: RobotServer, pilot: Pilot) -> None:
    sign = _sign_of_life(pilot)
    plans = {keys.PREVIEW: "plan_only"}

    async def go(
        context: Context, goal: telemetry.Pose, final_yaw: bool, place: telemetry.Place | None, plan_only: bool
    ) -> results.Navigation:
        robot = pilot.robot
        name = place.name if place else None
        if plan_only:
            route = await pilot.plan(goal, final_yaw=final_yaw, preview=preview.asked(context.request_context.meta))
            pose, distance, seconds = robot.fix.pose, 0.0, 0.0
        else:
            async with accompanied(context, server.callers, pilot.limits, moving=pilot):
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

    @server.tool(title="Drive to a pose", annotations=GO, meta={keys.TITLE: "Drive to ({x}, {y})", **sign, **plans})
    async def navigate_to_pose(
        ctx: Context,
        x: Annotated[float, Field(description="m in the map frame")],
        y: Annotated[float, Field(description="m in the map frame")],
        yaw: Annotated[float | None, Field(description="rad to face at the end; any when left out")] = None,
        plan_only: PlanOnly = False,
    ) -> results.Navigation:
        """Drive to a point of the map, around walls and furniture; returns when the robot is there."""
        return await go(ctx, telemetry.Pose(x, y, yaw or 0.0), yaw is not None, None, plan_only)

    @server.tool(title="Drive to a place", annotations=GO, meta={keys.TITLE: "Drive to {place}", **sign, **plans})
    async def navigate_to_place(
        ctx: Context,
        place: Annotated[str, Field(description="id or name from get_topological_map", max_length=200)],
        plan_only: PlanOnly = False,
    ) -> results.Navigation:
        """Drive to a named place of the topological map; returns when the robot is there."""
        found = places.resolve(place, pilot.robot.places)
        return await go(ctx, found.pose, True, found, plan_only)

    @server.tool(title="Turn on the spot", annotations=ACT, meta={keys.TITLE: "Turn by {degrees}°", **sign})
    async def rotate_in_place(
        ctx: Context,
        degrees: Annotated[float, Field(description="positive is counter-clockwise, to the left")],
    ) -> results.Rotation:
        """Turn the robot on the spot; returns when it has turned."""
        async with accompanied(ctx, server.callers, pilot.limits, moving=pilot):
            leg = await pilot.rotate(degrees)
        return results.Rotation(
            reached=True, degrees=degrees, pose=results.Pose.of(leg.pose), duration_s=round(leg.seconds, 2)
        )


def _add_speaking(server: RobotServer, pilot: Pilot) -> None:
    sign = _sign_of_life(pilot)

    @server.tool(title="Say something aloud", annotations=ACT, meta={keys.TITLE: "Say aloud: “{text}”", **sign})
    async def speak(
        ctx: Context, text: Annotated[str, Field(description="what to say, in plain words")]
    ) -> Annotated[CallToolResult, results.Spoken]:
        """Say a text aloud through the robot's loudspeaker; returns when it is said."""
        async with accompanied(ctx, server.callers, pilot.limits):
            sound = await pilot.speak(text)
        facts = results.Spoken(text=text, seconds=round(sound.seconds, 2), audible=sound.audible)
        audio = AudioContent(type="audio", data=base64.b64encode(sound.wav).decode(), mime_type="audio/wav")
        return _with_text(facts, audio)


def _status(pilot: Pilot) -> results.RobotStatus:
    state = pilot.state()
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


def _with_text(facts: BaseModel, content: ImageContent | AudioContent) -> CallToolResult:
    """A result for clients that show content and for those that read structure."""
    return CallToolResult(
        content=[content, TextContent(type="text", text=facts.model_dump_json(indent=2))],
        structured_content=facts.model_dump(mode="json"),
    )
