"""The fields of the interfaces that are generated, as in ROS 2 Humble to Kilted. Data, no behaviour.

Results grew: Humble's navigation result holds nothing, Iron and Jazzy added an error code, Kilted a message to it.
"""

from __future__ import annotations

PACKAGES = ("nav2_msgs", "tf2_msgs")


def definitions(package: str, distro: str) -> dict[str, str]:
    """File name below the package -> its text."""
    if package == "tf2_msgs":
        return {"msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n"}
    error = {"humble": "", "jazzy": "uint16 error_code\n", "kilted": "uint16 error_code\nstring error_msg\n"}[distro]
    navigated = error or "std_msgs/Empty result\n"
    checks = "bool disable_collision_checks\n" if distro == "kilted" else ""
    return {
        "action/NavigateToPose.action": f"""\
geometry_msgs/PoseStamped pose
string behavior_tree
---
{navigated}---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
""",
        "action/Spin.action": f"""\
float32 target_yaw
builtin_interfaces/Duration time_allowance
{checks}---
builtin_interfaces/Duration total_elapsed_time
{error}---
float32 angular_distance_traveled
""",
        "action/ComputePathToPose.action": f"""\
geometry_msgs/PoseStamped goal
geometry_msgs/PoseStamped start
string planner_id
bool use_start
---
nav_msgs/Path path
builtin_interfaces/Duration planning_time
{error}---
""",
    }
