"""For all tests: the slowest files come first, so that two workers end together; each test has a time limit."""

from __future__ import annotations

import pytest

from tests.deep import DEEP

SLOWEST_FIRST = (
    "test_papers_session",
    "test_kiosk",
    "test_accessibility",
    "test_watchdog",
    "test_halted",
    "test_questions",
    "test_dashboard",
    "test_scene",
    "test_activity",
    "test_interleavings",
    "test_adapter",
    "test_people",
)
TIME_LIMIT_S = 1800.0 if DEEP else 180.0


def _rank(item: pytest.Item) -> int:
    name = item.path.stem
    return SLOWEST_FIRST.index(name) if name in SLOWEST_FIRST else len(SLOWEST_FIRST)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files that take long begin; the order is otherwise the random one, whose seed the first lines show."""
    items.sort(key=_rank)
    for item in items:
        if item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(TIME_LIMIT_S))
