"""The robot's state in one line: what it says, and which change of it is news."""

from __future__ import annotations

from typing import Any

import pytest

from backend.chat.status import Status

STANDING = {
    "robot": "Sancho",
    "online": True,
    "time": 1795240339.45,
    "pose": {"x": 3.21, "y": 4.0, "yaw": 1.5708},
    "twist": {"linear": 0.0, "angular": 0.0},
    "battery": {"level": 0.83, "charging": False},
    "motion": None,
    "stop": None,
    "speaking": None,
    "turn": None,
}
GOAL = {"x": 9.0, "y": 4.0, "yaw": 0.0}
MOTION = {"kind": "navigate", "goal": GOAL, "place": "lab 2.3.9", "distance": 5.8, "seconds": 11.0}
DRIVING = STANDING | {"twist": {"linear": 0.55, "angular": 0.0}, "motion": MOTION, "turn": {"by": "Ana"}}


def shown(params: dict[str, Any], trip: float | None = 0.0042) -> str:
    status = Status(trip)
    status.apply(params)
    return status.line


def test_a_robot_that_stands() -> None:
    assert shown(STANDING) == "ready · battery 83% · 0.00 m/s · x 3.2, y 4.0, 90° · held by nobody · link 4 ms"


def test_a_robot_that_drives_for_somebody() -> None:
    assert shown(DRIVING).startswith("driving to lab 2.3.9, 5.8 m to go · battery 83% · 0.55 m/s")
    assert "held by Ana" in shown(DRIVING)


def test_what_matters_most_comes_first() -> None:
    assert shown(DRIVING | {"stop": {"by": "Vic", "at": 1.0}}).startswith("STOPPED by Vic · ")
    assert shown({"robot": "Sancho", "online": False, "turn": None}).startswith("Sancho is not reachable · ")
    halted = {"code": "blocked", "text": "Somebody is in the way.", "at": 1.0}
    assert "halted by itself: Somebody is in the way." in shown(STANDING | {"halted": halted})


@pytest.mark.parametrize("nonsense", [{}, {"online": "yes"}, STANDING | {"pose": "here"}])
def test_a_message_that_cannot_be_read_gives_no_number(nonsense: dict[str, Any]) -> None:
    assert shown(nonsense) == "The robot is not reachable · held by nobody · link 4 ms"


def test_a_link_without_an_answer_has_no_figure() -> None:
    assert shown(STANDING, None).endswith("link –")
    assert Status().line == "no telemetry yet"


def test_numbers_that_move_all_the_time_are_no_news_and_the_rest_is() -> None:
    status = Status()
    assert status.apply(STANDING)
    assert not status.apply(STANDING | {"battery": {"level": 0.829, "charging": False}})
    assert status.apply(DRIVING)
    assert not status.apply(DRIVING | {"pose": GOAL, "motion": MOTION | {"distance": 2.0}})
    assert status.apply(DRIVING | {"stop": {"by": "Vic", "at": 1.0}})
    assert status.apply(STANDING)
    assert status.apply(STANDING | {"battery": {"level": 0.79, "charging": False}})
    assert status.apply(STANDING | {"battery": {"level": 0.79, "charging": True}})
