"""Where a viewer's camera is put, when it is left alone, and what a click means: the state machine and its events."""

from __future__ import annotations

import math

import pytest

from backend.bridge.scene.drawing.camera_views import TYPICAL_ASPECT, View, follow_view, map_view, top_view
from backend.bridge.scene.viewers import picking
from backend.bridge.scene.viewers.viewer_camera import SETTLING_SECONDS, CameraReport, ViewerCamera
from backend.bridge.scene.viser_internals import Click
from backend.telemetry import Place, Pose

EXTENT = (0.0, 0.0, 24.0, 14.0)
ROBOT = Pose(5.0, 6.0, 0.5)
ORIGIN = View((3.0, 3.0, 3.0), (0.0, 0.0, 0.0))
"""Where viser's page begins."""
ELSEWHERE = View((4.0, 4.0, 4.0), (5.0, 5.0, 0.0))
LATER = SETTLING_SECONDS + 1.0


def opened(view: View = ORIGIN, aspect: float = 1.5) -> ViewerCamera:
    """A camera whose page has reported where it stands, at the time 0."""
    camera = ViewerCamera(EXTENT, ROBOT)
    put = camera.reported(CameraReport(view, aspect), 0.0)
    if put is not None:
        assert camera.reported(CameraReport(put, aspect), 0.1) is None
    return camera


def test_a_page_that_opens_is_shown_the_whole_map_in_its_own_shape():
    for begin in (ORIGIN, map_view(EXTENT, TYPICAL_ASPECT)):
        camera = ViewerCamera(EXTENT, ROBOT)
        assert camera.reported(CameraReport(begin, 0.6), 0.0) == map_view(EXTENT, 0.6)
        assert camera.view == "map"


def test_a_page_that_connects_again_stands_where_its_viewer_left_it():
    camera = opened(ELSEWHERE)
    assert camera.view == "free"
    assert camera.robot_moved(Pose(7, 7, 0), 9.0) is None
    assert camera.map_changed((0, 0, 5, 5)) is None


def test_a_page_of_before_a_restart_of_the_bridge_is_recognised():
    mine = map_view(EXTENT, 1.5)
    assert opened(mine).view == "map"
    camera = ViewerCamera((-5.0, -5.0, 5.0, 5.0), None)  # no map yet
    assert camera.reported(CameraReport(mine, 1.5), 0.0) is None
    assert camera.view == "free"
    assert camera.map_changed(EXTENT) is None  # it stands there already
    assert camera.view == "map"


def test_a_page_that_was_moved_since_it_opened_is_not_recognised_any_more():
    mine = CameraReport(map_view(EXTENT, 1.5), 1.5)
    for move in (
        lambda camera: camera.moved_by_hand(),
        lambda camera: camera.reported(CameraReport(ELSEWHERE, 1.5), LATER),
    ):
        camera = ViewerCamera((-5.0, -5.0, 5.0, 5.0), None)  # no map yet
        camera.reported(mine, 0.0)
        move(camera)
        assert camera.map_changed(EXTENT) is None
        assert camera.reported(mine, LATER + 1) is None
        assert camera.view == "free"


@pytest.mark.parametrize("view", ["map", "top", "follow"])
def test_a_camera_taken_in_hand_stays_free_although_it_stands_where_the_whole_map_is_seen(view):
    camera = opened()
    camera.choose(view, 0.2)
    camera.moved_by_hand()
    for now in (0.3, LATER, LATER + 1):  # a report that was on its way, and a viewer who put it back by hand
        assert camera.reported(CameraReport(map_view(EXTENT, 1.5), 1.5), now) is None
        assert camera.view == "free"
    assert camera.map_changed((0.0, 0.0, 9.0, 9.0)) is None


def test_a_camera_taken_in_hand_stays_free_when_its_page_connects_again():
    camera = opened()
    camera.moved_by_hand()
    camera.page_closed()
    assert camera.reported(CameraReport(map_view(EXTENT, 1.5), 1.5), LATER) is None
    assert camera.view == "free"


def test_a_page_of_before_a_restart_is_recognised_although_it_connects_twice_before_there_is_a_map():
    camera = ViewerCamera((-5.0, -5.0, 5.0, 5.0), None)
    camera.reported(CameraReport(map_view(EXTENT, 1.5), 1.5), 0.0)
    camera.page_closed()
    camera.reported(CameraReport(map_view(EXTENT, 1.5), 1.5), 1.0)
    camera.map_changed(EXTENT)
    assert camera.view == "map"


def test_the_reports_of_pages_do_not_compute_the_same_view_again():
    moved, still = opened(), opened()
    moved.moved_by_hand()
    before = map_view.cache_info().misses
    for i in range(100):
        moved.reported(CameraReport(View((i, 4.0, 4.0), (5.0, 5.0, 0.0)), 1.5), LATER + i)
        still.reported(CameraReport(map_view(EXTENT, 1.5), 1.5), LATER + i)
    assert map_view.cache_info().misses <= before + 2
    assert (moved.view, still.view) == ("free", "map")


def test_a_pane_that_changes_its_shape_sees_the_whole_map_again():
    camera = opened()
    assert camera.reported(CameraReport(map_view(EXTENT, 1.5), 0.7), LATER) == map_view(EXTENT, 0.7)


def test_the_initial_view_that_a_slow_page_applies_late_is_not_its_viewers_choice():
    camera = opened()
    late = CameraReport(map_view(EXTENT, TYPICAL_ASPECT), 1.5)
    assert camera.reported(late, LATER) == map_view(EXTENT, 1.5)
    assert camera.view == "map"


@pytest.mark.parametrize("view", ["map", "top", "follow"])
def test_a_camera_that_its_viewer_has_moved_is_not_moved_again(view):
    camera = opened()
    camera.choose(view, 0.2)
    assert camera.reported(CameraReport(ELSEWHERE, 1.5), LATER) is None
    assert camera.view == "free"
    assert camera.robot_moved(Pose(9, 9, 0), LATER + 1) is None
    assert camera.reported(CameraReport(ELSEWHERE, 0.5), LATER + 1) is None
    assert camera.map_changed((0, 0, 9, 9)) is None


def test_a_viewer_who_takes_the_camera_in_hand_is_free_at_once():
    camera = opened()
    camera.choose("follow", 0.2)
    camera.moved_by_hand()
    assert camera.view == "free"
    assert camera.robot_moved(Pose(9, 9, 0), 0.3) is None


def test_each_view_stands_where_it_says():
    camera = opened()
    assert camera.choose("top", 1.0) == top_view(EXTENT, 1.5)
    assert camera.choose("follow", 2.0) == follow_view(ROBOT, 1.5)
    assert camera.choose("map", 3.0) == map_view(EXTENT, 1.5)
    assert camera.choose("map", 4.0) == map_view(EXTENT, 1.5)  # asked for again: put there again


def test_a_wish_brings_a_freed_camera_back_although_old_reports_are_on_their_way():
    camera = opened(ELSEWHERE)
    assert camera.choose("map", 5.0) == map_view(EXTENT, 1.5)
    camera.reported(CameraReport(ELSEWHERE, 1.5), 5.1)
    assert camera.view == "map"


def test_a_wish_before_the_page_opens_counts_when_it_opens():
    camera = ViewerCamera(EXTENT, ROBOT)
    assert camera.choose("follow", 0.0) is None
    assert camera.reported(CameraReport(ELSEWHERE, 1.5), 3.0) == follow_view(ROBOT, 1.5)


def test_following_goes_on_while_the_page_echoes_where_it_was_put():
    camera = opened()
    put = [camera.choose("follow", 1.0)]
    for step in range(1, 200):
        now = 1.0 + step * 0.05
        put.append(camera.robot_moved(Pose(5.0 + step * 0.03, 6.0, 0.5), now))
        late = put[max(0, step - 20)]  # a second behind
        assert camera.reported(CameraReport(late, 1.5), now) is None
    assert camera.view == "follow"
    assert put[-1].look_at[0] - put[1].look_at[0] == pytest.approx(198 * 0.03)


def test_following_a_robot_that_stands_costs_nothing():
    camera = opened()
    camera.choose("follow", 1.0)
    assert [camera.robot_moved(ROBOT, 1.0 + i * 0.05) for i in range(20)] == [None] * 20


def test_the_camera_turns_calmly_with_the_robot_and_the_short_way():
    camera = opened()
    camera.robot_moved(Pose(0, 0, 3.0), 1.0)
    camera.choose("follow", 1.0)

    def heading(view: View) -> float:
        return math.atan2(view.look_at[1] - view.position[1], view.look_at[0] - view.position[0])

    before, turned = 3.0, 0.0
    for i in range(1, 100):
        view = camera.robot_moved(Pose(0, 0, -3.0), 1.0 + i * 0.05)
        if view is None:
            break
        step = math.remainder(heading(view) - before, math.tau)
        assert 0.0 <= step < 0.1
        before, turned = heading(view), turned + step
    assert turned == pytest.approx(math.tau - 6.0, abs=0.01)


def test_a_robot_that_is_set_down_elsewhere_is_followed_there_at_once():
    camera = opened()
    camera.choose("follow", 1.0)
    assert camera.robot_moved(Pose(20, 3, -2.0), 1.05) == follow_view(Pose(20, 3, -2.0), 1.5)


def test_without_a_robot_there_is_nothing_to_follow_until_it_comes():
    camera = ViewerCamera(EXTENT, None)
    camera.reported(CameraReport(ORIGIN, 1.5), 0.0)
    assert camera.choose("follow", 0.5) is None
    assert camera.robot_moved(ROBOT, 1.0) == follow_view(ROBOT, 1.5)


@pytest.mark.parametrize("aspect", [0.4, 1.0, 2.5])
def test_whoever_follows_sees_the_robot_from_behind_and_above(aspect):
    view = follow_view(Pose(5.0, 6.0, math.pi / 2), aspect)
    assert view.position[0] == pytest.approx(5.0)
    assert view.position[1] < 6.0 < view.look_at[1]
    assert view.position[2] > 2.0


PLACES = [Place("k", "kitchen", "space", Pose(4.0, 8.0, 0.0)), Place("l", "lab", "space", Pose(4.0, 5.5, 0.0))]


def test_a_click_means_the_point_of_the_floor_below_it():
    assert picking.floor_point(Click((2.0, 3.0, 10.0), (0.1, 0.2, -1.0)), EXTENT) == pytest.approx((3.0, 5.0))
    for miss in (((2, 3, 10), (0, 0, 1)), ((2, 3, 10), (1, 0, 0)), ((2, 3, -1), (0, 0, -1)), ((90, 3, 9), (0, 0, -1))):
        assert picking.floor_point(Click(*miss), EXTENT) is None


def test_a_click_near_a_place_or_on_its_name_means_the_place():
    assert picking.place_at((4.0, 8.9), PLACES) == "kitchen"
    assert picking.place_at((4.3, 7.1), PLACES) == "kitchen"  # its name stands there
    assert picking.place_at((4.0, 4.6), PLACES) == "lab"
    assert picking.place_at((4.0, 9.1), PLACES) is None
    assert picking.place_at((6.0, 6.0), PLACES) is None
