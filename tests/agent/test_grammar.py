"""The command grammar understands what the README says, and does nothing about what it does not understand."""

import pytest

from backend.agent.offline import report
from backend.agent.offline.grammar import (
    GoBack,
    GoTo,
    GoToPoint,
    Say,
    TakePhoto,
    TellBattery,
    TellPlaces,
    TellPose,
    Turn,
    parse,
)

NOON = Say("The meeting is at noon.")


@pytest.mark.parametrize(
    ("text", "actions"),
    [
        ("Go to lab 2.3.7 and tell them that the meeting is at noon", [GoTo("lab 2.3.7"), NOON]),
        (
            "go to lab 2.3.7 and tell them that the meeting is at noon, then come back",
            [GoTo("lab 2.3.7"), NOON, GoBack()],
        ),
        ("Go back to where you started", [GoBack()]),
        ("Return to the start.", [GoBack()]),
        ("come back", [GoBack()]),
        ("return to the dock", [GoTo("the dock")]),
        ("go back to the kitchen", [GoTo("the kitchen")]),
        ("Sancho, could you please take me to the kitchen?", [GoTo("the kitchen")]),
        ("drive to (3.2, -1.5)", [GoToPoint(3.2, -1.5)]),
        ("go to x 3 y 4", [GoToPoint(3, 4)]),
        ("turn left", [Turn(90)]),
        ("turn right by 30 degrees", [Turn(-30)]),
        ("rotate 45 degrees clockwise", [Turn(-45)]),
        ("rotate 45 degrees counter-clockwise", [Turn(45)]),
        ("turn around", [Turn(180)]),
        ("say hello", [Say("Hello.")]),
        ("tell everyone: lunch is ready!", [Say("Lunch is ready.")]),
        ("tell lab 2.3.4 that the coffee is ready", [GoTo("lab 2.3.4"), Say("The coffee is ready.")]),
        ("deliver 'see you at five' to the kitchen", [GoTo("the kitchen"), Say("See you at five.")]),
        ('say "I am here. Then I go home." and come back', [Say("I am here. Then I go home."), GoBack()]),
        ("say that you will go and look for coffee", [Say("You will go and look for coffee.")]),
        ("say that I wonder where you are", [Say("I wonder where you are.")]),
        (
            "Go to lab 2.3.7, tell them that it moved to one o'clock, and then tell them that lunch is at two",
            [GoTo("lab 2.3.7"), Say("It moved to one o'clock."), Say("Lunch is at two.")],
        ),
        ("go to the kitchen, take a photo and come back", [GoTo("the kitchen"), TakePhoto(), GoBack()]),
        ("what do you see?", [TakePhoto()]),
        ("how is the battery?", [TellBattery()]),
        ("Where are you?", [TellPose()]),
        ("tell me where you are", [TellPose()]),
        ("which places are there?", [TellPlaces()]),
    ],
)
def test_understands(text: str, actions: list[object]) -> None:
    assert parse(text) == actions


@pytest.mark.parametrize(
    "text", ["", "go", "make me a sandwich", "turn left and make me a sandwich", "tell me a joke", "turn", "\x00", "!?"]
)
def test_does_nothing_about_what_it_does_not_understand_in_whole(text: str) -> None:
    assert parse(text) == []


def test_what_was_left_out_ends_with_one_full_stop() -> None:
    assert report.left_out([GoTo("the kitchen"), Say("Lunch is ready.")])[0].endswith("Say: Lunch is ready.")
