"""Each rule refuses what it is for, with its code and a sentence to act on, and lets the rest pass."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import get_args

import pytest

from backend.config import Limits
from backend.mcp_robot import refusal
from backend.mcp_robot.motion import safety
from backend.mcp_robot.motion.stop import FILE, StopLatch, name_of
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Battery, Pose, Stop

RADIUS = 0.25


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_is_refused(number: float) -> None:
    safety.finite(x=1.0, yaw=None)
    with pytest.raises(Refusal, match=r"^not_finite: yaw must be an ordinary number"):
        safety.finite(x=1.0, yaw=number)


@pytest.mark.parametrize(
    ("x", "y", "code", "words"),
    [
        (40.0, 3.0, "outside_map", "x from -0.5 to 24.5"),
        (1e300, 0.0, "outside_map", "outside"),
        (5.6, 3.0, "occupied", "inside a wall"),
        (10.0, 6.2, "occupied", "too close to a wall"),
        (-0.3, 3.0, "occupied", "unknown part"),
    ],
)
def test_a_goal_that_is_no_free_floor_is_refused(office: World, x: float, y: float, code: str, words: str) -> None:
    with pytest.raises(Refusal) as refused:
        safety.goal_is_free(office.grid, Pose(x, y, 0.0), RADIUS)
    assert refused.value.code == code
    assert words in refused.value.sentence


def test_every_named_place_is_a_goal_that_passes(office: World) -> None:
    for place in office.places.places:
        safety.goal_is_free(office.grid, place.pose, RADIUS)


def test_with_a_low_battery_only_the_way_to_the_dock_is_allowed(office: World) -> None:
    low, limits = Battery(0.05, False), Limits()
    dock = next(place.pose for place in office.places.places if place.kind == "docking")
    safety.battery_suffices(low, dock, office.places, limits)
    safety.battery_suffices(Battery(0.5, False), None, office.places, limits)
    for goal in (Pose(12.0, 7.0, 0.0), None):
        with pytest.raises(Refusal, match=r"^battery_low: The battery is at 5%, below 10%. Send it to the dock first."):
            safety.battery_suffices(low, goal, office.places, limits)


def test_speech_is_neither_empty_nor_too_long() -> None:
    safety.speech_fits("Hello", Limits())
    with pytest.raises(Refusal, match=r"^too_long: The text has 401 characters; 400"):
        safety.speech_fits("x" * 401, Limits())
    with pytest.raises(Refusal, match=r"^empty: "):
        safety.speech_fits(" \n", Limits())


def test_more_than_so_many_within_a_minute_are_too_often() -> None:
    rate = safety.Rate("motions", 3)
    for now in (0.0, 10.0, 20.0):
        rate.take(now)
    with pytest.raises(Refusal, match=r"^too_often: 3 motions were begun within a minute, .* Ask again in 35 s."):
        rate.take(25.0)
    rate.take(60.0)
    with pytest.raises(Refusal, match=r"Ask again in 9 s"):
        rate.take(61.5)
    rate.take(0.0)  # the robot's clock was set back: nobody is locked out by that


def test_every_code_is_in_the_table_of_the_documentation_and_the_table_has_no_other() -> None:
    table = (Path(__file__).parents[3] / "docs" / "safety.md").read_text()
    assert set(re.findall(r"^\| `([a-z_]+)` \|", table, re.M)) == set(get_args(refusal.Code))


def test_a_set_latch_and_another_motion_refuse() -> None:
    safety.not_stopped(None)
    safety.idle(None)
    with pytest.raises(Refusal, match=r"^stopped: Stopped by Ana. A supervisor has to release it.$"):
        safety.not_stopped(Stop("Ana", 1.0))
    with pytest.raises(Refusal, match=r"^busy: The robot is turning already"):
        safety.idle("turning already")


def test_the_first_stop_is_kept_and_survives_a_restart(tmp_path: Path) -> None:
    latch = StopLatch(tmp_path)
    assert latch.set("Ana", 10.0) == Stop("Ana", 10.0)
    assert latch.set("Ben", 20.0) == Stop("Ana", 10.0)
    assert StopLatch(tmp_path).stop == Stop("Ana", 10.0)
    latch.release()
    assert StopLatch(tmp_path).stop is None
    latch.release()


@pytest.mark.parametrize("content", [b"", b"{", b'{"by": 7}', b"\xff\xfe"])
def test_a_stop_file_that_cannot_be_read_is_a_stop(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE).write_bytes(content)
    assert StopLatch(tmp_path).stop is not None


def test_a_stop_that_cannot_be_written_down_is_still_a_stop(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    latch = StopLatch(tmp_path / "other")
    (tmp_path / "other").write_text("no folder")
    latch.set("Ana", 1.0)
    assert latch.stop == Stop("Ana", 1.0)


@pytest.mark.parametrize(
    ("given", "name"),
    [("Ana", "Ana"), (" Ana\n B ", "Ana B"), ("", "someone"), (None, "someone"), ("\x1b", "someone")],
)
def test_whoever_stops_gets_a_clean_name(given: str | None, name: str) -> None:
    assert name_of(given) == name
