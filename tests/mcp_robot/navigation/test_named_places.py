"""Names of places are understood as people write them, and an unknown one is answered with the nearest."""

from __future__ import annotations

import pytest

from backend.mcp_robot.navigation import named_places
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import TopologicalMap
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Place, Pose


@pytest.mark.parametrize(
    "name", ["lab 2.3.7", "lab-2.3.7", "LAB 2.3.7", "lab2.3.7", " Lab  2.3.7 ", "the lab 2.3.7", "lab_2-3-7", "2.3.7"]
)
def test_one_place_has_many_spellings(office: World, name: str) -> None:
    assert named_places.resolve(name, office.places).name == "lab 2.3.7"


def test_an_unknown_place_is_answered_with_the_nearest_names_first(office: World) -> None:
    with pytest.raises(Refusal) as refusal:
        named_places.resolve("lab 9", office.places)
    assert refusal.value.code == "unknown_place"
    assert refusal.value.sentence.startswith("No place called lab 9. Known places: lab 2.3.9, ")
    assert "kitchen" in refusal.value.sentence


@pytest.mark.parametrize("name", ["", "   ", "lab", "2.3", "…", "x" * 5000])
def test_what_names_no_single_place_is_refused(office: World, name: str) -> None:
    with pytest.raises(Refusal, match=r"^unknown_place: No place called"):
        named_places.resolve(name, office.places)


def test_the_nearest_place_is_told_with_its_distance(office: World) -> None:
    found = named_places.nearest(Pose(2.9, 9.2, 0.0), office.places)
    assert found is not None
    assert found[0].name == "kitchen"
    assert found[1] == pytest.approx(0.5)


def test_where_no_place_has_a_name_another_way_to_drive_is_named() -> None:
    with pytest.raises(Refusal, match=r"^unknown_place: This map names no places. Drive to a pose"):
        named_places.resolve("kitchen", TopologicalMap("map", (), ()))


def named(*names: str) -> TopologicalMap:
    return TopologicalMap("map", tuple(Place(f"p{i}", n, "space", Pose(0, 0, 0)) for i, n in enumerate(names)), ())


@pytest.mark.parametrize(
    ("said", "name"),
    [("the desk", "desk"), ("La Mesa", "mesa"), ("our front desk", "front desk"), ("cafeteri\u0301a", "Cafetería"),
     ("३ का", "३ का"), ("al a 12", "a 12")],
)  # fmt: skip
def test_an_article_capitals_and_the_way_an_accent_is_written_do_not_matter(said: str, name: str) -> None:
    assert (
        named_places.resolve(said, named("desk", "front desk", "mesa", "Cafetería", "३ का", "३ कि", "a 12")).name
        == name
    )


@pytest.mark.parametrize(("said", "only"), [("2.3.7", "lab 12.3.7"), ("ward 1", "steward 1"), ("desk", "deskdesk")])
def test_the_end_of_a_word_or_a_number_names_no_place(said: str, only: str) -> None:
    with pytest.raises(Refusal, match=r"^unknown_place: No place called"):
        named_places.resolve(said, named(only, "kitchen"))


def test_a_name_that_means_two_places_is_never_a_guess() -> None:
    with pytest.raises(Refusal, match=r"^unknown_place: No place called the desk"):
        named_places.resolve("the desk", named("desk", "the desk"))


def test_the_refusal_shows_no_invisible_characters() -> None:
    with pytest.raises(Refusal, match="No place called a\ufffdb\ufffdc"):
        named_places.resolve("a\u202eb\x1bc", named("kitchen"))
