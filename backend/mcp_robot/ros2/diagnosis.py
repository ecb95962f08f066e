"""Diagnoses a ROS 2 robot from outside: imports, topics, actions, transform. `robot-acp doctor` prints the findings.

It only listens and commands nothing, so that it may be run beside a robot that drives.
"""

from __future__ import annotations

import asyncio
import math
import os
import time
from collections.abc import Iterator
from typing import Any

from backend.config import Settings
from backend.findings import Finding, bad, good
from backend.mcp_robot.ros2 import interfaces

LISTEN = 8.0
"""Seconds that it listens before it reports that a part is missing: nodes need a while to discover each other."""
LOOK_EVERY = 0.5


async def examine(settings: Settings) -> list[Finding]:
    """All findings about ROS, in the order in which one thing needs the other."""
    ros2 = settings.robot.ros2
    try:
        interfaces.require_rclpy()
    except interfaces.Ros2Missing as error:
        return [bad("rclpy", "it cannot be imported", str(error))]
    found = [good("rclpy", "it can be imported")]
    if ros2.demo:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        where = await asyncio.to_thread(interfaces.provide, settings.data_dir, ros2.distro)
    except interfaces.Ros2Missing as error:
        return [*found, bad("nav2_msgs, tf2_msgs", f"they are missing for {ros2.distro}", str(error))]
    found.append(good("nav2_msgs, tf2_msgs", f"for {ros2.distro}: {where}"))
    return [*found, *await _graph(settings)]


async def _graph(settings: Settings) -> list[Finding]:
    from rclpy.utilities import get_rmw_implementation_identifier

    from backend.mcp_robot.ros2.ros_thread import RosThread
    from backend.mcp_robot.ros2.senses import Senses

    ros = RosThread("robot_acp_doctor", settings.robot.ros2.domain_id)
    senses = Senses(ros.node, settings.robot.ros2, settings.robot.limits.pose_timeout, ())
    ros.open()
    try:
        deadline = time.monotonic() + LISTEN
        while True:
            await asyncio.sleep(LOOK_EVERY)
            found = await ros.run(lambda: _all(ros, senses, get_rmw_implementation_identifier()))
            if all(finding.ok for finding in found) or time.monotonic() > deadline:
                return found
    finally:
        await asyncio.to_thread(ros.close)


def _all(ros: Any, senses: Any, middleware: str) -> list[Finding]:
    nodes = [name for name in ros.node.get_node_names() if name != ros.node.get_name()]
    about = f"{middleware}, domain {ros.domain}"
    if not nodes:
        advice = "Start the robot, or set robot.ros2.domain_id or ROS_AUTOMATIC_DISCOVERY_RANGE as it has them."
        return [bad("ROS graph", f"no other node is to be seen ({about})", advice)]
    graph = good("ROS graph", f"{len(nodes)} other node{'' if len(nodes) == 1 else 's'} ({about})")
    return [graph, *_topics(ros.node, senses), *_picture(ros.node, senses), *_outputs(ros.node, senses.settings),
            *_actions(ros.node, senses.settings), _transform(senses)]  # fmt: skip


def _topics(node: Any, senses: Any) -> Iterator[Finding]:
    for setting in ("map", "amcl_pose", "odom", "scan", "battery"):
        if topic := getattr(senses.settings, setting):
            publishers, age = node.count_publishers(topic), senses.age(setting)
            said = "nothing heard yet" if math.isinf(age) else f"last heard {age:.1f} s ago"
            what = f"{publishers} publisher{'' if publishers == 1 else 's'}, {said}"
            advice = f"Start what publishes it, or set robot.ros2.{setting}."
            yield (bad if math.isinf(age) else good)(f"topic {topic}", what, advice)
    if not math.isinf(senses.age("scan")) and not senses.scan().ranges:
        advice = f"Publish the transform from {senses.settings.base_frame} to the laser's frame."
        yield bad("laser", "its scans cannot be used: they are empty, or nobody knows where the laser is", advice)


def _picture(node: Any, senses: Any) -> Iterator[Finding]:
    # Counted and not subscribed to: pictures are large.
    if topic := senses.settings.image:
        count = node.count_publishers(topic)
        advice = "Start the camera's driver, or set robot.ros2.image."
        yield (good if count else bad)(f"topic {topic}", f"{count} publisher{'' if count == 1 else 's'}", advice)


def _outputs(node: Any, settings: Any) -> Iterator[Finding]:
    wanted = "geometry_msgs/msg/TwistStamped" if settings.stamped else "geometry_msgs/msg/Twist"
    types = {info.topic_type for info in node.get_subscriptions_info_by_topic(settings.cmd_vel)}
    name = f"topic {settings.cmd_vel}"
    if wanted in types:
        yield good(name, f"a stop's zero velocity is heard ({wanted})")
    elif types:
        yield bad(name, f"its listeners want {', '.join(sorted(types))}", "Set robot.ros2.cmd_vel_stamped.")
    else:
        yield bad(name, "nobody listens to a stop's zero velocity", "Set robot.ros2.cmd_vel to the smoother's input.")
    if settings.speech and not settings.speech_action:
        count = node.count_subscribers(settings.speech)
        advice = 'Start the speech node, or set robot.ros2.speech, "" for none.'
        about = f"{count} listener{'' if count == 1 else 's'}"
        yield (good if count else bad)(f"topic {settings.speech}", about, advice)


def _actions(node: Any, settings: Any) -> Iterator[Finding]:
    services = {name for name, _ in node.get_service_names_and_types()}
    start_nav2 = "Start Nav2 and activate it, or set the action's name."
    for action, advice in (
        (settings.navigate, start_nav2),
        (settings.spin, start_nav2),
        (settings.compute_path, None),
        (settings.speech_action, 'Start the speech node, or set robot.ros2.speech_action, "" for the topic.'),
    ):
        if not action:
            continue
        name = node.resolve_service_name(f"{action}/_action/send_goal")
        if name in services:
            yield good(f"action {action}", "its server is there")
        elif advice:
            yield bad(f"action {action}", "no server", advice)
        else:
            yield good(f"action {action}", "no server; paths are planned here instead")


def _transform(senses: Any) -> Finding:
    frames = f"transform {senses.settings.map_frame} to {senses.settings.base_frame}"
    advice = "Start the localisation and set the initial pose, or set robot.ros2.map_frame and base_frame."
    if senses.frames.find(senses.settings.base_frame, senses.settings.map_frame) is None:
        return bad(frames, "nothing joins them", advice)
    if senses.lost is not None:
        return bad(frames, f"the last is {senses.lost:.1f} s old", advice)
    return good(frames, f"the pose comes from {senses.fix.source}")
