"""What each mode lets each kind of tool do."""

import pytest

from backend.agent.control.policy import Policy, ToolTraits
from backend.config import Decision
from backend.identity import Role

DRIVE = ToolTraits("navigate_to_place", False, can_preview=True)
SPEAK = ToolTraits("speak", False)
LOOK = ToolTraits("look_around", True)
ACT = ToolTraits("open_gripper", False)
UNKNOWN = ToolTraits("mystery", None)


@pytest.mark.parametrize(
    ("mode", "drive", "speak", "look", "act", "unknown"),
    [
        ("observe", "deny", "deny", "allow", "deny", "deny"),
        ("plan", "deny", "deny", "allow", "deny", "deny"),
        ("movement", "allow", "deny", "allow", "ask", "ask"),
        ("supervised", "allow", "ask", "allow", "ask", "ask"),
        ("autonomous", "allow", "allow", "allow", "allow", "ask"),
    ],
)
def test_table(mode: str, drive: str, speak: str, look: str, act: str, unknown: str) -> None:
    decided = [Policy().decide(mode, tool, Role.OPERATOR) for tool in (DRIVE, SPEAK, LOOK, ACT, UNKNOWN)]
    assert decided == [drive, speak, look, act, unknown]


def test_only_the_plan_mode_previews_and_only_what_can_be_previewed() -> None:
    assert Policy().previews("plan", DRIVE)
    assert not Policy().previews("plan", SPEAK)
    assert not Policy().previews("supervised", DRIVE)


def test_settings_override_the_table_for_the_tools_that_they_name() -> None:
    policy = Policy({"supervised": {"navigate_to_place": "ask", "look_around": "deny"}})
    assert policy.decide("supervised", DRIVE, Role.OPERATOR) == "ask"
    assert policy.decide("supervised", LOOK, Role.OPERATOR) == "deny"
    assert policy.decide("supervised", SPEAK, Role.OPERATOR) == "ask"


def test_a_mode_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(ValueError, match="'supervized'; modes: observe, plan, movement, supervised, autonomous"):
        Policy({"supervized": {}})


@pytest.mark.parametrize(
    ("mode", "drive", "pose", "speak", "look", "act", "unknown"),
    [
        ("observe", "deny", "deny", "deny", "allow", "deny", "deny"),
        ("plan", "deny", "deny", "deny", "allow", "deny", "deny"),
        ("movement", "allow", "ask", "deny", "allow", "ask", "ask"),
        ("supervised", "allow", "ask", "ask", "allow", "ask", "ask"),
        ("autonomous", "allow", "ask", "ask", "allow", "ask", "ask"),
    ],
)
def test_what_a_visitor_asks_for_passes_the_stricter_of_two_tables(
    mode: str, drive: str, pose: str, speak: str, look: str, act: str, unknown: str
) -> None:
    tools = (DRIVE, ToolTraits("navigate_to_pose", False), SPEAK, LOOK, ACT, UNKNOWN)
    decided = [Policy().decide(mode, tool, Role.VISITOR) for tool in tools]
    assert decided == [drive, pose, speak, look, act, unknown]


@pytest.mark.parametrize(("setting", "decision"), [("allow", "ask"), ("ask", "ask"), ("deny", "deny")])
def test_the_visitors_table_can_forbid_but_never_gives_more_than_the_mode(setting: Decision, decision: str) -> None:
    policy = Policy(visitors={"speak": setting})
    assert policy.decide("supervised", SPEAK, Role.VISITOR) == decision
    assert policy.decide("supervised", SPEAK, Role.OPERATOR) == "ask"


def test_the_wish_that_motion_asks_counts_for_everyone() -> None:
    for role in (Role.VISITOR, Role.OPERATOR, Role.SUPERVISOR):
        assert Policy().decide("autonomous", DRIVE, role, motion_asks=True) == "ask"
        assert Policy().decide("observe", DRIVE, role, motion_asks=True) == "deny"
        assert Policy().decide("autonomous", ToolTraits("drive_to", False), role, motion_asks=True) == "ask"
    assert Policy().decide("autonomous", SPEAK, Role.OPERATOR, motion_asks=True) == "allow"
    assert Policy().decide("autonomous", LOOK, Role.OPERATOR, motion_asks=True) == "allow"
