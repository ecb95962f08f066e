"""The command grammar understands what the README says, and does nothing about what it does not understand."""

import re
import time
from pathlib import Path

import pytest

from backend.agent.offline import report
from backend.agent.offline.grammar import (
    LONGEST,
    GoBack,
    GoTo,
    GoToPoint,
    Say,
    TakePhoto,
    TellAbilities,
    TellBattery,
    TellPlaces,
    TellPose,
    Turn,
    parse,
)

LOCALES = Path(__file__).parents[3] / "web" / "src" / "i18n" / "locales"
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
        ("What can you do?", [TellAbilities()]),
        ("help", [TellAbilities()]),
        ("Lléveme a: lab 2.3.7", [GoTo("lab 2.3.7")]),
        ("ve al dock, por favor", [GoTo("dock")]),
        ("Por favor, llévanos a la recepción.", [GoTo("recepción")]),
        ("Vuelva al dock.", [GoTo("dock")]),
        ("regresa", [GoBack()]),
        ("¡Salude!", [Say("Hola.")]),
        ("diga: la reunión es a las doce", [Say("La reunión es a las doce.")]),
        ("Di «¡Hola, María!»", [Say("¡Hola, María!")]),
        ("gire a la derecha", [Turn(-90)]),
        ("¿Qué ve?", [TakePhoto()]),
        ("haz una foto", [TakePhoto()]),
        ("¿Dónde estás?", [TellPose()]),
        ("¿cuánta batería le queda?", [TellBattery()]),
        ("¿Qué lugares hay?", [TellPlaces()]),
        ("¿qué sabe hacer usted?", [TellAbilities()]),
    ],
)
def test_understands(text: str, actions: list[object]) -> None:
    assert parse(text) == actions


@pytest.mark.parametrize(
    "text",
    [
        "",
        "go",
        "make me a sandwich",
        "turn left and make me a sandwich",
        "tell me a joke",
        "turn",
        "\x00",
        "!?",
        "help yourself to a coffee",
        "no vayas a la cocina",
        "¿Dónde está la cocina?",
        "salude y vuelva",
        f"go to {'9' * 400} 1",
        f"turn left by {'9' * 400} degrees",
    ],
)
def test_does_nothing_about_what_it_does_not_understand_in_whole(text: str) -> None:
    assert parse(text) == []


HEADS = ("", "go to ", "say ", "tell ", "turn ", "hello,", "di ", "deliver ", "what ", "list ", "por favor ")
PIECES = (
    " ", ",", " , ", ".", ":", "!", '"', "'", " 'a", "\x00", "\x00 ", "9", "9 ", "9.", "-", "(", "a", "a ", "a,", "to ",
    "by ", "and ", "go; ", "go. ", "go, ", "then ", "hello ", "i want you to ", "let a know ", "tell a that ",
    "charged ", "list ", "x that", "return ", "está ", "di que ", "¿",
)  # fmt: skip


@pytest.mark.parametrize("length", [LONGEST, 100_000])
@pytest.mark.parametrize("head", HEADS)
def test_no_text_takes_long(head: str, length: int) -> None:
    """Each of these once took seconds or for ever. The limit is for a machine that is a hundred times slower."""
    for piece in PIECES:
        for tail in ("", "x"):
            text = (head + piece * length)[: length - 1] + tail
            before = time.process_time()
            parse(text)
            assert time.process_time() - before < 1, (piece, tail)


@pytest.mark.parametrize("language", sorted(LOCALES.glob("??.ts")), ids=lambda path: path.stem)
def test_understands_what_the_pages_suggest(language: Path) -> None:
    words = language.read_text(encoding="utf-8")

    def said(page: str, names: str) -> list[str]:
        block = words[words.index(f"\n  {page}: {{") :]
        return re.findall(rf'^    (?:{names}): "(.+)",$', block[: block.index("\n  }")], re.M)

    suggested = said("suggestions", "abilities|where|photo|battery")
    suggested += said("kiosk", "toThe|to|see|sayHello|where|abilities|battery")
    assert len(suggested) == 11
    assert [text for text in suggested if not parse(text.replace("{{place}}", "reception"))] == []


def test_what_was_left_out_ends_with_one_full_stop() -> None:
    assert report.left_out([GoTo("the kitchen"), Say("Lunch is ready.")])[0].endswith("Say: Lunch is ready.")
