"""What each mode lets each kind of tool do."""

import pytest

from backend.agent.policy import Policy, ToolTraits

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
    decided = [Policy().decide(mode, tool) for tool in (DRIVE, SPEAK, LOOK, ACT, UNKNOWN)]
    assert decided == [drive, speak, look, act, unknown]


def test_only_the_plan_mode_previews_and_only_what_can_be_previewed() -> None:
    assert Policy().previews("plan", DRIVE)
    assert not Policy().previews("plan", SPEAK)
    assert not Policy().previews("supervised", DRIVE)


def test_settings_override_the_table_for_the_tools_that_they_name() -> None:
    policy = Policy({"supervised": {"navigate_to_place": "ask", "look_around": "deny"}})
    assert policy.decide("supervised", DRIVE) == "ask"
    assert policy.decide("supervised", LOOK) == "deny"
    assert policy.decide("supervised", SPEAK) == "ask"


def test_a_mode_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(ValueError, match="'supervized'; modes: observe, plan, movement, supervised, autonomous"):
        Policy({"supervized": {}})
